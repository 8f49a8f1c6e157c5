"""Accuracies with confidence intervals over independent units, and paired comparisons of two pipelines.

An independent unit is a recording, a run, a session or an operator.
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
"""Whether each prediction is correct, by repeat and fold."""
MIN_CLUSTERS = 5
"""Smallest number of clusters whose spread determines an interval. With fewer, each counts as one test."""
MIN_CORRELATION = 0.1
"""Smallest intraclass correlation assumed for the lower limit of an interval over clusters. If one operator
in ten is far worse than the rest, a small sample may contain no such operator (see `cluster_interval`)."""
LEVEL = 0.05
"""Significance level of two-sided tests."""


@dataclass(frozen=True)
class Accuracy:
    """Accuracy pooled over folds, with its confidence interval.

    Attributes
    ----------
    n_hits, n_tested
        Number of correct predictions, and number of predictions.
    folds
        Accuracy of each fold, for paired comparisons on the same folds.
    balanced
        Balanced accuracy, which is the mean of the accuracies of the surfaces. None if every surface was
        tested equally often, because the balanced accuracy then equals the accuracy.
    bounds
        95 % confidence interval over clusters (recordings, runs or operators); see `cluster_interval`. None
        if each cluster has only one test.
    majority_vote
        Accuracy of the majority votes over the predictions of each recording (or run). None if each recording
        has only one prediction.
    n_clusters
        Number of clusters. None if each cluster has only one test.
    has_spread
        Whether `bounds` are computed from the spread between clusters, which requires at least
        `MIN_CLUSTERS` clusters.

    Examples
    --------
    >>> accuracy = Accuracy(n_hits=18, n_tested=20)
    >>> accuracy.mean
    0.9
    >>> [round(limit, 3) for limit in accuracy.interval]
    [0.699, 0.972]
    """

    n_hits: int
    n_tested: int
    folds: tuple[float, ...] = ()
    balanced: float | None = None
    bounds: tuple[float, float] | None = None
    majority_vote: "Accuracy | None" = None
    n_clusters: int | None = None
    has_spread: bool = False

    @property
    def mean(self) -> float:
        """Accuracy as a fraction."""
        return self.n_hits / self.n_tested

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval: `bounds`, or the Wilson score interval if `bounds` is None."""
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
            Unit of the majority vote: "recording" (default) or "run".
        clusters : str
            Independent unit: "recording", "run", "operator" or "session" (default: `unit`).
        """
        (low, high), cluster_name = self.interval, clusters or unit
        method = "Wilson"
        if self.bounds is not None:
            method = f"{'t' if self.has_spread else 'Wilson'} over {cluster_name}s"
        return {
            "mean": self.mean,
            "low": low,
            "high": high,
            "interval": method,
            "clusters": cluster_name,
            "n_clusters": self.n_tested if self.n_clusters is None else self.n_clusters,
            "balanced": self.mean if self.balanced is None else self.balanced,
            "worst": self.worst,
            "folds": list(self.folds),
            **(
                {}
                if self.majority_vote is None
                else {f"per_{unit}": self.majority_vote.to_dict(unit, cluster_name)}
            ),
        }


def wilson_interval(n_hits: float, n_tested: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the Wilson score interval of a proportion.

    (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n), where p = n_hits/n,
    n = n_tested, and z is the normal quantile.

    Parameters
    ----------
    n_hits : float
        Number of successes, not necessarily an integer.
    n_tested : int
        Number of trials.
    confidence : float
        Coverage of the interval (default 0.95).

    Returns
    -------
    tuple of float
        Lower and upper limit.

    Examples
    --------
    >>> [round(limit, 3) for limit in wilson_interval(18, 20)]
    [0.699, 0.972]
    """
    p, n, z = n_hits / n_tested, n_tested, ndtri(0.5 + confidence / 2)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    low, high = ((p + z**2 / (2 * n) + side * half) / (1 + z**2 / n) for side in (-1, 1))
    # Rounding errors must not exclude the proportion from its interval.
    return max(0.0, min(float(low), p)), min(1.0, max(float(high), p))


