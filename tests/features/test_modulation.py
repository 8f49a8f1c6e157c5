import numpy as np
import pytest
from scipy import signal

from texclass.features.bands import band_course, level_fluctuation, level_persistence
from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView
from texclass.recording import Samples

FS = 2000.0


def noise(n: int, seed: int = 0) -> Samples:
    return np.random.default_rng(seed).standard_normal(n)


@pytest.mark.parametrize("feature", [band_course, level_fluctuation, level_persistence])
def test_a_fixed_change_of_the_sensor_cancels(feature) -> None:  # type: ignore[no-untyped-def]
    x = noise(60_000) * (1 + 0.5 * np.sin(2 * np.pi * 0.7 * np.arange(60_000) / FS))
    tilted = signal.lfilter([1, 0.3], [1], x)  # +2.3 dB at 0 Hz, -3.1 dB at fs/2
    np.testing.assert_allclose(feature(PhaseView(tilted, FS)), feature(PhaseView(x, FS)), atol=0.03)


def test_course_of_a_falling_level_is_in_its_first_term() -> None:
    n = 120_000
    fall = 10 ** (0.05 * np.cos(np.pi * (np.arange(n) + 0.5) / n))
    terms = band_course(PhaseView(noise(n) * fall, FS), n_parts=6).reshape(5, 4)
    np.testing.assert_allclose(terms[0], 0.1, atol=0.03)
    np.testing.assert_allclose(terms[1:], 0, atol=0.03)


def test_course_reversed_in_time_changes_the_sign_of_odd_terms() -> None:
    x = noise(30_000) * np.linspace(1, 3, 30_000)
    forth, back = band_course(PhaseView(x, FS)), band_course(PhaseView(x[::-1].copy(), FS))
    np.testing.assert_allclose(back, forth * np.repeat([-1, 1], 4), atol=2e-3)


def test_noise_of_steady_level_fluctuates_less_in_wider_octaves() -> None:
    levels = level_fluctuation(PhaseView(noise(100_000), FS))
    assert (np.diff(levels) > 0).all()
    # The highest octave holds 16 bins, 12 independent ones of a Hann window: log10 of a mean of so many.
    assert levels[0] == pytest.approx(np.sqrt(1.5 / 16) / np.log(10), rel=0.25)


def test_grains_fluctuate_and_bursts_persist() -> None:
    n = 100_000
    bursts = 1 + 5 * (np.sin(2 * np.pi * 1.5 * np.arange(n) / FS) > 0)
    steady, bursting = PhaseView(noise(n), FS), PhaseView(noise(n) * bursts, FS)
    assert (level_fluctuation(bursting) > level_fluctuation(steady) + 0.1).all()
    assert (np.abs(level_persistence(steady)) < 0.1).all()
    assert (level_persistence(bursting) > 0.3).all()


def test_too_short_a_movement_is_refused_with_the_rule() -> None:
    with pytest.raises(UndefinedFeatureError, match="511 samples; the rule is at least 512"):
        level_fluctuation(PhaseView(noise(511), FS))
    with pytest.raises(UndefinedFeatureError, match="287 samples; the rule is at least 288"):
        band_course(PhaseView(noise(287), FS))


def test_thirds_are_made_of_sixths() -> None:
    view = PhaseView(noise(30_000) * np.linspace(1, 3, 30_000), FS)
    thirds, sixths = band_course(view), band_course(view, n_parts=6)
    np.testing.assert_allclose(thirds[:4], sixths[:4], atol=0.05)
    with pytest.raises(ValueError, match="n_parts is 4; the rule is 2, 3 or 6"):
        band_course(view, n_parts=4)
