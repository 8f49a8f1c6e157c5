"""The tables and figures of `okamura2001`, published beside ours."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from texclass.loaders import DataNotFoundError, open_dataset
from texclass.provenance import versions
from texclass.recording import Samples
from texclass.reporting.reproductions import _okamura2001_figures as figures
from texclass.reporting.reproductions._okamura2001_text import KEY, markdown
from texclass.textures.okamura2001.factorial import EFFECTS
from texclass.textures.okamura2001.study import Study, study

CHANNEL = 1
"""Of `taps5`: the second, whose swing the converter cuts least."""


def reproduce(out: Path, *, seed: int = 0) -> list[Path]:
    """Write the report, its numbers and its figures into a folder, and return the files.

    Parameters
    ----------
    out : Path
    seed : int
        Of simulated taps, raters and users.
    """
    taps, digest = _real()
    result = study(taps=taps, seed=seed)
    out.mkdir(parents=True, exist_ok=True)
    text, numbers = out / f"{KEY}.md", out / f"{KEY}.json"
    found = document(result, seed, digest)
    text.write_text(markdown(result, found), encoding="utf-8")
    numbers.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return [text, numbers, *figures.draw(result, out)]


def document(result: Study, seed: int, digest: str) -> dict[str, Any]:
    """Return what goes into the JSON."""
    test = result.identification
    return {
        "key": KEY,
        "versions": versions("numpy", "scipy", "numba", "matplotlib"),
        "seed": seed,
        "input_hash": {"taps5": digest} if digest else {},
        "recovery_percent": {
            f"velocity known to {e:.0%}": {
                m: {
                    "largest": (100 * np.abs(errors).max(axis=0)).round(3).tolist(),
                    "95 %": (100 * np.quantile(np.abs(errors), 0.95, axis=0)).round(3).tolist(),
                    "r_squared": round(one.r_squared[m], 4),
                }
                for m, errors in one.errors.items()
            }
            for e, one in result.recovery.items()
        },
        "scaled": {m: [t.amplitude_slope, t.decay_per_s, t.frequency_hz] for m, t in result.scaled.items()},
        "factorial": {
            m: {name: [r.effect[name], r.f_value[name], r.p_value[name]] for name in EFFECTS}
            for m, r in result.factorial.items()
        },
        "factor_found": result.factor_found,
        "identification": {
            "noise_nepers": result.noise,
            "confusion": test.confusion.tolist(),
            "correct": test.n_correct,
            "experiments": len(test.answers),
            "interval": test.interval,
            "confusion_of_20000": result.long_run.round(4).tolist(),
        },
        "taps5": {
            m: {
                "n": int(r.decay.size),
                "decay_per_sample": _middle(r.decay),
                "cycles_per_sample": _middle(r.frequency),
                "explained": _middle(r.explained),
            }
            for m, r in result.real.items()
        },
    }


def _middle(values: Samples) -> list[float]:
    """Return the quartiles."""
    return [round(float(q), 5) for q in np.nanquantile(values, [0.25, 0.5, 0.75])]


def _real() -> tuple[dict[str, list[Samples]], str]:
    """Return the taps of `taps5` by material, if they are there."""
    try:
        dataset = open_dataset("taps5")
    except DataNotFoundError:
        return {}, ""
    taps: dict[str, list[Samples]] = {}
    for entry in dataset.entries:
        taps.setdefault(entry.material, []).append(dataset.load(entry).acceleration[:, CHANNEL])
    return taps, dataset.input_hash
