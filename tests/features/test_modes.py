import numpy as np
import pytest

from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import TapSignal, TapView
from texclass.features.tap_modes import decimated, tap_amplitude_slope, tap_mode_decay, tap_mode_frequency
from texclass.recording import Samples
from texclass.vibration import DecayingModes

MODES = DecayingModes(
    np.array([220.0, 610.0]), np.array([50.0, 120.0]), np.array([1.0, 0.6]), np.array([-1.5, -1.2])
)


VELOCITIES = np.array([0.05, 0.08, 0.12])


def view(fs: float, noise: float = 0.0, velocities: Samples = VELOCITIES) -> TapView:
    rng = np.random.default_rng(0)
    hand = np.sin(np.pi * np.arange(round(0.05 * fs)) / (0.05 * fs)) ** 2
    hand *= fs / hand.sum()
    x = MODES.synthesize(round(0.1 * fs), fs)
    return TapView(
        tuple(TapSignal(v * hand, 500 * v * (x + noise * rng.standard_normal(x.size))) for v in velocities),
        fs,
    )


@pytest.mark.parametrize("fs", [2000.0, 5000.0, 10_000.0, 25_000.0, 50_000.0])
def test_modes_of_a_tap_are_recovered_at_any_rate(fs: float) -> None:
    np.testing.assert_allclose(tap_mode_frequency(view(fs)), [220, 610], rtol=1e-6)
    np.testing.assert_allclose(10 ** tap_mode_decay(view(fs)), [50, 120], rtol=1e-5)


def test_modes_are_recovered_from_noisy_taps() -> None:
    noisy = view(10_000.0, noise=0.03, velocities=np.linspace(0.05, 0.15, 7))
    np.testing.assert_allclose(tap_mode_frequency(noisy), [220, 610], rtol=0.03)
    np.testing.assert_allclose(10 ** tap_mode_decay(noisy), [50, 120], rtol=0.4)


def test_a_tap_with_one_mode_gives_it_twice() -> None:
    t = np.arange(400) / 10_000
    tap = TapSignal(np.ones(10), np.exp(-60 * t) * np.sin(2 * np.pi * 300 * t))
    np.testing.assert_allclose(tap_mode_frequency(TapView((tap,), 10_000.0)), [300, 300], rtol=1e-6)


def test_decimation_keeps_a_mode_what_it_is() -> None:
    fs = 20_000.0
    z = np.exp((-100 + 2j * np.pi * 400) / fs)
    y, rate = decimated((z ** np.arange(500)).real, fs)
    q = fs / rate
    predicted = 2 * (z**q).real * y[1:-1] - abs(z**q) ** 2 * y[:-2]
    np.testing.assert_allclose(y[2:], predicted, atol=1e-12)


def test_amplitude_slope_is_that_of_the_taps() -> None:
    given = view(10_000.0)
    peak = np.abs(MODES.synthesize(1000, 10_000.0)).max()
    assert tap_amplitude_slope(given) == pytest.approx(np.log10(500 * peak), rel=1e-9)


@pytest.mark.parametrize(
    ("velocities", "reason"), [([0.1, 0.2], "at least 3"), ([0.1, 0.1, 0.1], "of their mean; the rule")]
)
def test_a_slope_needs_taps_of_different_velocity(velocities: list[float], reason: str) -> None:
    with pytest.raises(UndefinedFeatureError, match=reason):
        tap_amplitude_slope(view(10_000.0, velocities=np.array(velocities)))


def test_a_tap_that_is_too_short_is_the_reason() -> None:
    with pytest.raises(UndefinedFeatureError, match="3 samples of a tap; the rule is at least 8"):
        tap_mode_frequency(TapView((TapSignal(np.ones(2), np.array([1.0, -1.0, 0.5])),), 1.0))
