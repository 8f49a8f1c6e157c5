"""Sequential forward selection, fast where a classifier's cross-validated scores have a closed form."""

from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, MetaEstimatorMixin
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.feature_selection import SelectorMixin, SequentialFeatureSelector
from sklearn.model_selection import StratifiedKFold
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.recording import Samples

Labels = NDArray[np.intp]
Predict = Callable[[list[int], Labels], Labels]
"""(columns selected so far, candidates) -> predicted classes of shape (n_candidates, n_test)."""

COLLINEAR = 1e-8
"""Relative eigenvalue of the within-class correlation below which a direction is dropped, as sklearn does."""


class ForwardSelector(SelectorMixin, MetaEstimatorMixin, BaseEstimator):  # type: ignore[misc]
    """Add columns one by one, each time the one that helps the classifier most in an inner cross-validation.

    The choice is that of `sklearn.feature_selection.SequentialFeatureSelector` with stratified folds.
    The scores of Gaussian naive Bayes, of the nearest class mean and of the nearest neighbour add up over
    columns, and linear discriminants need only the class means and one covariance; so each inner fold is
    fitted once and candidates are compared without fitting again: 40 to 360 times faster than refitting
    (12 of 20 columns, 24 to 69 classes of 9 samples). Any other classifier goes to scikit-learn's selector.

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
        classes, labels = np.unique(y, return_inverse=True)
        n_folds = min(self.cv, int(np.bincount(labels).min()))
        if n_folds < 2:
            lonely = classes[np.bincount(labels).argmin()]
            raise ValueError(f"class {lonely} has 1 sample to train on; selection needs at least 2 of each")
        if X.shape[1] <= self.n_features_to_select:
            self.support_ = np.ones(X.shape[1], dtype=bool)
        else:
            self.support_ = self._select(X, labels, n_folds)
        return self

    def _select(self, X: Samples, labels: Labels, n_folds: int) -> NDArray[np.bool_]:
        splits = list(StratifiedKFold(n_folds).split(X, labels))
        found = [_closed_form(self.estimator, X[a], labels[a], X[b]) for a, b in splits]
        predict = [p for p in found if p is not None]
        n_select = self.n_features_to_select
        if len(predict) < n_folds:
            search = SequentialFeatureSelector(self.estimator, n_features_to_select=n_select, cv=n_folds)
            support: NDArray[np.bool_] = search.fit(X, labels).get_support()
            return support
        selected = forward_search(predict, [labels[b] for _, b in splits], X.shape[1], n_select)
        return np.isin(np.arange(X.shape[1]), selected)

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_


def forward_search(predict: list[Predict], truths: list[Labels], n_columns: int, n_select: int) -> list[int]:
    """Return the columns in the order in which they were added; of equal candidates the first wins.

    Parameters
    ----------
    predict : list of callable
        The predictions of each inner fold.
    truths : list of ndarray of shape (n_test,)
        Labels of each inner fold's test samples.
    n_columns, n_select : int
        Size of the pool and of the selection.
    """
    selected: list[int] = []
    while len(selected) < n_select:
        candidates = np.setdiff1d(np.arange(n_columns), selected)
        folds = [
            (predicted(selected, candidates) == truth).mean(axis=1)
            for predicted, truth in zip(predict, truths, strict=True)
        ]
        # Rounded, so that equal candidates are equal.
        selected.append(int(candidates[np.mean(folds, axis=0).round(12).argmax()]))
    return selected


def _closed_form(estimator: Any, train: Samples, labels: Labels, test: Samples) -> Predict | None:
    """Return the predictions of a fold, or None when the classifier has no closed form here."""
    kind = type(estimator)
    if kind is GaussianNB and estimator.priors is None:
        terms = _gaussian_terms(train, labels, test, estimator.var_smoothing)
        return _additive(terms, _log_priors(labels), np.arange(labels.max() + 1))
    if kind is NearestCentroid and _plain_centroid(estimator):
        means = _class_means(train, labels)
        return _additive(_distance_terms(means, test), np.zeros(len(means)), np.arange(len(means)))
    if kind is KNeighborsClassifier and _plain_neighbour(estimator):
        return _additive(_distance_terms(train, test), np.zeros(len(train)), labels)
    if kind is LinearDiscriminantAnalysis and _plain_discriminant(estimator):
        return _discriminant(train, labels, test, float(estimator.shrinkage or 0.0))
    return None


def _plain_centroid(estimator: Any) -> bool:
    uniform = getattr(estimator, "priors", "uniform") == "uniform"
    return bool(estimator.metric == "euclidean" and estimator.shrink_threshold is None and uniform)


def _plain_neighbour(estimator: Any) -> bool:
    euclidean = estimator.metric == "euclidean" or (estimator.metric == "minkowski" and estimator.p == 2)
    return bool(estimator.n_neighbors == 1 and euclidean)


def _plain_discriminant(estimator: Any) -> bool:
    plain = estimator.priors is None and estimator.covariance_estimator is None
    return bool(plain) and (estimator.shrinkage is None or isinstance(estimator.shrinkage, int | float))


def _additive(terms: Samples, constant: Samples, labels: Labels) -> Predict:
    """Predict the label of the largest score; terms (n_columns, n_test, n_labels) add up over columns."""

    def predict(selected: list[int], candidates: Labels) -> Labels:
        scores = terms[candidates] + (terms[selected].sum(axis=0) + constant)
        return np.asarray(labels[scores.argmax(axis=2)])

    return predict


def _gaussian_terms(train: Samples, labels: Labels, test: Samples, smoothing: float) -> Samples:
    # log N(x; mean, variance) of each column, sample and class, without -log(2 pi) / 2.
    mean = _class_means(train, labels)
    variance = _class_means((train - mean[labels]) ** 2, labels) + smoothing * train.var(axis=0).max()
    variance = np.maximum(variance, np.finfo(np.float64).tiny)
    mean, variance = mean.T[:, None, :], variance.T[:, None, :]
    return np.asarray(-0.5 * (np.log(variance) + (test.T[:, :, None] - mean) ** 2 / variance))


def _distance_terms(prototypes: Samples, test: Samples) -> Samples:
    return np.asarray(-((test.T[:, :, None] - prototypes.T[:, None, :]) ** 2))


def _discriminant(train: Samples, labels: Labels, test: Samples, shrinkage: float) -> Predict:
    """Linear discriminants of any subset of columns, from class means m and the within-class covariance W.

    score = (x - m / 2)' W^-1 m + log prior, W shrunk towards a multiple of the identity within the subset.
    """
    means, log_priors = _class_means(train, labels), _log_priors(labels)
    residual = train - means[labels]
    # The divisor is sklearn's: n - n_classes in its svd solver, n where shrinkage asks for another solver.
    within = residual.T @ residual / (len(train) - (0 if shrinkage else len(means)))

    def predict(selected: list[int], candidates: Labels) -> Labels:
        columns = np.column_stack([np.tile(selected, (len(candidates), 1)).astype(int), candidates])
        inverse = _inverse(within[columns[:, :, None], columns[:, None, :]], shrinkage)
        m = means[:, columns].swapaxes(0, 1)
        weights = inverse @ m.swapaxes(1, 2)
        bias = log_priors - 0.5 * np.einsum("ckp,cpk->ck", m, weights)
        scores = test[:, columns].swapaxes(0, 1) @ weights + bias[:, None, :]
        return np.asarray(scores.argmax(axis=2))

    return predict


def _inverse(covariance: Samples, shrinkage: float) -> Samples:
    """Pseudo-inverse of covariances (n, p, p) by their correlation, which no unit of a column can upset."""
    p = covariance.shape[1]
    level = np.trace(covariance, axis1=1, axis2=2)[:, None, None] / p
    covariance = (1 - shrinkage) * covariance + shrinkage * level * np.eye(p)
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    deviation = np.where(deviation > 0, deviation, 1.0)
    scale = deviation[:, :, None] * deviation[:, None, :]
    return np.asarray(np.linalg.pinv(covariance / scale, rcond=COLLINEAR, hermitian=True) / scale)


def _class_means(values: Samples, labels: Labels) -> Samples:
    one_hot = np.eye(int(labels.max()) + 1)[labels]
    return np.asarray(one_hot.T @ values / one_hot.sum(axis=0)[:, None])


def _log_priors(labels: Labels) -> Samples:
    return np.asarray(np.log(np.bincount(labels) / len(labels)))
