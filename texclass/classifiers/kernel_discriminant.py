"""A kernel discriminant for many correlated features and few recordings: closed form, no tuning inside."""

from numbers import Integral, Real
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import check_scalar
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.recording import Samples

Labels = NDArray[np.intp]
BLOCK = 2048
"""Rows of a kernel matrix computed at a time when predicting."""
LEAST_RELEVANCE = 0.1
"""Correlation ratio below which no column falls: classes may differ in spread alone."""
CHANGES_WEIGHT = 3.0
"""Of the covariance of known changes, beside the within-class covariance of the training samples."""
LARGEST_CHANGE = 3.0
"""Standard deviations of a column that a known change may be, for what hardly varied in training."""


class KernelDiscriminant(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Kernel ridge regression on class membership, on two views of the features.

    Materials differ in many features a little, some of them nonlinearly, and most features vary together from
    one stroke to the next. One view takes the features as they are; the other first removes that common
    variation, as a linear discriminant does (within-class whitening, shrunk). The kernel is the mean of both.

    Parameters
    ----------
    length : float
        Length scale of the kernel, in root mean square distances of a sample from the mean.
    ridge : float
        Added to the diagonal of the kernel, whose elements reach 1; what part of a label may be noise.
    shrinkage : float
        Of the within-class covariance towards a multiple of the identity, above 0; 1 switches whitening off.
    relevance : float
        Columns are weighted by their correlation ratio (at least 0.1) to this power; 0: all alike.
    limit : float, optional
        Standard deviations from a column's mean at which its values end; by default they are as they are.
        Features of single taps have long tails: a few values would fill the scale of a column, and one that
        is far out would take a sample away from all others.
    max_samples : int
        Of more training samples so many are drawn, at least one of each class: time grows with their cube.
    max_kb : float, optional
        Kilobytes of the exported discriminant: its numbers are then of few bits, and as many training samples
        are kept as fit, at least one of each class, with the coefficients that serve all of them best. By
        default all are kept, in double precision.
    random_state : int
        Of the drawing.

    Attributes
    ----------
    classes_ : ndarray of shape (n_classes,)
        Labels.
    low_, high_ : ndarray of shape (n_features,)
        Where values end; with a `limit` only.
    views_ : tuple of View
        The linear maps from features to the two views.
    prototypes_ : tuple of ndarray of shape (n_kept, n_features)
        Training samples in each view.
    dual_ : ndarray of shape (n_kept, n_classes)
        Coefficients alpha = (K + ridge W^-1)^-1 Y.

    Notes
    -----
    Y_ik is 1 - 1/K for the sample's class and -1/K for the K - 1 others. W weights samples so that classes
    count alike. The kernel is Matern 3/2, (1 + s) exp(-s) with s = sqrt(3) |x - x'| / length: smooth, with a
    longer reach than a Gaussian. The decision is an estimate of P(class) - 1/K, so that decisions of several
    windows of a recording may be averaged.

    With `max_kb`, alpha minimises the squares of Y - K_nm alpha, weighted by W, plus ridge alpha' K_mm alpha,
    where m samples of n are kept: the subset of regressors (Rasmussen and Williams, Gaussian Processes for
    Machine Learning, 2006, section 8.3.1). Standardised samples and the whitening are rounded to 16 bits
    before K is computed, then alpha to 32: rounding is part of the model, and its export loses nothing.

    Examples
    --------
    >>> import numpy as np
    >>> X = np.random.default_rng(0).standard_normal((60, 5)) + np.repeat([[0.0], [2.0]], 30, axis=0)
    >>> y = np.repeat(["felt", "glass"], 30)
    >>> KernelDiscriminant().fit(X, y).predict([[0.0] * 5, [2.0] * 5]).tolist()
    ['felt', 'glass']
    """

    limit: float | None = None  # of models of before, which have none

    def __init__(
        self,
        *,
        length: float = 1.6,
        ridge: float = 0.04,
        shrinkage: float = 0.5,
        relevance: float = 0.5,
        limit: float | None = None,
        max_samples: int = 10_000,
        max_kb: float | None = None,
        random_state: int = 0,
    ) -> None:
        self.length = length
        self.ridge = ridge
        self.shrinkage = shrinkage
        self.relevance = relevance
        self.limit = limit
        self.max_samples = max_samples
        self.max_kb = max_kb
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike, changes: Samples | None = None) -> Self:
        """Learn views, prototypes and coefficients.

        Parameters
        ----------
        X : array_like of shape (n_samples, n_features)
            Finite features; their scales do not matter.
        y : array_like of shape (n_samples,)
            Labels of at least two classes.
        changes : ndarray of shape (n_changes, n_features), optional
            What is known to change samples of one class, in the units of X: what few samples do not show. It
            is whitened as what they show is, and makes the columns that it changes count less.

        Raises
        ------
        TypeError, ValueError
            If a parameter is of another kind or out of its range, there is one class only, changes have not
            the columns of X, or not a sample of each class is within `max_kb`.
        """
        for name in ("length", "ridge"):
            check_scalar(getattr(self, name), name, Real, min_val=0, include_boundaries="neither")
        check_scalar(self.shrinkage, "shrinkage", Real, min_val=0, max_val=1, include_boundaries="right")
        check_scalar(self.relevance, "relevance", Real, min_val=0)
        check_scalar(self.max_samples, "max_samples", Integral, min_val=2)
        if self.limit is not None:
            check_scalar(self.limit, "limit", Real, min_val=0, include_boundaries="neither")
        if self.max_kb is not None:
            check_scalar(self.max_kb, "max_kb", Real, min_val=0, include_boundaries="neither")
        rows, given = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(given)
        if changes is not None and changes.shape[1] != rows.shape[1]:
            raise ValueError(
                f"changes have {changes.shape[1]} columns; the rule is those of X, {rows.shape[1]}"
            )
        self.classes_, labels = np.unique(given, return_inverse=True)
        n_classes = self.classes_.size
        if n_classes < 2:
            raise ValueError("y holds 1 class; the rule is at least 2")
        kept = drawn(labels, self.max_samples, self.random_state)
        rows, labels = rows[kept], labels[kept]
        if self.limit is not None:
            mean, reach = rows.mean(axis=0), self.limit * rows.std(axis=0)
            self.low_, self.high_ = mean - reach, mean + reach
        rows = self._limited(rows)
        shrinkages = (1.0,) if self.shrinkage == 1 else (1.0, self.shrinkage)
        self.views_ = tuple(view_of(rows, labels, part, self.relevance, changes) for part in shrinkages)
        weight = (labels.size / n_classes / np.bincount(labels))[labels]
        Y = np.eye(n_classes)[labels] - 1 / n_classes
        if self.max_kb is not None:
            self._fit_few(rows, labels, weight[:, None], Y)
            return self
        self.prototypes_ = tuple(view(rows) for view in self.views_)
        K = self._kernel(self.prototypes_)
        K.flat[:: labels.size + 1] += self.ridge / weight
        self.dual_ = linalg.solve(K, Y, assume_a="pos", overwrite_a=True)
        return self

    def _fit_few(self, rows: Samples, labels: Labels, weight: Samples, Y: Samples) -> None:
        """Keep the samples that are within `max_kb`, and the coefficients that serve all of them best."""
        n_features, n_classes, n_views = rows.shape[1], Y.shape[1], len(self.views_)
        # Means, scales and weights of columns; the whitening. A sample, its lengths, its coefficients.
        n_limits = 0 if self.limit is None else 2
        of_views = (16 + 16 * n_views + 8 * n_limits) * n_features + 2 * n_features**2 * (n_views - 1)
        of_one = 2 * n_features + 8 * n_views + 4 * n_classes
        n_kept = int((1000 * (self.max_kb or 0) - of_views) // of_one)
        if n_kept < n_classes:
            least = (of_views + n_classes * of_one) / 1000
            raise ValueError(
                f"max_kb is {self.max_kb:g}; the rule is at least {least:g}, "
                f"for {n_features} features and a sample of each of {n_classes} classes"
            )
        kept = rows[drawn(labels, n_kept, self.random_state)]
        for view in self.views_:
            view.weights = _in(np.float16, view.weights) if view.weights.ndim > 1 else view.weights
        self.prototypes_ = tuple(view.seen(_in(np.float16, view.standardised(kept))) for view in self.views_)
        # With K_mm = V l V', beta of F = K_nm V l^(-1/2) is a plain ridge regression.
        values, vectors = linalg.eigh(self._kernel(self.prototypes_), driver="evd")
        sure = values > values[-1] * len(values) * np.finfo(float).eps
        root = vectors[:, sure] / np.sqrt(values[sure])
        F = self._kernel([view(rows) for view in self.views_]) @ root
        squares = F.T @ (weight * F) + self.ridge * np.eye(F.shape[1])
        self.dual_ = _in(np.float32, root @ linalg.solve(squares, F.T @ (weight * Y), assume_a="pos"))

    def decision_function(self, X: ArrayLike) -> Samples:
        """Return estimates of P(class) - 1/n_classes, shape (n_samples, n_classes).

        Of two classes, only that of the second, shape (n_samples,), as scikit-learn has it.
        """
        scores = self._scores(X)
        return scores[:, 1] if scores.shape[1] == 2 else scores

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Return the class with the largest decision, shape (n_samples,)."""
        winner = self._scores(X).argmax(axis=1)
        return np.asarray(self.classes_[winner])

    def predict_proba(self, X: ArrayLike) -> Samples:
        """Return the decisions as probabilities, shape (n_samples, n_classes): below 0 is 0, the sum is 1."""
        scores = self._scores(X)
        p = np.maximum(scores + 1 / scores.shape[1], 1e-6)
        return np.asarray(p / p.sum(axis=1, keepdims=True))

    def _scores(self, X: ArrayLike) -> Samples:
        check_is_fitted(self)
        rows = self._limited(validate_data(self, X, dtype=np.float64, reset=False))
        blocks = (rows[k : k + BLOCK] for k in range(0, len(rows), BLOCK))
        return np.concatenate([self._kernel([v(b) for v in self.views_]) @ self.dual_ for b in blocks])

    def _limited(self, rows: Samples) -> Samples:
        return rows if self.limit is None else np.clip(rows, self.low_, self.high_)

    def _kernel(self, rows: Any) -> Samples:
        pairs = zip(rows, self.prototypes_, strict=True)
        return np.asarray(sum(matern(a, b, self.length) for a, b in pairs) / len(self.views_))


class View:
    """A linear map of features: standardise, then multiply.

    Attributes
    ----------
    mean, scale : ndarray of shape (n_features,)
        Of the training samples; `scale` is infinite where a column is constant.
    weights : ndarray of shape (n_features, n_features), or (n_features,) when diagonal
        The root mean square length of a training sample is 1 after it.
    """

    def __init__(self, mean: Samples, scale: Samples, weights: Samples) -> None:
        self.mean, self.scale, self.weights = mean, scale, weights

    def __call__(self, X: Samples) -> Samples:
        """Return the samples in this view, shape (n_samples, n_features)."""
        return self.seen(self.standardised(X))

    def standardised(self, X: Samples) -> Samples:
        """Return the samples without mean and scale."""
        return np.asarray((X - self.mean) / self.scale)

    def seen(self, Z: Samples) -> Samples:
        """Return standardised samples in this view."""
        return np.asarray(Z * self.weights if self.weights.ndim == 1 else Z @ self.weights)


def view_of(
    X: Samples, labels: Labels, shrinkage: float, relevance: float, changes: Samples | None = None
) -> View:
    """Return the view with S = (1 - shrinkage) S_w + shrinkage tr(S_w)/p I whitened; shrinkage 1: none.

    S_w is the within-class covariance of the standardised samples; `CHANGES_WEIGHT` C' C / n is added where n
    changes C are known. The whitened columns are the directions S^(-1/2), so each still belongs to one
    feature, and is weighted by its correlation ratio.
    """
    mean, deviation = X.mean(axis=0), X.std(axis=0)
    scale = np.where(deviation > 1e-12 * np.abs(mean), deviation, np.inf)
    Z = (X - mean) / scale
    C = np.zeros((1, Z.shape[1])) if changes is None else changes / scale
    C = np.clip(C, -LARGEST_CHANGE, LARGEST_CHANGE) * np.sqrt(CHANGES_WEIGHT / len(C))
    if shrinkage == 1:
        weights = _weights(Z, labels, relevance, C)
        seen = Z * weights
    else:
        residual = Z - class_means(Z, labels)[labels]
        S = residual.T @ residual / len(Z) + C.T @ C
        level = np.trace(S) / len(S) or 1.0
        # Few samples leave many equal values: LAPACK's default driver can fail on those.
        values, vectors = linalg.eigh((1 - shrinkage) * S + shrinkage * level * np.eye(len(S)), driver="evd")
        root = vectors / np.sqrt(np.maximum(values, 1e-12 * level)) @ vectors.T
        weights = root * _weights(Z @ root, labels, relevance, C @ root)
        seen = Z @ weights
    size = np.sqrt(np.mean(np.einsum("ij,ij->i", seen, seen)))
    return View(mean, scale, weights / (size or 1.0))


def correlation_ratio(Z: Samples, labels: Labels, changes: Samples | float = 0.0) -> Samples:
    """Return eta = sqrt(1 - within/total variance) of each column, shape (n_features,); 0 for a constant.

    The variances are unbiased, so that a column of pure noise gets about 0 even with few samples a class. The
    variance of known `changes`, shape (n_features,), adds to both.
    """
    n, n_classes = len(Z), int(labels.max()) + 1
    within = (Z - class_means(Z, labels)[labels]).var(axis=0) * n / max(1, n - n_classes) + changes
    total = Z.var(axis=0) * n / max(1, n - 1) + changes
    ratio = np.divide(within, total, out=np.ones_like(total), where=total > 0)
    return np.asarray(np.sqrt(np.clip(1 - ratio, 0, 1)))


def matern(a: Samples, b: Samples, length: float) -> Samples:
    """Return (1 + s) exp(-s), s = sqrt(3) |a_i - b_j| / length, shape (n_a, n_b)."""
    s = a @ (-2 * b.T)
    s += np.einsum("ij,ij->i", a, a)[:, None]
    s += np.einsum("ij,ij->i", b, b)
    np.maximum(s, 0, out=s)
    s *= 3 / length**2
    np.sqrt(s, out=s)
    k = np.exp(-s)
    s += 1
    return np.asarray(np.multiply(k, s, out=k))


def _in(dtype: type[np.floating[Any]], values: Samples) -> Samples:
    """Return values rounded to a type of fewer bits."""
    return np.asarray(values.astype(dtype).astype(np.float64))


def drawn(labels: Labels, n: int, seed: int) -> Labels:
    """Return indices of `n` samples drawn at random, one of each class at least, in order; all, if not more.

    Every k-th sample would be the same part of all recordings of k windows.
    """
    if n >= labels.size:
        return np.arange(labels.size)
    order = np.random.default_rng(seed).permutation(labels.size)
    first = np.unique(labels[order], return_index=True)[1]
    return np.sort(np.concatenate([order[first], np.delete(order, first)])[:n])


def _weights(Z: Samples, labels: Labels, relevance: float, changes: Samples) -> Samples:
    ratio = correlation_ratio(Z, labels, np.einsum("ij,ij->j", changes, changes))
    return np.asarray(np.maximum(ratio, LEAST_RELEVANCE) ** relevance)


def class_means(X: Samples, labels: Labels) -> Samples:
    """Return the mean of each class, labelled 0 ... n_classes - 1: shape (n_classes, n_features)."""
    one_hot = np.eye(int(labels.max()) + 1)[labels]
    return np.asarray(one_hot.T @ X / one_hot.sum(axis=0)[:, None])
