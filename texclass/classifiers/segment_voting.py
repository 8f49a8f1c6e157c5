"""A classifier of recordings described in pieces: it learns from all of them and lets them vote.

It may know besides what another stroke does to features, a quicker one, a stronger one, a brighter one: one
recording of a surface says little about the next one of it, but how features change when the same surface is
felt in another way is known from simulation, and much the same for all surfaces.
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

OF_A_PIECE = ".piece"
"""What the name of a column of a piece holds; see `texclass.features.contract.feature`."""
KNOWN_CHANGES = Path(__file__).with_name("known_changes.csv")
"""Columns of the set `surfaces`, and their changes; made by benchmarks/known_changes.py."""


class SegmentVoting(MetaEstimatorMixin, ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Classify each piece of a recording, then average the decisions.

    With few recordings, pieces are many more samples to learn from, and how they differ shows what to expect
    of the next recording; a piece at which a finger lifts off or slips is outvoted. Columns that are not of
    pieces (taps, friction) stand in each of them. Where there are none, one more voter sees the whole, the
    pieces side by side: what a stroke is like at its beginning, later, and at its end.

    Parameters
    ----------
    estimator : classifier, optional
        Classifies one piece; `KernelDiscriminant` by default. Its `decision_function` is averaged, or its
        `predict_proba` where it has no other.
    n_pieces : int
        Pieces of a recording.
    whole_weight : float
        Weight of the voter that sees the whole, against 1 of all pieces together, where recordings are many;
        n/(n + 1) of it where a class has n.
    undivided : tuple of int
        Columns that are not of pieces but of the whole recording; see `knowing`.
    known_changes : bool
        Let the estimator know what another stroke does to the columns, which few recordings do not show; for
        columns of the set `surfaces`, and an estimator whose `fit` takes `changes`.
    columns : tuple of str
        Their names, where `known_changes`; see `knowing`.

    Attributes
    ----------
    classes_ : ndarray of shape (n_classes,)
        Labels.
    estimator_ : classifier
        Fitted on pieces.
    whole_ : classifier or None
        Fitted on the whole; None without weight, or where no recording has more than one piece.
    weight_ : float
        Of `whole_`; what the smallest class allows.

    Notes
    -----
    The n_pieces values of one feature stand side by side, as features with a parameter `n_pieces` give them:
    of the columns that are divided, X[:, j n_pieces + i] is feature j of piece i. Features are compared
    between pieces, so what scales columns one by one should stand inside `estimator`. Where all pieces of a
    recording are the same (it was too short to be divided), they count as one.

    The voter of the whole learns from n samples of a class, pieces from n_pieces n: of single recordings it
    cannot know what varies, so its weight grows with n.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> X = rng.standard_normal((60, 8)) + np.repeat([[0.0], [2.0]], 30, axis=0)
    >>> y = np.repeat(["felt", "glass"], 30)
    >>> SegmentVoting(n_pieces=4).fit(X, y).predict([[0.0] * 8, [2.0] * 8]).tolist()
    ['felt', 'glass']
    """

    undivided: tuple[int, ...] = ()  # of models of before, which have none
    known_changes: bool = False
    columns: tuple[str, ...] = ()
    weight_: float = 0.5  # of models of before, for any number of recordings

    def __init__(
        self,
        estimator: Any = None,
        *,
        n_pieces: int = 1,
        whole_weight: float = 1.0,
        undivided: tuple[int, ...] = (),
        known_changes: bool = False,
        columns: tuple[str, ...] = (),
    ) -> None:
        self.estimator = estimator
        self.n_pieces = n_pieces
        self.whole_weight = whole_weight
        self.undivided = undivided
        self.known_changes = known_changes
        self.columns = columns

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn from all pieces of all recordings.

        Parameters
        ----------
        X : array_like of shape (n_recordings, n_columns)
            Finite features, the pieces of each side by side, and columns of the whole.
        y : array_like of shape (n_recordings,)
            Labels of at least two classes.

        Raises
        ------
        ValueError
            If the number of columns of pieces is not a multiple of `n_pieces`, `undivided` names others than
            columns of X, there are not as many names as columns, or as `estimator` does.
        """
        check_scalar(self.n_pieces, "n_pieces", Integral, min_val=1)
        check_scalar(self.whole_weight, "whole_weight", Real, min_val=0)
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        self.classes_ = np.unique(labels)
        if len(self.classes_) < 2:
            raise ValueError("y holds 1 class; the rule is at least 2")
        if not np.isin(self.undivided, np.arange(rows.shape[1])).all():
            raise ValueError(f"undivided is {self.undivided}; the rule is columns 0 to {rows.shape[1] - 1}")
        if self.columns and len(self.columns) != rows.shape[1]:
            raise ValueError(
                f"{len(self.columns)} names of columns; the rule is one a column, {rows.shape[1]}"
            )
        columns, n_pieces = self.columns_
        pieces, owner = pieces_of(rows[:, columns], n_pieces)
        of_whole = {"changes": changes_of(self.columns)} if self.columns else {}
        # All pieces change alike: the columns of the first are those of any.
        of_piece = {name: changes[:, columns[::n_pieces]] for name, changes in of_whole.items()}
        self.estimator_ = self._unfitted().fit(pieces, labels[owner], **of_piece)
        more = len(pieces) > len(rows) and not self.undivided and self.whole_weight > 0
        self.whole_ = self._unfitted().fit(rows, labels, **of_whole) if more else None
        n = int(np.unique(labels, return_counts=True)[1].min())
        self.weight_ = float(self.whole_weight) * n / (n + 1)
        return self

    @property
    def columns_(self) -> tuple[NDArray[np.intp], int]:
        """Which columns the pieces have, side by side, and how many pieces vote.

        What is of the whole stands in each piece. Where no column is of pieces, a recording is one piece.
        """
        every = np.arange(self.n_features_in_)
        divided = np.setdiff1d(every, self.undivided)
        if not divided.size:
            return every, 1
        of_whole = np.repeat(np.asarray(self.undivided, dtype=np.intp), self.n_pieces)
        return np.append(divided, of_whole), int(self.n_pieces)

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
        columns, n_pieces = self.columns_
        pieces, owner = pieces_of(rows[:, columns], n_pieces)
        decisions = decide(self.estimator_, pieces)
        counts = np.bincount(owner).reshape(-1, *[1] * (decisions.ndim - 1))
        mean = np.add.reduceat(decisions, np.flatnonzero(np.diff(owner, prepend=-1)), axis=0) / counts
        if self.whole_ is None:
            return np.asarray(mean)
        whole = decide(self.whole_, rows)
        return np.asarray((mean + self.weight_ * whole) / (1 + self.weight_))

    def _unfitted(self) -> Any:
        return KernelDiscriminant() if self.estimator is None else clone(self.estimator)


def knowing(classifier: Any, columns: Sequence[str]) -> Any:
    """Return an unfitted classifier that knows, if it lets pieces vote, what is asked of its columns.

    Which are not of pieces; and their names, where it wants known changes.
    """
    if not isinstance(classifier, SegmentVoting):
        return classifier
    facts: dict[str, Any] = {"columns": tuple(columns)} if classifier.known_changes else {}
    if classifier.n_pieces > 1:
        facts["undivided"] = tuple(i for i, column in enumerate(columns) if OF_A_PIECE not in column)
    return clone(classifier).set_params(**facts)


def decisions_of(classifier: Any, rows: Samples) -> Samples:
    """Return a classifier's decisions, or its probabilities where it has no other; of two classes, one."""
    if hasattr(classifier, "decision_function"):
        return np.asarray(classifier.decision_function(rows))
    p = np.asarray(classifier.predict_proba(rows))
    return p[:, 1] - 0.5 if p.shape[1] == 2 else p


