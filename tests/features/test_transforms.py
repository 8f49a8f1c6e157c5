import numpy as np
import pytest

from texclass.features.conditioning import first_bins, low_spectrum, padded_length, spectrum, unit
from texclass.features.phase_view import PhaseView
from texclass.recording import Samples

FS = 10_000.0


def noise(n: int, seed: int = 0) -> Samples:
    return np.random.default_rng(seed).standard_normal(n)


@pytest.mark.parametrize("n", [64, 65, 1000, 20_000, 99_991])
def test_low_spectrum_is_the_first_quarter_of_the_spectrum(n: int) -> None:
    view = PhaseView(noise(n), FS)
    low, whole = low_spectrum(view), np.fft.rfft(unit(view), padded_length(view))
    assert low.size == padded_length(view) // 4 + 1
    np.testing.assert_allclose(low, whole[: low.size], atol=1e-6 * np.abs(whole).max())


def test_bins_beyond_a_fourth_of_the_rate_and_of_slow_sensors_come_from_the_whole_spectrum() -> None:
    fast, slow = PhaseView(noise(2000), FS), PhaseView(noise(2000), 2000.0)
    np.testing.assert_array_equal(first_bins(fast, 501), low_spectrum(fast))
    np.testing.assert_array_equal(first_bins(fast, 600), spectrum(fast)[:600])
    np.testing.assert_array_equal(first_bins(slow, 100), spectrum(slow)[:100])
