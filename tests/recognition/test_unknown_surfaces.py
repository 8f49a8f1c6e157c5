"""Strangers stand out, and known surfaces are called unknown as often as was asked for."""

import numpy as np
import pytest

from texclass.recognition.unknown import Novelty, fit_nearness

RNG = np.random.default_rng(3)


def test_p_values_count_the_held_out_scores_that_are_as_large():
    novelty = Novelty("decision", np.arange(19.0), 0.1)
    np.testing.assert_allclose(novelty.p_value(np.array([-1.0, 18.0, 17.5, 99.0])), [1, 0.1, 0.1, 0.05])


@pytest.mark.parametrize("n", [19, 20, 39, 100])
def test_the_threshold_is_where_answers_change(n):
    novelty = Novelty("distance", np.sort(RNG.normal(size=n)), 0.05)
    beyond = np.nextafter(novelty.threshold, np.inf)
    assert (novelty.p_value(np.array([novelty.threshold, beyond])) <= 0.05).tolist() == [False, True]


def test_too_few_held_out_recordings_are_refused():
    with pytest.raises(ValueError, match=r"18 recordings are held out. Expected at least 19"):
        Novelty("decision", np.zeros(18), 0.05)


def test_nearness_is_the_distance_in_whitened_units(monkeypatch):
    monkeypatch.setattr("texclass.recognition.unknown.SHRINKAGE", 1e-9)
    # Two classes along the first axis, whose within-class deviation is 3; the second axis is noise.
    labels = np.arange(4000) % 2
    X = np.column_stack([10 * labels + 3 * RNG.normal(size=4000), 50 * RNG.normal(size=4000)])
    near = fit_nearness(X, labels)
    found = near(np.array([[0.0, 0.0], [10.0, 300.0], [-6.0, 0.0], [16.0, 0.0]]))
    np.testing.assert_allclose(found, [0, 0, 4, 4], atol=0.6)


def test_nearness_does_not_depend_on_units():
    labels = np.arange(60) % 3
    X = RNG.normal(size=(60, 4)) + labels[:, None]
    scale = np.array([1e-3, 1.0, 1e4, 7.0])
    np.testing.assert_allclose(
        fit_nearness(X, labels)(X), fit_nearness(X * scale, labels)(X * scale), rtol=1e-8
    )


def test_constant_columns_say_nothing():
    labels = np.arange(30) % 3
    X = RNG.normal(size=(30, 2)) + 3 * labels[:, None]
    with_constant = np.column_stack([X, np.full(30, 1e6)])
    asked = np.array([[0.0, 0.0, 5.0]])
    near = fit_nearness(with_constant, labels)
    assert near(asked)[0] == pytest.approx(near(np.array([[0.0, 0.0, 1e6]]))[0])
