"""How good a subset of columns is: a classifier's cross-validated score, in closed form if there is one."""

import warnings
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax
from sklearn.base import clone
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.naive_bayes import GaussianNB

from texclass.experiment.closed_form import Labels, closed_form
from texclass.recording import Samples

Scoring = Literal["accuracy", "log_likelihood"]
Columns = Sequence[int]


class Criterion:
    """Cross-validated score of any subset of columns; larger is better.

    Parameters
    ----------
    estimator : classifier
        Unfitted; fitted once a fold if `closed_form` knows it, else once a fold and subset.
    X : ndarray of shape (n_samples, n_columns)
        Finite.
    labels : ndarray of shape (n_samples,)
        0 ... n_classes - 1.
    splits : list of (train, test)
        Inner folds.
    scoring : {"accuracy", "log_likelihood"}
        Share of hits, or the mean log probability of the true class, which still tells columns apart where
        the accuracy is saturated. For a classifier without probabilities it is the accuracy.
    """

    def __init__(
        self,
        estimator: Any,
        X: Samples,
        labels: Labels,
        splits: list[tuple[Labels, Labels]],
        scoring: Scoring = "accuracy",
    ) -> None:
        self.estimator, self.X, self.labels, self.splits = estimator, X, labels, splits
        found = [closed_form(estimator, X[a], labels[a], X[b]) for a, b in splits]
        self.folds = [fold for fold in found if fold is not None]
        self.fast = len(self.folds) == len(splits)
        probable = isinstance(estimator, GaussianNB | LinearDiscriminantAnalysis)
        if not self.fast:
            probable = hasattr(estimator, "predict_proba")
        self.soft = scoring == "log_likelihood" and probable
        self._known: dict[tuple[int, ...], float] = {}

    def of(self, columns: Columns) -> float:
        """Return the score of a subset; of none, that of guessing by the classes' shares."""
        if not len(columns):
            shares = np.bincount(self.labels) / len(self.labels)
            return float(shares @ np.log(shares)) if self.soft else float(shares.max())
        return float(self.adding(columns[:-1], columns[-1:])[0])

    def adding(self, selected: Columns, candidates: Columns) -> Samples:
        """Return the score of `selected` with each of the candidates added, shape (n_candidates,)."""
        keys = [tuple(sorted((*selected, c))) for c in candidates]
        new = [c for c, key in zip(candidates, keys, strict=True) if key not in self._known]
        if new:
            scores = self._scores(selected, new)
            self._known |= {tuple(sorted((*selected, c))): float(s) for c, s in zip(new, scores, strict=True)}
        return np.array([self._known[key] for key in keys])

    def _scores(self, selected: Columns, candidates: Columns) -> Samples:
        parts = [
            self._closed(i, list(selected), np.asarray(candidates, dtype=np.intp))
            if self.fast
            else np.array([self._refit(i, [*selected, c]) for c in candidates])
            for i in range(len(self.splits))
        ]
        # Rounded, so that equal candidates are equal.
        return np.asarray(np.mean(parts, axis=0).round(12))

    def _closed(self, i: int, selected: list[int], candidates: NDArray[np.intp]) -> Samples:
        fold, truth = self.folds[i], self.labels[self.splits[i][1]]
        if not self.soft:
            return np.asarray((fold.predict(selected, candidates) == truth).mean(axis=1))
        log_p = log_softmax(fold.scores(selected, candidates), axis=2)
        return np.asarray(log_p[:, np.arange(truth.size), truth].mean(axis=1))

    def _refit(self, i: int, columns: list[int]) -> float:
        train, test = self.splits[i]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fitted = clone(self.estimator).fit(self.X[train][:, columns], self.labels[train])
        truth = self.labels[test]
        if not self.soft:
            return float((fitted.predict(self.X[test][:, columns]) == truth).mean())
        p = fitted.predict_proba(self.X[test][:, columns])[np.arange(truth.size), truth]
        return float(np.log(np.maximum(p, np.finfo(np.float64).tiny)).mean())
