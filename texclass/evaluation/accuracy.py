"""Accuracies with intervals, and their differences on the same splits, over what is independent.

That is recordings, runs, or the operators who made them.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, ndtri, stdtr, stdtrit

from texclass.recording import Samples

if TYPE_CHECKING:
    from texclass.evaluation.protocols import Protocol
    from texclass.evaluation.splits import Split

Labels = NDArray[Any]
Hits = Sequence[Sequence[NDArray[np.bool_]]]
"""Repeat -> fold -> whether each test was right."""
LEAST_CLUSTERS = 5
"""Clusters from which their spread is an interval; of fewer, each counts as one test."""
LEAST_CORRELATION = 0.1
"""Intraclass correlation that the lower limit of an interval over clusters allows for at least: clusters that
agree may lack the one in ten that is far worse (see `cluster_interval`)."""
LEVEL = 0.05
"""Of tests, two-sided."""


@dataclass(frozen=True)
class Accuracy:
    """Share of correct classifications, pooled over folds.

    Attributes
    ----------
    n_hits, n_tested
        Correct classifications out of all.
    folds
        Accuracy of each fold, for paired comparisons on the same folds.
    balanced
        Mean over surfaces of the share that was recognised; None where every surface was tested equally
        often, for then it is the accuracy itself.
    bounds
        95 % interval over clusters (recordings, runs, operators), where several tests come from one of them;
        see `cluster_interval`.
    voted
        Accuracy of the recordings (or runs), each the majority of its tests; None where each is one test.
    n_clusters
        How many clusters were tested; None where each is one test.
    spread
        Whether the bounds come from the spread over clusters; if not, so few cannot tell.
    """

    n_hits: int
    n_tested: int
    folds: tuple[float, ...] = ()
    balanced: float | None = None
    bounds: tuple[float, float] | None = None
    voted: "Accuracy | None" = None
    n_clusters: int | None = None
    spread: bool = False

    @property
    def mean(self) -> float:
        """Accuracy as a fraction."""
        return self.n_hits / self.n_tested

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval: `bounds`, else Wilson's."""
        return self.bounds or wilson_interval(self.n_hits, self.n_tested)

    @property
    def worst(self) -> float:
        """Accuracy of the worst fold."""
        return min(self.folds, default=self.mean)

    def to_dict(self, unit: str = "recording", clusters: str = "") -> dict[str, Any]:
        """Return the accuracy as JSON values.

        Parameters
        ----------
        unit : str
            What votes: "recording" or "run".
        clusters : str
            What is independent: "recording", "run", "operator", "session"; what votes by default.
        """
        (low, high), over = self.interval, clusters or unit
        alone = self.bounds is None
        return {
            "mean": self.mean,
            "low": low,
            "high": high,
            "interval": "Wilson" if alone else f"{'t' if self.spread else 'Wilson'} over {over}s",
            "clusters": over,
            "n_clusters": self.n_tested if self.n_clusters is None else self.n_clusters,
            "balanced": self.mean if self.balanced is None else self.balanced,
            "worst": self.worst,
            "folds": list(self.folds),
            **({} if self.voted is None else {f"per_{unit}": self.voted.to_dict(unit, over)}),
        }


