"""Segment voting: classify every segment of a movement, then average the decisions.

Segments increase the number of training samples and show how much a surface varies. A segment in which the
tool lifts off or slips is outvoted. Features also vary with the speed, force and brightness of a stroke,
which cannot be estimated from a few recordings. This variation is similar for all surfaces. It is therefore
estimated from simulation, and can be passed to the segment classifier (`stroke_variations`).
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
"""Part of the name of every column of a segment; see `texclass.features.contract.feature`."""
VARIATIONS_FILE = Path(__file__).with_name("stroke_variations.csv")
"""Simulated variations of the columns of the set `surfaces`; written by benchmarks/stroke_variations.py."""


class SegmentVoting(MetaEstimatorMixin, ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Average the decisions of one classifier over the segments of a recording.

    Columns of the whole recording (taps, friction) are repeated in every segment. Without such columns, a
    second classifier uses the features of all segments together, and thus the course of a stroke, and votes
    as well.

    Parameters
    ----------
    estimator : classifier, optional
        Classifier of one segment (default: `KernelDiscriminant`). Its `decision_function` is averaged, or its
        `predict_proba` if it has none.
    n_segments : int
        Number of segments per recording (default 1).
    whole_weight : float
        Weight of the classifier of whole recordings, relative to 1 for all segments together (default 1). It
        is multiplied by n / (n + 1), where n is the number of recordings of the smallest class.
    recording_columns : tuple of int
        Indices of the columns of the whole recording; see `with_segment_columns`.
    use_variations : bool
        Whether to pass `stroke_variations` to the `fit` method of the classifiers (default False). This
        requires columns of the set `surfaces`, and an estimator whose `fit` accepts `variations`.
    column_names : tuple of str
        Names of the columns, for `use_variations`; see `with_segment_columns`.
    channels_estimator : classifier, optional
        Classifier of one segment if the columns belong to several channels, some of which may be irrelevant
        (default: `estimator`); see `with_segment_columns`.

    Attributes
    ----------
    classes_ : ndarray of shape (n_classes,)
        Class labels.
    segment_classifier_ : classifier
        Classifier fitted on segments.
    whole_classifier_ : classifier or None
        Classifier fitted on whole recordings; None if its weight is 0, if there are recording columns, or if
        no recording has more than one segment.
    whole_weight_ : float
        Weight of `whole_classifier_`.

    Notes
    -----
    The values of one feature for all segments are adjacent columns. Without the recording columns,
    X[:, j * n_segments + i] is feature j of segment i. Features are compared between segments, so a scaler
    that treats columns separately belongs inside `estimator`. A training recording with identical segments
    (too short to be divided) counts as one segment.

    The classifier of whole recordings is trained on n samples per class, the classifier of segments on
    n_segments n. A few recordings do not cover the variation between recordings, so the weight of the
    classifier of whole recordings grows with n.

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
        recording_columns: tuple[int, ...] = (),
        use_variations: bool = False,
        column_names: tuple[str, ...] = (),
        channels_estimator: Any = None,
    ) -> None:
        self.estimator = estimator
        self.n_segments = n_segments
        self.whole_weight = whole_weight
        self.recording_columns = recording_columns
        self.use_variations = use_variations
        self.column_names = column_names
        self.channels_estimator = channels_estimator

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fit the segment classifier and, if there is one, the classifier of whole recordings.

        Parameters
        ----------
        X : array_like of shape (n_recordings, n_columns)
            Finite features: adjacent columns for the segments, and columns of the whole recording.
        y : array_like of shape (n_recordings,)
            Labels of at least two classes.

        Raises
        ------
        ValueError
            If the number of segment columns is not a multiple of `n_segments`, `recording_columns` contains
            an index that is not a column of X, `column_names` does not contain one name per column, or
            `estimator` cannot be fitted.
        """
        rows, labels = self._check(X, y)
        variations = stroke_variations(self.column_names) if self.column_names else None
        segments, recording = self._distinct_segments(rows)
        # All segments vary alike: the columns of the first one represent any of them.
        self.segment_classifier_ = self._fit_clone(
            segments, labels[recording], variations, self.segment_columns_[:, 0]
        )
        has_whole = len(segments) > len(rows) and not self.recording_columns and self.whole_weight > 0
        self.whole_classifier_ = self._fit_clone(rows, labels, variations) if has_whole else None
        n = int(np.unique(labels, return_counts=True)[1].min())
        self.whole_weight_ = float(self.whole_weight) * n / (n + 1)
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
        if not np.isin(self.recording_columns, np.arange(n_columns)).all():
            raise ValueError(
                f"recording_columns must be in 0 ... {n_columns - 1}, got {self.recording_columns}"
            )
        if self.column_names and len(self.column_names) != n_columns:
            raise ValueError(
                f"column_names must contain {n_columns} names, one per column, got {len(self.column_names)}"
            )
        n_divided = n_columns - len(set(self.recording_columns))
        if n_divided % self.n_segments:
            raise ValueError(
                f"X must have a multiple of n_segments = {self.n_segments} segment columns, got {n_divided}. "
                "Compute the features for the same number of segments, and select all segments of each"
            )
        return rows, labels

    def _fit_clone(
        self, X: Samples, y: NDArray[Any], variations: Samples | None, columns: Any = slice(None)
    ) -> Any:
        options = {} if variations is None else {"variations": variations[:, columns]}
        return self._unfitted().fit(X, y, **options)

    @property
    def segment_columns_(self) -> NDArray[np.intp]:
        """Columns of each feature in each segment, shape (n_features, n_segments).

        Recording columns are repeated in every segment. If there are only recording columns, a recording is
        one segment.
        """
        columns = np.arange(self.n_features_in_)
        divided = np.setdiff1d(columns, self.recording_columns)
        if not divided.size:
            return columns[:, np.newaxis]
        repeated = np.tile(np.array(self.recording_columns, dtype=np.intp)[:, np.newaxis], self.n_segments)
        return np.vstack([divided.reshape(-1, self.n_segments), repeated])

    def _distinct_segments(self, X: Samples) -> tuple[Samples, NDArray[np.intp]]:
        """Return segments as rows (one if all segments of a recording are equal), and their recordings."""
        segments = X[:, self.segment_columns_.T]  # (n_recordings, n_segments, n_features)
        is_distinct = np.ones(segments.shape[:2], dtype=bool)
        is_distinct[:, 1:] = (segments != segments[:, :1]).any(axis=(1, 2))[:, np.newaxis]
        return segments[is_distinct], np.nonzero(is_distinct)[0]

    def decision_function(self, X: ArrayLike) -> Samples:
        """Return the mean decisions, shape (n_recordings, n_classes).

        For two classes, the result is the decision for the second class, shape (n_recordings,), as in
        scikit-learn.
        """
        return self._mean(X, decisions_of)

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Return the class with the largest mean decision, shape (n_recordings,)."""
        decisions = self.decision_function(X)
        winner = decisions.argmax(axis=1) if decisions.ndim == 2 else (decisions > 0).astype(np.intp)
        return np.asarray(self.classes_[winner])

    @available_if(lambda self: hasattr(self._unfitted(), "predict_proba"))  # type: ignore[untyped-decorator]
    def predict_proba(self, X: ArrayLike) -> Samples:
        """Return the mean probabilities, shape (n_recordings, n_classes)."""
        return self._mean(X, lambda classifier, rows: np.asarray(classifier.predict_proba(rows)))

    def _mean(self, X: ArrayLike, decide: Callable[[Any, Samples], Samples]) -> Samples:
        """Average decisions over segments, then combine the mean with the decision on the whole recording."""
        check_is_fitted(self)
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        segments = rows[:, self.segment_columns_.T]  # (n_recordings, n_segments, n_features)
        decisions = decide(self.segment_classifier_, segments.reshape(-1, segments.shape[2]))
        mean = decisions.reshape(*segments.shape[:2], *decisions.shape[1:]).mean(axis=1)
        if self.whole_classifier_ is None:
            return np.asarray(mean)
        whole = decide(self.whole_classifier_, rows)
        return np.asarray((mean + self.whole_weight_ * whole) / (1 + self.whole_weight_))

    def _unfitted(self) -> Any:
        return KernelDiscriminant() if self.estimator is None else clone(self.estimator)


def with_segment_columns(classifier: Any, columns: Sequence[str]) -> Any:
    """Return a clone of a segment-voting classifier with its columns set; other classifiers are unchanged.

    Parameters
    ----------
    classifier : classifier
        Unfitted classifier.
    columns : sequence of str
        Names of the columns of X.
    """
    if not isinstance(classifier, SegmentVoting):
        return classifier
    parameters: dict[str, Any] = {"column_names": tuple(columns)} if classifier.use_variations else {}
    channels = {column.partition("/")[0] for column in columns if "/" in column}
    if classifier.channels_estimator is not None and len(channels) > 1:
        parameters["estimator"] = classifier.channels_estimator
    if classifier.n_segments > 1:
        parameters["recording_columns"] = tuple(
            i for i, column in enumerate(columns) if SEGMENT_SUFFIX not in column
        )
    return clone(classifier).set_params(**parameters)


def decisions_of(classifier: Any, rows: Samples) -> Samples:
    """Return the decisions of a classifier, else its probabilities; one column for two classes."""
    if hasattr(classifier, "decision_function"):
        return np.asarray(classifier.decision_function(rows))
    p = np.asarray(classifier.predict_proba(rows))
    return p[:, 1] - 0.5 if p.shape[1] == 2 else p


def stroke_variations(column_names: Sequence[str]) -> Samples:
    """Return the joint variation of features between strokes on one surface, in the units of the features.

    Parameters
    ----------
    column_names : sequence of str
        Columns of the set `surfaces`, with or without a channel and a segment: all channels and segments vary
        alike.

    Returns
    -------
    ndarray of shape (n_variations, n_columns)
        Principal variations V for strokes that are 10 % faster, have 1.3 times the amplitude, or have 1.5 dB
        per octave more at high frequencies. V' V / n_variations is the covariance. The variation of other
        columns is 0.
    """
    by_name = _simulated_variations()
    zeros = np.zeros_like(next(iter(by_name.values())))
    features = [name.rpartition("/")[2].partition(SEGMENT_SUFFIX)[0] for name in column_names]
    return np.array([by_name.get(feature, zeros) for feature in features]).T


@cache
def _simulated_variations() -> dict[str, Samples]:
    with VARIATIONS_FILE.open(encoding="utf-8", newline="") as file:
        return {name: np.array(values, dtype=np.float64) for name, *values in csv.reader(file)}
