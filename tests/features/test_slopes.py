"""Differences, second differences and residual levels: known distributions, tones and tilts are recovered."""

from functools import partial

import numpy as np
import pytest
from feature_signals import noise, tone
from scipy import signal, stats

from texclass.features import residual_bands, slopes
from texclass.features.bands import band_level, octave_level
from texclass.features.phase_view import PhaseView
from texclass.features.slopes import LAGS, curvature_level, curvature_shape, slope_agreement, slope_level

FS = 2000.0
N = 200_000
NOISE = noise(N)


def view(x):
    return PhaseView(np.asarray(x), FS)


def coloured(seed=0):
    return signal.lfilter(*signal.butter(1, 300, fs=FS), noise(N, seed))


def test_agreement_of_gaussian_slopes_is_the_arcsine_of_their_correlation():
    x, expected = coloured(), []
    for lag in LAGS:
        d = x[lag:] - x[:-lag]
        for shift in (lag, 2 * lag, 3 * lag):
            expected.append(0.5 + np.arcsin(np.dot(d[shift:], d[:-shift]) / np.dot(d, d)) / np.pi)
    np.testing.assert_allclose(slope_agreement(view(x)), expected, atol=0.006)


def test_curvature_agreement_equals_that_of_second_differences():
    x = coloured(1)
    positive = x[8:] - 2 * x[4:-4] + x[:-8] > 0
    agreement = slopes.curvature_agreement(view(x), lags=(4,), steps=(2,))
    assert agreement[0] == pytest.approx(np.mean(positive[8:] == positive[:-8]), abs=1e-4)


def test_signs_do_not_depend_on_gain_drift_or_a_few_strong_events():
    x = coloured(2)
    with_impacts = x.copy()
    with_impacts[:: N // 20] += 100 * x.std()
    for variant in (x * np.linspace(1, 1.2, N), with_impacts):
        np.testing.assert_allclose(slope_agreement(view(variant)), slope_agreement(view(x)), atol=2e-3)


def test_shape_of_gaussian_noise_matches_the_normal_distribution():
    expected = [0, np.log10(3), np.log10(np.sqrt(2 / np.pi))]
    np.testing.assert_allclose(curvature_shape(view(NOISE)), expected * 6, atol=0.02)
    np.testing.assert_allclose(slopes.slope_shape(view(NOISE)), expected * 6, atol=0.02)
    np.testing.assert_allclose(slopes.vibration_shape(view(NOISE + 5)), expected, atol=0.02)


def test_peakedness_is_the_kurtosis_of_scipy():
    x = NOISE**3
    c = (x[8:] + x[:-8]) / 2 - x[4:-4]
    expected = np.log10(np.mean(c**4) / np.mean(c**2) ** 2)
    assert curvature_shape(view(x), lags=(4,))[1] == pytest.approx(expected, rel=1e-5)
    kurtosis = np.log10(stats.kurtosis(x, fisher=False))
    assert slopes.vibration_shape(view(x))[1] == pytest.approx(kurtosis, rel=1e-5)


def test_slope_shape_of_a_sawtooth_is_asymmetric_and_reverses_with_time():
    saw = signal.sawtooth(2 * np.pi * 20.01 * np.arange(N) / FS)  # rises slowly, falls quickly
    forth, back = (slopes.slope_shape(view(x), lags=(1, 4)).reshape(2, 3) for x in (saw, saw[::-1]))
    assert (forth[:, 0] < -0.9).all()
    np.testing.assert_allclose(back, forth * [-1, 1, 1], atol=1e-6)
    levels = [np.log10(np.mean(np.abs(saw[lag:] - saw[:-lag]))) for lag in (1, 4)]
    np.testing.assert_allclose(slope_level(view(saw[::-1]), lags=(1, 4)), levels, atol=1e-6)


def test_negating_a_signal_changes_lopsidedness_only():
    up, down = (curvature_shape(view(s * np.abs(NOISE))).reshape(-1, 3) for s in (1, -1))
    np.testing.assert_allclose(down, up * [-1, 1, 1], rtol=1e-6)
    assert slopes.vibration_shape(view(np.abs(NOISE)))[0] > 0.2


def test_curvature_shape_of_one_impulse():
    lopsided, peaked, even = curvature_shape(view(np.eye(1, 1000, 500)[0]), lags=(1,))
    assert lopsided == pytest.approx((2 / 4 - 1) / 1.5)  # one -1 and two 1/2: squares 1 and 2/4
    assert peaked == pytest.approx(np.log10((1 + 2 / 16) / 1.5**2 * 998))
    assert even == pytest.approx(np.log10(2 / 998 / np.sqrt(1.5 / 998)))


def test_levels_of_a_tone_follow_the_response_of_the_difference():
    movement, lags = view(3 * tone(100.1, 100_000, FS) + 7), np.array([1, 2, 4, 8, 16])
    response = 1 - np.cos(2 * np.pi * 100.1 * lags / FS)
    expected = np.log10(3 / np.sqrt(2) * response)
    np.testing.assert_allclose(curvature_level(movement, lags=tuple(lags.tolist())), expected, atol=1e-4)
    np.testing.assert_allclose(slopes.vibration_level(movement), np.log10(3 / np.sqrt(2)), atol=1e-4)


# Residual levels -------------------------------------------------------------------------------------------

LEVELS = {
    residual_bands.band_residual_level: band_level,
    residual_bands.octave_residual_level: octave_level,
    residual_bands.slope_residual_level: slope_level,
    residual_bands.curvature_residual_level: curvature_level,
}


def test_the_line_is_the_least_squares_fit_of_slope_levels():
    assert residual_bands.level_tilt(view(NOISE)) == pytest.approx([0], abs=2e-3)
    walk = view(np.cumsum(NOISE))
    assert residual_bands.level_tilt(walk) == pytest.approx([-np.log10(2) / 2], abs=5e-3)
    np.testing.assert_allclose(residual_bands.slope_residual_level(walk), 0, atol=5e-3)
    movement = view(coloured())
    tilt, middle = np.polyfit(-np.log2(LAGS), slope_level(movement), 1)
    line = residual_bands.line_at(movement, np.array([0.0, -3.0]))
    np.testing.assert_allclose(line, [middle, middle - 3 * tilt], rtol=1e-9)


def test_levels_are_residuals_plus_the_line_at_the_centre_of_each_band():
    movement = view(coloured())
    at, edges = partial(residual_bands.line_at, movement), np.linspace(0, 1, 25)
    for feature, parameters, expected in (
        (residual_bands.band_residual_level, {}, 2 * at(np.log2((edges[1:] + edges[:-1]) / 2))),
        (
            residual_bands.octave_residual_level,
            {"octaves": (2, 3)},
            2 * at(np.array([-2 - 1 / 6, -2.5, -3 + 1 / 6])),
        ),
        (residual_bands.slope_residual_level, {"lags": (4,)}, at(np.array([-2.0]))),
        (residual_bands.curvature_residual_level, {"lags": (4,)}, at(np.array([-2.0]))),
    ):
        line = LEVELS[feature](movement, **parameters) - feature(movement, **parameters)
        np.testing.assert_allclose(line, expected)
    residual = residual_bands.slope_residual_level(movement)
    assert np.abs(residual).max() > 0.02
    assert (residual.sum(), residual @ residual_bands.log_frequency(LAGS)) == pytest.approx((0, 0), abs=1e-9)
