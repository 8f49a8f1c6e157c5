"""The tables and figures of `oeztuerk2018`, published beside ours."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from texclass.loaders import DataNotFoundError, open_dataset
from texclass.provenance import versions
from texclass.recording import Samples
from texclass.reporting.reproductions import _oeztuerk2018_figures as figures
from texclass.reporting.reproductions._oeztuerk2018_text import KEY, markdown
from texclass.textures.oeztuerk2018 import displayed_signals, fit_frequencies, write_wav
from texclass.textures.oeztuerk2018.prediction import mean_scores
from texclass.textures.oeztuerk2018.study import SPEEDS_MM_S, Study, simulated_plates, study

FS = 10_000.0
SHOWN_ORDERS = (0, 1, 2, 5, 10, 20, 50, 100, 200, 400, 700, 1000)
OAK_FRICTION = 0.2


def reproduce(out: Path, *, seed: int = 0) -> list[Path]:
    """Write the report, its numbers, figures and a sound into a folder, and return the files.

    Parameters
    ----------
    out : Path
    seed : int
        Of surfaces, speeds and noise that are simulated.
    """
    excerpts, digest = _real("lmt_excerpts")
    by_session, fabric_digest = _real("fabric_speeds")
    fabrics: dict[str, list[Samples]] = {}
    for name, x in by_session.items():
        fabrics.setdefault(name.rpartition("_")[0], []).append(x)
    result = study(excerpts=excerpts, fabrics=fabrics, fs=FS, seed=seed)
    found = document(result, seed, {"lmt_excerpts": digest, "fabric_speeds": fabric_digest})
    lengths = [[x.size / FS for x in four] for four in fabrics.values()]
    found["fabric_seconds"] = np.median(lengths, axis=0).round(2).tolist() if lengths else []
    out.mkdir(parents=True, exist_ok=True)
    text, numbers = out / f"{KEY}.md", out / f"{KEY}.json"
    text.write_text(markdown(result, found), encoding="utf-8")
    numbers.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    plates = simulated_plates(seed)
    wood = next((name for name in plates if name.startswith("wood")), next(iter(plates)))
    pictures = figures.draw(result, excerpts, {**plates, **fabrics}, wood, out, seed)
    return [text, numbers, *pictures, _sound(plates[wood], wood, out)]


def document(result: Study, seed: int, digests: dict[str, str]) -> dict[str, Any]:
    """Return what goes into the JSON."""
    return {
        "key": KEY,
        "versions": versions("numpy", "scipy", "numba", "matplotlib"),
        "seed": seed,
        "input_hash": {name: digest for name, digest in digests.items() if digest},
        "orders": {
            name: {
                "error": {m: round(float(o.curve[m]), 4) for m in SHOWN_ORDERS},
                "other half": {m: round(float(o.other_half[m]), 4) for m in SHOWN_ORDERS},
                "aicc": o.aicc,
                "little": o.little,
                "at most 0.4": o.at_most,
            }
            for name, o in result.orders.items()
        },
        "frequencies": {
            name: {
                "gfc": c.gfc.round(4).tolist(),
                "0.8": c.fair,
                "0.9": c.good,
                "left out as beating": c.too_close,
                "least margin (Hz)": c.least_margin_hz,
            }
            for name, c in result.counts.items()
        },
        "intervals": {
            str(r.friction): {
                "published": r.published,
                "simulated": np.bincount(r.found).tolist(),
                "mean speed (mm/s)": round(r.mean_mm_s, 2),
            }
            for r in result.intervals
        },
        "predictions": {
            kind: {
                "mean": {way: asdict(s) for way, s in mean_scores(found).items()},
                "each": [asdict(p) for p in found],
            }
            for kind, found in (("fabric_speeds", result.real), ("simulated", result.simulated))
            if found
        },
        "rendering": [asdict(r) for r in result.rendering],
        "jump_at_joins": result.jump_at_joins,
        "thresholds_agree": result.thresholds_agree,
    }


def _real(card: str) -> tuple[dict[str, Samples], str]:
    """Return the recordings of a card without their means, if they are there."""
    try:
        dataset = open_dataset(card)
    except DataNotFoundError:
        return {}, ""
    signals = {e.recording_id: np.ravel(dataset.load(e).acceleration) for e in dataset.entries}
    return {name: x - x.mean() for name, x in signals.items()}, dataset.input_hash


def _sound(signals: list[Samples], name: str, out: Path) -> Path:
    """Write the signal displayed in the middle interval of a simulated surface."""
    texture = fit_frequencies(signals, SPEEDS_MM_S, FS, name=name)
    shown = displayed_signals(texture, OAK_FRICTION)
    path = out / f"{KEY}-between.wav"
    write_wav(path, shown.signals[2], FS, sample_format="PCM_16")
    return path
