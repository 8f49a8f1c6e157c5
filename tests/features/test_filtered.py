import numpy as np
import pytest

from texclass.features.conditioning import band_passed, banded, level, low_passed
from texclass.features.phase_view import PhaseView

FS = 10_000.0


def tone(f_hz: float, fs: float = FS, n: int = 50_000) -> PhaseView:
    return PhaseView(np.sin(2 * np.pi * f_hz * np.arange(n) / fs), fs)


@pytest.mark.parametrize(("f_hz", "amplitude"), [(707.1, 1.0), (500.0, 0.5), (1000.0, 0.5), (100.0, 0.0)])
@pytest.mark.parametrize("rate_hz", [3000.0, 5000.0, 20_000.0])
def test_band_pass_halves_the_amplitude_at_its_edges_at_any_rate(
    f_hz: float, amplitude: float, rate_hz: float
) -> None:
    view = tone(f_hz)
    y = level(view) * band_passed(view, 500.0, 1000.0, rate_hz)
    assert y.size == pytest.approx(50_000 * min(rate_hz / FS, 1), rel=0.03)
    assert np.sqrt(2) * y[100:-100].std() == pytest.approx(amplitude, abs=0.01)


def test_banded_is_the_same_signal_at_another_rate() -> None:
    slow, fs = banded(tone(210.0), 1000.0)
    t = np.arange(slow.size) / fs
    assert fs == 2000.0
    np.testing.assert_allclose(slow[50:-50], np.sin(2 * np.pi * 210 * t)[50:-50], atol=2e-3)
    assert np.abs(banded(tone(1210.0), 1000.0)[0][50:-50]).max() < 0.02


def test_low_pass_of_corrected_features_is_that_of_printed_ones_to_rounding() -> None:
    view = PhaseView(np.random.default_rng(0).standard_normal(50_000), FS)
    (own, factor), (shared, same) = low_passed(view, 100.0), low_passed(view, 100.0, shared=True)
    assert factor == same
    np.testing.assert_allclose(shared, own, atol=1e-6)