def wilson_interval(n_hits: float, n_tested: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the Wilson score interval of a proportion; hits may be a fraction, as of clusters.

    (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n), with p = n_hits/n and z the normal quantile.
    """
    p, n, z = n_hits / n_tested, n_tested, ndtri(0.5 + confidence / 2)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    low, high = ((p + z**2 / (2 * n) + side * half) / (1 + z**2 / n) for side in (-1, 1))
    # Rounding must not part a proportion from its own limits.
    return max(0.0, min(float(low), p)), min(1.0, max(float(high), p))


def cluster_interval(hits: ArrayLike, clusters: ArrayLike, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of a proportion whose tests come in clusters, few or many.

    The logit of the pooled proportion, g = log((s + 1/2)/(n - s + 1/2)), s hits of n tests, is computed
    again without each of the K clusters; its standard error is that of the jackknife,

        e^2 = (K - 1)/K sum_k (g_(k) - mean g_(.))^2,

    and the interval g -+ t e, with the t quantile of K - 1 degrees of freedom, is taken back to proportions.
    One far worse operator in ten may be absent from a test of few operators, whose spread is then too small.
    The lower limit therefore uses at least the error at an intraclass correlation of r = `LEAST_CORRELATION`,

        e^2 >= (1 + r (sum_k n_k^2/n - 1))/(n p (1 - p)),  p = (s + 1/2)/(n + 1).

    Simulated with 5 to 40 clusters and proportions of 0.6 to 0.9 (reports/studies/certainty.md), it covers
    94 % or more where one operator in ten is far worse (intraclass correlation 0.2), where the spread alone
    covers 53 to 87 %, and where skill varies by a beta distribution. The price is width: with about 20 tests
    from each of 12 operators of equal skill it is 17 points wide, not 10. The upper limit makes no allowance
    for one operator in ten who is far better.
    Where all clusters agree, or fewer than `LEAST_CLUSTERS` are there, each counts as one test of Wilson's.

    Parameters
    ----------
    hits : array_like of bool, shape (n_tested,)
        Whether each test was right.
    clusters : array_like of shape (n_tested,)
        Which recording (or run, operator) each test comes from.
    confidence : float
        Coverage.
    """
    n_hits, n_tests = by_cluster(hits, clusters)
    s, n, k = n_hits.sum(), n_tests.sum(), len(n_tests)
    if not has_spread(n_hits, n_tests):
        return wilson_interval(k * s / n, k, confidence)
    g, without = np.log((s + 0.5) / (n - s + 0.5)), (s - n_hits, n - n_tests)
    # e^2 = (K - 1)/K sum_k (g_(k) - mean g_(.))^2
    error = jackknife_error(np.log((without[0] + 0.5) / (without[1] - without[0] + 0.5)))
    # e^2 >= (1 + r (sum_k n_k^2/n - 1))/(n p (1 - p))
    p = (s + 0.5) / (n + 1)
    least = np.sqrt((1 + LEAST_CORRELATION * ((n_tests**2).sum() / n - 1)) / (n * p * (1 - p)))
    t = stdtrit(k - 1, 0.5 + confidence / 2)
    low, high = expit([g - t * max(error, least), g + t * error])
    return min(float(low), s / n), max(float(high), s / n)


def by_cluster(values: ArrayLike, clusters: ArrayLike) -> tuple[Samples, NDArray[np.intp]]:
    """Return the sum of what belongs to each cluster, and how many tests that is."""
    _, cluster = np.unique(np.asarray(clusters), return_inverse=True)
    sums = np.bincount(cluster, weights=np.asarray(values, dtype=np.float64))
    return sums.astype(np.float64), np.bincount(cluster)


def has_spread(sums: Samples, n_tests: NDArray[np.intp]) -> bool:
    """Return whether there are `LEAST_CLUSTERS` clusters, and their means are not all the same."""
    return len(n_tests) >= LEAST_CLUSTERS and bool(np.any(sums * n_tests.sum() != n_tests * sums.sum()))


def jackknife_error(without: Samples) -> float:
    """Return the standard error of what was computed without each cluster in turn."""
    k = len(without)
    return float(np.sqrt((k - 1) / k * ((without - without.mean()) ** 2).sum()))


def most_frequent(labels: Iterable[Any]) -> Any:
    """Return what occurs most often; of equals, what comes first."""
    return Counter(labels).most_common(1)[0][0]


def score(
    truth: Sequence[Labels],
    predicted: Sequence[Labels],
    clusters: Sequence[Labels] | None = None,
    independent: Sequence[Labels] | None = None,
) -> Accuracy:
    """Score predictions.

    Parameters
    ----------
    truth, predicted : sequence of ndarray
        Labels, one array a fold.
    clusters : sequence of ndarray, optional
        Which recording (or run) each test comes from: it votes, if any holds several tests.
    independent : sequence of ndarray, optional
        Which operator (or whatever is independent) each test comes from: the bounds are over these, if any
        holds several tests. The clusters by default; without any, tests are independent.
    """
    hits = [t == p for t, p in zip(truth, predicted, strict=True)]
    every_truth, every_hit = np.concatenate(truth), np.concatenate(hits)
    surfaces, counts = np.unique(every_truth, return_counts=True)
    balanced = None
    if np.ptp(counts):
        balanced = float(np.mean([every_hit[every_truth == surface].mean() for surface in surfaces]))
    accuracy = Accuracy(
        n_hits=int(every_hit.sum()),
        n_tested=every_hit.size,
        folds=tuple(float(h.mean()) for h in hits),
        balanced=balanced,
    )
    groups = independent or clusters
    if groups is not None and (over := np.concatenate(groups)).size > (n := len(np.unique(over))):
        bounds, spread = cluster_interval(every_hit, over), has_spread(*by_cluster(every_hit, over))
        accuracy = replace(accuracy, bounds=bounds, n_clusters=n, spread=spread)
    if clusters is None or all(np.unique(c).size == c.size for c in clusters):
        return accuracy
    votes = [
        pd.DataFrame({"truth": t, "predicted": p, "cluster": c, "independent": i})
        # A cluster of two surfaces counts as two.
        .groupby(["truth", "cluster"], sort=False)
        .agg({"predicted": most_frequent, "independent": "last"})
        .reset_index()
        for t, p, c, i in zip(truth, predicted, clusters, groups or clusters, strict=True)
    ]
    columns = ([of[name].to_numpy() for of in votes] for name in ("truth", "predicted", "independent"))
    felt, taken, of_votes = columns
    return replace(accuracy, voted=score(felt, taken, independent=of_votes))


def corrected_resampled_t(
    differences: ArrayLike, test_train_ratio: float
) -> tuple[tuple[float, float], float]:
    """Return 95 % interval and two-sided p-value of the mean difference over folds that are drawn repeatedly.

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
        raise ValueError(f"{d.size} differences. Expected at least 2 folds")
    if agree(d):
        return (-1.0, 1.0), 1.0
    # t = mean d / sqrt((1/J + n_test/n_train) s^2)
    error = float(np.sqrt((1 / d.size + test_train_ratio) * d.var(ddof=1)))
    return _t_test(float(d.mean()), error, d.size - 1)


def agree(values: ArrayLike) -> bool:
    """Return whether values are the same but for rounding."""
    return bool(np.ptp(values) <= 1e-12)


def clustered_t(differences: ArrayLike, n_tests: ArrayLike) -> tuple[tuple[float, float], float]:
    """Return 95 % interval and two-sided p-value of a pooled difference whose tests come in clusters.

        t = d / e,  d = sum of differences / sum of tests,  e^2 = (K - 1)/K sum_k (d_(k) - mean d_(.))^2,

    d_(k) being computed without cluster k; K - 1 degrees of freedom. Where clusters have no spread (see
    `has_spread`) each counts as one test: the interval is as far to either side
    as Wilson's of none of them, and p is that of flipping their signs, 2/2^K; if none differs, 1.

    Parameters
    ----------
    differences, n_tests : array_like of shape (n_clusters,)
        Of each recording (or run, operator): tests that only the one recognised, minus those that only the
        other did; and how many tests it holds.
    """
    sums, n = np.asarray(differences, dtype=np.float64), np.asarray(n_tests)
    d, k = float(sums.sum() / n.sum()), len(n)
    if not has_spread(sums, n):
        half = cluster_interval(np.zeros(k), np.arange(k))[1]
        p = 2.0 ** (1 - k) if np.all(sums > 0) or np.all(sums < 0) else 1.0
        return (max(-1.0, d - half), min(1.0, d + half)), p
    # d_(k): without cluster k
    return _t_test(d, jackknife_error((sums.sum() - sums) / (n.sum() - n)), k - 1)


def _t_test(mean: float, error: float, free: int) -> tuple[tuple[float, float], float]:
    half = float(stdtrit(free, 1 - LEVEL / 2) * error)
    return (mean - half, mean + half), float(2 * stdtr(free, -abs(mean / error)))


def least_difference(interval: tuple[float, float], free: int) -> float:
    """Return the difference that a test would find in 8 of 10 trials, from its 95 % interval.

    (t_(1 - LEVEL/2) + t_0.8) e, with the standard error e that is in the interval.
    """
    quantile = stdtrit(free, 1 - LEVEL / 2)
    return float((interval[1] - interval[0]) / 2 * (quantile + stdtrit(free, 0.8)) / quantile)


def exact_mcnemar(n_gained: int, n_lost: int) -> float:
    """Return the two-sided p-value of McNemar's exact test.

    Of the recordings that only one of two pipelines recognises, chance alone gives each pipeline half.
    """
    n_discordant = n_gained + n_lost
    return float(scipy.stats.binomtest(n_gained, n_discordant).pvalue) if n_discordant else 1.0


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
    splits: "Sequence[Split]",
    protocol: "Protocol",
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
    if protocol.is_random and len(hits[0]) > 1 and not agree(differences):
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
