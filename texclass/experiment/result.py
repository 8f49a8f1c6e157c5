"""What a benchmark found: accuracies with intervals beside the published ones, and how it was done."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.feature_table import Flag, LeftOut
from texclass.experiment.nested_choice import NestedChoice
from texclass.experiment.paired import Paired


class Undefined(NamedTuple):
    """A feature without a value in some recordings: the commonest reason, and how many recordings."""

    feature: str
    reason: str
    n_recordings: int


@dataclass(frozen=True)
class RowResult:
    """One row of the table.

    Attributes
    ----------
    name, reference
        As in the pipeline.
    n_features
        Columns that reach the classifier.
    accuracy
        Classifier -> accuracy; empty when the row could not be computed.
    published
        Classifier -> published accuracy in per cent.
    ms_per_recording
        Time of the row's features (of the whole pool, where columns are selected), segmentation not included.
    missing
        What the dataset lacks for this row; None if nothing.
    selected
        Classifier -> column -> share of folds in which the column was selected; empty without selection.
    """

    name: str
    n_features: int
    accuracy: Mapping[str, Accuracy]
    published: Mapping[str, float] = field(default_factory=dict)
    ms_per_recording: float | None = None
    missing: str | None = None
    selected: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    reference: str = ""


@dataclass(frozen=True)
class RowSum:
    """A row over all repeats: columns at the classifier, mean accuracy, milliseconds of its features."""

    n_features: int
    accuracy: float
    ms_per_recording: float


@dataclass(frozen=True)
class GroupGain:
    """What a group of features adds to a row.

    Attributes
    ----------
    name, reference
        As in the pipeline.
    n_columns
        Its columns.
    joined
        The row together with the group; None when the dataset lacks the group.
    paired
        The row with the group against the row without it.
    p_corrected
        The p-value corrected for the number of groups (Holm).
    missing
        What the dataset lacks for it; None if nothing.
    """

    name: str
    n_columns: int
    joined: RowSum | None = None
    paired: Paired | None = None
    p_corrected: float | None = None
    missing: str | None = None
    reference: str = ""


@dataclass(frozen=True)
class Gains:
    """What each group of features adds to one row, on the same splits.

    Attributes
    ----------
    row, classifier, chosen
        The row that is added to, who judges, and how both were chosen.
    selects
        Whether the row selects a fixed number of columns, so that a group competes for places.
    without
        The row without any group.
    n_repeats, n_folds
        The splits.
    groups : tuple of GroupGain
        In the pipeline's order.
    """

    row: str
    classifier: str
    chosen: str
    selects: bool
    without: RowSum
    n_repeats: int
    n_folds: int
    groups: tuple[GroupGain, ...]


@dataclass(frozen=True, eq=False)
class Confusion:
    """Confusion matrix of one row and classifier.

    Attributes
    ----------
    row, classifier
        Which.
    materials : tuple of str
        Labels.
    counts : ndarray of shape (n_materials, n_materials)
        Recordings of material i that were taken for material j.
    """

    row: str
    classifier: str
    materials: tuple[str, ...]
    counts: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class BenchmarkResult:
    """A pipeline evaluated on a dataset.

    Attributes
    ----------
    dataset
        Facts: name, title, source, notes, numbers of recordings, materials, operators and sessions, and of
        windows, if it is recordings that were cut into windows.
    pipeline, pipeline_hash, feature_set, classifiers
        What was evaluated.
    protocol, protocol_description, n_folds
        How.
    rows : tuple of RowResult
        In the pipeline's order.
    confusion : Confusion or None
        Of the best row; None when no row could be computed.
    versions, seed, input_hash
        What is needed to do it again.
    unit
        What is never parted by the protocol; it votes where it holds several tests.
    left_out, flags, undefined
        Recordings not used, remarks of the loaders, features without a value.
    gains : Gains or None
        What each addition of the pipeline adds; None without additions or without a row to add to.
    choice : NestedChoice or None
        What choosing a row and a classifier inside each training part gives; None if that was not asked.
    """

    dataset: Mapping[str, Any]
    pipeline: str
    pipeline_hash: str
    feature_set: str
    classifiers: tuple[str, ...]
    protocol: str
    protocol_description: str
    n_folds: int
    rows: tuple[RowResult, ...]
    confusion: Confusion | None
    versions: Mapping[str, str]
    seed: int
    input_hash: str
    left_out: tuple[LeftOut, ...] = ()
    flags: tuple[Flag, ...] = ()
    undefined: tuple[Undefined, ...] = ()
    unit: Literal["recording", "run"] = "recording"
    gains: Gains | None = None
    choice: NestedChoice | None = None

    @property
    def best(self) -> tuple[RowResult, str] | None:
        """Row and classifier of the highest accuracy; the first of equals."""
        pairs = [(row, name) for row in self.rows for name in row.accuracy]
        return max(pairs, key=lambda pair: pair[0].accuracy[pair[1]].mean, default=None)

    @property
    def tested(self) -> str:
        """What was classified: "recordings" or "windows"."""
        return "windows" if "n_windows" in self.dataset else "recordings"

    def rank_agreement(self, classifier: str) -> float | None:
        """Spearman correlation of our accuracies with the published ones; None with fewer than three rows."""
        pairs = [
            (row.accuracy[classifier].mean, row.published[classifier])
            for row in self.rows
            if classifier in row.accuracy and classifier in row.published
        ]
        if len(pairs) < 3 or any(len(set(values)) < 2 for values in zip(*pairs, strict=True)):
            return None
        ours, theirs = np.array(pairs).T
        return float(spearmanr(ours, theirs).statistic)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain JSON values; accuracies and published figures as fractions."""
        return {
            "dataset": dict(self.dataset),
            "pipeline": {"name": self.pipeline, "hash": self.pipeline_hash, "features": self.feature_set},
            "protocol": self.protocol,
            "protocol_description": self.protocol_description,
            "n_folds": self.n_folds,
            "accuracy_unit": f"fraction of {self.tested}; low and high are the 95 % interval by `interval`",
            "rows": [_row(row, self.unit) for row in self.rows],
            "rank_agreement": {name: self.rank_agreement(name) for name in self.classifiers},
            "confusion": _confusion(self.confusion),
            "gains": None if self.gains is None else _gains(self.gains),
            "choice": None if self.choice is None else _choice(self.choice, self.unit),
            "left_out": [list(item) for item in self.left_out],
            "flags": [list(item) for item in self.flags],
            "undefined": [item._asdict() for item in self.undefined],
            "versions": dict(self.versions),
            "seed": self.seed,
            "input_hash": self.input_hash,
        }

    def to_json(self) -> str:
        """Return the result as JSON text."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"


def _row(row: RowResult, unit: str) -> dict[str, Any]:
    return {
        "name": row.name,
        "n_features": row.n_features,
        "accuracy": {name: _accuracy(a, unit) for name, a in row.accuracy.items()},
        "paper": {name: value / 100 for name, value in row.published.items()},
        "ms_per_recording": row.ms_per_recording,
        "missing": row.missing,
        "selected": {name: dict(columns) for name, columns in row.selected.items()},
        "reference": row.reference,
    }


def _gains(gains: Gains) -> dict[str, Any]:
    found = asdict(gains)
    for group in found["groups"]:
        paired = group["paired"]
        if paired is not None:
            low, high = paired.pop("interval")
            group["paired"] = {"low": low, "high": high, **paired}
    return found


def _accuracy(accuracy: Accuracy, unit: str) -> dict[str, Any]:
    """Return an accuracy as JSON values; balanced is the mean itself, where materials are tested equally."""
    low, high = accuracy.interval
    voted = accuracy.voted
    return {
        "mean": accuracy.mean,
        "low": low,
        "high": high,
        "interval": f"bootstrap over {unit}s" if accuracy.bounds else "Wilson",
        "balanced": accuracy.mean if accuracy.balanced is None else accuracy.balanced,
        "folds": list(accuracy.folds),
        **({} if voted is None else {f"per_{unit}": _accuracy(voted, unit)}),
    }


def _choice(choice: NestedChoice, unit: str) -> dict[str, Any]:
    return {
        "accuracy": _accuracy(choice.accuracy, unit),
        "chosen": [list(pair) for pair in choice.chosen],
        "protocol": choice.protocol,
    }


def _confusion(confusion: Confusion | None) -> dict[str, Any] | None:
    if confusion is None:
        return None
    return {
        "row": confusion.row,
        "classifier": confusion.classifier,
        "materials": list(confusion.materials),
        "counts": confusion.counts.tolist(),
    }
