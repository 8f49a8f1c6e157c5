"""Selection of columns by cross-validation, fast where a classifier's scores have a closed form.

`SubsetScore` returns the score of a subset of columns. For the simplest classifiers it prepares each fold
once, not once per subset (`closed_form`); all other classifiers are fitted to each subset.
"""

from collections.abc import Sequence
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax
from sklearn.base import BaseEstimator, MetaEstimatorMixin
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.feature_selection import SelectorMixin
from sklearn.model_selection import StratifiedGroupKFold, StratifiedKFold
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import NearestCentroid
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.classifiers.closed_form_scores import Labels, closed_form
from texclass.classifiers.fitting import fit_varying, quiet_fits
from texclass.recording import Samples

Split = tuple[Labels, Labels]
"""Row numbers of a training set and of its test set."""
Scoring = Literal["accuracy", "log_likelihood"]
TINY = float(np.finfo(np.float64).tiny)


class ForwardSelector(SelectorMixin, MetaEstimatorMixin, BaseEstimator):  # type: ignore[misc]
    """Add columns one by one, each time the one that helps the classifier most in an inner cross-validation.

    The choice is that of `sklearn.feature_selection.SequentialFeatureSelector` with stratified folds, ties
    included. The scores of Gaussian naive Bayes, of the nearest class mean and of the nearest neighbour are
    sums over columns, and linear discriminants need only the class means and one covariance. With these
    classifiers each inner fold is prepared once, and a candidate is fitted only where rounding could change a
    prediction: two classes score alike, or columns are collinear or constant. Any other classifier is fitted
    to every candidate.

    Unlike scikit-learn's, the selector does not stop where a classifier cannot be fitted: constant columns
    predict the commonest class, and a singular covariance scores 0.

    Parameters
    ----------
    estimator : classifier
        Whose accuracy decides.
    n_features_to_select : int
        Number of columns; all are kept when there are not more.
    cv : int
        Inner stratified folds, not shuffled; reduced to the size of the smallest class.

    Attributes
    ----------
    support_ : ndarray of shape (n_columns,)
        Which columns are selected.
    """

    def __init__(self, estimator: Any, *, n_features_to_select: int, cv: int = 3) -> None:
        self.estimator = estimator
        self.n_features_to_select = n_features_to_select
        self.cv = cv

    def fit(self, X: Samples, y: NDArray[Any]) -> Self:
        """Select columns.

        Raises
        ------
        ValueError
            If a class has one sample only.
        """
        X, y = validate_data(self, X, y)
        check_classification_targets(y)
        labels, splits = np.unique(y, return_inverse=True)[1], inner_splits(y, None, self.cv)
        every = np.arange(X.shape[1])
        if every.size <= self.n_features_to_select:
            self.support_ = np.ones(every.size, dtype=bool)
            return self
        score, selected = SubsetScore(self.estimator, X, labels, splits), list[int]()
        while len(selected) < self.n_features_to_select:
            candidates = np.setdiff1d(every, selected)
            selected.append(
                int(candidates[score.adding(selected, candidates.tolist(), decimals=None).argmax()])
            )
        self.support_ = np.isin(every, selected)
        return self

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_


def inner_splits(y: NDArray[Any], groups: NDArray[Any] | None, cv: int) -> list[Split]:
    """Return up to `cv` stratified inner folds, not shuffled; samples of one group are never divided.

    Raises
    ------
    ValueError
        If a class has one sample (or one group) only.
    """
    classes, counts = np.unique(y, return_counts=True)
    if groups is not None:
        counts = np.array([np.unique(np.asarray(groups)[y == label]).size for label in classes])
    n_folds = min(cv, int(counts.min()))
    if n_folds < 2:
        lonely, what = classes[counts.argmin()], "sample" if groups is None else "group"
        raise ValueError(f"class {lonely} has 1 {what} to train on; selection needs at least 2 of each")
    folds = StratifiedKFold(n_folds) if groups is None else StratifiedGroupKFold(n_folds)
    return list(folds.split(np.zeros(len(y)), y, groups))


