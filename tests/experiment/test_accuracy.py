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


def coverage(interval_of, p, correlation, sizes, n_trials=250):
    """Share of trials whose interval holds the truth, when operators differ in how well they do."""
    rng = np.random.default_rng([int(100 * p), int(100 * correlation), len(sizes)])
    shape = (n_trials, len(sizes))
    a = 1 / max(correlation, 1e-9) - 1
    skill = rng.beta(p * a, (1 - p) * a, shape) if correlation else np.full(shape, p)
    clusters = np.repeat(np.arange(len(sizes)), sizes)
    inside = 0
    for n_hits in rng.binomial(sizes, skill):
        hits = np.concatenate([np.arange(n) < k for k, n in zip(n_hits, sizes, strict=True)])
        low, high = interval_of(hits, clusters)
        inside += low <= p <= high
    return inside / n_trials


@pytest.mark.parametrize("n_clusters", [5, 12, 40])
def test_intervals_over_operators_cover_as_often_as_they_say_where_those_over_recordings_do_not(n_clusters):
    uneven = np.maximum(3, np.round(20 * np.exp(np.linspace(-1, 1, n_clusters)))).astype(int)
    for p, correlation in product([0.3, 0.8, 0.9], [0.0, 0.2]):
        found = coverage(cluster_interval, p, correlation, uneven)
        # 250 trials tell coverage to 0.014; the claim is 0.92 to 0.98, and at least 0.9 of the highest.
        assert (0.92 if p < 0.9 else 0.9) - 0.028 <= found <= 0.98 + 0.02, (p, correlation, found)
    plain = coverage(lambda hits, _: wilson_interval(hits.sum(), hits.size), 0.8, 0.2, uneven)
    assert plain < 0.7


def test_with_clusters_of_one_the_interval_is_the_binomial_one():
    hits = np.arange(400) < 300
    assert cluster_interval(hits, np.arange(400)) == pytest.approx(wilson_interval(300, 400), abs=0.003)


def test_few_clusters_and_those_that_agree_altogether_count_as_single_tests():
    for right in (0, 1):
        assert cluster_interval(np.full(90, right), np.repeat(np.arange(30), 3)) == wilson_interval(
            30 * right, 30
        )
    halves = np.tile([True, False], 30)
    assert cluster_interval(halves, np.repeat(np.arange(6), 10)) == wilson_interval(3, 6)
    hits = np.arange(80) % 20 < np.repeat([19, 12, 15, 18], 20)
    low, high = cluster_interval(hits, np.repeat(np.arange(4), 20))
    assert (low, high) == wilson_interval(4 * 0.8, 4)


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
    assert found.bounds == found.interval == cluster_interval(hits, of)
    assert (found.voted.n_hits, found.voted.n_tested, found.voted.folds) == (3, 4, (0.5, 1.0))
    assert found.voted.balanced == pytest.approx((2 / 3 + 1) / 2)
    assert found.voted.bounds is None


def test_recordings_of_few_operators_and_their_votes_have_intervals_over_operators():
    rng = np.random.default_rng(0)
    truth, operator = np.repeat(list("abcd"), 60), np.tile(np.repeat(np.arange(6), 10), 4)
    recording = np.arange(240) // 2  # of two windows each
    predicted = np.where(rng.random(240) < 0.5 + 0.08 * operator, truth, "x")
    found = score([truth], [predicted], [recording], [operator])
    assert found.interval == cluster_interval(truth == predicted, operator)
    assert (found.n_clusters, found.spread, found.voted.n_clusters) == (6, True, 6)
    told = found.to_dict("recording", "operator")
    assert (told["interval"], told["clusters"], told["n_clusters"]) == ("t over operators", "operator", 6)
    assert told["per_recording"]["interval"] == "t over operators"
    few = score([truth], [predicted], [np.arange(240)], [operator % 3]).to_dict("recording", "operator")
    assert (few["interval"], few["n_clusters"]) == ("Wilson over operators", 3)


def test_recordings_tested_equally_often_have_neither_vote_nor_another_balance():
    truth, predicted = np.array(list("abab")), np.array(list("abaa"))
    found = score([truth[:3], truth[3:]], [predicted[:3], predicted[3:]], [np.arange(3), np.arange(3, 4)])
    assert (found.balanced, found.bounds, found.voted) == (None, None, None)
    assert found.interval == wilson_interval(3, 4)
    assert found.mean == 0.75  # over recordings, not over folds
    assert found.to_dict() == {
        "mean": 0.75, "low": found.interval[0], "high": found.interval[1], "interval": "Wilson",
        "clusters": "recording", "n_clusters": 4, "balanced": 0.75, "folds": [1.0, 0.0],
    }  # fmt: skip
