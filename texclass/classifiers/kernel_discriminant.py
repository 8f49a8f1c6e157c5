"""A kernel discriminant for many correlated features and few recordings: closed form, no tuning inside."""

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


class KernelDiscriminant(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Kernel ridge regression on class membership, on two views of the features.

    Surfaces differ a little in many features, in some of them nonlinearly, and most features vary together
    from one stroke to the next. One view takes the features as they are; the other first removes that common
    variation, as a linear discriminant does (shrunk within-class whitening). The kernel is the mean over
    both.

    Parameters
    ----------
    length : float
        Length scale of the kernel, in root mean square distances of a sample from the mean.
    ridge : float
        Added to the diagonal of the kernel, whose elements reach 1: the share of a label that may be noise.
    shrinkage : float
        Shrinkage of the within-class covariance towards a multiple of the identity, above 0; 1: no whitening.
    relevance : float
        Columns are weighted by their correlation ratio (at least 0.1) to this power; 0: equal weights.
    limit : float, optional
        Standard deviations from a column's mean at which values are clipped; not clipped by default. Features
        of single taps have long tails: a few values would dominate the scale of a column, and one outlier
        would move a sample away from all others.
    max_samples : int
        Largest number of training samples; of more, so many are drawn, at least one of each class. Time grows
        with the cube of the number.
    max_kb : float, optional
        Kilobytes of the exported discriminant: numbers are rounded to few bits, and as many training samples
        are kept as fit into it, at least one of each class, with the coefficients that fit all of them best.
        By default all are kept, in double precision.
    random_state : int
        Seed of the subsample.

    Attributes
    ----------
    classes_ : ndarray of shape (n_classes,)
        Labels.
    low_, high_ : ndarray of shape (n_features,)
        Values are clipped to this range; with a `limit` only.
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
        """Fit views, prototypes and coefficients.

        Parameters
        ----------
        X : array_like of shape (n_samples, n_features)
            Finite features; their scales do not matter.
        y : array_like of shape (n_samples,)
            Labels of at least two classes.
        changes : ndarray of shape (n_changes, n_features), optional
            Known changes between samples of one class, in the units of X, which few samples do not show. They
            add to the within-class covariance, and lower the weights of the columns that they change.

        Raises
        ------
        TypeError, ValueError
            If a parameter has the wrong type or is out of range, there is one class only, `changes` has other
            columns than X, or `max_kb` is too small for one sample of each class.
        """
        rows, labels = self._check(X, y, changes)
        kept = stratified_subsample(labels, self.max_samples, self.random_state)
        rows, labels = rows[kept], labels[kept]
        if self.limit is not None:
            mean, reach = rows.mean(axis=0), self.limit * rows.std(axis=0)
            self.low_, self.high_ = mean - reach, mean + reach
        rows = self._clip(rows)
        shrinkages = (1.0,) if self.shrinkage == 1 else (1.0, self.shrinkage)
        self.views_ = tuple(fit_view(rows, labels, part, self.relevance, changes) for part in shrinkages)
        Y, weight = class_indicators(labels)
        if self.max_kb is not None:
            return self._fit_compressed(rows, labels, Y, weight)
        self.prototypes_ = tuple(view(rows) for view in self.views_)
        K = mean_kernel(self.prototypes_, self.prototypes_, self.length)
        K.flat[:: labels.size + 1] += self.ridge / weight
        self.dual_ = linalg.solve(K, Y, assume_a="pos", overwrite_a=True)
        return self

    def _check(self, X: ArrayLike, y: ArrayLike, changes: Samples | None) -> tuple[Samples, Labels]:
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
        if changes is not None and changes.shape[1] != rows.shape[1]:
            raise ValueError(f"changes must have {rows.shape[1]} columns as X, got {changes.shape[1]}")
        self.classes_, labels = np.unique(y, return_inverse=True)
        if len(self.classes_) < 2:
            raise ValueError("y must contain at least 2 classes, got 1 class")
        return rows, labels

    def _fit_compressed(self, rows: Samples, labels: Labels, Y: Samples, weight: Samples) -> Self:
        """Keep the samples that fit into `max_kb`, with the coefficients that fit all samples best."""
        n_kept = self._n_kept(rows.shape[1], Y.shape[1])
        kept = rows[stratified_subsample(labels, n_kept, self.random_state)]
        self.views_ = tuple(
            replace(view, weights=rounded(view.weights, np.float16)) if view.weights.ndim == 2 else view
            for view in self.views_
        )
        self.prototypes_ = tuple(
            view.project(rounded(view.standardise(kept), np.float16)) for view in self.views_
        )
        # With K_mm = V D V', beta of F = K_nm V D^(-1/2) is a plain ridge regression.
        K = mean_kernel(self.prototypes_, self.prototypes_, self.length)
        D, V = linalg.eigh(K, driver="evd")
        is_regular = D[-1] * len(D) * np.finfo(float).eps < D
        root = V[:, is_regular] / np.sqrt(D[is_regular])
        F = mean_kernel((view(rows) for view in self.views_), self.prototypes_, self.length) @ root
        WF = weight[:, np.newaxis] * F
        beta = linalg.solve(F.T @ WF + self.ridge * np.eye(F.shape[1]), WF.T @ Y, assume_a="pos")
        self.dual_ = rounded(root @ beta, np.float32)
        return self

    def _n_kept(self, n_features: int, n_classes: int) -> int:
        """Return how many samples fit into `max_kb`: at least one of each class."""
        n_views, n_limits = len(self.views_), 0 if self.limit is None else 2
        # Bytes of means, scales, weights and limits of columns, and of the whitening; then those of a sample,
        # its lengths and coefficients.
        of_views = (16 + 16 * n_views + 8 * n_limits) * n_features + 2 * n_features**2 * (n_views - 1)
        of_sample = 2 * n_features + 8 * n_views + 4 * n_classes
        n_kept = int((1000 * (self.max_kb or 0) - of_views) // of_sample)
        if n_kept < n_classes:
            least = (of_views + n_classes * of_sample) / 1000
            raise ValueError(
                f"max_kb is {self.max_kb:g}. Expected at least {least:g}, "
                f"for {n_features} features and a sample of each of {n_classes} classes"
            )
        return n_kept

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
        rows = self._clip(validate_data(self, X, dtype=np.float64, reset=False))
        return kernel_scores(rows, self.views_, self.prototypes_, self.dual_, self.length)

    def _clip(self, rows: Samples) -> Samples:
        return rows if self.limit is None else np.clip(rows, self.low_, self.high_)


def fit_view(
    X: Samples, labels: Labels, shrinkage: float, relevance: float, changes: Samples | None = None
) -> View:
    """Fit the view that whitens S = (1 - shrinkage) S_w + shrinkage tr(S_w)/p I; shrinkage 1: no whitening.

    S_w is the within-class covariance of the standardised samples; 3 C' C / n is added where n
    changes C are known. The whitened columns are the directions S^(-1/2), so each still belongs to one
    feature, and is weighted by its correlation ratio.
    """
    mean, deviation = X.mean(axis=0), X.std(axis=0)
    scale = np.where(deviation > 1e-12 * np.abs(mean), deviation, np.inf)
    Z = (X - mean) / scale
    C = np.zeros((1, Z.shape[1])) if changes is None else changes / scale
    # Of what hardly varied in training, a change is at most 3 standard deviations.
    C = np.clip(C, -3, 3) * np.sqrt(3 / len(C))
    root = np.ones(Z.shape[1])
    if shrinkage < 1:
        residual = Z - class_means(Z, labels)[labels]
        root = shrunk_whitening(residual.T @ residual / len(Z) + C.T @ C, shrinkage)
    view = View(mean, scale, root)
    eta = correlation_ratio(view.project(Z), labels, np.square(view.project(C)).sum(axis=0))
    # No column falls below a correlation ratio of 0.1: classes may differ in spread alone.
    weights = root * np.maximum(eta, 0.1) ** relevance
    rms = np.sqrt(np.mean(np.square(View(mean, scale, weights).project(Z)).sum(axis=1)))
    return View(mean, scale, weights / (rms or 1.0))


def shrunk_whitening(S: Samples, shrinkage: float) -> Samples:
    """Return ((1 - shrinkage) S + shrinkage tr(S)/p I)^(-1/2)."""
    level = np.trace(S) / len(S) or 1.0
    # Few samples leave many equal eigenvalues, with which the default driver of LAPACK can fail.
    D, V = linalg.eigh((1 - shrinkage) * S + shrinkage * level * np.eye(len(S)), driver="evd")
    return np.asarray(V / np.sqrt(np.maximum(D, 1e-12 * level)) @ V.T)


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


def class_indicators(labels: Labels) -> tuple[Samples, Samples]:
    """Return centred class indicators, shape (n_samples, n_classes), and weights that balance the classes."""
    counts = np.bincount(labels)
    return np.eye(len(counts))[labels] - 1 / len(counts), (len(labels) / len(counts) / counts)[labels]


def rounded(values: Samples, dtype: type[np.floating[Any]]) -> Samples:
    """Return values rounded to a type of fewer bits, in double precision again."""
    return np.asarray(values.astype(dtype).astype(np.float64))


def stratified_subsample(labels: Labels, n: int, seed: int) -> Labels:
    """Return ascending indices of `n` samples drawn at random, one of each class at least; all, if not more.

    Every k-th sample would be the same part of all recordings of k windows.
    """
    if n >= labels.size:
        return np.arange(labels.size)
    order = np.random.default_rng(seed).permutation(labels.size)
    first = np.unique(labels[order], return_index=True)[1]
    return np.sort(np.concatenate([order[first], np.delete(order, first)])[:n])


def class_means(X: Samples, labels: Labels) -> Samples:
    """Return the mean of each class, labelled 0 ... n_classes - 1: shape (n_classes, n_features)."""
    one_hot = np.eye(int(labels.max()) + 1)[labels]
    return np.asarray(one_hot.T @ X / one_hot.sum(axis=0)[:, None])
