"""Facts that several documents show: best row, titles, chance level, dataset and example recording."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from texclass.evaluation.accuracy import MIN_CLUSTERS
from texclass.evaluation.windows import is_testable, parents
from texclass.loaders.dataset import label_columns
from texclass.recording import Recording, Samples
from texclass.reporting.wording import counted

if TYPE_CHECKING:
    import pandas as pd

    from texclass.loaders.dataset import Dataset

CODE_DEPENDENCIES: tuple[str, ...] = (
    "recording",
    "signals",
    "phases",
    "features",
    "vibration",
    "classifiers",
    "evaluation",
)
"""Subpackages and modules whose code determines results. Each result stores a hash of this code."""

CLASSIFIER_TITLES = {
    "naive_bayes": "Naive Bayes",
    "lda": "LDA",
    "shrinkage_lda": "Shrinkage LDA",
    "euclidean": "Euclidean",
    "nearest_neighbour": "Nearest neighbour",
}
NESTED_CV_TITLE = "nested cross-validation"
"""Name of nested cross-validation in tables of rows."""
FEW_CLUSTERS = 10
"""Number of clusters below which an accuracy above 90 % or below 10 % is reported with a warning."""


class Pair(NamedTuple):
    """Row and classifier of a result, with the measured and the published accuracy (None if unpublished)."""

    row: Mapping[str, Any]
    classifier: str
    accuracy: Mapping[str, Any]
    published: Any


def list_pairs(data: Mapping[str, Any]) -> list[Pair]:
    """Return every evaluated pair of row and classifier."""
    return [
        Pair(row, name, accuracy, row.get("paper", {}).get(name))
        for row in data["rows"]
        for name, accuracy in row["accuracy"].items()
    ]


def best_pair(data: Mapping[str, Any]) -> Pair | None:
    """Return the first pair with the highest accuracy, or None if no row could be evaluated."""
    return max(list_pairs(data), key=lambda pair: float(pair.accuracy["mean"]), default=None)


def classifier_title(name: str) -> str:
    """Return the title of a classifier, for example "Shrinkage LDA" for "shrinkage_lda"."""
    return CLASSIFIER_TITLES.get(name, name.replace("_", " ").capitalize())


def dataset_size(facts: Mapping[str, Any]) -> str:
    """Return the size of a dataset as text, for example "120 recordings of 24 surfaces"."""
    windows = f"{counted(facts['n_windows'], 'window')} of " if "n_windows" in facts else ""
    recordings, surfaces = (counted(facts[f"n_{what}s"], what) for what in ("recording", "surface"))
    return f"{windows}{recordings} of {surfaces}"


def chance_level(data: Mapping[str, Any]) -> float:
    """Return the chance level, which is the accuracy of always predicting the most frequent surface."""
    return float(data["dataset"]["chance"])


def cluster_phrase(accuracy: Mapping[str, Any]) -> str:
    """Return a phrase that names the clusters of an interval, for example " over 10 operators"."""
    n = accuracy.get("n_clusters")
    return f" over {n:,} {accuracy['clusters']}s" if n else ""


def caution(accuracy: Mapping[str, Any]) -> str:
    """Return a warning if an interval is based on few clusters or on clusters without spread, else ""."""
    n, units = accuracy.get("n_clusters") or FEW_CLUSTERS, f"{accuracy.get('clusters')}s"
    method = accuracy.get("interval", "")
    if method.startswith("Wilson over"):
        why = "have the same accuracy" if n >= MIN_CLUSTERS else "are too few to show their spread"
        return f"{n} {units} {why}, so each counts as one test in the interval."
    if n < FEW_CLUSTERS and method.startswith("t over") and not 0.1 < accuracy["mean"] < 0.9:
        return f"Near 0 or 100 % the interval of {n} {units} may be too narrow."
    return ""


def dataset_facts(data: Mapping[str, Any]) -> tuple[str, dict[str, str]]:
    """Return the name of the dataset of a result, and facts about it."""
    facts = data["dataset"]
    others = ("operator", "session", "test")
    counts = [counted(facts[f"n_{what}s"], what) for what in others if facts.get(f"n_{what}s")]
    counts += [f"{counted(n, 'value')} of {name}" for name, n in facts.get("labels", {}).items()]
    values = {
        "Dataset": facts.get("title"),
        "Size": ", ".join([dataset_size(facts), *counts]),
        "Surfaces": ", ".join(facts.get("surfaces") or ()),
        "Signals": f"{facts['fs_hz']:g} Hz, {facts['unit']}" if facts.get("fs_hz") else "",
        "Chance level": f"{100 * chance_level(data):.1f} %",
        "Source": facts.get("source"),
        "Licence": facts.get("licence"),
        "Input hash": data["input_hash"],
    }
    return facts["name"], {title: value for title, value in values.items() if value}


def reproduction_facts(data: Mapping[str, Any], pipeline: str) -> dict[str, str]:
    """Return the facts that are needed to reproduce a result. The input hash is shortened."""
    input_hash = data["input_hash"]
    values = {
        "Pipeline or features": pipeline,
        "Movement": data.get("movement", ""),
        "Protocol": data["protocol"],
        "Seed": str(data["seed"]),
        "Input hash": f"{input_hash[:12]}\N{HORIZONTAL ELLIPSIS}" if len(input_hash) > 12 else input_hash,
        "Code": data.get("code_hash", ""),
    }
    return {title: value for title, value in values.items() if value}


def describe_dataset(dataset: "Dataset", frame: "pd.DataFrame", like: Recording) -> dict[str, Any]:
    """Return the facts of a dataset and the size of its feature table as JSON values.

    Parameters
    ----------
    dataset : Dataset
        Recordings or windows.
    frame : DataFrame
        Feature table of the dataset.
    like : Recording
        Recording whose sampling rate and unit represent the dataset.
    """
    frame = frame[is_testable(frame)]
    return {
        "name": dataset.name,
        "title": dataset.title,
        "n_recordings": int(parents(frame).nunique()),
        **({"n_windows": len(frame)} if "parent" in frame else {}),
        **{f"n_{of}s": int(frame[of].nunique()) for of in ("surface", "operator", "session")},
        "labels": {name: int(frame[name].nunique()) for name in label_columns(dataset.entries)},
        "surfaces": list(dataset.surfaces),
        "chance": float(frame["surface"].value_counts(normalize=True).max()),
        "fs_hz": float(like.fs),
        "unit": like.unit,
        "licence": dataset.licence,
        "source": dataset.source,
        "notes": list(dataset.notes),
    }


def example_facts(recording: Recording) -> dict[str, Any]:
    """Return the data of a figure of a recording and its phases as JSON values.

    Parameters
    ----------
    recording : Recording
        Recording with its phases.

    Returns
    -------
    dict
        `recording` (id), `surface`, `unit`, `seconds` (duration); `low` and `high`, the envelope of the
        signal in equal blocks; `taps`, with start, impact and end of each in s; `movement`, with start and
        end in s, or None.
    """
    phases, fs = recording.phases, recording.fs
    assert phases is not None
    low, high = signal_envelope(main_direction(recording), 300)
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


def signal_envelope(x: Samples, n: int) -> tuple[Samples, Samples]:
    """Return minimum and maximum of each of about `n` equal blocks, including the last preceding sample."""
    size = max(1, x.size // n)
    blocks = x[: x.size // size * size].reshape(-1, size)
    low, high = blocks.min(axis=1), blocks.max(axis=1)
    low[1:], high[1:] = np.minimum(low[1:], blocks[:-1, -1]), np.maximum(high[1:], blocks[:-1, -1])
    return low, high


def main_direction(recording: Recording) -> Samples:
    """Subtract the mean of each axis, and project the axes on the direction of the largest changes.

    Figures use this projection, because DFT321 mixes the phases of the axes and thereby blurs the contact.
    """
    acceleration = recording.acceleration
    axes = acceleration.reshape(len(acceleration), -1)
    axes = axes - axes.mean(axis=0)
    if axes.shape[1] == 1:
        return np.asarray(axes[:, 0])
    lag = max(1, round(2e-3 * recording.fs))  # 2 ms: longer than noise, shorter than changes of gravity
    steps = axes[lag:] - axes[:-lag]
    direction = np.linalg.eigh(steps.T @ steps)[1][:, -1]
    return np.asarray(axes @ (direction * np.sign(direction[np.argmax(np.abs(direction))])))
