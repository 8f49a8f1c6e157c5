"""Kernel discriminant: a closed-form classifier for many correlated features and few recordings."""

from dataclasses import replace
from numbers import Integral, Real
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import check_scalar
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.classifiers.kernel import View, kernel_scores, mean_kernel
from texclass.recording import Samples

Labels = NDArray[np.intp]
MIN_RELEVANCE = 0.1
"""Lower limit of the correlation ratio of a feature, because classes may differ in variance only."""
VARIATION_WEIGHT = 3.0
"""Weight of the covariance of known variations relative to the within-class covariance."""
MAX_VARIATION = 3.0
"""Limit of a known variation, in standard deviations of the feature in the training set."""


class KernelDiscriminant(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Kernel ridge regression on class indicators, with two views of the features.

    The first view contains the standardised features. The second view whitens them with the shrunk
    within-class covariance, as linear discriminant analysis does. The kernel is the mean of a Matern 3/2
    kernel on each view. The classifier suits many correlated features and few recordings. The solution has a
    closed form and needs no tuning.

    Parameters
    ----------
    length : float
        Length scale of the kernel, relative to the root-mean-square distance of the samples from their mean
        (default 1.6).
    ridge : float
        Regularisation added to the unit diagonal of the kernel matrix (default 0.04).
    shrinkage : float
        Shrinkage of the within-class covariance towards a multiple of the identity, in (0, 1] (default 0.5);
        1 disables the whitened view.
    relevance : float
        Exponent of the feature weights (default 0.5). Each feature is weighted by its correlation ratio (at
        least 0.1) to this power; 0 weights all features equally.
    limit : float, optional
        Clipping limit of the features, in standard deviations from the mean (default: no clipping). Features
        of single taps have long tails: without clipping, a few values would dominate the scale, and a single
        outlier would move a sample away from all others.
    max_samples : int
        Maximum number of training samples (default 10,000). Larger training sets are subsampled with at least
        one sample of each class, because the fitting time grows with the cube of the number of samples.
    max_kb : float, optional
        Maximum size of the exported classifier in kB (default: no limit, double precision); see Notes.
    random_state : int
        Seed of the subsampling (default 0).

    Attributes
    ----------
    classes_ : ndarray of shape (n_classes,)
        Class labels.
    low_, high_ : ndarray of shape (n_features,)
        Clipping limits; they exist only if `limit` is set.
    views_ : tuple of View
        Affine maps from the features to the views.
    prototypes_ : tuple of ndarray of shape (n_prototypes, n_features)
        Training samples in each view.
    dual_ : ndarray of shape (n_prototypes, n_classes)
        Coefficients alpha = (K + ridge W^-1)^-1 Y.

    Notes
    -----
    Y_ik is 1 - 1/n_classes if k is the class of sample i, and -1/n_classes otherwise. W weights the samples
    so that all classes count equally. The kernel is (1 + s) exp(-s) with s = sqrt(3) |x - x'| / length. It is
    smooth, and has heavier tails than a Gaussian kernel. Decision values estimate P(class) - 1/n_classes, so
    they may be averaged over the windows of a recording.

    With `max_kb`, only m of the n samples are used as prototypes, at least one of each class. The
    coefficients minimise the sum of squares of Y - K_nm alpha, weighted by W, plus ridge alpha' K_mm alpha.
    This is the "subset of regressors" method (Rasmussen and Williams, Gaussian Processes for Machine
    Learning, 2006, section 8.3.1). The export is lossless: standardised samples and the whitening matrix are
    rounded to 16 bits before K is computed, and alpha is rounded to 32 bits.

    Examples
    --------
    >>> import numpy as np
    >>> X = np.random.default_rng(0).standard_normal((60, 5)) + np.repeat([[0.0], [2.0]], 30, axis=0)
    >>> y = np.repeat(["felt", "glass"], 30)
    >>> KernelDiscriminant().fit(X, y).predict([[0.0] * 5, [2.0] * 5]).tolist()
    ['felt', 'glass']
    """

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

    def fit(self, X: ArrayLike, y: ArrayLike, variations: Samples | None = None) -> Self:
        """Fit the classifier to training samples.

        Parameters
        ----------
        X : array_like of shape (n_samples, n_features)
            Finite features; their scaling has no effect.
        y : array_like of shape (n_samples,)
            Labels of at least two classes.
        variations : ndarray of shape (n_variations, n_features), optional
            Known within-class variations in the units of X that cannot be estimated from a few samples. Their
            covariance is added to the within-class covariance. Features that they change receive smaller
            weights.

        Raises
        ------
        TypeError, ValueError
            If a parameter has the wrong type or is out of range, there is only one class, `variations` and X
            have different numbers of columns, or `max_kb` is too small for one sample of each class.
        """
        rows, labels = self._check(X, y, variations)
        subsample = stratified_subsample(labels, self.max_samples, self.random_state)
        rows, labels = rows[subsample], labels[subsample]
        if self.limit is not None:
            mean, reach = rows.mean(axis=0), self.limit * rows.std(axis=0)
            self.low_, self.high_ = mean - reach, mean + reach
        rows = self._clip(rows)
        shrinkages = (1.0,) if self.shrinkage == 1 else (1.0, self.shrinkage)
        self.views_ = tuple(
            fit_view(rows, labels, shrinkage, self.relevance, variations) for shrinkage in shrinkages
        )
        Y, weight = class_indicators(labels)
        if self.max_kb is not None:
            return self._fit_compressed(rows, labels, Y, weight)
        self.prototypes_ = tuple(view(rows) for view in self.views_)
        K = mean_kernel(self.prototypes_, self.prototypes_, self.length)
        K.flat[:: labels.size + 1] += self.ridge / weight
        self.dual_ = linalg.solve(K, Y, assume_a="pos", overwrite_a=True)
        return self

    def _check(self, X: ArrayLike, y: ArrayLike, variations: Samples | None) -> tuple[Samples, Labels]:
        positive: dict[str, Any] = {"min_val": 0, "include_boundaries": "neither"}
        check_scalar(self.length, "length", Real, **positive)
        check_scalar(self.ridge, "ridge", Real, **positive)
        check_scalar(self.shrinkage, "shrinkage", Real, min_val=0, max_val=1, include_boundaries="right")
        check_scalar(self.relevance, "relevance", Real, min_val=0)
        check_scalar(self.max_samples, "max_samples", Integral, min_val=2)
        for name in ("limit", "max_kb"):
            if getattr(self, name) is not None:
                check_scalar(getattr(self, name), name, Real, **positive)
        rows, y = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(y)
        if variations is not None and variations.shape[1] != rows.shape[1]:
            raise ValueError(
                f"variations must have {rows.shape[1]} columns like X, got {variations.shape[1]} columns"
            )
        self.classes_, labels = np.unique(y, return_inverse=True)
        if len(self.classes_) < 2:
            raise ValueError("y must contain at least 2 classes, got 1 class")
        return rows, labels

    def _fit_compressed(self, rows: Samples, labels: Labels, Y: Samples, weight: Samples) -> Self:
        """Fit coefficients to all samples, with as many prototypes as `max_kb` permits."""
        n = self._n_prototypes(rows.shape[1], Y.shape[1])
        prototypes = rows[stratified_subsample(labels, n, self.random_state)]
        self.views_ = tuple(
            replace(view, weights=rounded(view.weights, np.float16)) if view.weights.ndim == 2 else view
            for view in self.views_
        )
        self.prototypes_ = tuple(
            view.project(rounded(view.standardise(prototypes), np.float16)) for view in self.views_
        )
        # With K_mm = V D V', F = K_nm V D^(-1/2) turns the problem into plain ridge regression for beta.
        K = mean_kernel(self.prototypes_, self.prototypes_, self.length)
        D, V = linalg.eigh(K, driver="evd")
        is_regular = D[-1] * len(D) * np.finfo(float).eps < D
        root = V[:, is_regular] / np.sqrt(D[is_regular])
        F = mean_kernel((view(rows) for view in self.views_), self.prototypes_, self.length) @ root
        WF = weight[:, np.newaxis] * F
        beta = linalg.solve(F.T @ WF + self.ridge * np.eye(F.shape[1]), WF.T @ Y, assume_a="pos")
        self.dual_ = rounded(root @ beta, np.float32)
        return self

    def _n_prototypes(self, n_features: int, n_classes: int) -> int:
        """Return how many prototypes fit into `max_kb`, at least one of each class."""
        n_views, n_limits = len(self.views_), 0 if self.limit is None else 2
        # Means, scales, weights and limits of the features, and the whitening matrices.
        fixed_bytes = (16 + 16 * n_views + 8 * n_limits) * n_features + 2 * n_features**2 * (n_views - 1)
        # Features, squared length in each view, and coefficients of a prototype.
        bytes_each = 2 * n_features + 8 * n_views + 4 * n_classes
        n = int((1000 * (self.max_kb or 0) - fixed_bytes) // bytes_each)
        if n < n_classes:
            min_kb = (fixed_bytes + n_classes * bytes_each) / 1000
            raise ValueError(
                f"max_kb must be at least {min_kb:g} kB for {n_features} features and {n_classes} classes, "
                f"got {self.max_kb:g}"
            )
        return n

    def decision_function(self, X: ArrayLike) -> Samples:
        """Return estimates of P(class) - 1/n_classes, shape (n_samples, n_classes).

        For two classes, only the decision value of the second class is returned, shape (n_samples,), as in
        scikit-learn.
        """
        scores = self._scores(X)
        return scores[:, 1] if scores.shape[1] == 2 else scores

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Return the class with the largest decision value, shape (n_samples,)."""
        winner = self._scores(X).argmax(axis=1)
        return np.asarray(self.classes_[winner])

    def predict_proba(self, X: ArrayLike) -> Samples:
        """Return class probabilities, shape (n_samples, n_classes).

        These are the decision values plus 1/n_classes, clipped to at least 1e-6 and normalised to sum 1.
        """
        scores = self._scores(X)
        p = np.maximum(scores + 1 / scores.shape[1], 1e-6)
        return np.asarray(p / p.sum(axis=1, keepdims=True))

    def _scores(self, X: ArrayLike) -> Samples:
        check_is_fitted(self)
        rows = self._clip(validate_data(self, X, dtype=np.float64, reset=False))
        return kernel_scores(rows, self.views_, self.prototypes_, self.dual_, self.length)

    def _clip(self, rows: Samples) -> Samples:
        return rows if self.limit is None else np.clip(rows, self.low_, self.high_)


def fit_view(
    X: Samples, labels: Labels, shrinkage: float, relevance: float, variations: Samples | None = None
) -> View:
    """Fit a view that whitens the features (unless `shrinkage` is 1) and weights them by relevance.

    The whitening matrix is S^(-1/2) with S = (1 - shrinkage) S_w + shrinkage tr(S_w)/p I. S_w is the
    within-class covariance of the standardised samples, plus `VARIATION_WEIGHT` times the covariance of the
    known variations. Each column of S^(-1/2) corresponds to one feature, and is weighted by the correlation
    ratio of this whitened feature.

    Parameters
    ----------
    X : ndarray of shape (n_samples, n_features)
        Training samples.
    labels : ndarray of int, shape (n_samples,)
        Classes 0 ... n_classes - 1.
    shrinkage, relevance : float
        Shrinkage and relevance; see `KernelDiscriminant`.
    variations : ndarray of shape (n_variations, n_features), optional
        Known within-class variations in the units of X.
    """
    mean, std = X.mean(axis=0), X.std(axis=0)
    scale = np.where(std > 1e-12 * np.abs(mean), std, np.inf)
    Z = (X - mean) / scale
    V = np.zeros((1, Z.shape[1])) if variations is None else variations / scale
    V = np.clip(V, -MAX_VARIATION, MAX_VARIATION) * np.sqrt(VARIATION_WEIGHT / len(V))
    root = np.ones(Z.shape[1])
    if shrinkage < 1:
        residual = Z - class_means(Z, labels)[labels]
        root = shrunk_whitening(residual.T @ residual / len(Z) + V.T @ V, shrinkage)
    view = View(mean, scale, root)
    eta = correlation_ratio(view.project(Z), labels, np.square(view.project(V)).sum(axis=0))
    weights = root * np.maximum(eta, MIN_RELEVANCE) ** relevance
    rms = np.sqrt(np.mean(np.square(View(mean, scale, weights).project(Z)).sum(axis=1)))
    return View(mean, scale, weights / (rms or 1.0))


def shrunk_whitening(S: Samples, shrinkage: float) -> Samples:
    """Return ((1 - shrinkage) S + shrinkage tr(S)/p I)^(-1/2)."""
    level = np.trace(S) / len(S) or 1.0
    # Few samples leave many equal eigenvalues, with which the default driver of LAPACK can fail.
    D, V = linalg.eigh((1 - shrinkage) * S + shrinkage * level * np.eye(len(S)), driver="evd")
    return np.asarray(V / np.sqrt(np.maximum(D, 1e-12 * level)) @ V.T)


def correlation_ratio(Z: Samples, labels: Labels, extra_variance: Samples | float = 0.0) -> Samples:
    """Return the correlation ratio of each feature, eta = sqrt(1 - within-class / total variance).

    Both variances are unbiased, so eta is about 0 for pure noise, even with few samples. It is 0 for a
    constant feature.

    Parameters
    ----------
    Z : ndarray of shape (n_samples, n_features)
        Samples.
    labels : ndarray of int, shape (n_samples,)
        Classes 0 ... n_classes - 1.
    extra_variance : ndarray of shape (n_features,)
        Variance of known variations, which is added to both variances (default 0).
    """
    n, n_classes = len(Z), int(labels.max()) + 1
    residual_variance = (Z - class_means(Z, labels)[labels]).var(axis=0) * n / max(1, n - n_classes)
    within_class = residual_variance + extra_variance
    total = Z.var(axis=0) * n / max(1, n - 1) + extra_variance
    ratio = np.divide(within_class, total, out=np.ones_like(total), where=total > 0)
    return np.asarray(np.sqrt(np.clip(1 - ratio, 0, 1)))


def class_indicators(labels: Labels) -> tuple[Samples, Samples]:
    """Return centred class indicators, shape (n_samples, n_classes), and weights that balance the classes."""
    counts = np.bincount(labels)
    return np.eye(len(counts))[labels] - 1 / len(counts), (len(labels) / len(counts) / counts)[labels]


def rounded(values: Samples, dtype: type[np.floating[Any]]) -> Samples:
    """Return values rounded to the precision of `dtype`, as float64."""
    return np.asarray(values.astype(dtype).astype(np.float64))


def stratified_subsample(labels: Labels, n: int, seed: int) -> Labels:
    """Return the sorted indices of `n` random samples, with at least one of each class.

    If there are no more than `n` samples, all indices are returned. Samples are drawn at random, because
    every k-th sample could be the same window of each recording.
    """
    if n >= labels.size:
        return np.arange(labels.size)
    order = np.random.default_rng(seed).permutation(labels.size)
    first = np.unique(labels[order], return_index=True)[1]
    return np.sort(np.concatenate([order[first], np.delete(order, first)])[:n])


def class_means(X: Samples, labels: Labels) -> Samples:
    """Return the mean of each class 0 ... n_classes - 1, shape (n_classes, n_features)."""
    one_hot = np.eye(int(labels.max()) + 1)[labels]
    return np.asarray(one_hot.T @ X / one_hot.sum(axis=0)[:, None])
