"""Paired comparisons: agreement with scipy, and errors as often as promised."""

import numpy as np
import pytest
from scipy.stats import binomtest, ttest_1samp

from texclass.experiment.paired import (
    compare,
    corrected_resampled_t,
    exact_mcnemar,
    holm,
    paired_bootstrap,
    sign_flip,
)
from texclass.experiment.protocols import find_protocol

RNG = np.random.default_rng(3)


def test_without_overlap_the_corrected_test_is_the_t_test():
    d = RNG.normal(0.02, 0.05, 20)
    (low, high), p = corrected_resampled_t(d, 0.0)
    reference = ttest_1samp(d, 0)
    interval = reference.confidence_interval()
    assert p == pytest.approx(reference.pvalue)
    assert (low, high) == pytest.approx((interval.low, interval.high))


def test_overlap_widens_the_interval_by_the_printed_factor():
    d = RNG.normal(0.02, 0.05, 50)
    plain, corrected = corrected_resampled_t(d, 0.0)[0], corrected_resampled_t(d, 1 / 9)[0]
    assert np.ptp(corrected) / np.ptp(plain) == pytest.approx(np.sqrt((1 / 50 + 1 / 9) / (1 / 50)))


def test_folds_that_all_agree_leave_no_doubt_and_one_fold_is_no_resampling():
    for difference, p in ((0.0, 1.0), (0.1, 0.0)):
        assert corrected_resampled_t([difference] * 4, 0.5) == ((difference, difference), p)
    with pytest.raises(ValueError, match="1 differences; the rule is at least 2 folds"):
        corrected_resampled_t([0.1], 0.5)


def test_the_corrected_test_is_wrong_as_rarely_as_it_says_where_the_plain_one_is_not():
    # Two classifiers of equal skill: nearest mean on either of two columns that say the same.
    def difference_in_folds(rng, n=60, n_folds=5, n_repeats=4):
        y = np.repeat([0, 1], n // 2)
        X = y[:, None] * 1.0 + rng.normal(size=(n, 2))
        found = []
        for _ in range(n_repeats):
            for test in np.array_split(rng.permutation(n), n_folds):
                train = np.setdiff1d(np.arange(n), test)
                middle = (X[train][y[train] == 0].mean(axis=0) + X[train][y[train] == 1].mean(axis=0)) / 2
                hits = (X[test] > middle) == (y[test] == 1)[:, None]
                found.append(hits[:, 0].mean() - hits[:, 1].mean())
        return found

    rng = np.random.default_rng(0)
    trials = [difference_in_folds(rng) for _ in range(300)]
    plain = np.mean([corrected_resampled_t(d, 0.0)[1] < 0.05 for d in trials])
    corrected = np.mean([corrected_resampled_t(d, 1 / 4)[1] < 0.05 for d in trials])
    assert plain > 0.15
    assert corrected < 0.08


def test_mcnemar_is_a_fair_coin_over_discordant_recordings():
    assert exact_mcnemar(0, 0) == 1.0
    for gained, lost in ((3, 0), (7, 2), (12, 30)):
        assert exact_mcnemar(gained, lost) == pytest.approx(binomtest(gained, gained + lost).pvalue)


def test_sign_flips_of_single_tests_agree_with_mcnemar_and_windows_of_one_recording_count_once():
    d = np.concatenate([np.ones(14), -np.ones(5), np.zeros(40)])
    assert sign_flip(d, np.random.default_rng(0)) == pytest.approx(exact_mcnemar(14, 5), abs=0.015)
    d = np.zeros(20)
    d[0] = 30  # windows of one recording
    assert sign_flip(d, np.random.default_rng(0)) == 1.0


def test_bootstrap_interval_has_the_width_of_the_normal_one():
    d = np.concatenate([np.ones(60), -np.ones(30), np.zeros(310)])
    low, high = paired_bootstrap(d, np.ones(400, dtype=int), np.random.default_rng(0))
    assert (low + high) / 2 == pytest.approx(d.mean(), abs=0.003)
    assert high - low == pytest.approx(2 * 1.96 * d.std() / 20, rel=0.05)


def test_holm_by_hand():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.9]).tolist() == [1.0, 1.0]
    assert holm([]).size == 0


HITS = [[np.array([True, True, False]), np.array([True, True, True])]]
OTHER = [[np.array([True, False, False]), np.array([False, True, True])]]
SPLITS = [(np.arange(3, 6), np.arange(3)), (np.arange(3), np.arange(3, 6))]


def test_folds_that_are_drawn_are_resampled_and_kept():
    found = compare(HITS, OTHER, SPLITS, find_protocol("recording"), np.array(list("abcdef")), 0)
    assert found["folds"] == [pytest.approx([1 / 3, 1 / 3])]
    assert found["difference"] == pytest.approx(1 / 3)
    assert (found["n_gained"], found["n_lost"]) == (2, 0)
    assert found["test"] == "corrected resampled t-test over folds and repeats"
    some = ([HITS[0][:1]], [OTHER[0][:1]], SPLITS, find_protocol("recording"))
    one = compare(*some, np.array(list("abcdef")), 0)
    assert one["test"].startswith("exact McNemar")  # one finished fold is no resampling


def test_one_set_of_splits_says_which_test_was_used():
    for clusters, test in (("abcdef", "exact McNemar test"), ("aabbcd", "sign-flip test")):
        found = compare(HITS, OTHER, SPLITS, find_protocol("blocks"), np.array(list(clusters)), 0)
        assert found["test"] == f"{test} and paired bootstrap over recordings"
        assert found["difference"] == pytest.approx(1 / 3)
        assert found["low"] <= found["difference"] <= found["high"]
        assert (found["n_gained"], found["n_lost"]) == (2, 0)
