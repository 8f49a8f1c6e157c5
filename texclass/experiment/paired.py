"""Two pipelines on the same splits: their difference, its interval, and how likely chance alone makes it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtr, stdtrit
from scipy.stats import binomtest

from texclass.experiment.protocols import Protocol, Split
from texclass.recording import Samples

Hits = Sequence[Sequence[NDArray[np.bool_]]]
"""Repeat -> fold -> whether each test was right."""
N_RESAMPLES = 4000


def corrected_resampled_t(
    differences: ArrayLike, test_train_ratio: float, confidence: float = 0.95
) -> tuple[tuple[float, float], float]:
    """Return interval and two-sided p-value of the mean difference over folds of repeated cross-validation.

    The training sets of folds overlap, so their differences d_1 ... d_J are not independent, and the plain
    t-test finds differences where there are none. With the corrected variance of the mean,

        t = mean d / sqrt((1/J + n_test/n_train) s^2),  J - 1 degrees of freedom,

    s^2 being the variance of d (divisor J - 1).

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
    # t = mean d / sqrt((1/J + n_test/n_train) s^2)
    error = np.sqrt((1 / d.size + test_train_ratio) * d.var(ddof=1))
    mean, free = float(d.mean()), d.size - 1
    half = float(stdtrit(free, 0.5 + confidence / 2) * error)
    if error == 0:
        return (mean, mean), float(mean == 0)
    return (mean - half, mean + half), float(2 * stdtr(free, -abs(mean / error)))


def exact_mcnemar(n_gained: int, n_lost: int) -> float:
    """Return the two-sided p-value of McNemar's exact test.

    Of the recordings that only one of two pipelines recognises, chance alone gives each pipeline half.
    """
    discordant = n_gained + n_lost
    return float(binomtest(n_gained, discordant).pvalue) if discordant else 1.0


def sign_flip(differences: ArrayLike, rng: np.random.Generator) -> float:
    """Return the two-sided p-value of a sum of differences whose signs chance alone would give.

    McNemar's test for clusters: a recording whose windows are tested counts with their sum, once.

    Parameters
    ----------
    differences : array_like of shape (n_clusters,)
        Tests of each cluster that only the one recognised, minus those that only the other did.
    rng : numpy.random.Generator
        Draws the signs.
    """
    d = np.abs(np.asarray(differences, dtype=np.float64))
    sums = (1 - 2 * rng.integers(0, 2, (N_RESAMPLES, d.size))) @ d
    n_as_large = int((np.abs(sums) >= abs(np.sum(differences)) - 1e-9).sum())
    return (1 + n_as_large) / (1 + N_RESAMPLES)


def paired_bootstrap(
    differences: ArrayLike, n_tests: ArrayLike, rng: np.random.Generator, confidence: float = 0.95
) -> tuple[float, float]:
    """Return the percentile interval of sum of differences / sum of tests over resampled clusters.

    Parameters
    ----------
    differences, n_tests : array_like of shape (n_clusters,)
        Of each recording (or run): see `sign_flip`, and how many tests it holds.
    rng : numpy.random.Generator
        Draws the clusters.
    confidence : float
        Coverage.
    """
    d, n = np.asarray(differences), np.asarray(n_tests)
    drawn = rng.multinomial(d.size, np.full(d.size, 1 / d.size), size=N_RESAMPLES)
    low, high = np.quantile((drawn @ d) / (drawn @ n), [0.5 - confidence / 2, 0.5 + confidence / 2])
    return float(low), float(high)


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
    clusters: NDArray[np.str_],
    seed: int,
) -> dict[str, Any]:
    """Compare two pipelines on the same tests.

    Folds that the protocol draws are resampled: `corrected_resampled_t` takes the differences of all folds
    and repeats. One set of splits is judged by its discordant tests: `paired_bootstrap` over clusters gives
    the interval, `exact_mcnemar` the p-value, or `sign_flip` where a cluster holds several tests.

    Parameters
    ----------
    hits, other : sequence of sequence of ndarray of shape (n_test,)
        Repeat -> fold -> whether each test was right, by the one and by the other.
    splits : sequence of (train, test)
        Of the first repeat; there may be more than were tested.
    protocol : Protocol
        How they were made.
    clusters : ndarray of shape (n_recordings,)
        Which recording (or run) each row comes from.
    seed : int
        Of the bootstrap and of the flips.

    Returns
    -------
    dict
        As JSON: `difference` of the mean accuracies, a fraction, with its 95 % interval from `low` to `high`;
        two-sided `p_value`: how likely chance alone makes such a difference or a larger one; the `test` that
        gave them; the difference in each of the `folds` of each repeat; tests (of all repeats) in which only
        the one, only the other was right: `n_gained`, `n_lost`.
    """
    folds = [
        [float(a.mean() - b.mean()) for a, b in zip(*pair, strict=True)]
        for pair in zip(hits, other, strict=True)
    ]
    one, two = (np.concatenate([fold for repeat in of for fold in repeat]) for of in (hits, other))
    gained, lost = int((one & ~two).sum()), int((two & ~one).sum())
    if protocol.drawn and len(hits[0]) > 1:
        differences = np.concatenate(folds)
        ratio = float(np.mean([test.size / train.size for train, test in splits]))
        interval, p = corrected_resampled_t(differences, ratio)
        difference, test = differences.mean(), "corrected resampled t-test over folds and repeats"
    else:
        d = one.astype(int) - two
        tested = np.concatenate([clusters[test] for _, test in splits[: len(hits[0])]])
        _, cluster = np.unique(tested, return_inverse=True)
        n_tests, sums = np.bincount(cluster), np.bincount(cluster, weights=d)
        rng = np.random.default_rng(seed)
        interval = paired_bootstrap(sums, n_tests, rng)
        single = n_tests.max() == 1
        p = exact_mcnemar(gained, lost) if single else sign_flip(sums, rng)
        name = "exact McNemar" if single else "sign-flip"
        difference, test = d.mean(), f"{name} test and paired bootstrap over {protocol.unit}s"
    return {
        "low": interval[0],
        "high": interval[1],
        "difference": float(difference),
        "p_value": p,
        "test": test,
        "folds": folds,
        "n_gained": gained,
        "n_lost": lost,
    }
