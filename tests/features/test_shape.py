import numpy as np
import pytest
from scipy import stats

from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView
from texclass.features.slopes import curvature_level, curvature_shape, vibration_level, vibration_shape

FS = 2000.0
NOISE = np.random.default_rng(0).standard_normal(200_000)


def test_shape_of_gaussian_noise_is_that_of_the_normal_distribution() -> None:
    expected = [0, np.log10(3), np.log10(np.sqrt(2 / np.pi))]
    np.testing.assert_allclose(curvature_shape(PhaseView(NOISE, FS)), expected * 6, atol=0.02)
    np.testing.assert_allclose(vibration_shape(PhaseView(NOISE + 5, FS)), expected, atol=0.02)


def test_peakedness_is_the_kurtosis_of_scipy() -> None:
    x = NOISE**3
    c = (x[8:] + x[:-8]) / 2 - x[4:-4]
    found = curvature_shape(PhaseView(x, FS), lags=(4,))
    assert found[1] == pytest.approx(np.log10(np.mean(c**4) / np.mean(c**2) ** 2), rel=1e-5)
    assert vibration_shape(PhaseView(x, FS))[1] == pytest.approx(
        np.log10(stats.kurtosis(x, fisher=False)), rel=1e-5
    )


def test_turning_a_signal_upside_down_changes_lopsidedness_alone() -> None:
    x = np.abs(NOISE)
    up, down = (curvature_shape(PhaseView(s * x, FS)).reshape(-1, 3) for s in (1, -1))
    np.testing.assert_allclose(down, up * [-1, 1, 1], rtol=1e-6)
    assert vibration_shape(PhaseView(x, FS))[0] > 0.2


def test_one_impulse_bends_twice_as_far_one_way() -> None:
    x = np.zeros(1000)
    x[500] = 1.0
    lopsided, peaked, even = curvature_shape(PhaseView(x, FS), lags=(1,))
    assert lopsided == pytest.approx((2 / 4 - 1) / 1.5)  # one -1 and two 1/2: squares 1 and 2/4
    assert peaked == pytest.approx(np.log10((1 + 2 / 16) / 1.5**2 * 998))
    assert even == pytest.approx(np.log10(2 / 998 / np.sqrt(1.5 / 998)))


def test_levels_of_a_tone_are_its_amplitude_times_the_response_of_the_difference() -> None:
    t = np.arange(100_000) / FS
    view = PhaseView(3 * np.sin(2 * np.pi * 100.1 * t) + 7, FS)
    lags = (1, 2, 4, 8, 16)
    response = [1 - np.cos(2 * np.pi * 100.1 * lag / FS) for lag in lags]
    expected = np.log10(3 / np.sqrt(2) * np.array(response))
    np.testing.assert_allclose(curvature_level(view, lags=lags), expected, atol=1e-4)
    np.testing.assert_allclose(vibration_level(view), np.log10(3 / np.sqrt(2)), atol=1e-4)


def test_what_does_not_bend_or_is_too_short_is_refused_with_the_rule() -> None:
    with pytest.raises(UndefinedFeatureError, match=r"over 1 samples is .* of the largest sample"):
        curvature_shape(PhaseView(np.linspace(-1, 1, 2000), FS))
    with pytest.raises(UndefinedFeatureError, match="127 samples; the rule is at least 128"):
        curvature_level(PhaseView(NOISE[:127], FS))
