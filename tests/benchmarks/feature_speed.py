"""What a feature set costs: ratio to one `np.fft.rfft` of the same recording, and milliseconds per feature.

Run it by hand from the project's root: `python tests/benchmarks/feature_speed.py`. It writes
reports/feature_speed.json and .md. One thread; CPU time of that thread; the reference and the sets take turns
within each round, and medians over rounds are compared, so that a loaded machine slows all alike. The
recording has one axis and its phases are given, so nothing but features is timed.
"""

# ruff: noqa: E402  (the number of threads is set before numpy reads it)
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import platform
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pywt
import scipy

from texclass import __version__
from texclass.features import FeatureSet, load_feature_set
from texclass.features.views import Views
from texclass.recording import Phases, Recording, Tap

FS, DURATION_S = 10_000.0, 25.0
LIMITS = {"strese2015": 40.0, "strese2015 without spectral_roughness": 12.0}


def example(seed: int = 0) -> tuple[Recording, Phases]:
    """Five taps before a movement of 25 s, which is what the reference transforms."""
    rng = np.random.default_rng(seed)
    n, lead = round(DURATION_S * FS), 10_000
    stroke = np.convolve(rng.standard_normal(n), [0.25, 0.5, 0.25], "same")
    t = np.arange(1000) / FS
    tap = np.concatenate([0.2 * np.sin(np.pi * t / t[-1]), 5 * np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t)])
    acceleration = np.concatenate([1e-3 * rng.standard_normal(lead), stroke])
    taps = tuple(Tap(start, start + 1000, start + 2000) for start in range(0, lead, 2000))
    for i, each in enumerate(taps):
        acceleration[each.start : each.end] += (1 + 0.25 * i) * tap
    friction = 0.3 + 0.1 * rng.standard_normal(lead + n)
    phases = Phases(taps, (lead, lead + n))
    return Recording(acceleration, FS, "m/s^2", "speed", friction=friction, phases=phases), phases


def sets() -> dict[str, FeatureSet]:
    """The shipped sets, and the one of the paper without its most expensive feature."""
    strese, texclass = load_feature_set("strese2015"), load_feature_set("texclass")
    cheap = strese.restricted_to(name for name in strese.columns if name != "spectral_roughness")
    return {"strese2015": strese, "strese2015 without spectral_roughness": cheap, "texclass": texclass}


def fresh(recording: Recording, phases: Phases) -> Views:
    """Views that remember nothing yet, their samples conditioned."""
    views = Views(recording, phases)
    for phase in ("movement", "tap", "friction"):
        views.of(phase)
    return views


def seconds(call: Callable[[], object]) -> float:
    """CPU time of this thread."""
    start = time.thread_time()
    call()
    return time.thread_time() - start


def measure(n_rounds: int) -> dict[str, object]:
    """Return medians over rounds: the reference (ms), the ratio of each set, ms of each feature."""
    recording, phases = example()
    movement = np.ascontiguousarray(recording.acceleration[slice(*(phases.movement or (0, 0)))])
    known = sets()
    reference: list[float] = []
    total: dict[str, list[float]] = {name: [] for name in known}
    single: dict[str, dict[str, list[float]]] = {n: {m.name: [] for m in s.members} for n, s in known.items()}
    for i in range(n_rounds + 2):
        for name, feature_set in known.items():
            rfft = seconds(lambda: np.fft.rfft(movement))
            views = fresh(recording, phases)
            costs = {m.name: seconds(lambda m=m, v=views: m.values(v)) for m in feature_set.members}  # type: ignore[misc]
            if i >= 2:  # warm
                reference.append(rfft)
                total[name].append(sum(costs.values()))
                for member, cost in costs.items():
                    single[name][member].append(cost)
    rfft_ms = 1e3 * float(np.median(reference))
    return {
        "reference_ms": rfft_ms,
        "ratio": {name: 1e3 * float(np.median(values)) / rfft_ms for name, values in total.items()},
        "limit": LIMITS,
        "feature_ms": {n: {m: 1e3 * float(np.median(v)) for m, v in s.items()} for n, s in single.items()},
    }


def as_markdown(result: dict) -> str:  # type: ignore[type-arg]
    """Return the report for people."""
    what = result["input"]
    lines = [
        "# Cost of the feature sets",
        "",
        f"One recording of {what['duration_s']:g} s at {what['fs']:g} Hz, one axis, one thread, warm, median "
        f"of {result['n_rounds']} rounds. One `np.fft.rfft` of it took {result['reference_ms']:.2f} ms.",
        "",
        "| set | times one rfft | at most |",
        "|---|---|---|",
    ]
    for name, ratio in result["ratio"].items():
        lines.append(f"| {name} | {ratio:.1f} | {result['limit'].get(name, '')} |")
    for name in ("strese2015", "texclass"):
        lines += ["", f"## {name}, per feature", "", "| feature | ms | times one rfft |", "|---|---|---|"]
        for feature, cost in result["feature_ms"][name].items():
            lines.append(f"| {feature} | {cost:.2f} | {cost / result['reference_ms']:.2f} |")
    lines += [
        "",
        "A transform that several features share is counted with the first that asks for it.",
        "",
        "Versions: " + ", ".join(f"{name} {version}" for name, version in result["versions"].items()) + ".",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parents[2] / "reports")
    options = parser.parse_args()
    result = measure(options.rounds) | {
        "n_rounds": options.rounds,
        "input": {"duration_s": DURATION_S, "fs": FS, "seed": 0},
        "versions": {
            "texclass": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "PyWavelets": pywt.__version__,
        },
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "feature_speed.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (options.out / "feature_speed.md").write_text(as_markdown(result), encoding="utf-8")
    print(as_markdown(result))


if __name__ == "__main__":
    main()
