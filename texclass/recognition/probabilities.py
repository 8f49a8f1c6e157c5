"""Calibrated probabilities: temperature scaling, and correlation between windows of one contact."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples

Labels = NDArray[np.intp]
LOG_BOUNDS = (-8.0, 8.0)
"""Limits of log(beta): decisions range from about 1e-3 (kernel) to 1e3 (naive Bayes with many columns)."""
N_BINS = 15
"""Number of bins of the calibration error, as in Guo et al. (2017)."""
PRIOR_BETA = 6.5
"""Inverse temperature, divided by log K, of a kernel trained on one recording of each of K classes.

It is within 15 % of the value with the largest mean likelihood over the datasets in the study
`later_recordings`. The best values of the datasets differ, so probabilities that are based on it are rough
estimates.
"""
PRIOR_BETA_WINDOWS = 3.0
"""The same for a kernel trained on several windows of one recording of each class.

Its decisions are larger, because windows of one recording resemble each other.
"""
PRIOR_LAPSE = 0.02
"""Residual probability of an error without held-out recordings, fitted together with `PRIOR_BETA`."""
MIN_PROBABILITY = 1e-12
"""Lower bound of a probability before its logarithm is taken."""
DEFAULT_CORRELATION = 1.0
"""Correlation between windows of one contact if it could not be estimated: more windows add no confidence."""


def softmax(scores: Samples) -> Samples:
    """Return exp(s_k) / sum_j exp(s_j) over the last axis.

    It is faster than `scipy.special.softmax` for the single rows of a stream.
    """
    p = np.exp(scores - scores.max(axis=-1, keepdims=True))
    return np.asarray(p / p.sum(axis=-1, keepdims=True))


def log_probabilities(p: Samples) -> Samples:
    """Return the logarithms of probabilities, with `MIN_PROBABILITY` as lower limit."""
    return np.asarray(np.log(np.maximum(p, MIN_PROBABILITY)))


def class_scores(classifier: Any, rows: Samples) -> Samples:
    """Return the decisions of a classifier, one column per class, shape (n, n_classes).

    These are `decision_function`, else the logarithm of `predict_proba`, else 1 for the predicted class and 0
    for all other classes.
    """
    if hasattr(classifier, "decision_function"):
        scores = np.asarray(classifier.decision_function(rows), dtype=np.float64)
        return scores if scores.ndim == 2 else np.column_stack([-scores, scores])
    if hasattr(classifier, "predict_proba"):
        return log_probabilities(classifier.predict_proba(rows))
    predicted = np.asarray(classifier.predict(rows))
    return np.asarray(predicted[:, None] == classifier.classes_, dtype=np.float64)


@dataclass(frozen=True)
class Calibration:
    """Temperature scaling: p = (1 - lapse) softmax(beta s) + lapse / K for decisions s of K classes.

    Attributes
    ----------
    beta : float
        Inverse temperature.
    lapse : float
        Residual probability of an error: 1 / (n + 2) after n answers (Laplace's rule of succession).

    References
    ----------
    Guo, Pleiss, Sun, Weinberger: On calibration of modern neural networks, ICML 2017.

    Examples
    --------
    >>> import numpy as np
    >>> Calibration(beta=2.0, lapse=0.01)(np.array([[1.0, 0.0]])).round(3).tolist()
    [[0.877, 0.123]]
    """

    beta: float
    lapse: float

    def __call__(self, scores: Samples) -> Samples:
        """Return the probabilities of decisions, both of shape (n, n_classes)."""
        return np.asarray((1 - self.lapse) * softmax(self.beta * scores) + self.lapse / scores.shape[1])


def fit_calibration(scores: Samples, labels: Labels) -> Calibration:
    """Fit the temperature to held-out decisions by maximum likelihood, with limited confidence.

    The mean confidence is at most (hits + 1) / (n + 2), Laplace's estimate of the accuracy. Without this
    limit, the likelihood has no maximum if every answer is correct, and every probability would be 1 - lapse.

    Parameters
    ----------
    scores : ndarray of shape (n, n_classes)
        Decisions of a classifier on held-out recordings.
    labels : ndarray of int, shape (n,)
        Column of the true class.

    Examples
    --------
    >>> import numpy as np
    >>> labels = np.arange(40) % 4
    >>> calibration = fit_calibration(np.eye(4)[labels], labels)
    >>> calibration(np.eye(4)[:1]).round(3).tolist()
    [[0.976, 0.008, 0.008, 0.008]]
    """
    from scipy.optimize import brentq, minimize_scalar
    from scipy.special import log_softmax

    n, n_classes = scores.shape
    lapse, rows = 1 / (n + 2), np.arange(n)
    max_confidence = float((np.count_nonzero(scores.argmax(axis=1) == labels) + 1) / (n + 2))

    def loss(log_beta: float) -> float:
        p = np.exp(log_softmax(np.exp(log_beta) * scores, axis=1)[rows, labels])
        return -float(np.mean(np.log((1 - lapse) * p + lapse / n_classes)))

    def overconfidence(log_beta: float) -> float:
        p = Calibration(float(np.exp(log_beta)), lapse)(scores)
        return float(p.max(axis=1).mean()) - max_confidence

    log_beta = float(minimize_scalar(loss, bounds=LOG_BOUNDS, method="bounded", options={"xatol": 1e-4}).x)
    if overconfidence(LOG_BOUNDS[0]) < 0 < overconfidence(log_beta):
        log_beta = float(brentq(overconfidence, LOG_BOUNDS[0], log_beta, xtol=1e-6))
    return Calibration(float(np.exp(log_beta)), lapse)


def prior_calibration(n_classes: int, n: int) -> Calibration:
    """Return the calibration of a kernel discriminant without held-out recordings, from other datasets.

    Decisions estimate P(class) - 1/K and are shrunk towards 0, so the largest decision decreases with the
    number of classes.

    Parameters
    ----------
    n_classes : int
        Number K of classes.
    n : int
        Number of training recordings, or of their windows. If it is at least twice the number of classes,
        the calibration is that of windows.

    Examples
    --------
    >>> prior_calibration(20, 20).beta > prior_calibration(20, 100).beta
    True
    """
    beta = PRIOR_BETA if n < 2 * n_classes else PRIOR_BETA_WINDOWS
    return Calibration(beta * float(np.log(n_classes)), PRIOR_LAPSE)


def effective_windows(n: Any, correlation: float) -> Any:
    """Return the effective number of independent windows, n / (1 + r (n - 1)).

    Parameters
    ----------
    n : float or ndarray
        Number of windows of one contact.
    correlation : float
        Correlation r between windows; the result is at most 1 / r.

    Examples
    --------
    >>> effective_windows(5, correlation=0.25).item()
    2.5
    """
    return n / (1 + correlation * np.maximum(n - 1, 0))


def fit_correlation(p: Samples, labels: Labels, contacts: ArrayLike) -> float:
    """Fit the correlation between windows of one contact by maximum likelihood.

    The probability of the true surface is the softmax of the mean log posterior of the first n windows of a
    contact, times their effective number. Every contact has the same weight.

    Parameters
    ----------
    p : ndarray of shape (n, n_classes)
        Calibrated probabilities of held-out windows, in chronological order.
    labels : ndarray of int, shape (n,)
        Column of the true class.
    contacts : array_like of shape (n,)
        Contact (recording) of each window.

    Raises
    ------
    ValueError
        If no contact has more than one window.
    """
    from scipy.optimize import minimize_scalar

    mean, n, contact = running_log_posterior(p, contacts)
    if n.max(initial=0) < 2:
        raise ValueError(
            "cannot estimate the correlation between windows: no contact has two windows. Use longer "
            "recordings or shorter windows"
        )
    rows, n_windows = np.arange(len(n)), np.bincount(contact)
    lapse, n_classes = 1 / (len(n_windows) + 2), p.shape[1]

    def loss(correlation: float) -> float:
        p_true = softmax(effective_windows(n, correlation)[:, None] * mean)[rows, labels]
        return -float(np.sum(np.log((1 - lapse) * p_true + lapse / n_classes) / n_windows[contact]))

    return float(minimize_scalar(loss, bounds=(0, 1), method="bounded", options={"xatol": 1e-3}).x)


def running_log_posterior(p: Samples, contacts: ArrayLike) -> tuple[Samples, Labels, Labels]:
    """Return the mean log posterior of each contact after each of its windows.

    Parameters
    ----------
    p : ndarray of shape (n, n_classes)
        Calibrated probabilities of windows, in chronological order.
    contacts : array_like of shape (n,)
        Contact of each window.

    Returns
    -------
    mean : ndarray of shape (n, n_classes)
        Mean log posterior of the windows of the contact, up to and including this one.
    n_so_far : ndarray of int, shape (n,)
        Number of these windows.
    contact : ndarray of int, shape (n,)
        Number of the contact.
    """
    import pandas as pd

    logs = pd.DataFrame(log_probabilities(p))
    contact = pd.factorize(np.asarray(contacts))[0]
    n_so_far = np.asarray(logs.groupby(contact).cumcount(), dtype=np.intp) + 1
    mean = logs.groupby(contact).cumsum().to_numpy() / n_so_far[:, None]
    return mean, n_so_far, np.asarray(contact, dtype=np.intp)


def expected_calibration_error(
    confidence: ArrayLike, hits: ArrayLike, n_bins: int = N_BINS, *, equal_counts: bool = False
) -> float:
    """Return sum_b n_b/n |hit rate of bin b - mean confidence of bin b|.

    Parameters
    ----------
    confidence : array_like of shape (n,)
        Probability of the predicted class.
    hits : array_like of bool, shape (n,)
        Whether the prediction is correct.
    n_bins : int
        Number of bins (default 15).
    equal_counts : bool
        Whether bins have equal numbers of answers instead of equal widths (default False). Answers of the
        same confidence are in the same bin.

    Raises
    ------
    ValueError
        If there is no answer, or the lengths differ.

    Examples
    --------
    >>> expected_calibration_error([0.75, 0.75, 0.75, 0.75], [True, True, True, False])
    0.0
    """
    p, is_hit = np.asarray(confidence, dtype=np.float64), np.asarray(hits, dtype=np.float64)
    if p.size == 0 or p.shape != is_hit.shape:
        raise ValueError(
            f"confidence and hits must be of the same length and not empty, got shapes {p.shape} "
            f"and {is_hit.shape}"
        )
    gaps = np.bincount(_bins(p, n_bins, equal_counts), weights=is_hit - p)
    return float(np.abs(gaps).sum() / p.size)


def calibration_error_by_chance(
    confidence: ArrayLike, n_bins: int = N_BINS, *, equal_counts: bool = False
) -> float:
    """Return the mean of `expected_calibration_error` for perfectly calibrated probabilities.

    The calibration error is a sum of absolute values, so its mean is positive even for perfect calibration:
    sum_b sqrt(2/pi sum_{i in b} p_i (1 - p_i)) / n, from the mean of absolute normal deviates. Only a larger
    error indicates poor calibration.

    Parameters
    ----------
    confidence, n_bins, equal_counts
        Confidence and bins, as for `expected_calibration_error`.
    """
    p = np.asarray(confidence, dtype=np.float64)
    variances = np.bincount(_bins(p, n_bins, equal_counts), weights=p * (1 - p))
    return float(np.sqrt(2 / np.pi * variances).sum() / p.size)


def _bins(p: Samples, n_bins: int, equal_counts: bool) -> Labels:
    from scipy.stats import rankdata

    position = (rankdata(p) - 0.5) / p.size if equal_counts else p
    return np.minimum((position * n_bins).astype(np.intp), n_bins - 1)
