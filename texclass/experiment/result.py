"""What a benchmark found: accuracies with intervals beside the published ones, and how it was done."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import spearmanr

from texclass.experiment.table import Flag, LeftOut


class Undefined(NamedTuple):
    """A feature without a value in some recordings: the commonest reason, and how many recordings."""

    feature: str
    reason: str
    n_recordings: int


@dataclass(frozen=True)
class Accuracy:
    """Share of correctly classified recordings, pooled over folds.

    Attributes
    ----------
    n_hits, n_tested
        Correct classifications out of all.
    folds
        Accuracy of each fold, for paired comparisons on the same folds.
    """

    n_hits: int
    n_tested: int
    folds: tuple[float, ...] = ()

    @property
    def mean(self) -> float:
        """Accuracy as a fraction."""
        return self.n_hits / self.n_tested

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson 95 % confidence interval."""
        return wilson_interval(self.n_hits, self.n_tested)


def wilson_interval(n_hits: int, n_tested: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the Wilson score interval of a proportion.

    (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n), with p = n_hits/n and z the normal quantile.
    """
    n, p, z = n_tested, n_hits / n_tested, float(ndtri(0.5 + confidence / 2))
    centre = p + z**2 / (2 * n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    low, high = (centre - half) / (1 + z**2 / n), (centre + half) / (1 + z**2 / n)
    # Rounding must not part an extreme proportion from its own limit.
    return min(p, max(0.0, float(low))), max(p, min(1.0, float(high)))


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
        Facts: name, title, source, notes, numbers of recordings, materials, operators and sessions.
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
    left_out, flags, undefined
        Recordings not used, remarks of the loaders, features without a value.
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

    @property
    def best(self) -> tuple[RowResult, str] | None:
        """Row and classifier of the highest accuracy; the first of equals."""
        pairs = [(row, name) for row in self.rows for name in row.accuracy]
        return max(pairs, key=lambda pair: pair[0].accuracy[pair[1]].mean, default=None)

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
            "accuracy_unit": "fraction of recordings; low and high are the Wilson 95 % interval",
            "rows": [_row(row) for row in self.rows],
            "rank_agreement": {name: self.rank_agreement(name) for name in self.classifiers},
            "confusion": _confusion(self.confusion),
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


def _row(row: RowResult) -> dict[str, Any]:
    return {
        "name": row.name,
        "n_features": row.n_features,
        "accuracy": {
            name: {"mean": a.mean, "low": a.interval[0], "high": a.interval[1], "folds": list(a.folds)}
            for name, a in row.accuracy.items()
        },
        "paper": {name: value / 100 for name, value in row.published.items()},
        "ms_per_recording": row.ms_per_recording,
        "missing": row.missing,
        "selected": {name: dict(columns) for name, columns in row.selected.items()},
        "reference": row.reference,
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
