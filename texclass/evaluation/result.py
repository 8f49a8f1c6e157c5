"""Values of results that several documents share: best rows, names, facts of a dataset, an example."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from texclass.evaluation.accuracy import LEAST_CLUSTERS
from texclass.evaluation.windows import asked, parents
from texclass.recording import Recording, Samples
from texclass.reporting.wording import counted

if TYPE_CHECKING:
    import pandas as pd

    from texclass.loaders.dataset import Dataset

COMPUTED_BY = ("recording", "signals", "phases", "features", "vibration", "classifiers", "evaluation")
"""Subpackages and modules on whose code results depend."""

CLASSIFIER_TITLES = {
    "naive_bayes": "Naive Bayes",
    "lda": "LDA",
    "shrinkage_lda": "Shrinkage LDA",
    "euclidean": "Euclidean",
    "nearest_neighbour": "Nearest neighbour",
}
CHOICE = "nested cross-validation"
"""Name of the accuracy of nested cross-validation beside those of rows."""
FEW = 10
"""Clusters below which an accuracy above 90 % (or below 10 %) is reported with a caution."""


class Pair(NamedTuple):
    """A row of a result, a classifier that evaluated it, its accuracy, and the published one or None."""

    row: Mapping[str, Any]
    classifier: str
    accuracy: Mapping[str, Any]
    published: Any


def pairs_of(data: Mapping[str, Any]) -> list[Pair]:
    """Return every pair of row and classifier that was computed."""
    return [
        Pair(row, name, found, row.get("paper", {}).get(name))
        for row in data["rows"]
        for name, found in row["accuracy"].items()
    ]


def best_of(data: Mapping[str, Any]) -> Pair | None:
    """Return the pair of the highest accuracy, the first of equals; None if no row was computed."""
    return max(pairs_of(data), key=lambda pair: float(pair.accuracy["mean"]), default=None)


def classifier_title(name: str) -> str:
    """Return a classifier in words."""
    return CLASSIFIER_TITLES.get(name, name.replace("_", " ").capitalize())


def size(facts: Mapping[str, Any]) -> str:
    """Return how many recordings of how many surfaces a dataset has."""
    windows = f"{counted(facts['n_windows'], 'window')} of " if "n_windows" in facts else ""
    recordings, surfaces = (counted(facts[f"n_{what}s"], what) for what in ("recording", "surface"))
    return f"{windows}{recordings} of {surfaces}"


def chance_of(data: Mapping[str, Any]) -> float:
    """Return the chance level: the accuracy of always predicting the commonest surface."""
    return float(data["dataset"]["chance"])


def over(found: Mapping[str, Any]) -> str:
    """Return what the interval of an accuracy or a difference is over: " over 10 operators"."""
    return f" over {found['n_clusters']:,} {found['clusters']}s" if found.get("n_clusters") else ""


def caution(found: Mapping[str, Any]) -> str:
    """Return a caution on few or agreeing clusters, or an empty string."""
    n, what = found.get("n_clusters") or FEW, f"{found.get('clusters')}s"
    if found.get("interval", "").startswith("Wilson over"):
        why = "agree" if n >= LEAST_CLUSTERS else "are too few"
        return f"{n} {what} {why} to estimate their spread: each counts as one test in the interval."
    if n < FEW and found.get("interval", "").startswith("t over") and not 0.1 < found["mean"] < 0.9:
        return f"Near 0 or 100 % the interval of {n} {what} may be too narrow."
    return ""


def dataset_facts(data: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """Return name and facts of the dataset that a result was measured on."""
    facts = data["dataset"]
    others = ("operator", "session", "test")
    counts = [counted(facts[f"n_{what}s"], what) for what in others if facts.get(f"n_{what}s")]
    told = {
        "Dataset": facts.get("title"),
        "Size": ", ".join([size(facts), *counts]),
        "Surfaces": ", ".join(facts.get("surfaces") or ()),
        "Signals": f"{facts['fs_hz']:g} Hz, {facts['unit']}" if facts.get("fs_hz") else "",
        "Chance level": f"{100 * chance_of(data):.1f} %",
        "Source": facts.get("source"),
        "Licence": facts.get("licence"),
        "Input hash": data["input_hash"],
    }
    return facts["name"], {what: fact for what, fact in told.items() if fact}


def again_facts(data: Mapping[str, Any], pipeline: str) -> dict[str, str]:
    """Return what is needed to compute a result again; its dataset's facts have the whole hash."""
    hashed = data["input_hash"]
    told = {
        "Pipeline or features": pipeline,
        "Movement": data.get("movement", ""),
        "Protocol": data["protocol"],
        "Seed": str(data["seed"]),
        "Input hash": f"{hashed[:12]}\N{HORIZONTAL ELLIPSIS}" if len(hashed) > 12 else hashed,
        "Code": data.get("code_hash", ""),
    }
    return {what: fact for what, fact in told.items() if fact}


