"""What a rendered sample of `guruswamy2011` costs: blocks of one sample, many features, the worst case.

Run it by hand from the project's root: `python tests/benchmarks/guruswamy_speed.py`. It writes
reports/studies/guruswamy_speed.json and .md. One thread. Times are those of single calls, wall clock: what a
loaded machine adds shows in the highest ones. The reference, one call of `scipy.signal.sosfilt` with 8
sections and their state on one sample, takes turns with the renderers.
"""

# ruff: noqa: E402  (the number of threads is set before numpy reads it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import hashlib
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import signal

from texclass.provenance import versions
from texclass.textures.guruswamy2011 import SpatialTexture, fit_texture
from texclass.textures.guruswamy2011.texture import N_RINGING

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "examples" / "papers"))

from guruswamy2011_objects import OBJECTS, lay_out, simulate_scan

SEED, FS, RUN_S = 0, 1000.0, 60.0
COPIES = (1, 100, 10_000)
MODES = ("frequency_hz", "decay_per_s", "amplitude", "phase")
QUANTILES = (50.0, 99.0, 99.9, 100.0)


def fitted() -> tuple[list[SpatialTexture], list[float]]:
    """Fit each object to 5 s at 1 kHz; return the textures and the seconds of each fit."""
    textures, seconds = [], []
    for i, thing in enumerate(OBJECTS):
        rng = np.random.default_rng([SEED, i])
        scan = simulate_scan(thing, lay_out(thing, 5 * thing.speed, rng), rng, fs=FS)
        start = time.perf_counter()
        textures.append(fit_texture(scan, thing.law).texture)
        seconds.append(time.perf_counter() - start)
    return textures, seconds


def repeated(texture: SpatialTexture, copies: int) -> SpatialTexture:
    """Return a surface with that many times the features, as far apart as before."""
    turns = np.arange(copies)[:, np.newaxis]
    return replace(
        texture,
        length_mm=texture.length_mm * copies,
        position_mm=(texture.position_mm + texture.length_mm * turns).ravel(),
        feature=(texture.feature + texture.n_features * turns).ravel(),
        **{name: np.tile(getattr(texture, name), copies) for name in MODES},
    )


def worst(texture: SpatialTexture) -> SpatialTexture:
    """Return a surface of which four features of 12 modes are struck at every sample and none soon ends."""
    n, k = 2000, 12
    rng = np.random.default_rng(SEED)
    return replace(
        texture, length_mm=n * 0.1, position_mm=0.1 * np.arange(n), feature=np.repeat(np.arange(n), k),
        frequency_hz=rng.uniform(10, 400, n * k), decay_per_s=np.full(n * k, 14.0),
        amplitude=texture.peak * rng.uniform(0.5, 1, n * k), phase=np.zeros(n * k),
    )  # fmt: skip


def timed(calls: dict[str, Callable[[], object]], n: int) -> dict[str, list[float]]:
    """Time each call n times, in turns; return microseconds at the quantiles."""
    found = {name: np.empty(n) for name in calls}
    for i in range(n):
        for name, call in calls.items():
            start = time.perf_counter_ns()
            call()
            found[name][i] = time.perf_counter_ns() - start
    return {name: [float(q) for q in np.percentile(ns / 1000, QUANTILES)] for name, ns in found.items()}


def stroking(texture: SpatialTexture, speed: float) -> Callable[[], object]:
    """Return a call that renders the next sample of a stroke."""
    renderer = texture.renderer()
    v, f = np.array([[speed, 0.0]]), np.array([0.5])
    for _ in range(2000):
        renderer.process(v, f)
    return lambda: renderer.process(v, f)


def contacts(textures: list[SpatialTexture], speed: float) -> Callable[[], object]:
    """Return a call that renders the next sample of four contacts."""
    each = [stroking(texture, speed) for texture in textures[:4]]
    return lambda: [call() for call in each]


def reference() -> Callable[[], object]:
    """Return one sample through 8 sections."""
    sos = signal.butter(8, (0.05, 0.3), "bandpass", output="sos")
    state = [np.zeros((len(sos), 2))]
    x = np.ones(1)

    def call() -> None:
        _, state[0] = signal.sosfilt(sos, x, zi=state[0])

    return call


def main() -> None:
    """Measure and write."""
    textures, fit_s = fitted()
    calls: dict[str, Callable[[], object]] = {"reference: sosfilt, 8 sections": reference()}
    for copies in COPIES:
        surface = repeated(textures[4], copies)
        calls[f"SP 80, {surface.n_features} features, 100 mm/s"] = stroking(surface, 100.0)
    calls["four contacts, 100 mm/s"] = contacts(textures, 100.0)
    calls["worst case: all places ringing, 48 modes struck a sample"] = stroking(worst(textures[4]), 1000.0)
    found = timed(calls, int(RUN_S * FS))
    digest = hashlib.sha256(b"".join(t.position_mm.tobytes() + t.amplitude.tobytes() for t in textures))
    result = {
        "quantiles": QUANTILES, "microseconds": found, "places": N_RINGING, "fit_seconds": fit_s,
        "seed": SEED,
        "operations": {t.name: t.operations for t in textures}, "input_hash": digest.hexdigest(),
        "versions": versions("numpy", "scipy", "numba"),
    }  # fmt: skip
    (ROOT / "reports/studies/guruswamy_speed.json").write_text(
        json.dumps(result, indent=1) + "\n", encoding="utf-8"
    )
    (ROOT / "reports/studies/guruswamy_speed.md").write_text(report(result), encoding="utf-8")
    print(report(result))


def report(result: dict) -> str:
    """Return the table."""
    found = result["microseconds"]
    base = next(iter(found.values()))[0]
    lines = [
        "# Rendering `guruswamy2011`: microseconds per sample\n",
        f"{RUN_S:g} s of calls of one sample each at {FS:g} Hz, one thread, wall clock. A full pool holds "
        f"{result['places']} modes. Ratio: median to that of the reference.\n",
        "| what | median | 99 % | 99.9 % | highest | ratio |", "|---|---|---|---|---|---|",
    ]  # fmt: skip
    for name, row in found.items():
        lines.append(f"| {name} | " + " | ".join(f"{q:.1f}" for q in row) + f" | {row[0] / base:.2f} |")
    fits = ", ".join(f"{seconds:.2g}" for seconds in result["fit_seconds"])
    lines += [
        f"\nFitting 5 s of each of the five objects: {fits} s (the first with what it compiles or loads)."
    ]
    told = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    lines += [f"\n{told}; seed {result['seed']}, input {result['input_hash'][:12]}."]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
