"""Scores of classifiers on any subset of columns, without fitting again: once a fold, not once a subset."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid

from texclass.recording import Samples

Labels = NDArray[np.intp]

COLLINEAR = 1e-8
"""Relative eigenvalue of the within-class correlation below which a direction is dropped, as sklearn does."""


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """A classifier fitted on one fold, able to answer for any subset of columns.

    Attributes
    ----------
    scores : callable
        (columns selected so far, candidates) -> scores of shape (n_candidates, n_test, n_prototypes) with
        each candidate added; the largest wins.
    labels : ndarray of shape (n_prototypes,)
        The class of each prototype (a class mean, or for the nearest neighbour a training sample).
    """

    scores: Callable[[list[int], Labels], Samples]
    labels: Labels

    def predict(self, selected: list[int], candidates: Labels) -> Labels:
        """Return the predicted classes, shape (n_candidates, n_test)."""
        return np.asarray(self.labels[self.scores(selected, candidates).argmax(axis=2)])


def closed_form(estimator: Any, train: Samples, labels: Labels, test: Samples) -> ClosedForm | None:
    """Return the scores of a fold, or None when the classifier has no closed form here.

    Parameters
    ----------
    estimator : classifier
        Unfitted: `GaussianNB`, `NearestCentroid`, one nearest neighbour or `LinearDiscriminantAnalysis`,
        their parameters nearly as they come.
    train, test : ndarray of shape (n_samples, n_columns)
        Of the fold.
    labels : ndarray of shape (n_train,)
        0 ... n_classes - 1.
    """
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


def _additive(terms: Samples, constant: Samples, labels: Labels) -> ClosedForm:
    """Scores that are sums of terms (n_columns, n_test, n_prototypes) over columns."""

    def scores(selected: list[int], candidates: Labels) -> Samples:
        return np.asarray(terms[candidates] + (terms[selected].sum(axis=0) + constant))

    return ClosedForm(scores, labels)


def _gaussian_terms(train: Samples, labels: Labels, test: Samples, smoothing: float) -> Samples:
    # log N(x; mean, variance) of each column, sample and class, without -log(2 pi) / 2.
    mean = _class_means(train, labels)
    variance = _class_means((train - mean[labels]) ** 2, labels) + smoothing * train.var(axis=0).max()
    variance = np.maximum(variance, np.finfo(np.float64).tiny)
    mean, variance = mean.T[:, None, :], variance.T[:, None, :]
    return np.asarray(-0.5 * (np.log(variance) + (test.T[:, :, None] - mean) ** 2 / variance))


def _distance_terms(prototypes: Samples, test: Samples) -> Samples:
    return np.asarray(-((test.T[:, :, None] - prototypes.T[:, None, :]) ** 2))


def _discriminant(train: Samples, labels: Labels, test: Samples, shrinkage: float) -> ClosedForm:
    """Linear discriminants of any subset of columns, from class means m and the within-class covariance W.

    score = (x - m / 2)' W^-1 m + log prior, W shrunk towards a multiple of the identity within the subset.
    """
    means, log_priors = _class_means(train, labels), _log_priors(labels)
    residual = train - means[labels]
    # The divisor is sklearn's: n - n_classes in its svd solver, n where shrinkage asks for another solver.
    within = residual.T @ residual / (len(train) - (0 if shrinkage else len(means)))

    def scores(selected: list[int], candidates: Labels) -> Samples:
        columns = np.column_stack([np.tile(selected, (len(candidates), 1)).astype(int), candidates])
        inverse = _inverse(within[columns[:, :, None], columns[:, None, :]], shrinkage)
        m = means[:, columns].swapaxes(0, 1)
        weights = inverse @ m.swapaxes(1, 2)
        bias = log_priors - 0.5 * np.einsum("ckp,cpk->ck", m, weights)
        return np.asarray(test[:, columns].swapaxes(0, 1) @ weights + bias[:, None, :])

    return ClosedForm(scores, np.arange(len(means)))


def _inverse(covariance: Samples, shrinkage: float) -> Samples:
    """Pseudo-inverse of covariances (n, p, p) by their correlation, which no unit of a column can upset."""
    p = covariance.shape[1]
    level = np.trace(covariance, axis1=1, axis2=2)[:, None, None] / p
    covariance = (1 - shrinkage) * covariance + shrinkage * level * np.eye(p)
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    deviation = np.where(deviation > 0, deviation, 1.0)
    scale = deviation[:, :, None] * deviation[:, None, :]
    if shrinkage > COLLINEAR**0.5 and (level > 0).all():  # positive definite: ten times faster
        return np.asarray(np.linalg.inv(covariance / scale) / scale)
    return np.asarray(np.linalg.pinv(covariance / scale, rcond=COLLINEAR, hermitian=True) / scale)


def _class_means(values: Samples, labels: Labels) -> Samples:
    one_hot = np.eye(int(labels.max()) + 1)[labels]
    return np.asarray(one_hot.T @ values / one_hot.sum(axis=0)[:, None])


def _log_priors(labels: Labels) -> Samples:
    return np.asarray(np.log(np.bincount(labels) / len(labels)))
