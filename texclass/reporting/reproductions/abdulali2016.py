"""Figures 2(b), 4 and 5 of `abdulali2016` and what the text says of them, beside ours."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from texclass.loaders import DataNotFoundError, open_dataset
from texclass.provenance import versions
from texclass.recording import Samples
from texclass.reporting.reproductions import _abdulali2016_figures as figures
from texclass.reporting.reproductions._abdulali2016_text import KEY, Study, markdown
from texclass.textures.abdulali2016 import bake, condition, cross_validate, model_scan, simulate_scan, surface
from texclass.textures.abdulali2016 import study as studies
from texclass.textures.abdulali2016.fitting import segment_enough
from texclass.textures.abdulali2016.simulated import SURFACES
from texclass.textures.abdulali2016.study import FS, SurfaceScores
from texclass.textures.abdulali2016.timing import RenderTime, time_fit, time_rendering
from texclass.textures.scan import Scan

N_SEEDS = 50
SPECTRA = ("S3", "S1", "S7")


def reproduce(out: Path, *, seed: int = 0) -> list[Path]:
    """Write the report, its numbers and its figures into a folder, and return the files.

    Parameters
    ----------
    out : Path
    seed : int
        Of motions, vibrations and rendered noise.
    """
    with threadpool_limits(1):  # matrices are small: threads would wait for each other
        result = run(seed)
    out.mkdir(parents=True, exist_ok=True)
    text, numbers = out / f"{KEY}.md", out / f"{KEY}.json"
    text.write_text(markdown(result), encoding="utf-8")
    described = asdict(result) | {"versions": versions("numpy", "scipy", "scikit-learn", "numba")}
    numbers.write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
    return [text, numbers, *draw(result, out)]


def run(seed: int) -> Study:
    """Compute what the report says."""
    real, input_hash = _real()
    runs = [studies.study_held_out(SURFACES[i % len(SURFACES)], seed + i) for i in range(N_SEEDS)]
    sparse = np.mean([studies.study_sparsity(each, seed) for each in SURFACES], axis=0)
    return Study(
        seed,
        [studies.study_surface(each, seed) for each in SURFACES],
        real,
        {kept: [one[kept] for one in runs] for kept in ("speed", "force", "direction")},
        [(float(tau), float(n), float(gfc)) for tau, n, gfc in sparse],
        [time_fit(fs, order) for fs in (1000.0, 10_000.0) for order in (20, 400)],
        _renders(seed),
        input_hash,
    )


def _real() -> tuple[list[SurfaceScores], str]:
    """Train on the first and validate on the second half of each recording of `stylus6`, if it is there."""
    try:
        dataset = open_dataset("stylus6")
        scans = [condition(Scan.from_recording(dataset.load(entry))) for entry in dataset.entries]
    except (DataNotFoundError, FileNotFoundError):
        return [], ""
    halves = [(scan.part(0, len(scan) // 2), scan.part(len(scan) // 2, len(scan))) for scan in scans]
    return [studies.study_scans(a, b, isotropic=True) for a, b in halves], dataset.input_hash


def _renders(seed: int) -> list[RenderTime]:
    training = simulate_scan(surface("S2"), 20.0, FS, np.random.default_rng(seed))
    times = []
    for order in (20, 400):
        network = model_scan(training, order=order).network()
        times += [time_rendering(network, n_steps=4000), time_rendering(bake(network, "S2"))]
    return times


def draw(result: Study, out: Path) -> list[Path]:
    """Draw the figures into a folder."""
    scan = simulate_scan(surface("S3"), 10.0, FS, np.random.default_rng(result.seed))
    training = simulate_scan(surface("S3"), 20.0, FS, np.random.default_rng(result.seed))
    pictures: dict[str, Callable[[], Any]] = {
        "fig2b": lambda: figures.draw_segments(scan, segment_enough(scan)),
        "fig4": lambda: figures.draw_input_space(model_scan(training)),
        "fig5a": lambda: figures.draw_scores(result.simulated),
        "fig5bcd": lambda: figures.draw_spectra(_spectra(result.seed), FS),
        "held-out": lambda: figures.draw_held_out({k: np.array(v) for k, v in result.held_out.items()}),
    }
    if result.real:
        pictures["stylus6"] = lambda: figures.draw_scores(result.real)
    paths = []
    for name, picture in pictures.items():
        paths.append(out / f"{KEY}-{name}.png")
        picture().savefig(paths[-1], dpi=130)
    return paths


def _spectra(seed: int) -> dict[str, tuple[Samples, Samples]]:
    """Return recorded and rendered vibration of the surfaces the paper shows."""
    pairs = {}
    for name in SPECTRA:
        rng = np.random.default_rng(seed)
        training, validation = (simulate_scan(surface(name), s, FS, rng) for s in (20.0, 10.0))
        rendered = cross_validate(model_scan(training).network(), validation, seed=seed).rendered
        pairs[name] = validation.acceleration, rendered
    return pairs
