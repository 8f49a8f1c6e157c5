"""Closed-form class scores of any subset of columns, for feature selection with simple classifiers.

The scores of Gaussian naive Bayes, the nearest class mean and the nearest neighbour are sums over columns;
linear discriminants need only the class means and one covariance matrix. Each fold is therefore prepared once
for all subsets.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid

from texclass.classifiers.kernel_discriminant import class_means
from texclass.recording import Samples

Labels = NDArray[np.intp]
Scores = Callable[[list[int], Labels], tuple[Samples, Samples]]
"""Function of the selected columns and the candidates. It returns the class scores with each candidate added,
shape (n_candidates, n_test, n_classes), and a bound on their rounding error, shape (n_candidates,). The bound
is infinite if the classifier must be fitted instead."""
ROUNDING = 1e-11
"""Bound on the rounding error of a score, computed here or by scikit-learn, relative to the largest term of
its sum."""
FLAT = 1e-6
"""Within-class standard deviation, relative to the largest magnitude of a column, below which rounding errors
dominate."""
COLLINEAR = 1e-6
"""Smallest eigenvalue of a correlation matrix for which the closed form is used."""


def closed_form(estimator: Any, train: Samples, labels: Labels, test: Samples) -> Scores | None:
    """Return a function that computes the class scores of any subset of columns.

    Parameters
    ----------
    estimator : classifier
        Unfitted `GaussianNB`, `NearestCentroid`, `KNeighborsClassifier` with one neighbour, or
        `LinearDiscriminantAnalysis` with any solver and a fixed shrinkage. Priors must have their default
        value, and the metric must be Euclidean.
    train, test : ndarray of shape (n_samples, n_columns)
        Training set and test set of the fold.
    labels : ndarray of shape (n_train,)
        Class of each row of the training set.

    Returns
    -------
    callable or None
        Function described under `Scores`; the class with the largest score is predicted. Classes are in the
        order of `np.unique`. None if the estimator has no closed form.
    """
    classes, labels = np.unique(labels, return_inverse=True)
    kind, priors = type(estimator), getattr(estimator, "priors", None)
    if len(classes) < 2:
        return None
    if kind is GaussianNB and priors is None:
        return _naive_bayes(train, labels, test, estimator.var_smoothing)
    if kind is NearestCentroid:
        plain = estimator.metric == "euclidean" and estimator.shrink_threshold is None
        means = class_means(train, labels)
        return _nearest(means, np.arange(len(means)), test) if plain and priors == "uniform" else None
    if kind is KNeighborsClassifier:
        euclidean = (estimator.metric, estimator.p) == ("minkowski", 2) or estimator.metric == "euclidean"
        plain = euclidean and estimator.n_neighbors == 1 and estimator.metric_params is None
        return _nearest(train, labels, test) if plain else None
    if kind is LinearDiscriminantAnalysis and priors is None and estimator.covariance_estimator is None:
        return _discriminant(estimator, train, labels, test)
    return None


def _nearest(prototypes: Samples, labels: Labels, test: Samples) -> Scores:
    """Score each class by its nearest prototype m, for which sum(x m - m^2/2) is largest."""
    order = np.argsort(labels, kind="stable")
    starts, m = np.flatnonzero(np.diff(labels[order], prepend=-1)), prototypes[order].T[:, None, :]
    terms = test.T[:, :, None] * m - m**2 / 2
    magnitude = np.maximum(np.abs(prototypes).max(axis=0), np.abs(test).max(axis=0)) ** 2

    def scores(selected: list[int], candidates: Labels) -> tuple[Samples, Samples]:
        sums = terms[candidates] + terms[selected].sum(axis=0)
        best = sums if len(starts) == len(labels) else np.maximum.reduceat(sums, starts, axis=2)
        return best, ROUNDING * (magnitude[candidates] + magnitude[selected].sum())

    return scores


def _naive_bayes(train: Samples, labels: Labels, test: Samples, var_smoothing: float) -> Scores:
    """Score each class by naive Bayes: log prior + sum over columns of log N(x; m, v + e).

    The constant log(2 pi)/2 is omitted. e is `var_smoothing` times the largest variance of a column in the
    subset.
    """
    m, total = class_means(train, labels), train.var(axis=0)
    v = class_means((train - m[labels]) ** 2, labels)
    log_priors = np.log(np.bincount(labels) / len(labels))
    largest = np.maximum(np.abs(train).max(axis=0), np.abs(test).max(axis=0))

    def terms(columns: Any, variance: float) -> tuple[Samples, Samples]:
        ve = (v[:, columns] + var_smoothing * variance).T[:, None, :]
        flat = np.sqrt(ve.min(axis=(1, 2))) <= FLAT * largest[columns]
        ve = np.where(ve > 0, ve, 1.0)
        # log N(x; m, v + e)
        log_n = -0.5 * (np.log(ve) + (test.T[columns, :, None] - m.T[columns, None, :]) ** 2 / ve)
        return log_n, np.where(flat, np.inf, ROUNDING * np.abs(log_n).max(axis=(1, 2)))

    def scores(selected: list[int], candidates: Labels) -> tuple[Samples, Samples]:
        shared = float(total[selected].max(initial=0.0))
        log_n, error = terms(candidates, shared)
        selected_log_n, selected_error = (
            terms(selected, shared) if selected else (np.zeros((1, 1, 1)), np.zeros(1))
        )
        sums, errors = log_n + (selected_log_n.sum(axis=0) + log_priors), error + selected_error.sum()
        for i in np.flatnonzero(total[candidates] > shared):  # these raise the variance that e depends on
            log_n, error = terms([*selected, candidates[i]], float(total[candidates[i]]))
            sums[i], errors[i] = log_n.sum(axis=0) + log_priors, error.sum()
        return sums, errors

    return scores


@cache
def svd_degrees_of_freedom_per_class() -> float:
    """Return c, where n - c n_classes is the divisor of the covariance in scikit-learn's svd solver.

    c is 1 up to scikit-learn 1.8, and 0 from version 1.9 on. It is determined from a small example, in which
    the class means are 1 and 12 and the scatter is 2 + 8: the fitted coefficient is
    (12 - 1)/(scatter/divisor).
    """
    fitted = LinearDiscriminantAnalysis().fit([[0.0], [2.0], [10.0], [12.0], [14.0]], [0, 0, 1, 1, 1])
    divisor = float(fitted.coef_[0, 0]) * 10 / 11
    return round((5 - divisor) / 2, 9)


def _discriminant(estimator: Any, train: Samples, labels: Labels, test: Samples) -> Scores | None:
    """Score each class by its linear discriminant, x' W^-1 m - m' W^-1 m/2 + log prior.

    m is the class mean. W is the within-class covariance of the subset, shrunk towards a multiple of the
    identity. The result is None if the solver is unknown or does not support the shrinkage.
    """
    svd, shrinkage, counts = estimator.solver == "svd", estimator.shrinkage, np.bincount(labels)
    if estimator.solver not in ("svd", "lsqr", "eigen") or (svd and shrinkage is not None):
        return None
    if not isinstance(shrinkage, int | float | None):
        return None
    shrinkage, tol = float(shrinkage or 0.0), estimator.tol if svd else 0.0
    divisor = len(train) - (svd_degrees_of_freedom_per_class() * len(counts) if svd else 0)
    if divisor <= 0:
        return None
    means, shares = class_means(train, labels), counts / len(train)
    residual = train - means[labels]
    within_class = residual.T @ residual / divisor
    largest = np.maximum(np.abs(train).max(axis=0), np.abs(test).max(axis=0))
    is_flat = np.sqrt(np.diagonal(within_class)) <= FLAT * largest
    centre = shares @ means

    def scores(selected: list[int], candidates: Labels) -> tuple[Samples, Samples]:
        columns = np.column_stack([np.tile(selected, (len(candidates), 1)).astype(int), candidates])
        deviation, whitening, smallest = _whitening(
            within_class[columns[:, :, None], columns[:, None, :]], shrinkage
        )
        x, m = ((a - centre)[:, columns].swapaxes(0, 1) @ whitening for a in (test, means))
        magnitude = ((largest[columns] / deviation) ** 2).sum(axis=1) / smallest
        doubtful = is_flat[columns].any(axis=1) | (smallest < max(COLLINEAR, 2 * tol**2))
        if svd:
            doubtful |= _is_truncated(np.sqrt(counts)[:, None] * m, tol)
        # x' W^-1 m - m' W^-1 m/2 + log prior, whitened, from the common centre
        class_scores = x @ m.swapaxes(1, 2) + (np.log(shares) - 0.5 * (m**2).sum(axis=2))[:, None, :]
        return class_scores, np.where(doubtful, np.inf, ROUNDING * magnitude)

    return scores


def _whitening(covariance: Samples, shrinkage: float) -> tuple[Samples, Samples, Samples]:
    """Whiten n covariance matrices W, shape (n, p, p), after shrinkage.

    Return the standard deviations, shape (n, p), matrices B with B B' = W^-1, shape (n, p, p), and the
    smallest eigenvalue of each correlation matrix, shape (n,). Correlation matrices are inverted instead of
    W, because their eigenvalues do not depend on the units.
    """
    p = covariance.shape[1]
    level = np.trace(covariance, axis1=1, axis2=2)[:, None, None] / p
    covariance = (1 - shrinkage) * covariance + shrinkage * level * np.eye(p)
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    deviation = np.where(deviation > 0, deviation, 1.0)
    eigenvalues, vectors = np.linalg.eigh(covariance / (deviation[:, :, None] * deviation[:, None, :]))
    eigenvalues = np.maximum(eigenvalues, np.finfo(np.float64).eps)
    return deviation, vectors / np.sqrt(eigenvalues)[:, None, :] / deviation[:, :, None], eigenvalues[:, 0]


def _is_truncated(centres: Samples, tol: float) -> NDArray[np.bool_]:
    """Return whether the svd solver may drop a direction of the weighted class centres (n, n_classes, p).

    The solver drops directions whose singular value is below `tol` times the largest one. Singular values
    that are zero up to rounding are ignored here.
    """
    squares = np.linalg.eigvalsh(centres.swapaxes(1, 2) @ centres)
    ratio = squares / np.maximum(squares[:, -1:], np.finfo(np.float64).tiny)
    return np.asarray(((ratio > 1e-13) & (ratio < 2 * tol**2)).any(axis=1))
