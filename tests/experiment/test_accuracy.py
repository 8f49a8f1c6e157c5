"""Accuracy: intervals that cover, balance over materials, votes."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import binomtest
from sklearn.metrics import balanced_accuracy_score

from texclass.experiment.accuracy import cluster_interval, majority, score, wilson_interval


def test_wilson_interval_agrees_with_scipy():
    for hits, confidence in product([0, 1, 17, 39, 40], [0.95, 0.8]):
        reference = binomtest(hits, 40).proportion_ci(confidence, method="wilson")
        found = wilson_interval(hits, 40, confidence)
        assert found == pytest.approx((reference.low, reference.high), abs=1e-12)


def covered(interval_of, n_trials=200, n_clusters=60, size=12):
    """Share of trials whose interval holds the truth, when all windows of a recording share their fate."""
    clusters, inside = np.repeat(np.arange(n_clusters), size), 0
    for trial in range(n_trials):
        rng = np.random.default_rng(trial)
        chance = np.repeat(rng.beta(1.6, 0.4, n_clusters), size)  # 0.8 on the average
        low, high = interval_of(rng.random(clusters.size) < chance, clusters)
        inside += low <= 0.8 <= high
    return inside / n_trials


def test_bootstrap_over_recordings_covers_where_an_interval_over_windows_does_not():
    bootstrap = covered(lambda hits, clusters: cluster_interval(hits, clusters, 0))
    assert bootstrap == pytest.approx(0.95, abs=0.05)
    assert covered(lambda hits, _: wilson_interval(hits.sum(), hits.size)) < 0.7


def test_with_clusters_of_one_the_bootstrap_is_the_binomial_interval():
    hits = np.arange(400) < 300
    assert cluster_interval(hits, np.arange(400), 0) == pytest.approx(wilson_interval(300, 400), abs=0.006)


def test_windows_that_agree_altogether_count_as_their_recordings():
    for right in (0, 1):
        found = cluster_interval(np.full(90, right), np.repeat(np.arange(30), 3), 0)
        assert found == wilson_interval(30 * right, 30)


def test_balanced_accuracy_agrees_with_sklearn():
    rng = np.random.default_rng(0)
    truth, predicted = rng.choice(list("aaab"), 100), rng.choice(list("ab"), 100)
    expected = balanced_accuracy_score(truth, predicted)
    assert score([truth], [predicted]).balanced == pytest.approx(expected)


def test_the_majority_votes_and_the_first_of_equals_wins():
    predicted, clusters = np.array(list("oaaxoxx")), np.array([1, 1, 1, 2, 2, 3, 3])
    assert majority(predicted, clusters) == {1: "a", 2: "x", 3: "x"}


def test_score_of_windows_holds_bounds_balance_and_vote():
    truth = [np.array(list("aaaaa")), np.array(list("aab"))]
    predicted = [np.array(list("aabbb")), np.array(list("abb"))]
    clusters = [np.array([1, 1, 1, 2, 2]), np.array([3, 3, 4])]
    found = score(truth, predicted, clusters)
    assert (found.n_hits, found.n_tested, found.folds) == (4, 8, (2 / 5, 2 / 3))
    assert found.balanced == pytest.approx((3 / 7 + 1) / 2)
    hits, of = [1, 1, 0, 0, 0, 1, 0, 1], [1, 1, 1, 2, 2, 3, 3, 4]
    assert found.bounds == found.interval == cluster_interval(hits, of, 0)
    assert (found.voted.n_hits, found.voted.n_tested, found.voted.folds) == (3, 4, (0.5, 1.0))
    assert found.voted.balanced == pytest.approx((2 / 3 + 1) / 2)
    assert found.voted.bounds is None


def test_recordings_tested_equally_often_have_neither_vote_nor_another_balance():
    truth, predicted = np.array(list("abab")), np.array(list("abaa"))
    found = score([truth[:3], truth[3:]], [predicted[:3], predicted[3:]], [np.arange(3), np.arange(1)])
    assert (found.balanced, found.bounds, found.voted) == (None, None, None)
    assert found.interval == wilson_interval(3, 4)
    assert found.mean == 0.75  # over recordings, not over folds
    assert found.to_dict() == {
        "mean": 0.75, "low": found.interval[0], "high": found.interval[1], "interval": "Wilson",
        "balanced": 0.75, "folds": [1.0, 0.0],
    }  # fmt: skip