def cluster_interval(hits: ArrayLike, clusters: ArrayLike, confidence: float = 0.95) -> tuple[float, float]:
    """Return the confidence interval of a proportion whose tests are correlated within clusters.

    The logit of the pooled proportion is g = log((s + 1/2)/(n - s + 1/2)), for s correct
    predictions in n tests. Its standard error e is the jackknife error over the K clusters,

        e^2 = (K - 1)/K sum_k (g_(k) - mean g_(.))^2,

    where g_(k) is computed without cluster k. The interval g -+ t e, with the t quantile of K - 1 degrees of
    freedom, is transformed back to proportions. If one operator in ten is far worse than the rest, a sample
    of few operators may contain no such operator, so that its spread is too small. For the lower limit, the
    standard error is therefore at least its value for an intraclass correlation of r = `MIN_CORRELATION`,

        e^2 >= (1 + r (sum_k n_k^2/n - 1))/(n p (1 - p)),  p = (s + 1/2)/(n + 1),

    where n_k is the number of tests in cluster k. If all clusters have the same proportion, or there are
    fewer than `MIN_CLUSTERS`, the function returns a Wilson score interval in which each cluster counts as
    one test.

    Parameters
    ----------
    hits : array_like of bool, shape (n_tested,)
        Whether each prediction is correct.
    clusters : array_like of shape (n_tested,)
        Cluster of each test: recording, run or operator.
    confidence : float
        Coverage of the interval (default 0.95).

    Returns
    -------
    tuple of float
        Lower and upper limit.

    Notes
    -----
    In simulations with 5 to 40 clusters and proportions of 0.6 to 0.9 (reports/studies/certainty.md), the
    coverage is at least 94 % if one operator in ten is far worse (intraclass correlation 0.2). An interval
    from the spread alone covers 53 to 87 %. The price is a wider interval: 17 instead of 10 percentage points
    for about 20 tests from each of 12 operators of equal skill. The upper limit is not corrected for
    operators who are far better.

    Examples
    --------
    >>> hits = [1, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1, 1]
    >>> operators = ["a", "a", "b", "b", "c", "c", "d", "d", "e", "e", "f", "f"]
    >>> [round(limit, 2) for limit in cluster_interval(hits, operators)]
    [0.37, 0.96]
    """
    n_hits, n_tests = sum_clusters(hits, clusters)
    s, n, k = n_hits.sum(), n_tests.sum(), len(n_tests)
    if not has_spread(n_hits, n_tests):
        return wilson_interval(k * s / n, k, confidence)
    g = np.log((s + 0.5) / (n - s + 0.5))
    s_k, n_k = s - n_hits, n - n_tests  # without cluster k
    # e^2 = (K - 1)/K sum_k (g_(k) - mean g_(.))^2
    error = jackknife_error(np.log((s_k + 0.5) / (n_k - s_k + 0.5)))
    # e^2 >= (1 + r (sum_k n_k^2/n - 1))/(n p (1 - p))
    p = (s + 0.5) / (n + 1)
    min_error = np.sqrt((1 + MIN_CORRELATION * ((n_tests**2).sum() / n - 1)) / (n * p * (1 - p)))
    t = stdtrit(k - 1, 0.5 + confidence / 2)
    low, high = expit([g - t * max(error, min_error), g + t * error])
    return min(float(low), s / n), max(float(high), s / n)


def sum_clusters(values: ArrayLike, clusters: ArrayLike) -> tuple[Samples, NDArray[np.intp]]:
    """Return the sum of the values in each cluster, and the number of values in each cluster."""
    _, cluster = np.unique(np.asarray(clusters), return_inverse=True)
    sums = np.bincount(cluster, weights=np.asarray(values, dtype=np.float64))
    return sums.astype(np.float64), np.bincount(cluster)


def has_spread(sums: Samples, n_tests: NDArray[np.intp]) -> bool:
    """Return whether there are at least `MIN_CLUSTERS` clusters whose means are not all equal."""
    return len(n_tests) >= MIN_CLUSTERS and bool(np.any(sums * n_tests.sum() != n_tests * sums.sum()))


def jackknife_error(estimates: Samples) -> float:
    """Return the jackknife standard error of leave-one-cluster-out estimates, shape (n_clusters,)."""
    k = len(estimates)
    return float(np.sqrt((k - 1) / k * ((estimates - estimates.mean()) ** 2).sum()))


def most_frequent(labels: Iterable[Any]) -> Any:
    """Return the most frequent label, or the first of several equally frequent labels."""
    return Counter(labels).most_common(1)[0][0]


