"""Sequential forward selection of columns by cross-validation.

`SubsetScore` computes the score of a subset of columns. For simple classifiers, it prepares each fold only
once (see `closed_form`); all other classifiers are fitted to each subset.
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
"""Row numbers of a training set and its test set."""
Scoring = Literal["accuracy", "log_likelihood"]
TINY = float(np.finfo(np.float64).tiny)
"""Lower limit of a probability before its logarithm is taken."""


class ForwardSelector(SelectorMixin, MetaEstimatorMixin, BaseEstimator):  # type: ignore[misc]
    """Select columns one at a time, each with the best accuracy in an inner cross-validation.

    The selection equals that of `sklearn.feature_selection.SequentialFeatureSelector` with stratified folds,
    including ties. The scores of Gaussian naive Bayes, of the nearest class mean and of the nearest neighbour
    are sums over columns. Linear discriminants need only the class means and one covariance matrix. With
    these classifiers, each inner fold is prepared once. The classifier is fitted to a candidate only if
    rounding could change a prediction: two classes have nearly equal scores, or columns are collinear or
    constant. Any other classifier is fitted to every candidate.

    Unlike scikit-learn's selector, this selector continues if a classifier cannot be fitted. If all columns
    are constant, the most frequent class is predicted. If the covariance is singular, the score is 0.

    Parameters
    ----------
    estimator : classifier
        Classifier whose accuracy is maximised.
    n_features_to_select : int
        Number of columns to select. All columns are selected if X has no more than this.
    cv : int
        Number of inner stratified folds without shuffling (default 3), limited to the size of the smallest
        class.

    Attributes
    ----------
    support_ : ndarray of shape (n_columns,)
        Whether each column is selected.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.naive_bayes import GaussianNB
    >>> y = np.repeat([0, 1], 30)
    >>> X = np.random.default_rng(0).standard_normal((60, 4))
    >>> X[:, 2] += 3 * y
    >>> ForwardSelector(GaussianNB(), n_features_to_select=1).fit(X, y).get_support().tolist()
    [False, False, True, False]
    """

    def __init__(self, estimator: Any, *, n_features_to_select: int, cv: int = 3) -> None:
        self.estimator = estimator
        self.n_features_to_select = n_features_to_select
        self.cv = cv

    def fit(self, X: Samples, y: NDArray[Any]) -> Self:
        """Select the columns of X that best predict y.

        Parameters
        ----------
        X : array_like of shape (n_samples, n_columns)
            Finite features.
        y : array_like of shape (n_samples,)
            Class labels.

        Raises
        ------
        ValueError
            If a class has only one sample.
        """
        X, y = validate_data(self, X, y)
        check_classification_targets(y)
        labels, splits = np.unique(y, return_inverse=True)[1], inner_splits(y, None, self.cv)
        columns = np.arange(X.shape[1])
        if columns.size <= self.n_features_to_select:
            self.support_ = np.ones(columns.size, dtype=bool)
            return self
        score, selected = SubsetScore(self.estimator, X, labels, splits), list[int]()
        while len(selected) < self.n_features_to_select:
            candidates = np.setdiff1d(columns, selected)
            selected.append(
                int(candidates[score.adding(selected, candidates.tolist(), decimals=None).argmax()])
            )
        self.support_ = np.isin(columns, selected)
        return self

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_


def inner_splits(y: NDArray[Any], groups: NDArray[Any] | None, cv: int) -> list[Split]:
    """Return at most `cv` stratified inner folds without shuffling; a group is never divided between folds.

    Raises
    ------
    ValueError
        If a class has only one sample (or group).
    """
    classes, counts = np.unique(y, return_counts=True)
    if groups is not None:
        counts = np.array([np.unique(np.asarray(groups)[y == label]).size for label in classes])
    n_folds = min(cv, int(counts.min()))
    if n_folds < 2:
        rarest, unit = classes[counts.argmin()], "sample" if groups is None else "group"
        raise ValueError(f"selection needs at least 2 {unit}s of each class, got 1 {unit} of class {rarest}")
    folds = StratifiedKFold(n_folds) if groups is None else StratifiedGroupKFold(n_folds)
    return list(folds.split(np.zeros(len(y)), y, groups))


class SubsetScore:
    """Cross-validated score of any subset of columns; larger is better.

    Parameters
    ----------
    estimator : classifier
        Unfitted classifier. It is fitted to every subset, unless `closed_form` supports it.
    X : ndarray of shape (n_samples, n_columns)
        Finite features.
    labels : ndarray of shape (n_samples,)
        Classes 0 ... n_classes - 1.
    splits : list of (train, test)
        Row numbers of the inner folds.
    scoring : {"accuracy", "log_likelihood"}
        Accuracy (default), or the mean log probability of the true class, which can rank columns even if
        their accuracies are all close to 1. A classifier without probabilities is scored by accuracy.
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
            closed_form(fittable, X[train], labels[train], X[test])
            for fittable, (train, test) in zip(self.estimators, splits, strict=True)
        ]
        if any(self.forms):
            has_probabilities = isinstance(estimator, GaussianNB | LinearDiscriminantAnalysis)
        else:
            has_probabilities = hasattr(estimator, "predict_proba")
        self.is_log_likelihood = scoring == "log_likelihood" and has_probabilities
        self._means: dict[tuple[int, ...], float] = {}

    def of(self, columns: Sequence[int]) -> float:
        """Return the score of a subset of columns; an empty subset is scored by the class proportions."""
        if not len(columns):
            shares = np.bincount(self.labels) / len(self.labels)
            return float(shares @ np.log(shares)) if self.is_log_likelihood else float(shares.max())
        return float(self.adding(columns[:-1], columns[-1:])[0])

    def adding(
        self, selected: Sequence[int], candidates: Sequence[int], decimals: int | None = 12
    ) -> Samples:
        """Return the score of `selected` with each candidate added in turn, shape (n_candidates,).

        The mean of the same numbers in another order may differ in the last digits, so scores are rounded to
        `decimals`. If `decimals` is None, they equal the result of `sklearn.model_selection.cross_val_score`.
        """
        keys = [tuple(sorted((*selected, c))) for c in candidates]
        new = [c for c, key in zip(candidates, keys, strict=True) if key not in self._means]
        if new:
            with quiet_fits():
                folds = [self._fold_scores(i, selected, new) for i in range(len(self.splits))]
            for c, scores in zip(new, np.stack(folds, axis=1), strict=True):
                self._means[tuple(sorted((*selected, c)))] = float(scores.mean())
        means = np.array([self._means[key] for key in keys])
        return means if decimals is None else means.round(decimals)

    def _fold_scores(self, i: int, selected: Sequence[int], candidates: Sequence[int]) -> Samples:
        """Score candidates on one fold; fit the classifier if rounding could change a prediction."""
        form, (train, test) = self.forms[i], self.splits[i]
        scores = np.full(len(candidates), np.nan)
        if form is not None:
            class_scores, error = form(list(selected), np.asarray(candidates, dtype=np.intp))
            classes, truth = np.unique(self.labels[train]), self.labels[test]
            if self.is_log_likelihood:
                scores = _log_likelihood(log_softmax(class_scores, axis=2), classes, truth)
                is_certain = np.isfinite(error)
            else:
                scores = (classes[class_scores.argmax(axis=2)] == truth).mean(axis=1)
                second, best = np.moveaxis(np.partition(class_scores, -2, axis=2)[:, :, -2:], 2, 0)
                is_certain = (best - second > error[:, None]).all(axis=1)
            scores[~is_certain] = np.nan
        for j in np.flatnonzero(np.isnan(scores)):
            scores[j] = self._refitted(i, sorted((*selected, candidates[int(j)])))
        return scores

    def _refitted(self, i: int, columns: list[int]) -> float:
        # Select columns in order, then rows, as scikit-learn does, for the same rounding.
        X, (train, test) = self.X[:, columns], self.splits[i]
        truth = self.labels[test]
        try:
            fitted = fit_varying(self.estimators[i], X[train], self.labels[train])
        except np.linalg.LinAlgError:
            return float(np.log(TINY)) if self.is_log_likelihood else 0.0
        if not self.is_log_likelihood:
            return float(np.mean(fitted.predict(X[test]) == truth))
        log_p = np.log(np.maximum(fitted.predict_proba(X[test]), TINY))
        return float(_log_likelihood(log_p, fitted.classes_, truth))


def _fittable(estimator: Any, labels: Labels) -> Any:
    """Replace linear discriminants by the nearest class mean if there is only one sample of each class."""
    is_single = len(np.unique(labels)) == len(labels)
    return NearestCentroid() if is_single and isinstance(estimator, LinearDiscriminantAnalysis) else estimator


def _log_likelihood(log_p: Samples, classes: Labels, truth: Labels) -> Samples:
    """Return the mean over `log_p` (..., n_test, n_classes) of the log probability of the true class.

    A class without training samples counts as log `TINY`.
    """
    column = np.minimum(np.searchsorted(classes, truth), len(classes) - 1)
    true_log_p = log_p[..., np.arange(truth.size), column]
    return np.asarray(np.where(classes[column] == truth, true_log_p, np.log(TINY)).mean(axis=-1))
