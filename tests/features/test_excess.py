"""Truth: a gain and a tilt of the spectrum are made, and are found in the one column that stands for them."""

import numpy as np
import pytest
from scipy import signal

from texclass.features.bands import band_level, octave_level
from texclass.features.contract import UndefinedFeatureError
from texclass.features.excess import (
    band_excess,
    curvature_excess,
    level_tilt,
    line,
    octave_excess,
    octaves_of,
    slope_excess,
)
from texclass.features.phase_view import PhaseView
from texclass.features.slopes import LAGS, curvature_level, slope_level
from texclass.recording import Samples

FS = 2000.0
N = 100_000


def noise(seed: int = 0) -> Samples:
    return np.random.default_rng(seed).standard_normal(N)


def coloured(seed: int = 0) -> Samples:
    b, a = signal.butter(1, 300, fs=FS)
    return np.asarray(signal.lfilter(b, a, noise(seed)))


def test_white_noise_has_no_tilt_and_a_random_walk_half_an_order_an_octave() -> None:
    assert level_tilt(PhaseView(noise(), FS)) == pytest.approx([0], abs=2e-3)
    assert level_tilt(PhaseView(np.cumsum(noise()), FS)) == pytest.approx([-np.log10(2) / 2], abs=5e-3)


def test_the_line_is_the_least_squares_fit_of_slope_levels() -> None:
    view = PhaseView(coloured(), FS)
    tilt, middle = np.polyfit(-np.log2(LAGS), slope_level(view), 1)
    found = line(view)
    np.testing.assert_allclose(found.at(np.array([0.0, -3.0])), [middle, middle - 3 * tilt], rtol=1e-9)


def test_slopes_of_a_random_walk_lie_on_their_line() -> None:
    walk = PhaseView(np.cumsum(noise(1)), FS)
    np.testing.assert_allclose(slope_excess(walk), 0, atol=5e-3)


def test_what_is_left_of_the_slopes_has_neither_height_nor_tilt() -> None:
    left = slope_excess(PhaseView(coloured(), FS))
    assert np.abs(left).max() > 0.02
    assert left.sum() == pytest.approx(0, abs=1e-9)
    assert left @ octaves_of(LAGS) == pytest.approx(0, abs=1e-9)


def test_levels_are_the_excess_and_the_line_at_the_middle_of_each_band() -> None:
    view = PhaseView(coloured(), FS)
    at = line(view).at
    edges = np.linspace(0, 1, 25)
    np.testing.assert_allclose(
        band_level(view) - band_excess(view), 2 * at(np.log2((edges[1:] + edges[:-1]) / 2))
    )
    middle = np.array([-2 - 1 / 6, -2.5, -3 + 1 / 6])
    octave = octave_level(view, octaves=(2, 3)) - octave_excess(view, octaves=(2, 3))
    np.testing.assert_allclose(octave, 2 * at(middle))
    np.testing.assert_allclose(
        curvature_level(view, lags=(4,)) - curvature_excess(view, lags=(4,)), at(np.array([-2.0]))
    )


@pytest.mark.parametrize("excess", [band_excess, octave_excess, slope_excess, curvature_excess])
def test_a_tilt_of_the_whole_spectrum_changes_the_excess_less_than_the_levels(excess) -> None:
    levels = {
        band_excess: band_level,
        octave_excess: octave_level,
        slope_excess: slope_level,
        curvature_excess: curvature_level,
    }[excess]
    frequency = np.maximum(np.arange(N // 2 + 1), 1) / N
    spectra = np.fft.rfft(noise(2)) * frequency ** np.array([[-0.5], [-0.3]])
    plain, tilted = (PhaseView(x, FS) for x in np.fft.irfft(spectra, N))
    moved = np.abs(levels(tilted) - levels(plain)).mean()
    assert np.abs(excess(tilted) - excess(plain)).mean() < 0.5 * moved


def test_a_tone_stands_out_of_its_band_alone() -> None:
    x, t = coloured(3), np.arange(N) / FS
    rise = band_excess(PhaseView(x + 0.3 * np.sin(2 * np.pi * 730.0 * t), FS)) - band_excess(PhaseView(x, FS))
    assert np.argmax(rise) == int(730.0 / (FS / 2) * 24)
    assert np.sort(rise)[-2] < 0.2 * rise.max()


@pytest.mark.parametrize("excess", [level_tilt, band_excess, slope_excess, curvature_excess])
def test_silence_has_no_line(excess) -> None:
    with pytest.raises(UndefinedFeatureError, match="silence"):
        excess(PhaseView(np.zeros(N), FS))
