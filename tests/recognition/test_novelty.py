"""Novelty detection: p-values, thresholds and the distance to the nearest class mean."""

import numpy as np
import pytest

from texclass.recognition.novelty import NoveltyDetector, fit_class_distance

RNG = np.random.default_rng(3)


def test_p_values_count_the_held_out_scores_that_are_at_least_as_large():
    detector = NoveltyDetector("decision", np.arange(19.0), 0.1)
    np.testing.assert_allclose(detector.p_value(np.array([-1.0, 18.0, 17.5, 99.0])), [1, 0.1, 0.1, 0.05])


@pytest.mark.parametrize("n", [19, 20, 39, 100])
def test_only_scores_above_the_threshold_have_a_p_value_of_false_alarms(n):
    detector = NoveltyDetector("distance", np.sort(RNG.normal(size=n)), 0.05)
    above = np.nextafter(detector.threshold, np.inf)
    assert (detector.p_value(np.array([detector.threshold, above])) <= 0.05).tolist() == [False, True]


def test_too_few_held_out_recordings_are_refused():
    with pytest.raises(ValueError, match=r"requires at least 19 held-out recordings, got 18"):
        NoveltyDetector("decision", np.zeros(18), 0.05)


def test_class_distance_is_the_squared_distance_in_whitened_units(monkeypatch):
    monkeypatch.setattr("texclass.recognition.novelty.SHRINKAGE", 1e-9)
    # Two classes along the first axis, whose within-class deviation is 3; the second axis is noise.
    labels = np.arange(4000) % 2
    X = np.column_stack([10 * labels + 3 * RNG.normal(size=4000), 50 * RNG.normal(size=4000)])
    class_distance = fit_class_distance(X, labels)
    distance = class_distance(np.array([[0.0, 0.0], [10.0, 300.0], [-6.0, 0.0], [16.0, 0.0]]))
    np.testing.assert_allclose(distance, [0, 0, 4, 4], atol=0.6)


def test_class_distance_does_not_depend_on_units():
    labels = np.arange(60) % 3
    X = RNG.normal(size=(60, 4)) + labels[:, None]
    scale = np.array([1e-3, 1.0, 1e4, 7.0])
    np.testing.assert_allclose(
        fit_class_distance(X, labels)(X), fit_class_distance(X * scale, labels)(X * scale), rtol=1e-8
    )


def test_constant_columns_do_not_change_the_class_distance():
    labels = np.arange(30) % 3
    X = RNG.normal(size=(30, 2)) + 3 * labels[:, None]
    with_constant = np.column_stack([X, np.full(30, 1e6)])
    row = np.array([[0.0, 0.0, 5.0]])
    class_distance = fit_class_distance(with_constant, labels)
    assert class_distance(row)[0] == pytest.approx(class_distance(np.array([[0.0, 0.0, 1e6]]))[0])