def pieces_of(X: Samples, n_pieces: int) -> tuple[Samples, NDArray[np.intp]]:
    """Return the pieces of recordings as rows, and the recording that each belongs to.

    Parameters
    ----------
    X : ndarray of shape (n_recordings, n_features * n_pieces)
        The pieces of each feature side by side.
    n_pieces : int
        Pieces of a recording.

    Returns
    -------
    ndarray of shape (n_rows, n_features)
        n_pieces rows a recording; one where its pieces are all the same.
    ndarray of shape (n_rows,)
        Row of X, ascending.
    """
    n, n_columns = X.shape
    if n_columns % n_pieces:
        raise ValueError(
            f"X has {n_columns} columns; the rule is a multiple of n_pieces = {n_pieces}: "
            "features computed of so many pieces, and all pieces of each"
        )
    pieces = X.reshape(n, -1, n_pieces)
    same = (pieces == pieces[:, :, :1]).all(axis=(1, 2))
    kept = np.ones((n, n_pieces), dtype=bool)
    kept[same, 1:] = False
    owner, piece = np.nonzero(kept)
    return pieces[owner, :, piece], owner


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
    names = [column.rpartition("/")[2].partition(OF_A_PIECE)[0] for column in columns]
    return np.array([known.get(name, nothing) for name in names]).T


@cache
def _known_changes() -> dict[str, Samples]:
    with KNOWN_CHANGES.open(encoding="utf-8", newline="") as file:
        return {name: np.array(values, dtype=np.float64) for name, *values in csv.reader(file)}
