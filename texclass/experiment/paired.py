"""Two pipelines on the same splits: their difference, its interval, and how likely chance alone makes it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtr, stdtrit
from scipy.stats import binomtest

from texclass.experiment.accuracy import by_cluster, has_spread, jackknife_error, wilson_interval
from texclass.experiment.protocols import Protocol, Split
from texclass.recording import Samples

Hits = Sequence[Sequence[NDArray[np.bool_]]]
"""Repeat -> fold -> whether each test was right."""
LEVEL, POWER = 0.05, 0.8
"""Of tests, two-sided; at which the least difference that can be seen is told."""


def corrected_resampled_t(
    differences: ArrayLike, test_train_ratio: float, confidence: float = 0.95
) -> tuple[tuple[float, float], float]:
    """Return interval and two-sided p-value of the mean difference over folds of repeated cross-validation.

    The training sets of folds overlap, so their differences d_1 ... d_J are not independent, and the plain
    t-test finds differences where there are none. With the corrected variance of the mean,

        t = mean d / sqrt((1/J + n_test/n_train) s^2),  J - 1 degrees of freedom,

    s^2 being the variance of d (divisor J - 1). Folds that all agree have no spread to judge a difference by:
    then it may be anything, from -1 to 1, and p is 1.

    Parameters
    ----------
    differences : array_like of shape (J,)
        Accuracy of the one minus that of the other in each fold of each repeat.
    test_train_ratio : float
        n_test/n_train, recordings of a fold.
    confidence : float
        Of the interval.

    Raises
    ------
    ValueError
        If there are fewer than two differences.

    References
    ----------
    Nadeau, Bengio (2003): Inference for the generalization error. Machine Learning 52; for repeated
    cross-validation Bouckaert, Frank (2004): Evaluating the replicability of significance tests. PAKDD.

    Examples
    --------
    >>> interval, p = corrected_resampled_t([0.02, 0.0, 0.04, 0.02], 1 / 3)
    >>> round(p, 3)
    0.207
    """
    d = np.asarray(differences, dtype=np.float64)
    if d.size < 2:
        raise ValueError(f"{d.size} differences; the rule is at least 2 folds")
    if agree(d):
        return (-1.0, 1.0), 1.0
    # t = mean d / sqrt((1/J + n_test/n_train) s^2)
    error = float(np.sqrt((1 / d.size + test_train_ratio) * d.var(ddof=1)))
    return _t_test(float(d.mean()), error, d.size - 1, confidence)


def agree(values: ArrayLike) -> bool:
    """Return whether values are the same but for rounding."""
    return bool(np.ptp(values) <= 1e-12)


def clustered_t(
    differences: ArrayLike, n_tests: ArrayLike, confidence: float = 0.95
) -> tuple[tuple[float, float], float]:
    """Return interval and two-sided p-value of a pooled difference whose tests come in clusters.

        t = d / e,  d = sum of differences / sum of tests,  e^2 = (K - 1)/K sum_k (d_(k) - mean d_(.))^2,

    d_(k) being computed without cluster k; K - 1 degrees of freedom. Where clusters have no spread (see
    `texclass.experiment.accuracy.has_spread`) each counts as one test: the interval is as far to either side
    as Wilson's of none of them, and p is that of flipping their signs, 2/2^K; if none differs, 1.

    Parameters
    ----------
    differences, n_tests : array_like of shape (n_clusters,)
        Of each recording (or run, operator): tests that only the one recognised, minus those that only the
        other did; and how many tests it holds.
    confidence : float
        Of the interval.
    """
    sums, n = np.asarray(differences, dtype=np.float64), np.asarray(n_tests)
    d, k = float(sums.sum() / n.sum()), len(n)
    if not has_spread(sums, n):
        half = wilson_interval(0, k, confidence)[1]
        p = 2.0 ** (1 - k) if np.all(sums > 0) or np.all(sums < 0) else 1.0
        return (max(-1.0, d - half), min(1.0, d + half)), p
    # d_(k): without cluster k
    return _t_test(d, jackknife_error((sums.sum() - sums) / (n.sum() - n)), k - 1, confidence)


def _t_test(mean: float, error: float, free: int, confidence: float) -> tuple[tuple[float, float], float]:
    half = float(stdtrit(free, 0.5 + confidence / 2) * error)
    return (mean - half, mean + half), float(2 * stdtr(free, -abs(mean / error)))


def least_difference(interval: tuple[float, float], free: int) -> float:
    """Return the difference that a test would find in `POWER` of all trials, from its 95 % interval.

    (t_(1 - LEVEL/2) + t_POWER) e, with the standard error e that is in the interval.
    """
    quantile = stdtrit(free, 1 - LEVEL / 2)
    return float((interval[1] - interval[0]) / 2 * (quantile + stdtrit(free, POWER)) / quantile)


def exact_mcnemar(n_gained: int, n_lost: int) -> float:
    """Return the two-sided p-value of McNemar's exact test.

    Of the recordings that only one of two pipelines recognises, chance alone gives each pipeline half.
    """
    discordant = n_gained + n_lost
    return float(binomtest(n_gained, discordant).pvalue) if discordant else 1.0


def holm(p_values: ArrayLike) -> Samples:
    """Return p-values corrected for how many there are (Holm, 1979), in the order given.

    The k-th smallest of m (from 0) is multiplied by m - k, and none is smaller than the one before.
    """
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p)
    stepped = np.maximum.accumulate((p.size - np.arange(p.size)) * p[order])
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected


def compare(
    hits: Hits,
    other: Hits,
    splits: Sequence[Split],
    protocol: Protocol,
    independent: tuple[str, NDArray[np.str_]],
) -> dict[str, Any]:
    """Compare two pipelines on the same tests.

    Folds that the protocol draws are resampled: `corrected_resampled_t` takes the differences of all folds
    and repeats. One set of splits, or folds that all agree, are judged by what is independent: `clustered_t`
    gives the interval and the p-value, or `exact_mcnemar` the latter where each is a single test.

    Parameters
    ----------
    hits, other : sequence of sequence of ndarray of shape (n_test,)
        Repeat -> fold -> whether each test was right, by the one and by the other.
    splits : sequence of (train, test)
        Of the first repeat; there may be more than were tested.
    protocol : Protocol
        How they were made.
    independent : (str, ndarray of shape (n_recordings,))
        What is independent, and which each row comes from; see `Protocol.independent`.

    Returns
    -------
    dict
        As JSON: `difference` of the mean accuracies, a fraction, with its 95 % interval from `low` to `high`;
        two-sided `p_value`: how likely chance alone makes such a difference or a larger one; the `least`
        difference that would be found in 8 of 10 trials; the `test` that gave them, over `n_clusters` of
        `clusters`; the difference in each of the `folds` of each repeat; tests (of all repeats) in which only
        the one, only the other was right: `n_gained`, `n_lost`.
    """
    folds = [
        [float(a.mean() - b.mean()) for a, b in zip(*pair, strict=True)]
        for pair in zip(hits, other, strict=True)
    ]
    one, two = (np.concatenate([fold for repeat in of for fold in repeat]) for of in (hits, other))
    gained, lost = int((one & ~two).sum()), int((two & ~one).sum())
    differences, (unit, groups) = np.concatenate(folds), independent
    tested = np.concatenate([groups[test] for _, test in splits[: len(hits[0])]])
    first = slice(tested.size)  # of the first repeat
    sums, n_tests = by_cluster(one[first].astype(int) - two[first], tested)
    if protocol.drawn and len(hits[0]) > 1 and not agree(differences):
        ratio = float(np.mean([test.size / train.size for train, test in splits]))
        interval, p = corrected_resampled_t(differences, ratio)
        test, difference, free = "corrected resampled t-test over folds and repeats", differences.mean(), None
    else:
        interval, p = clustered_t(sums, n_tests)
        test, difference, free = f"t-test over {unit}s", sums.sum() / n_tests.sum(), len(n_tests) - 1
        if n_tests.max() == 1:
            n_first = (int((one & ~two)[first].sum()), int((two & ~one)[first].sum()))
            test, p = f"exact McNemar test, t interval over {unit}s", exact_mcnemar(*n_first)
    return {
        "low": interval[0],
        "high": interval[1],
        "difference": float(difference),
        "p_value": p,
        "least": least_difference(interval, max(1, free or differences.size - 1)),
        "test": test,
        "clusters": unit,
        "n_clusters": len(n_tests),
        "folds": folds,
        "n_gained": gained,
        "n_lost": lost,
    }
