"""Calibration of probabilities and its error."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import softmax
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier

from texclass.recognition import Calibration, expected_calibration_error, fit_calibration
from texclass.recognition.probabilities import (
    PRIOR_BETA,
    PRIOR_BETA_WINDOWS,
    calibration_error_by_chance,
    class_scores,
    prior_calibration,
)

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("beta", [0.05, 1.0, 20.0])
def test_the_temperature_of_drawn_labels_is_recovered(beta):
    scores = RNG.normal(size=(20_000, 4)) / beta
    cumulated = softmax(beta * scores, axis=1).cumsum(axis=1)
    labels = (RNG.random((20_000, 1)) > cumulated).sum(axis=1)
    calibration = fit_calibration(scores, labels)
    assert calibration.beta == pytest.approx(beta, rel=0.05)
    p = calibration(scores)
    assert expected_calibration_error(p.max(axis=1), p.argmax(axis=1) == labels) < 0.02


def test_probabilities_stay_below_1_if_every_answer_is_correct():
    scores = np.eye(3)[np.arange(30) % 3]
    p = fit_calibration(scores, np.arange(30) % 3)(scores)
    np.testing.assert_allclose(p.sum(axis=1), 1)
    assert 0.95 < p.max() <= 1 - 2 / 3 / 32 + 1e-12


@pytest.mark.parametrize("n", [40, 800])
def test_probabilities_still_rank_answers_if_every_one_is_correct(n):
    labels = np.arange(n) % 4
    margins = RNG.uniform(0.2, 3.0, n)
    scores = margins[:, None] * np.eye(4)[labels]
    p = fit_calibration(scores, labels)(scores)[np.arange(n), labels]
    assert (np.diff(p[np.argsort(margins)]) >= -1e-12).all()
    assert len(np.unique(np.round(p, 6))) > n / 10
    assert p.min() < 0.99 * p.max()
    assert p.mean() == pytest.approx((n + 1) / (n + 2), abs=1e-5)


def test_calibration_keeps_the_order_of_classes():
    scores = RNG.normal(size=(50, 5))
    np.testing.assert_array_equal(np.argsort(Calibration(3.0, 0.1)(scores)), np.argsort(scores))


def test_the_calibration_error_follows_its_definition():
    confidence, hits = (
        np.array([0.95, 0.95, 0.95, 0.95, 0.55, 0.55]),
        np.array([1, 1, 1, 0, 0, 0], dtype=bool),
    )
    assert expected_calibration_error(confidence, hits, 10) == pytest.approx((4 * 0.2 + 2 * 0.55) / 6)
    assert expected_calibration_error([0.5, 0.5], [True, False]) == 0
    assert expected_calibration_error([1.0], [True]) == 0
    equal = expected_calibration_error([0.9, 0.8, 0.7, 0.6], [1, 1, 0, 0], 2, equal_counts=True)
    assert equal == pytest.approx((2 * 0.15 + 2 * 0.65) / 4)
    with pytest.raises(ValueError, match="must be of the same length and not empty"):
        expected_calibration_error([], [])


def test_the_error_of_bins_of_equal_counts_does_not_depend_on_the_order_of_ties():
    hits = np.arange(200) % 5 > 0  # 80 %, as stated
    for order in (np.arange(200), np.argsort(hits)):
        error = expected_calibration_error(np.full(200, 0.8), hits[order], equal_counts=True)
        assert error == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("equal_counts", [False, True])
def test_the_error_by_chance_is_the_mean_error_of_perfect_probabilities(equal_counts):
    rng, bins = np.random.default_rng(0), {"equal_counts": equal_counts}
    trials = [(p := rng.uniform(0.3, 1, 200), rng.random(200) < p) for _ in range(200)]
    mean_error = np.mean([expected_calibration_error(p, hits, **bins) for p, hits in trials])
    by_chance = np.mean([calibration_error_by_chance(p, **bins) for p, _ in trials])
    assert mean_error > 0.05
    assert by_chance == pytest.approx(mean_error, rel=0.05)


@pytest.mark.parametrize("n_classes", [2, 3])
@pytest.mark.parametrize("classifier", [LinearDiscriminantAnalysis(), GaussianNB(), KNeighborsClassifier(3)])
def test_the_class_with_the_largest_score_is_predicted(classifier, n_classes):
    y = np.arange(60) % n_classes
    X = RNG.normal(size=(60, 3)) + y[:, None]
    scores = class_scores(classifier.fit(X, y), X)
    assert scores.shape == (60, n_classes)
    np.testing.assert_array_equal(scores.argmax(axis=1), classifier.predict(X))


@pytest.mark.parametrize("n", [3, 30])
def test_the_lapse_limits_probabilities_by_the_number_of_recordings(n):
    labels = np.arange(n) % 3
    lapse = 1 / (n + 2)
    p = fit_calibration(np.eye(3)[labels], labels)(1e9 * np.eye(3))  # however far apart the classes are
    np.testing.assert_allclose(p, np.where(np.eye(3) == 1, 1 - 2 * lapse / 3, lapse / 3), rtol=1e-9)


def test_one_wrong_label_among_many_does_not_flatten_the_probabilities():
    labels = np.arange(300) % 3
    scores = 5 * np.eye(3)[labels]
    mislabelled = np.where(np.arange(300) == 0, 1, labels)
    assert fit_calibration(scores, mislabelled)(scores).max() > 0.98


def test_the_prior_calibration_gives_the_same_odds_for_any_number_of_classes():
    for n_classes in (2, 5, 20):
        shrunk = np.eye(1, n_classes) / np.log(n_classes)
        for n_rows, beta in ((n_classes, PRIOR_BETA), (2 * n_classes, PRIOR_BETA_WINDOWS)):
            odds = replace(prior_calibration(n_classes, n_rows), lapse=0.0)(shrunk)[0]
            assert odds[0] / odds[1] == pytest.approx(np.exp(beta), rel=1e-6)
