import numpy as np
import pytest

from texclass.features.contract import UndefinedFeatureError
from texclass.features.hardness import damping, tap_band, tap_course, tap_crest, tap_decay_rate, tap_strength
from texclass.features.phase_view import TapSignal, TapView

FS = 10_000.0
T = np.arange(3000) / FS


def ringing(decay: float, f_hz: float, amplitude: float = 1.0) -> TapView:
    impulse = amplitude * np.exp(-decay * T) * np.sin(2 * np.pi * f_hz * T)
    return TapView((TapSignal(np.zeros(0), impulse),), FS)


@pytest.mark.parametrize("decay", [30.0, 60.0, 200.0])
def test_decay_rate_of_a_decaying_sinusoid_is_recovered(decay: float) -> None:
    assert tap_decay_rate(ringing(decay, 400.0)) == pytest.approx(decay, rel=0.05)


def test_damping_of_a_lightly_damped_tone_is_its_frequency() -> None:
    assert damping(ringing(20.0, 400.0)) == pytest.approx(400, rel=0.05)
    assert damping(ringing(20.0, 800.0)) > damping(ringing(20.0, 200.0))


def test_course_of_an_exponential_energy_is_its_quantiles() -> None:
    expected = -np.log(1 - np.array([0.1, 0.25, 0.5, 0.75, 0.9])) / (2 * 60)
    np.testing.assert_allclose(tap_course(ringing(60.0, 800.0)), expected, atol=1 / 800)


def test_band_of_a_tone_closes_around_its_frequency() -> None:
    band = tap_band(ringing(10.0, 500.0))
    assert (np.diff(band) > 0).all()
    assert band[2] == pytest.approx(500, abs=5)
    np.testing.assert_allclose(band[[1, 3]], 500, atol=10)


def test_strength_is_the_logarithm_of_the_peak() -> None:
    tap = TapView((TapSignal(np.zeros(0), np.append(0.01 * np.ones(20), -100.0)),), FS)
    assert tap_strength(tap) == pytest.approx(2)


def test_crest_of_a_steady_tone_is_root_two() -> None:
    assert tap_crest(ringing(0.0, 1000.0)) == pytest.approx(np.sqrt(2), rel=0.06)


def test_median_over_taps_ignores_one_bad_tap() -> None:
    good, bad = ringing(60.0, 400.0).taps[0], ringing(500.0, 3000.0).taps[0]
    assert damping(TapView((good, bad, good), FS)) == damping(TapView((good,), FS))


def test_a_tap_of_7_samples_is_too_short() -> None:
    with pytest.raises(UndefinedFeatureError, match="7 samples after the contact; the rule is at least 8"):
        damping(TapView((TapSignal(np.zeros(3), np.ones(7)),), FS))