def score(
    y_true: Sequence[Labels],
    y_pred: Sequence[Labels],
    clusters: Sequence[Labels] | None = None,
    independent: Sequence[Labels] | None = None,
) -> Accuracy:
    """Return the accuracy of predictions.

    Parameters
    ----------
    y_true, y_pred : sequence of ndarray of shape (n_test,)
        True and predicted labels of each fold.
    clusters : sequence of ndarray of shape (n_test,), optional
        Recording (or run) of each test. If a recording has several tests, the accuracy of the majority vote
        over its predictions is also computed.
    independent : sequence of ndarray of shape (n_test,), optional
        Independent unit of each test, for example the operator (default: `clusters`). If a unit has several
        tests, the confidence interval is computed over units. If neither `clusters` nor `independent` is
        given, all tests count as independent.

    Returns
    -------
    Accuracy
        Accuracy with its confidence interval.
    """
    hits = [t == p for t, p in zip(y_true, y_pred, strict=True)]
    all_labels, all_hits = np.concatenate(y_true), np.concatenate(hits)
    surfaces, counts = np.unique(all_labels, return_counts=True)
    balanced = None
    if np.ptp(counts):
        balanced = float(np.mean([all_hits[all_labels == surface].mean() for surface in surfaces]))
    accuracy = Accuracy(
        n_hits=int(all_hits.sum()),
        n_tested=all_hits.size,
        folds=tuple(float(h.mean()) for h in hits),
        balanced=balanced,
    )
    groups = independent or clusters
    if groups is not None and (units := np.concatenate(groups)).size > (n := len(np.unique(units))):
        bounds, is_spread = cluster_interval(all_hits, units), has_spread(*sum_clusters(all_hits, units))
        accuracy = replace(accuracy, bounds=bounds, n_clusters=n, has_spread=is_spread)
    if clusters is None or all(np.unique(c).size == c.size for c in clusters):
        return accuracy
    votes = [
        pd.DataFrame({"y_true": t, "y_pred": p, "cluster": c, "independent": i})
        # A cluster with two surfaces counts as two.
        .groupby(["y_true", "cluster"], sort=False)
        .agg({"y_pred": most_frequent, "independent": "last"})
        .reset_index()
        for t, p, c, i in zip(y_true, y_pred, clusters, groups or clusters, strict=True)
    ]
    vote_true, vote_pred, vote_units = (
        [frame[name].to_numpy() for frame in votes] for name in ("y_true", "y_pred", "independent")
    )
    return replace(accuracy, majority_vote=score(vote_true, vote_pred, independent=vote_units))


