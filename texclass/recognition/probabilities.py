"""From what a classifier decides to probabilities that mean what they say: decisions, temperature scaling."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax
from sklearn import config_context
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from sklearn.preprocessing import MinMaxScaler, StandardScaler
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from texclass.experiment.kernel_discriminant import KernelDiscriminant, matern
from texclass.recording import Samples

Labels = NDArray[np.intp]
LOG_BOUNDS = (-8.0, 8.0)
"""Of log(beta): decisions span some 1e-3 (a kernel) to 1e3 (naive Bayes over many columns)."""
N_BINS = 15
"""Bins of equal width over the confidence, as Guo et al. (2017) have them."""
UNCHECKED = {"assume_finite": True, "skip_parameter_validation": True}
"""How scikit-learn is asked about rows that were checked already."""
LEAST_PROBABILITY = 1e-12
"""Of which a logarithm is still taken."""


def class_scores(classifier: Any, rows: Samples) -> Samples:
    """Return the decisions of a classifier, one column a class, shape (n, n_classes).

    Its `decision_function`; the logarithm of `predict_proba` where it has no other; else 1 for its answer.
    """
    if hasattr(classifier, "decision_function"):
        found = np.asarray(classifier.decision_function(rows), dtype=np.float64)
        return found if found.ndim == 2 else np.column_stack([-found, found])
    if hasattr(classifier, "predict_proba"):
        return np.asarray(np.log(np.maximum(classifier.predict_proba(rows), LEAST_PROBABILITY)))
    return np.asarray(np.asarray(classifier.predict(rows))[:, None] == classifier.classes_, dtype=np.float64)


def deciding(steps: Sequence[Any], classifier: Any) -> Callable[[Samples], tuple[Samples, Samples]]:
    """Return what fitted steps make of rows (n, n_columns): prepared rows, and decisions (n, n_classes).

    Single rows are asked in microseconds: the arithmetic of scikit-learn without its checks. Steps and
    classifiers that are not known here are asked themselves, on one thread: starting more takes longer than
    the work that they would share.

    Parameters
    ----------
    steps : sequence of transformer
        Fitted, in order; None and "passthrough" do nothing.
    classifier : classifier
        Fitted.

    Raises
    ------
    ValueError
        From that function, if a prepared value is not finite.
    """
    active = [step for step in steps if step not in (None, "passthrough")]
    known = [found for step in active if (found := _transforming(step))]
    decide = _decision(classifier)
    if decide is None or len(known) < len(active):

        def asked(X: Samples) -> tuple[Samples, Samples]:
            with _libraries().limit(limits=1), config_context(**UNCHECKED):
                for step in active:
                    X = step.transform(X)
                return _finite(X), class_scores(classifier, X)

        return asked

    def computed(X: Samples) -> tuple[Samples, Samples]:
        for transform in known:
            X = transform(X)
        return _finite(X), decide(X)

    return computed


def _finite(prepared: Samples) -> Samples:
    if not np.isfinite(prepared).all():
        raise ValueError("features are undefined; the rule is a pipeline with a step that fills them")
    return prepared


@functools.cache
def _libraries() -> Any:
    """Return the libraries with threads of their own; looking for them takes milliseconds."""
    return ThreadpoolController()


def _transforming(step: Any) -> Callable[[Samples], Samples] | None:
    """Return what a fitted step computes; None for one that is not known."""
    match step:
        case SimpleImputer(add_indicator=False) if np.isnan(step.missing_values):
            # Columns without a median are left out, or filled in some other way.
            median = step.statistics_
            return None if np.isnan(median).any() else lambda X: np.where(np.isnan(X), median, X)
        case MinMaxScaler(clip=False):
            return lambda X: X * step.scale_ + step.min_
        case StandardScaler(with_mean=True, with_std=True):
            return lambda X: (X - step.mean_) / step.scale_
    return None


def _decision(classifier: Any) -> Callable[[Samples], Samples] | None:
    """Return how a fitted classifier of more than two classes decides; None for one that is not known."""
    if isinstance(classifier, LinearDiscriminantAnalysis) and len(classifier.classes_) > 2:
        return lambda X: np.asarray(X @ classifier.coef_.T + classifier.intercept_)
    if isinstance(classifier, KernelDiscriminant) and len(classifier.classes_) > 2:
        pairs = list(zip(classifier.views_, classifier.prototypes_, strict=True))

        def from_prototypes(X: Samples) -> Samples:
            kernels = [matern(view(X), prototypes, classifier.length) for view, prototypes in pairs]
            return np.asarray(sum(kernels) / len(kernels) @ classifier.dual_)

        return from_prototypes
    return None


@dataclass(frozen=True)
class Calibration:
    """Decisions -> probabilities: p = (1 - lapse) softmax(beta s) + lapse / K.

    Attributes
    ----------
    beta
        Inverse temperature.
    lapse
        What no number of right answers rules out: 1 / (n + 2) after n of them (Laplace's rule of succession).

    References
    ----------
    Guo, Pleiss, Sun, Weinberger: On calibration of modern neural networks, ICML 2017.
    """

    beta: float
    lapse: float

    def __call__(self, scores: Samples) -> Samples:
        """Return probabilities of decisions, both of shape (n, n_classes)."""
        # scipy's softmax, without the time that its checks take in every window of a stream.
        p = self.beta * scores
        p = np.exp(p - p.max(axis=1, keepdims=True))
        p /= p.sum(axis=1, keepdims=True)
        return np.asarray((1 - self.lapse) * p + self.lapse / scores.shape[1])


def fit_calibration(scores: Samples, labels: Labels) -> Calibration:
    """Return the temperature under which held-out labels are likeliest.

    Parameters
    ----------
    scores : ndarray of shape (n, n_classes)
        Decisions of a classifier on recordings it was not trained on.
    labels : ndarray of int, shape (n,)
        Which column is right.
    """
    n, n_classes = scores.shape
    lapse, chosen = 1 / (n + 2), np.arange(n)

    def loss(log_beta: float) -> float:
        p = np.exp(log_softmax(np.exp(log_beta) * scores, axis=1)[chosen, labels])
        return -float(np.mean(np.log((1 - lapse) * p + lapse / n_classes)))

    # Where every answer was right the loss falls for ever: the largest beta that still changes it will do.
    found = minimize_scalar(loss, bounds=LOG_BOUNDS, method="bounded", options={"xatol": 1e-4})
    return Calibration(float(np.exp(found.x)), lapse)


def expected_calibration_error(
    confidence: ArrayLike, hits: ArrayLike, n_bins: int = N_BINS, *, equal_counts: bool = False
) -> float:
    """Return sum_b n_b/n |mean hit rate of bin b - mean confidence of bin b|.

    Parameters
    ----------
    confidence : array_like of shape (n,)
        Probability of the answer.
    hits : array_like of bool, shape (n,)
        Whether it was right.
    n_bins : int
        Bins.
    equal_counts : bool
        Bins hold equally many answers instead of spanning equal widths of [0, 1].

    Raises
    ------
    ValueError
        If there is no answer, or the lengths differ.
    """
    p, right = np.asarray(confidence, dtype=np.float64), np.asarray(hits, dtype=np.float64)
    if p.size == 0 or p.shape != right.shape:
        raise ValueError(
            f"confidence has shape {p.shape}, hits {right.shape}; the rule is one of each, n > 0"
        )
    place = p.argsort(kind="stable").argsort(kind="stable") / p.size if equal_counts else p
    bins = np.minimum((place * n_bins).astype(int), n_bins - 1)
    gaps = np.bincount(bins, weights=right - p, minlength=n_bins)
    return float(np.abs(gaps).sum() / p.size)
