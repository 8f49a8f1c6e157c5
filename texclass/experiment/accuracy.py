"""Accuracy with an interval that does not take windows of one recording for independent tests."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binomtest
from sklearn.metrics import recall_score

Labels = NDArray[Any]
N_RESAMPLES = 2000
"""Bootstrap samples; another seed then moves a limit by about a thirtieth of the interval."""


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
        95 % interval by bootstrap over recordings (or runs), where several tests come from one of them.
    voted
        Accuracy of the recordings (or runs), each the majority of its tests; None where each is one test.
    """

    n_hits: int
    n_tested: int
    folds: tuple[float, ...] = ()
    balanced: float | None = None
    bounds: tuple[float, float] | None = None
    voted: "Accuracy | None" = None

    @property
    def mean(self) -> float:
        """Accuracy as a fraction."""
        return self.n_hits / self.n_tested

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval: `bounds`, else Wilson's."""
        return self.bounds or wilson_interval(self.n_hits, self.n_tested)

    def to_dict(self, unit: str = "recording") -> dict[str, Any]:
        """Return the accuracy as JSON values; `unit` ("recording" or "run") is what a cluster is called."""
        low, high = self.interval
        return {
            "mean": self.mean,
            "low": low,
            "high": high,
            "interval": f"bootstrap over {unit}s" if self.bounds else "Wilson",
            "balanced": self.mean if self.balanced is None else self.balanced,
            "folds": list(self.folds),
            **({} if self.voted is None else {f"per_{unit}": self.voted.to_dict(unit)}),
        }


def wilson_interval(n_hits: int, n_tested: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the Wilson score interval of a proportion.

    (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n), with p = n_hits/n and z the normal quantile.
    """
    found = binomtest(n_hits, n_tested).proportion_ci(confidence, method="wilson")
    # Rounding must not part a proportion from its own limits.
    return min(float(found.low), n_hits / n_tested), max(float(found.high), n_hits / n_tested)


def cluster_interval(
    hits: ArrayLike, clusters: ArrayLike, seed: int, confidence: float = 0.95
) -> tuple[float, float]:
    """Return the interval of a proportion by percentile bootstrap over clusters.

    Whole clusters are drawn with replacement; p* = sum of hits / sum of tests. Where all tests agree there is
    nothing to draw from, and Wilson's interval over the clusters stands in.

    Parameters
    ----------
    hits : array_like of bool, shape (n_tested,)
        Whether each test was right.
    clusters : array_like of shape (n_tested,)
        Which recording (or run) each test comes from.
    seed : int
        Of the draws.
    confidence : float
        Coverage.
    """
    right = np.asarray(hits, dtype=np.float64)
    _, cluster = np.unique(np.asarray(clusters), return_inverse=True)
    n_tests, n_hits = np.bincount(cluster), np.bincount(cluster, weights=right)
    n = len(n_tests)
    if right.min() == right.max():
        return wilson_interval(n if right[0] else 0, n, confidence)
    drawn = np.random.default_rng(seed).integers(n, size=(N_RESAMPLES, n))
    p = n_hits[drawn].sum(axis=1) / n_tests[drawn].sum(axis=1)
    low, high = np.quantile(p, [0.5 - confidence / 2, 0.5 + confidence / 2])
    return float(low), float(high)


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
    *,
    seed: int = 0,
) -> Accuracy:
    """Score predictions.

    Parameters
    ----------
    truth, predicted : sequence of ndarray
        Labels, one array a fold.
    clusters : sequence of ndarray, optional
        Which recording (or run) each test comes from; tests are independent by default.
    seed : int
        Of the bootstrap.

    Returns
    -------
    Accuracy
        With bounds over the clusters and their vote, if any cluster holds several tests.
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
    if clusters is None or all(np.unique(c).size == c.size for c in clusters):
        return accuracy
    felt, taken = [], []
    for materials_of, labels, of in zip(truth, predicted, clusters, strict=True):
        # A cluster of two materials counts as two.
        votes = majority(labels, np.array([f"{t}\0{c}" for t, c in zip(materials_of, of, strict=True)]))
        felt.append(np.array([name.split("\0")[0] for name in votes]))
        taken.append(np.array(list(votes.values())))
    bounds = cluster_interval(every_hit, np.concatenate(clusters), seed)
    return replace(accuracy, bounds=bounds, voted=score(felt, taken))