class SubsetScore:
    """Cross-validated score of any subset of columns; larger is better.

    Parameters
    ----------
    estimator : classifier
        Unfitted; see `closed_form` for those that are not fitted to every subset.
    X : ndarray of shape (n_samples, n_columns)
        Finite.
    labels : ndarray of shape (n_samples,)
        0 ... n_classes - 1.
    splits : list of (train, test)
        Inner folds.
    scoring : {"accuracy", "log_likelihood"}
        Accuracy, or the mean log probability of the true class, which still separates columns where the
        accuracy is saturated. For a classifier without probabilities it is the accuracy.
    """

    def __init__(
        self,
        estimator: Any,
        X: Samples,
        labels: Labels,
        splits: Sequence[Split],
        scoring: Scoring = "accuracy",
    ) -> None:
        self.X, self.labels, self.splits = X, labels, splits
        self.estimators = [_fittable(estimator, labels[train]) for train, _ in splits]
        self.forms = [
            closed_form(judge, X[train], labels[train], X[test])
            for judge, (train, test) in zip(self.estimators, splits, strict=True)
        ]
        if any(self.forms):
            has_probabilities = isinstance(estimator, GaussianNB | LinearDiscriminantAnalysis)
        else:
            has_probabilities = hasattr(estimator, "predict_proba")
        self.soft = scoring == "log_likelihood" and has_probabilities
        self._means: dict[tuple[int, ...], float] = {}

    def of(self, columns: Sequence[int]) -> float:
        """Return the score of a subset; of none, that of guessing by the class shares."""
        if not len(columns):
            shares = np.bincount(self.labels) / len(self.labels)
            return float(shares @ np.log(shares)) if self.soft else float(shares.max())
        return float(self.adding(columns[:-1], columns[-1:])[0])

    def adding(
        self, selected: Sequence[int], candidates: Sequence[int], decimals: int | None = 12
    ) -> Samples:
        """Return the score of `selected` with each of the candidates added, shape (n_candidates,).

        Means of the same numbers in another order differ by rounding: with `decimals` they are equal, with
        None they are those of `sklearn.model_selection.cross_val_score`.
        """
        keys = [tuple(sorted((*selected, c))) for c in candidates]
        new = [c for c, key in zip(candidates, keys, strict=True) if key not in self._means]
        if new:
            with quiet_fits():
                folds = [self._of_fold(i, selected, new) for i in range(len(self.splits))]
            for c, scores in zip(new, np.stack(folds, axis=1), strict=True):
                self._means[tuple(sorted((*selected, c)))] = float(scores.mean())
        means = np.array([self._means[key] for key in keys])
        return means if decimals is None else means.round(decimals)

    def _of_fold(self, i: int, selected: Sequence[int], candidates: Sequence[int]) -> Samples:
        """Return the scores of candidates on one fold; fit those of which the closed form is not certain."""
        form, (train, test) = self.forms[i], self.splits[i]
        scores = np.full(len(candidates), np.nan)
        if form is not None:
            of_classes, error = form(list(selected), np.asarray(candidates, dtype=np.intp))
            classes, truth = np.unique(self.labels[train]), self.labels[test]
            if self.soft:
                scores = _log_likelihood(log_softmax(of_classes, axis=2), classes, truth)
                certain = np.isfinite(error)
            else:
                scores = (classes[of_classes.argmax(axis=2)] == truth).mean(axis=1)
                second, best = np.moveaxis(np.partition(of_classes, -2, axis=2)[:, :, -2:], 2, 0)
                certain = (best - second > error[:, None]).all(axis=1)
            scores[~certain] = np.nan
        for j in np.flatnonzero(np.isnan(scores)):
            scores[j] = self._refitted(i, sorted((*selected, candidates[int(j)])))
        return scores

    def _refitted(self, i: int, columns: list[int]) -> float:
        # Columns in order and rows taken from them, as scikit-learn does: the same rounding.
        X, (train, test) = self.X[:, columns], self.splits[i]
        truth = self.labels[test]
        try:
            fitted = fit_varying(self.estimators[i], X[train], self.labels[train])
        except np.linalg.LinAlgError:
            return float(np.log(TINY)) if self.soft else 0.0
        if not self.soft:
            return float(np.mean(fitted.predict(X[test]) == truth))
        log_p = np.log(np.maximum(fitted.predict_proba(X[test]), TINY))
        return float(_log_likelihood(log_p, fitted.classes_, truth))


def _fittable(estimator: Any, labels: Labels) -> Any:
    """Return the classifier, or the nearest class mean where a discriminant has one sample of each class."""
    alone = len(np.unique(labels)) == len(labels)
    return NearestCentroid() if alone and isinstance(estimator, LinearDiscriminantAnalysis) else estimator


def _log_likelihood(log_p: Samples, classes: Labels, truth: Labels) -> Samples:
    """Return the mean log probability of the true class, that of `TINY` where the class was not trained.

    `log_p` is of shape (..., n_test, n_classes).
    """
    column = np.minimum(np.searchsorted(classes, truth), len(classes) - 1)
    of_truth = log_p[..., np.arange(truth.size), column]
    return np.asarray(np.where(classes[column] == truth, of_truth, np.log(TINY)).mean(axis=-1))