def measured_on(dataset: "Dataset", frame: "pd.DataFrame", like: Recording) -> dict[str, Any]:
    """Return the facts of a dataset, and how much of it is in a feature table, as plain JSON values.

    Parameters
    ----------
    dataset : Dataset
        Whose recordings, one of them `like`, the rows of `frame` are (or windows of them).
    frame : DataFrame
        Feature table.
    like : Recording
        States rate and unit.
    """
    frame = frame[asked(frame)]
    return {
        "name": dataset.name,
        "title": dataset.title,
        "n_recordings": int(parents(frame).nunique()),
        **({"n_windows": len(frame)} if "parent" in frame else {}),
        **{f"n_{of}s": int(frame[of].nunique()) for of in ("surface", "operator", "session")},
        "surfaces": list(dataset.surfaces),
        "chance": float(frame["surface"].value_counts(normalize=True).max()),
        "fs_hz": float(like.fs),
        "unit": like.unit,
        "licence": dataset.licence,
        "source": dataset.source,
        "notes": list(dataset.notes),
    }


def example_of(recording: Recording) -> dict[str, Any]:
    """Return what a picture of a recording and its phases needs, as plain JSON values.

    Parameters
    ----------
    recording : Recording
        With its phases.

    Returns
    -------
    dict
        `recording`, `surface`, `unit`, `seconds`; `low` and `high`, the outline of the signal in equal
        parts; `taps`, of each start, impact and end in s; `movement`, its start and end in s, or None.
    """
    phases, fs = recording.phases, recording.fs
    assert phases is not None
    low, high = outline(main_direction(recording), 300)
    return {
        "recording": recording.recording_id,
        "surface": recording.surface,
        "unit": recording.unit,
        "seconds": recording.duration_s,
        "low": [float(f"{x:.4g}") for x in low],
        "high": [float(f"{x:.4g}") for x in high],
        "taps": [[tap.start / fs, tap.impact / fs, tap.end / fs] for tap in phases.taps],
        "movement": phases.movement and [sample / fs for sample in phases.movement],
    }


def outline(x: Samples, n: int) -> tuple[Samples, Samples]:
    """Return least and greatest sample of about `n` equal blocks; each touches the next."""
    size = max(1, x.size // n)
    blocks = x[: x.size // size * size].reshape(-1, size)
    low, high = blocks.min(axis=1), blocks.max(axis=1)
    low[1:], high[1:] = np.minimum(low[1:], blocks[:-1, -1]), np.maximum(high[1:], blocks[:-1, -1])
    return low, high


def main_direction(recording: Recording) -> Samples:
    """Project the axes, without their means, on the direction in which they change most.

    For pictures: DFT321 mixes the phases of the axes and would blur the contact.
    """
    acceleration = recording.acceleration
    axes = acceleration.reshape(len(acceleration), -1)
    axes = axes - axes.mean(axis=0)
    if axes.shape[1] == 1:
        return np.asarray(axes[:, 0])
    lag = max(1, round(2e-3 * recording.fs))  # slow against noise, fast against gravity
    steps = axes[lag:] - axes[:-lag]
    direction = np.linalg.eigh(steps.T @ steps)[1][:, -1]
    return np.asarray(axes @ (direction * np.sign(direction[np.argmax(np.abs(direction))])))
