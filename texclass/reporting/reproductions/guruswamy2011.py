"""Tables I to III and figures 4 to 12 of `guruswamy2011`, beside ours."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from texclass.loaders import DataNotFoundError, open_dataset
from texclass.provenance import versions
from texclass.recording import Recording, Samples
from texclass.reporting.reproductions import _guruswamy2011_figures as figures
from texclass.reporting.reproductions._guruswamy2011_result import Study
from texclass.reporting.reproductions._guruswamy2011_text import markdown
from texclass.textures.guruswamy2011 import study as studies
from texclass.textures.guruswamy2011.comparison import SpeedPair, at_speeds, random_paths
from texclass.textures.guruswamy2011.fit import FittedScan, fit_texture
from texclass.textures.guruswamy2011.level import LevelFit, fit_level_law
from texclass.textures.guruswamy2011.orders import OrderFit, fits_by_order
from texclass.textures.guruswamy2011.profile import RESOLUTION, profile_of
from texclass.textures.guruswamy2011.recorded import Excerpt, HeldOut, cleaned, excerpt, held_out
from texclass.textures.guruswamy2011.simulated import OBJECTS
from texclass.textures.guruswamy2011.study import Recovery
from texclass.textures.guruswamy2011.texture import SpatialTexture
from texclass.textures.scan import Scan

KEY = "guruswamy2011"
N_TRIALS = 50
N_LOOSE = 10
SHOWN = "Rubber mat"
SEGMENT = 10
"""Of the rubber mat, as in figures 4 and 5."""


def reproduce(out: Path, *, seed: int = 0) -> list[Path]:
    """Write the report, its numbers and its figures into a folder, and return the files.

    Parameters
    ----------
    out : Path
    seed : int
        Of surfaces, hands and sensors.
    """
    out.mkdir(parents=True, exist_ok=True)
    result, pictures = run(seed)
    text, numbers = out / f"{KEY}.md", out / f"{KEY}.json"
    text.write_text(markdown(result), encoding="utf-8")
    numbers.write_text(json.dumps(asdict(result), indent=1, default=float) + "\n", encoding="utf-8")
    paths = [text, numbers]
    for name, draw in pictures.items():
        paths.append(out / f"{KEY}-{name}.png")
        draw().savefig(paths[-1], dpi=120)
    return paths


def run(seed: int, *, n_trials: int = N_TRIALS) -> tuple[Study, Mapping[str, Callable[[], Any]]]:
    """Compute what the report says; return it with the figures, not drawn yet."""
    stream = studies.stream
    scans = {o.name: studies.repeated_scans(o, stream(seed, 1, i)) for i, o in enumerate(OBJECTS)}
    fitted = {o.name: fit_texture(scans[o.name][0], o.law) for o in OBJECTS}
    orders = fits_by_order(_segment(fitted[SHOWN]), fitted[SHOWN].scan.fs, RESOLUTION)
    laws = {
        o.name: fit_level_law(studies.level_scans(o, stream(seed, 2, i)), o.law.k_c)
        for i, o in enumerate(OBJECTS)
    }
    free = {
        o.name: fit_level_law(studies.level_scans(o, stream(seed, 3, i), force_spread=0.5)).law
        for i, o in enumerate(OBJECTS)
    }
    recovered = studies.recoveries(seed, n_trials)
    loose = studies.recoveries(seed + 500, N_LOOSE, repeatability=0.03)
    speeds = {o.name: at_speeds(o, stream(seed, 4, i)) for i, o in enumerate(OBJECTS)}
    real, excerpts, hashes = _real()
    result = Study(
        seed=seed,
        n_trials=n_trials,
        scans={o.name: [studies.published_row(s, o.law) for s in scans[o.name]] for o in OBJECTS},
        modes={o.name: studies.modes_row(fitted[o.name], o.law) for o in OBJECTS},
        zero_phase={name: _zero_phase_density(each) for name, each in fitted.items()},
        orders=[(f.method, f.order, f.pole_radius, f.error) for f in orders],
        laws={name: (fit.law, fit.r_squared) for name, fit in laws.items()},
        force_laws=free,
        recovery={each.name: each.summary() for each in recovered},
        recovery_loose={each.name: each.summary() for each in loose},
        speeds={name: [_row(pair) for pair in pairs] for name, (_, pairs) in speeds.items()},
        paths=random_paths([texture for texture, _ in speeds.values()], stream(seed, 5)),
        held_out=real,
        excerpts=excerpts,
        input_hash={"simulated": _hash(scans), **hashes},
        versions=versions("numpy", "scipy", "numba"),
    )
    return result, _pictures(fitted, orders, laws, recovered, speeds)


def _pictures(
    fitted: Mapping[str, FittedScan],
    orders: list[OrderFit],
    laws: Mapping[str, LevelFit],
    recovered: list[Recovery],
    speeds: Mapping[str, tuple[SpatialTexture, list[SpeedPair]]],
) -> Mapping[str, Callable[[], Any]]:
    return {
        "recovery": lambda: figures.draw_recovery(recovered),
        "fig4": lambda: figures.draw_orders(_segment(fitted[SHOWN]), orders, fitted[SHOWN].scan.fs),
        "fig5": lambda: figures.draw_segmentation(fitted[SHOWN], SEGMENT),
        "fig6-7": lambda: figures.draw_spectra(fitted),
        "fig8-9": lambda: figures.draw_textures(fitted),
        "fig10": lambda: figures.draw_laws({name: laws[name] for name in (SHOWN, "SP 80 grit")}),
        "fig11": lambda: figures.draw_speeds(SHOWN, speeds[SHOWN][1]),
        "fig12": lambda: figures.draw_speeds("SP 80 grit", speeds["SP 80 grit"][1]),
    }


def _segment(fitted: FittedScan) -> Samples:
    return fitted.profile.segmentation.pieces(fitted.profile.samples)[SEGMENT]


def _zero_phase_density(fitted: FittedScan) -> float:
    profile = profile_of(fitted.normalised, fitted.scan.fs, phase="zero")
    return float(profile.segmentation.n_segments / fitted.scan.distance_mm[-1])


def _row(pair: SpeedPair) -> tuple[float, float, float, float]:
    return float(pair.scan.speed.mean()), pair.fit, pair.level, pair.level_printed


def _real() -> tuple[list[HeldOut], list[Excerpt], dict[str, str]]:
    """Return what the recordings of others give; nothing where they are absent."""
    try:
        stylus, lmt = open_dataset("stylus6"), open_dataset("lmt_excerpts")
    except (DataNotFoundError, FileNotFoundError):
        return [], [], {}
    halves = [held_out(cleaned(Scan.from_recording(recording))) for recording in stylus]
    return (
        halves,
        [_half_second(recording) for recording in lmt],
        {"stylus6": stylus.input_hash, "lmt_excerpts": lmt.input_hash},
    )


def _half_second(recording: Recording) -> Excerpt:
    a = np.asarray(recording.acceleration)[: int(recording.fs / 2)]
    one_axis = a if a.ndim == 1 else a[:, 0]
    return excerpt(one_axis, recording.fs, recording.material or recording.recording_id)


def _hash(scans: Mapping[str, list[Scan]]) -> str:
    digest = hashlib.sha256()
    for each in scans.values():
        for scan in each:
            digest.update(scan.acceleration.tobytes() + scan.position.tobytes() + scan.force.tobytes())
    return digest.hexdigest()
