import numpy as np
import pytest

from texclass.features.contract import UndefinedFeatureError
from texclass.features.fineness import fineness, fineness_as_printed, fineness_spread
from texclass.features.phase_view import PhaseView

FS = 10_000.0


def tone(f_hz: float, fs: float = FS, n: int = 40_960) -> PhaseView:
    return PhaseView(np.sin(2 * np.pi * f_hz * np.arange(n) / fs), fs)


@pytest.mark.parametrize("f_hz", [50.0, 432.1, 1400.0, 4000.0])
def test_fineness_of_a_sine_is_its_frequency(f_hz: float) -> None:
    assert fineness(tone(f_hz)) == pytest.approx(f_hz, rel=1e-3)
    assert fineness_spread(tone(f_hz)) < 3


def test_printed_bin_of_a_sine_is_twice_the_length_times_its_cycles_per_sample() -> None:
    assert fineness_as_printed(tone(500.0)) == pytest.approx(2 * 4096 * 500 / FS, rel=0.01)


def test_printed_sum_stops_at_a_quarter_of_the_rate() -> None:
    both = PhaseView(tone(1000.0).samples + tone(4000.0).samples, FS)
    assert fineness_as_printed(both) == pytest.approx(2 * 4096 * 1000 / FS, rel=0.02)
    assert fineness(both) == pytest.approx(2500, rel=1e-3)


def test_printed_centroid_is_equation_2_written_out() -> None:
    x = np.random.default_rng(0).standard_normal(2 * 64)
    centroids = []
    for frame in x.reshape(2, 64):
        n, k = np.arange(64), np.arange(1, 33)
        spectrum = np.cos(np.pi * k[:, np.newaxis] * (n + 0.5) / 64) @ frame
        centroids.append(sum(k * spectrum**2) / sum(spectrum**2))
    assert fineness_as_printed(PhaseView(x, FS), length=64) == pytest.approx(np.mean(centroids), rel=1e-5)


def test_spread_of_two_equal_tones_is_half_their_distance() -> None:
    both = PhaseView(tone(1000.0).samples + tone(3000.0).samples, FS)
    assert fineness_spread(both) == pytest.approx(1000, rel=1e-3)


def test_a_movement_of_63_samples_has_no_fineness() -> None:
    with pytest.raises(UndefinedFeatureError, match="63 samples; the rule is at least 64"):
        fineness(PhaseView(np.random.default_rng(0).standard_normal(63), FS))
