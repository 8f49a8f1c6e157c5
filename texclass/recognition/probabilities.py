"""From what a classifier decides to probabilities that mean what they say, of one answer and of several."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples

Labels = NDArray[np.intp]
LOG_BOUNDS = (-8.0, 8.0)
"""Of log(beta): decisions span some 1e-3 (a kernel) to 1e3 (naive Bayes over many columns)."""
N_BINS = 15
"""Bins of equal width over the confidence, as Guo et al. (2017) have them."""
PRIOR_BETA = 4.5
"""Inverse temperature of decisions of a kernel that learnt one recording a class, over log K of K classes.

The geometric mean of what fits the other recordings of six data sets of taps, strokes and wheels, each of
which has another: probabilities after it are no more than a guess at how sure an answer is.
"""
LEAST_PROBABILITY = 1e-12
"""Of which a logarithm is still taken."""
CORRELATION = 1.0
"""Where nothing is known of how windows of one contact agree by their contact: they add no certainty."""


def softmax(scores: Samples) -> Samples:
    """Return exp(s_k) / sum_j exp(s_j) over the last axis; scipy's takes its time for checks."""
    p = np.exp(scores - scores.max(axis=-1, keepdims=True))
    return np.asarray(p / p.sum(axis=-1, keepdims=True))


def log_of(p: Samples) -> Samples:
    """Return logarithms of probabilities, also where one is 0."""
    return np.asarray(np.log(np.maximum(p, LEAST_PROBABILITY)))


def class_scores(classifier: Any, rows: Samples) -> Samples:
    """Return the decisions of a classifier, one column a class, shape (n, n_classes).

    Its `decision_function`; the logarithm of `predict_proba` where it has no other; else 1 for its answer.
    """
    if hasattr(classifier, "decision_function"):
        found = np.asarray(classifier.decision_function(rows), dtype=np.float64)
        return found if found.ndim == 2 else np.column_stack([-found, found])
    if hasattr(classifier, "predict_proba"):
        return log_of(classifier.predict_proba(rows))
    return np.asarray(np.asarray(classifier.predict(rows))[:, None] == classifier.classes_, dtype=np.float64)


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
        return np.asarray((1 - self.lapse) * softmax(self.beta * scores) + self.lapse / scores.shape[1])


def fit_calibration(scores: Samples, labels: Labels) -> Calibration:
    """Return the temperature under which held-out labels are likeliest, or one that claims less.

    The mean confidence is at most (hits + 1) / (n + 2), Laplace's estimate of their share: where every answer
    was right, labels get likelier without end, and every probability would be 1 - lapse, whatever its margin.

    Parameters
    ----------
    scores : ndarray of shape (n, n_classes)
        Decisions of a classifier on recordings it was not trained on.
    labels : ndarray of int, shape (n,)
        Which column is right.
    """
    from scipy.optimize import brentq, minimize_scalar
    from scipy.special import log_softmax

    n, n_classes = scores.shape
    lapse, chosen = 1 / (n + 2), np.arange(n)
    most = (np.count_nonzero(scores.argmax(axis=1) == labels) + 1) / (n + 2)

    def loss(log_beta: float) -> float:
        p = np.exp(log_softmax(np.exp(log_beta) * scores, axis=1)[chosen, labels])
        return -float(np.mean(np.log((1 - lapse) * p + lapse / n_classes)))

    def claimed(log_beta: float) -> float:
        told = Calibration(float(np.exp(log_beta)), lapse)(scores).max(axis=1)
        return float(told.mean()) - float(most)

    found = float(minimize_scalar(loss, bounds=LOG_BOUNDS, method="bounded", options={"xatol": 1e-4}).x)
    if claimed(LOG_BOUNDS[0]) < 0 < claimed(found):
        found = float(brentq(claimed, LOG_BOUNDS[0], found, xtol=1e-6))
    return Calibration(float(np.exp(found)), lapse)


def prior_calibration(n_classes: int, n: int) -> Calibration:
    """Return the calibration of a kernel's decisions where no recording tells: that of other data sets.

    Decisions are about P(class) - 1/K, shrunk towards 0: the more classes, the smaller is the largest.

    Parameters
    ----------
    n_classes : int
        K.
    n : int
        Recordings that train; the lapse is 1 / (n + 2).
    """
    return Calibration(PRIOR_BETA * float(np.log(n_classes)), 1 / (n + 2))


