"""Accuracy with an interval over what is independent: recordings, runs, or the operators who made them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, ndtri, stdtrit
from sklearn.metrics import recall_score

from texclass.recording import Samples

Labels = NDArray[Any]
LEAST_CLUSTERS = 5
"""Clusters from which their spread is an interval; of fewer, each counts as one test."""


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
        Mean over materials of the share that was recognised; None where every material was tested equally
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
    Simulated with 5 to 40 clusters and intraclass correlations of 0 to 0.2, it covers 92 to 98 % of
    proportions of 0.3 to 0.8 and 92 to 99 % of one of 0.9, where a bootstrap over clusters covers 75 to 89 %
    (5 to 12 of them). Where all clusters agree, or fewer than `LEAST_CLUSTERS` are there, their spread tells
    nothing: then each counts as one test of Wilson's.

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
    half = stdtrit(k - 1, 0.5 + confidence / 2) * error
    low, high = expit([g - half, g + half])
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


def majority(predicted: Labels, clusters: Labels) -> dict[Any, Any]:
    """Return for each cluster what most of its tests were taken for; of equals, what came first."""
    votes: dict[Any, Counter[Any]] = {}
    for cluster, label in zip(clusters.tolist(), predicted.tolist(), strict=True):
        votes.setdefault(cluster, Counter())[label] += 1
    return {cluster: counter.most_common(1)[0][0] for cluster, counter in votes.items()}


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
    materials, counts = np.unique(every_truth, return_counts=True)
    balanced = None
    if np.ptp(counts):
        of_all = np.concatenate(predicted)
        balanced = float(recall_score(every_truth, of_all, labels=materials, average="macro"))
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
    felt, taken, of_votes = [], [], []
    for materials_of, labels, of, who in zip(truth, predicted, clusters, groups or clusters, strict=True):
        # A cluster of two materials counts as two.
        named = np.array([f"{t}\0{c}" for t, c in zip(materials_of, of, strict=True)])
        votes = majority(labels, named)
        felt.append(np.array([name.split("\0")[0] for name in votes]))
        taken.append(np.array(list(votes.values())))
        made_by = dict(zip(named.tolist(), who.tolist(), strict=True))
        of_votes.append(np.array([made_by[name] for name in votes]))
    return replace(accuracy, voted=score(felt, taken, independent=of_votes))