def corrected_resampled_t(
    differences: ArrayLike, test_train_ratio: float
) -> tuple[tuple[float, float], float]:
    """Return the 95 % interval and p-value of a mean difference over repeated folds (corrected t-test).

    Because the training sets of the folds overlap, the differences d_1, ..., d_J are correlated, and an
    ordinary t-test finds too many significant differences. This test corrects the variance of the mean:

        t = mean d / sqrt((1/J + n_test/n_train) s^2),  J - 1 degrees of freedom,

    where s^2 is the variance of d (divisor J - 1). If all differences are equal, the variance cannot be
    estimated, and the function returns the interval (-1, 1) and p = 1.

    Parameters
    ----------
    differences : array_like of shape (J,)
        Difference between two accuracies in each fold of each repeat.
    test_train_ratio : float
        Size of the test set divided by the size of the training set, n_test/n_train.

    Returns
    -------
    tuple
        Confidence interval (low, high), and two-sided p-value.

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
        raise ValueError(f"differences must contain at least 2 values (one per fold), got {d.size}")
    if is_constant(d):
        return (-1.0, 1.0), 1.0
    # t = mean d / sqrt((1/J + n_test/n_train) s^2)
    error = float(np.sqrt((1 / d.size + test_train_ratio) * d.var(ddof=1)))
    return _t_test(float(d.mean()), error, d.size - 1)


def is_constant(values: ArrayLike) -> bool:
    """Return whether all values are equal, apart from rounding errors."""
    return bool(np.ptp(values) <= 1e-12)


def clustered_t(differences: ArrayLike, n_tests: ArrayLike) -> tuple[tuple[float, float], float]:
    """Return the 95 % interval and p-value of a pooled difference whose tests are correlated in clusters.

        t = d / e,  d = sum of differences / sum of tests,  e^2 = (K - 1)/K sum_k (d_(k) - mean d_(.))^2,

    where d_(k) is computed without cluster k. The test has K - 1 degrees of freedom. If the clusters have no
    spread (see `has_spread`), each cluster counts as one test. The half-width of the interval is then the
    upper Wilson limit for 0 successes in K trials. The p-value is that of a sign test: 2/2^K if all signs
    agree, otherwise 1.

    Parameters
    ----------
    differences : array_like of shape (n_clusters,)
        For each cluster, the number of tests that only the first pipeline predicts correctly, minus the
        number that only the second pipeline predicts correctly.
    n_tests : array_like of shape (n_clusters,)
        Number of tests in each cluster.

    Returns
    -------
    tuple
        Interval (low, high), and two-sided p-value.
    """
    sums, n = np.asarray(differences, dtype=np.float64), np.asarray(n_tests)
    d, k = float(sums.sum() / n.sum()), len(n)
    if not has_spread(sums, n):
        half = cluster_interval(np.zeros(k), np.arange(k))[1]
        p = 2.0 ** (1 - k) if np.all(sums > 0) or np.all(sums < 0) else 1.0
        return (max(-1.0, d - half), min(1.0, d + half)), p
    # d_(k), the difference without cluster k
    return _t_test(d, jackknife_error((sums.sum() - sums) / (n.sum() - n)), k - 1)


def _t_test(mean: float, error: float, dof: int) -> tuple[tuple[float, float], float]:
    half = float(stdtrit(dof, 1 - LEVEL / 2) * error)
    return (mean - half, mean + half), float(2 * stdtr(dof, -abs(mean / error)))


def minimum_detectable_difference(interval: tuple[float, float], dof: int) -> float:
    """Return the difference that a test with this 95 % confidence interval detects with a power of 80 %.

    The difference is (t_(1 - LEVEL/2) + t_0.8) e, where t_q is the q quantile of the t distribution, and the
    standard error e is derived from the interval.

    Parameters
    ----------
    interval : tuple of float
        95 % confidence interval of a difference.
    dof : int
        Degrees of freedom of the t distribution from which the interval was computed.
    """
    quantile = stdtrit(dof, 1 - LEVEL / 2)
    return float((interval[1] - interval[0]) / 2 * (quantile + stdtrit(dof, 0.8)) / quantile)


def exact_mcnemar(n_gained: int, n_lost: int) -> float:
    """Return the two-sided p-value of the exact McNemar test.

    Under the null hypothesis, if exactly one of two pipelines predicts a recording correctly, each pipeline
    is equally likely to be the correct one. The arguments are the numbers of recordings that only the first
    or only the second pipeline predicts correctly.
    """
    n_discordant = n_gained + n_lost
    return float(scipy.stats.binomtest(n_gained, n_discordant).pvalue) if n_discordant else 1.0


def holm(p_values: ArrayLike) -> Samples:
    """Return p-values corrected for multiple comparisons (Holm, 1979), in the order of the input.

    The k-th smallest of m p-values (counted from k = 0) is multiplied by m - k. A corrected p-value that is
    smaller than the preceding one is then raised to the preceding one.
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
    """Compare the accuracies of two pipelines on the same tests.

    With repeated random folds, `corrected_resampled_t` tests the differences of all folds and repeats. If
    there is only one repeat, or all folds have the same difference, the differences of the independent units
    are tested instead. `clustered_t` then computes the interval and the p-value. If each unit has only one
    test, `exact_mcnemar` computes the p-value.

    Parameters
    ----------
    hits, other : sequence of sequence of ndarray of shape (n_test,)
        Whether each prediction of the first pipeline (`hits`) and of the second (`other`) is correct, by
        repeat and fold.
    splits : sequence of (train, test)
        Splits of the first repeat. They may include folds that were not tested.
    protocol : Protocol
        Protocol of the splits.
    independent : (str, ndarray of shape (n_recordings,))
        Kind of the independent units, and the unit of each row; see `Protocol.independent`.

    Returns
    -------
    dict
        JSON values: `difference` of the mean accuracies (a fraction) with its 95 % interval from `low` to
        `high`; two-sided `p_value`; `minimum_detectable` difference at a power of 80 %; name of the `test`;
        kind (`clusters`) and number (`n_clusters`) of the independent units; `folds`, the difference in each
        fold of each repeat; number of tests that only the first pipeline (`n_gained`) or only the second
        (`n_lost`) predicts correctly.
    """
    folds = [
        [float(a.mean() - b.mean()) for a, b in zip(*pair, strict=True)]
        for pair in zip(hits, other, strict=True)
    ]
    one, two = (np.concatenate([fold for repeat in repeats for fold in repeat]) for repeats in (hits, other))
    n_gained, n_lost = int((one & ~two).sum()), int((two & ~one).sum())
    differences, (unit, groups) = np.concatenate(folds), independent
    test_units = np.concatenate([groups[test] for _, test in splits[: len(hits[0])]])
    first = slice(test_units.size)  # tests of the first repeat
    sums, n_tests = sum_clusters(one[first].astype(int) - two[first], test_units)
    if protocol.is_random and len(hits[0]) > 1 and not is_constant(differences):
        ratio = float(np.mean([test.size / train.size for train, test in splits]))
        interval, p = corrected_resampled_t(differences, ratio)
        test, difference = "corrected resampled t-test over folds and repeats", differences.mean()
        dof = differences.size - 1
    else:
        interval, p = clustered_t(sums, n_tests)
        test, difference = f"t-test over {unit}s", sums.sum() / n_tests.sum()
        dof = len(n_tests) - 1 or differences.size - 1
        if n_tests.max() == 1:
            n_first = (int((one & ~two)[first].sum()), int((two & ~one)[first].sum()))
            test, p = f"exact McNemar test, t interval over {unit}s", exact_mcnemar(*n_first)
    return {
        "low": interval[0],
        "high": interval[1],
        "difference": float(difference),
        "p_value": p,
        "minimum_detectable": minimum_detectable_difference(interval, max(1, dof)),
        "test": test,
        "clusters": unit,
        "n_clusters": len(n_tests),
        "folds": folds,
        "n_gained": n_gained,
        "n_lost": n_lost,
    }
