import numpy as np
import pytest
from scipy import signal

from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView
from texclass.features.slopes import curvature_agreement, slope_agreement, slope_level
from texclass.recording import Samples

FS = 2000.0
N = 200_000


def coloured(seed: int = 0) -> Samples:
    b, a = signal.butter(1, 300, fs=FS)
    return np.asarray(signal.lfilter(b, a, np.random.default_rng(seed).standard_normal(N)))


def correlation(d: Samples, shift: int) -> float:
    return float(np.dot(d[shift:], d[:-shift]) / np.dot(d, d))


def test_agreement_of_gaussian_slopes_is_the_arcsine_of_their_correlation() -> None:
    x = coloured()
    lags, steps = (1, 2, 4, 8, 16, 32), (1, 2, 3)
    expected = [
        0.5 + np.arcsin(correlation(x[lag:] - x[:-lag], step * lag)) / np.pi for lag in lags for step in steps
    ]
    np.testing.assert_allclose(slope_agreement(PhaseView(x, FS)), expected, atol=0.006)


def test_agreement_of_curvatures_is_that_of_second_differences() -> None:
    x = coloured(1)
    second = x[8:] - 2 * x[4:-4] + x[:-8]
    positive = second > 0
    found = curvature_agreement(PhaseView(x, FS), lags=(4,), steps=(2,))
    assert found[0] == pytest.approx(np.mean(positive[8:] == positive[:-8]), abs=1e-4)


def test_a_tone_agrees_with_itself_a_period_later_and_never_half_a_period_later() -> None:
    t = np.arange(20_000) / FS
    view = PhaseView(np.sin(2 * np.pi * 125.01 * t), FS)
    assert slope_agreement(view, lags=(8,), steps=(1, 2)) == pytest.approx([0, 1], abs=0.01)


def test_signs_feel_neither_a_drifting_gain_nor_a_few_strong_events() -> None:
    x = coloured(2)
    drifting = x * np.linspace(1, 1.2, N)
    struck = x.copy()
    struck[:: N // 20] += 100 * x.std()
    plain = slope_agreement(PhaseView(x, FS))
    np.testing.assert_allclose(slope_agreement(PhaseView(drifting, FS)), plain, atol=2e-3)
    np.testing.assert_allclose(slope_agreement(PhaseView(struck, FS)), plain, atol=2e-3)


def test_slope_level_of_a_random_walk_grows_with_the_root_of_the_lag() -> None:
    walk = np.cumsum(np.random.default_rng(3).standard_normal(N))
    levels = slope_level(PhaseView(walk, FS))
    np.testing.assert_allclose(np.diff(levels), 0.5 * np.log10(2), atol=0.01)
    assert levels[0] == pytest.approx(np.log10(np.sqrt(2 / np.pi)), abs=0.01)


def test_a_short_movement_is_refused_with_the_rule() -> None:
    with pytest.raises(UndefinedFeatureError, match="255 samples; the rule is at least 256"):
        slope_agreement(PhaseView(coloured()[:255], FS))
    with pytest.raises(UndefinedFeatureError, match="319 samples; the rule is at least 320"):
        curvature_agreement(PhaseView(coloured()[:319], FS))
