"""Ridges along the path of the tool, at any speed."""

from dataclasses import replace

import numpy as np
import pytest
from feature_signals import noise, tone

import texclass as tx
from texclass.features.fineness import ridge_density, ridge_prominence
from texclass.features.phase_view import UndefinedFeatureError, Views, views_of
from texclass.recording import Phases, Recording
from texclass.simulate.surfaces import Grating

FS = 10_000.0


def stroked(per_mm, *, speeds=(40.0, 200.0), fs=FS, seconds=6.0, weights=(1, 0.6, 0.4), level=1.0):
    """Return strokes over ridges with noise; the speed rises and falls twice per second."""
    t = np.arange(round(seconds * fs)) / fs
    slow, fast = speeds
    v = slow + (fast - slow) * np.abs(4 * t % 2 - 1)
    path_mm = np.cumsum(v) / fs
    ridges = sum(w * np.cos(2 * np.pi * h * per_mm * path_mm) for h, w in enumerate(weights, 1))
    x = ridges + level * noise(t.size, 3)
    return Recording(x, fs, "m/s^2", "strokes", speed=v, phases=Phases(movement=(0, t.size)))


def travel(recording):
    return views_of(recording)[""].of("travel")


@pytest.mark.parametrize("per_mm", [0.06, 0.15, 0.4, 0.9, 1.7, 2.9])
def test_ridges_are_found_at_any_speed_of_the_hand(per_mm):
    for speeds in ((40.0, 200.0), (80.0, 80.0), (20.0, 90.0)):
        assert ridge_density(travel(stroked(per_mm, speeds=speeds))) == pytest.approx(per_mm, rel=0.02)


def test_ridges_with_a_weak_fundamental_or_of_a_slow_sensor_are_found():
    assert ridge_density(travel(stroked(0.5, weights=(0.3, 1, 1, 1, 1)))) == pytest.approx(0.5, rel=0.02)
    assert ridge_density(travel(stroked(0.5, fs=1000.0, level=0.5))) == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize("wavelength_mm", [0.8, 2.0, 4.5])
def test_the_period_of_a_simulated_grating_is_recovered(wavelength_mm):
    smooth = tx.simulate.surface_catalogue(1, seed=402)[0]
    grating = tx.simulate.Surface(
        **vars(smooth) | {"bumps": None, "gratings": (Grating(wavelength_mm, 12.0, 0.4, 0.1),)}
    )
    for operator in tx.simulate.operator_catalogue(2, seed=402):
        across = replace(operator, direction_deg=0.0)  # oblique paths have longer distances
        recording = tx.simulate.record_freehand(grating, across, duration_s=6.0, seed=1)
        density = tx.extract([recording], "scales")["ridge_density"].item()
        assert 1 / density == pytest.approx(wavelength_mm, rel=0.05)


def test_a_tone_that_does_not_follow_the_speed_is_not_ridges():
    humming = stroked(0.5, weights=(0,)).with_(acceleration=noise(60_000) + 0.2 * tone(60.0, 60_000))
    with pytest.raises(UndefinedFeatureError, match="no ridges"):
        ridge_density(travel(humming))
    assert ridge_prominence(travel(humming)) < 3.3


def test_prominence_of_noise_is_low_and_decreases_with_the_path():
    short, long = (ridge_prominence(noise(n, 1), fs=20_000) for n in (8000, 200_000))
    assert long < 1.5 < short < 5


def test_samples_over_the_path_are_means_over_equal_steps():
    rising = stroked(0.25, speeds=(30.0, 190.0), level=0.0, weights=(1,))
    view = travel(rising)
    assert view.fs == pytest.approx(20_000)
    assert view.n_samples == pytest.approx(rising.speed.sum() / FS * 20, abs=1.001)
    path_mm = (np.arange(view.n_samples) + 0.5) / 20
    expected = np.cos(2 * np.pi * 0.25 * path_mm)
    np.testing.assert_allclose(view.samples, expected, atol=0.05)
    turned = rising.with_(speed=rising.speed * np.where(np.arange(60_000) < 30_000, 1, -1))
    np.testing.assert_array_equal(travel(turned).samples, view.samples)


def test_the_path_has_at_most_as_many_samples_as_the_movement():
    fast_strokes = stroked(0.25, speeds=(1000.0, 1e9))
    assert travel(fast_strokes).n_samples <= fast_strokes.n_samples


def test_undefined_ridges_have_a_reason():
    strokes = stroked(0.5)
    for changes, reason in (
        ({"speed": None}, "no speed signal"),
        ({"speed": 0 * strokes.speed}, "the speed of the tool is always 0"),
        ({"speed": 0.1 * strokes.speed}, r"1440 samples. Expected at least 4096 \(three frames"),
        ({"acceleration": 0 * strokes.acceleration}, "silence"),
    ):
        with pytest.raises(UndefinedFeatureError, match=reason):
            ridge_prominence(travel(strokes.with_(**changes)))


def test_each_separate_channel_has_its_own_path_spectrum():
    two = stroked(0.5)
    two = two.with_(acceleration=np.column_stack([two.acceleration, noise(60_000)]), channels=("a", "b"))
    views = [Views(two, two.phases, channel) for channel in (0, 1)]
    assert ridge_density(views[0].travel) == pytest.approx(0.5, rel=0.02)
    assert ridge_prominence(views[1].travel) < 3.3
    each = tx.FeatureExtractor("scales", channels="each").fit([two])
    assert {"a/ridge_density", "b/ridge_prominence"} <= set(each.plan_.columns)