def independent(n: Any, correlation: float) -> Any:
    """Return how many independent windows n of one contact are worth, n / (1 + r (n - 1)): at most 1 / r."""
    return n / (1 + correlation * np.maximum(n - 1, 0))


def fit_correlation(p: Samples, labels: Labels, contacts: ArrayLike) -> float:
    """Return the correlation of windows under which what contacts say in the end is likeliest.

    The mean log posterior of the first n windows of each contact, times what they are worth, is to be the
    probability of the right surface; every contact counts once, however many windows it has.

    Parameters
    ----------
    p : ndarray of shape (n, n_classes)
        Calibrated probabilities of windows that were held out, in the order in which they were felt.
    labels : ndarray of int, shape (n,)
        Which column is right.
    contacts : array_like of shape (n,)
        Which contact (recording) each one is of.

    Raises
    ------
    ValueError
        If no contact has several windows.
    """
    from scipy.optimize import minimize_scalar

    mean, n, of = so_far(p, contacts)
    if n.max(initial=0) < 2:
        raise ValueError("no contact has two windows. Expected several windows of some")
    right, felt = np.arange(len(n)), np.bincount(of)
    lapse, n_classes = 1 / (len(felt) + 2), p.shape[1]

    def loss(correlation: float) -> float:
        told = softmax(independent(n, correlation)[:, None] * mean)[right, labels]
        return -float(np.sum(np.log((1 - lapse) * told + lapse / n_classes) / felt[of]))

    return float(minimize_scalar(loss, bounds=(0, 1), method="bounded", options={"xatol": 1e-3}).x)


def so_far(p: Samples, contacts: ArrayLike) -> tuple[Samples, Labels, Labels]:
    """Return what each contact has said when a window of it was felt, and how much of it.

    Parameters
    ----------
    p : ndarray of shape (n, n_classes)
        Calibrated probabilities of windows, in the order in which they were felt.
    contacts : array_like of shape (n,)
        Which contact each one is of.

    Returns
    -------
    mean : ndarray of shape (n, n_classes)
        Mean log posterior of the windows so far.
    n : ndarray of int, shape (n,)
        How many these are.
    of : ndarray of int, shape (n,)
        Number of the contact.
    """
    import pandas as pd

    logs = pd.DataFrame(log_of(p))
    of = pd.factorize(np.asarray(contacts))[0]
    n = np.asarray(logs.groupby(of).cumcount(), dtype=np.intp) + 1
    return logs.groupby(of).cumsum().to_numpy() / n[:, None], n, np.asarray(of, dtype=np.intp)


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
        Bins hold equally many answers instead of spanning equal widths of [0, 1]; answers of the same
        confidence stay together.

    Raises
    ------
    ValueError
        If there is no answer, or the lengths differ.
    """
    p, right = np.asarray(confidence, dtype=np.float64), np.asarray(hits, dtype=np.float64)
    if p.size == 0 or p.shape != right.shape:
        raise ValueError(f"confidence has shape {p.shape}, hits {right.shape}. Expected one of each, n > 0")
    gaps = np.bincount(_bins(p, n_bins, equal_counts), weights=right - p)
    return float(np.abs(gaps).sum() / p.size)


def calibration_error_of_chance(
    confidence: ArrayLike, n_bins: int = N_BINS, *, equal_counts: bool = False
) -> float:
    """Return what `expected_calibration_error` is on the average where probabilities are perfect.

    Gaps of bins are absolute, so chance does not cancel: sum_b sqrt(2/pi sum_{i in b} p_i (1 - p_i)) / n, the
    mean of as many absolute normal deviates. An error is one only as far as it is larger.
    """
    p = np.asarray(confidence, dtype=np.float64)
    variances = np.bincount(_bins(p, n_bins, equal_counts), weights=p * (1 - p))
    return float(np.sqrt(2 / np.pi * variances).sum() / p.size)


def _bins(p: Samples, n_bins: int, equal_counts: bool) -> Labels:
    from scipy.stats import rankdata

    place = (rankdata(p) - 0.5) / p.size if equal_counts else p
    return np.minimum((place * n_bins).astype(np.intp), n_bins - 1)
