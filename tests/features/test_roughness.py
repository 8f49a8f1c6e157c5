import numpy as np
import pytest
import pywt
from scipy import fft
from scipy.stats import spearmanr

from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import PhaseView
from texclass.features.roughness import (
    roughness_ratio,
    spectral_roughness,
    spectral_roughness_as_printed,
    temporal_roughness,
    temporal_roughness_as_printed,
)
from texclass.recording import Samples
from texclass.signals import highpass_fir

FS = 10_000.0


def noise(n: int, seed: int = 0) -> Samples:
    return np.random.default_rng(seed).standard_normal(n)


def test_temporal_roughness_as_printed_is_equation_3_written_out() -> None:
    x = np.convolve(noise(20_000), np.ones(8) / 8, "same")
    coefficients = pywt.wavedec(highpass_fir(x, 100.0, FS), "coif3", level=5)

    def rebuilt(j: int) -> Samples:
        only = [c if i == len(coefficients) - j else np.zeros_like(c) for i, c in enumerate(coefficients)]
        return np.abs(pywt.waverec(only, "coif3"))[: x.size]

    d1, d5 = rebuilt(1), rebuilt(5)
    expected = np.log10(np.mean(np.abs(d1 - d1.mean() / d5.mean() * d5)))
    assert temporal_roughness_as_printed(PhaseView(x, FS)) == pytest.approx(expected, abs=5e-3)


def test_temporal_roughness_needs_544_samples() -> None:
    assert np.isfinite(temporal_roughness_as_printed(PhaseView(noise(544), FS)))
    with pytest.raises(UndefinedFeatureError, match="543 samples; the rule is at least 544"):
        temporal_roughness_as_printed(PhaseView(noise(543), FS))


def test_corrected_temporal_roughness_needs_its_band_below_half_the_rate() -> None:
    with pytest.raises(UndefinedFeatureError, match="fs is 2000 Hz; the rule is fs/2 above 1000 Hz"):
        temporal_roughness(PhaseView(noise(5000), 2000.0))


def test_ratio_of_two_tones_in_the_bands_is_that_of_their_amplitudes() -> None:
    t = np.arange(50_000) / FS
    x = 0.1 * np.sin(2 * np.pi * 700 * t) + np.sin(2 * np.pi * 210 * t)
    assert roughness_ratio(PhaseView(x, FS)) == pytest.approx(-1, abs=0.02)


def test_spectral_roughness_as_printed_is_equation_4_in_a_loop() -> None:
    x = noise(2000)
    total = 0.0
    for start in range(0, 2000 - 500 - 20 + 1, 20):
        this, that = (np.abs(fft.dct(x[s : s + 500], norm="ortho")) for s in (start, start + 20))
        total += np.mean((this - that) ** 2)
    value = spectral_roughness_as_printed(PhaseView(x, FS), length=500, shift=20)
    assert value == pytest.approx(np.log10(total), abs=1e-6)


def test_single_precision_costs_nothing_even_on_a_weak_change() -> None:
    t = np.arange(20_000) / FS
    x = np.sin(2 * np.pi * 2 * t) + 1e-3 * noise(t.size)  # slow and smooth: neighbouring spectra nearly agree
    total = 0.0
    frames = np.lib.stride_tricks.sliding_window_view(x, 5000)[::100]
    magnitude = np.abs(fft.dct(frames, axis=1, norm="ortho"))
    total = float(np.mean(np.diff(magnitude, axis=0) ** 2, axis=1).sum())
    assert spectral_roughness_as_printed(PhaseView(x, FS)) == pytest.approx(np.log10(total), abs=1e-5)


def test_printed_sum_grows_with_length_and_the_mean_does_not() -> None:
    short, long = PhaseView(noise(30_000), FS), PhaseView(noise(120_000, 1), FS)
    grown = spectral_roughness_as_printed(long) - spectral_roughness_as_printed(short)
    assert grown == pytest.approx(np.log10(1150 / 250), abs=0.01)
    assert spectral_roughness(long) == pytest.approx(spectral_roughness(short), abs=0.01)


def test_corrected_spectral_roughness_is_the_mean_over_all_pairs_of_a_short_movement() -> None:
    x = noise(3000, 2)
    magnitude = [np.abs(fft.dct(x[s : s + 1000], norm="ortho")) for s in range(0, 2001, 20)]
    expected = np.log10(np.mean(np.diff(magnitude, axis=0) ** 2))
    assert spectral_roughness(PhaseView(x, 2000.0)) == pytest.approx(expected, abs=1e-6)


def test_pairs_spread_over_a_long_movement_rank_surfaces_as_all_pairs_do() -> None:
    values = []
    for i in range(12):
        strokes = 1 + 0.5 * np.sin(np.arange(40_000) / (400 + 30 * i))
        coloured = np.convolve(noise(40_000, i), np.ones(1 + i // 2), "same") * strokes
        view = PhaseView(coloured, 2000.0)
        values.append((spectral_roughness(view), spectral_roughness(view, n_pairs=10_000)))
    some, every = np.transpose(values)
    assert spearmanr(some, every).statistic > 0.99
    np.testing.assert_allclose(some, every, atol=0.05)


def test_what_lies_above_the_band_does_not_count() -> None:
    t = np.arange(30_000) / FS
    felt = np.sin(2 * np.pi * 300 * t) + 0.1 * noise(t.size)
    heard = felt + np.sin(2 * np.pi * 3000 * t)
    assert spectral_roughness(PhaseView(heard, FS)) == pytest.approx(
        spectral_roughness(PhaseView(felt, FS)), abs=0.01
    )
