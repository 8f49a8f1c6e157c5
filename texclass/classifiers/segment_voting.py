"""Classify recordings by segment voting: classify every piece of a movement, then average the decisions.

One recording of a surface says little about the next one. How features change with a quicker, a stronger or a
brighter stroke is much the same for all surfaces: it is estimated from simulation and can be added.
"""

import csv
from collections.abc import Callable, Sequence
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin, MetaEstimatorMixin, clone
from sklearn.utils import check_scalar
from sklearn.utils.metaestimators import available_if
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.classifiers.kernel_discriminant import KernelDiscriminant
from texclass.recording import Samples

SEGMENT_SUFFIX = ".segment"
"""Part of the name of every column of a piece; see `texclass.features.contract.feature`."""
KNOWN_CHANGES = Path(__file__).with_name("known_changes.csv")
"""Columns of the set `surfaces`, and their changes; made by benchmarks/known_changes.py."""


class SegmentVoting(MetaEstimatorMixin, ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Average the decisions of one classifier over the pieces of a recording.

    With few recordings, pieces are many more samples to train on, and their differences show what to expect
    of the next recording; a piece in which a finger lifts off or slips is outvoted. Columns of the whole
    recording (taps, friction) are repeated in every piece. Without such columns, a second classifier sees all
    pieces side by side and votes, too: how a stroke begins, goes on and ends.

    Parameters
    ----------
    estimator : classifier, optional
        Classifies one piece; `KernelDiscriminant` by default. Its `decision_function` is averaged, or its
        `predict_proba` where it has no other.
    n_segments : int
        Pieces of a recording.
    whole_weight : float
        Largest weight of the classifier of the whole, against 1 of all pieces together; with n recordings of
        the smallest class, n/(n + 1) of it.
    undivided : tuple of int
        Columns of the whole recording; see `with_segment_columns`.
    known_changes : bool
        Whether `estimator` is fitted with the simulated changes of the columns between strokes; for columns
        of the set `surfaces`, and an estimator whose `fit` takes `changes`.
    columns : tuple of str
        Names of the columns, with `known_changes`; see `with_segment_columns`.

    Attributes
    ----------
    classes_ : ndarray of shape (n_classes,)
        Labels.
    estimator_ : classifier
        Fitted on pieces.
    whole_ : classifier or None
        Fitted on the whole; None without weight, or where no recording has more than one piece.
    weight_ : float
        Weight of `whole_`.

    Notes
    -----
    The n_segments values of one feature are adjacent columns, as features with a parameter `n_segments`
    return them: among the divided columns, X[:, j n_segments + i] is feature j of segment i. Features are
    compared between segments, so a step that scales single columns belongs inside `estimator`. In training, a
    recording whose segments are all equal (it was too short to be divided) counts as one segment.

    The classifier of the whole is trained on n samples of a class, that of pieces on n_segments n: single
    recordings do not show what varies, so its weight grows with n.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> X = rng.standard_normal((60, 8)) + np.repeat([[0.0], [2.0]], 30, axis=0)
    >>> y = np.repeat(["felt", "glass"], 30)
    >>> SegmentVoting(n_segments=4).fit(X, y).predict([[0.0] * 8, [2.0] * 8]).tolist()
    ['felt', 'glass']
    """

    def __init__(
        self,
        estimator: Any = None,
        *,
        n_segments: int = 1,
        whole_weight: float = 1.0,
        undivided: tuple[int, ...] = (),
        known_changes: bool = False,
        columns: tuple[str, ...] = (),
    ) -> None:
        self.estimator = estimator
        self.n_segments = n_segments
        self.whole_weight = whole_weight
        self.undivided = undivided
        self.known_changes = known_changes
        self.columns = columns

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fit the classifier of pieces, and that of the whole recording.

        Parameters
        ----------
        X : array_like of shape (n_recordings, n_columns)
            Finite features, the pieces of each side by side, and columns of the whole.
        y : array_like of shape (n_recordings,)
            Labels of at least two classes.

        Raises
        ------
        ValueError
            If the number of columns of segments is not a multiple of `n_segments`, `undivided` names others
            than columns of X, there are not as many names as columns, or as `estimator` does.
        """
        rows, labels = self._check(X, y)
        changes = changes_of(self.columns) if self.columns else None
        pieces, recording = self._distinct_pieces(rows)
        # All pieces change alike: the columns of the first are those of any.
        self.estimator_ = self._fit_new(pieces, labels[recording], changes, self.columns_[:, 0])
        has_whole = len(pieces) > len(rows) and not self.undivided and self.whole_weight > 0
        self.whole_ = self._fit_new(rows, labels, changes) if has_whole else None
        n = int(np.unique(labels, return_counts=True)[1].min())
        self.weight_ = float(self.whole_weight) * n / (n + 1)
        return self

    def _check(self, X: ArrayLike, y: ArrayLike) -> tuple[Samples, NDArray[Any]]:
        check_scalar(self.n_segments, "n_segments", Integral, min_val=1)
        check_scalar(self.whole_weight, "whole_weight", Real, min_val=0)
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        self.classes_ = np.unique(labels)
        if len(self.classes_) < 2:
            raise ValueError("y must contain at least 2 classes, got 1 class")
        n_columns = rows.shape[1]
        if not np.isin(self.undivided, np.arange(n_columns)).all():
            raise ValueError(f"undivided must be columns 0 to {n_columns - 1}, got {self.undivided}")
        if self.columns and len(self.columns) != n_columns:
            raise ValueError(f"columns must be {n_columns} names, one a column, got {len(self.columns)}")
        n_divided = n_columns - len(set(self.undivided))
        if n_divided % self.n_segments:
            raise ValueError(
                f"X must have a multiple of n_segments = {self.n_segments} columns of segments, "
                f"got {n_divided}. Pass all segments of each feature"
            )
        return rows, labels

    def _fit_new(
        self, X: Samples, y: NDArray[Any], changes: Samples | None, columns: Any = slice(None)
    ) -> Any:
        return self._unfitted().fit(X, y, **({} if changes is None else {"changes": changes[:, columns]}))

    @property
    def columns_(self) -> NDArray[np.intp]:
        """The columns of each feature in each piece, shape (n_features, n_segments).

        Columns of the whole recording stand in each piece. Without others, a recording is one piece.
        """
        every = np.arange(self.n_features_in_)
        divided = np.setdiff1d(every, self.undivided)
        if not divided.size:
            return every[:, np.newaxis]
        repeated = np.tile(np.array(self.undivided, dtype=np.intp)[:, np.newaxis], self.n_segments)
        return np.vstack([divided.reshape(-1, self.n_segments), repeated])

    def _distinct_pieces(self, X: Samples) -> tuple[Samples, NDArray[np.intp]]:
        """Return the pieces of recordings as rows, and the recording that each belongs to, ascending.

        A recording whose pieces are all the same has one.
        """
        pieces = X[:, self.columns_.T]  # (n_recordings, n_segments, n_features)
        is_kept = np.ones(pieces.shape[:2], dtype=bool)
        is_kept[:, 1:] = (pieces != pieces[:, :1]).any(axis=(1, 2))[:, np.newaxis]
        return pieces[is_kept], np.nonzero(is_kept)[0]

    def decision_function(self, X: ArrayLike) -> Samples:
        """Return the mean decision of the pieces, shape (n_recordings, n_classes).

        Of two classes, only that of the second, shape (n_recordings,), as scikit-learn has it.
        """
        return self._mean(X, decisions_of)

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Return the class with the largest mean decision, shape (n_recordings,)."""
        decisions = self.decision_function(X)
        winner = decisions.argmax(axis=1) if decisions.ndim == 2 else (decisions > 0).astype(np.intp)
        return np.asarray(self.classes_[winner])

    @available_if(lambda self: hasattr(self._unfitted(), "predict_proba"))  # type: ignore[untyped-decorator]
    def predict_proba(self, X: ArrayLike) -> Samples:
        """Return the mean probabilities of the voters, shape (n_recordings, n_classes)."""
        return self._mean(X, lambda classifier, rows: np.asarray(classifier.predict_proba(rows)))

    def _mean(self, X: ArrayLike, decide: Callable[[Any, Samples], Samples]) -> Samples:
        """Return the mean over the pieces of each recording, and over them and the whole."""
        check_is_fitted(self)
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        pieces = rows[:, self.columns_.T]  # (n_recordings, n_segments, n_features)
        decisions = decide(self.estimator_, pieces.reshape(-1, pieces.shape[2]))
        mean = decisions.reshape(*pieces.shape[:2], *decisions.shape[1:]).mean(axis=1)
        if self.whole_ is None:
            return np.asarray(mean)
        whole = decide(self.whole_, rows)
        return np.asarray((mean + self.weight_ * whole) / (1 + self.weight_))

    def _unfitted(self) -> Any:
        return KernelDiscriminant() if self.estimator is None else clone(self.estimator)


def with_segment_columns(classifier: Any, columns: Sequence[str]) -> Any:
    """Return a clone of a segment-voting classifier with its columns set; return others unchanged."""
    if not isinstance(classifier, SegmentVoting):
        return classifier
    parameters: dict[str, Any] = {"columns": tuple(columns)} if classifier.known_changes else {}
    if classifier.n_segments > 1:
        parameters["undivided"] = tuple(i for i, column in enumerate(columns) if SEGMENT_SUFFIX not in column)
    return clone(classifier).set_params(**parameters)


def decisions_of(classifier: Any, rows: Samples) -> Samples:
    """Return a classifier's decisions, or its probabilities where it has no other; of two classes, one."""
    if hasattr(classifier, "decision_function"):
        return np.asarray(classifier.decision_function(rows))
    p = np.asarray(classifier.predict_proba(rows))
    return p[:, 1] - 0.5 if p.shape[1] == 2 else p


def changes_of(columns: Sequence[str]) -> Samples:
    """Return what changes columns of the set `surfaces` together, in the units of each.

    Parameters
    ----------
    columns : sequence of str
        Names, with or without a channel before and a piece behind: all channels and pieces change alike.

    Returns
    -------
    ndarray of shape (n_changes, n_columns)
        Principal changes C of features when strokes are a tenth quicker, 1.3 times as strong, or rise by
        1.5 dB an octave against what they were: C' C / n_changes is their covariance about no change. 0 for
        columns that are not known.
    """
    known = _known_changes()
    nothing = np.zeros_like(next(iter(known.values())))
    names = [column.rpartition("/")[2].partition(SEGMENT_SUFFIX)[0] for column in columns]
    return np.array([known.get(name, nothing) for name in names]).T


@cache
def _known_changes() -> dict[str, Samples]:
    with KNOWN_CHANGES.open(encoding="utf-8", newline="") as file:
        return {name: np.array(values, dtype=np.float64) for name, *values in csv.reader(file)}
