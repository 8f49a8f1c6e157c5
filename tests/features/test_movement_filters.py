"""Shared filters and spectra of a movement, at any sampling rate and length."""

from itertools import product

import numpy as np
import pytest
from feature_signals import FS, noise, tone
from numpy.lib.stride_tricks import sliding_window_view
from scipy import signal

from texclass.features.movement_filters import (
    band_limited,
    band_passed,
    first_bins,
    level,
    low_passed,
    low_spectrum,
    spectrum,
)
from texclass.features.phase_view import PhaseView
from texclass.features.spectra import (
    evenly_spaced,
    frames_of,
    long_frames,
    mean_spectrum,
    spectral_moments,
    window_of,
)
from texclass.features.tap_modes import TAP_RATE, decimated


def test_band_pass_halves_the_amplitude_at_its_edges_at_any_rate():
    for f_hz, amplitude in ((707.1, 1.0), (500.0, 0.5), (1000.0, 0.5), (100.0, 0.0)):
        for rate_hz in (3000.0, 5000.0, 20_000.0):
            view = PhaseView(tone(f_hz), FS)
            y = level(view) * band_passed(view, 500.0, 1000.0, rate_hz)
            assert y.size == pytest.approx(50_000 * min(rate_hz / FS, 1), rel=0.03)
            assert np.sqrt(2) * y[100:-100].std() == pytest.approx(amplitude, abs=0.01)


def test_band_limited_is_the_same_signal_at_another_rate():
    slow, fs = band_limited(PhaseView(tone(210.0), FS), 1000.0)
    assert fs == 2000.0
    np.testing.assert_allclose(slow[50:-50], tone(210, slow.size, fs)[50:-50], atol=2e-3)
    assert np.abs(band_limited(PhaseView(tone(1210.0), FS), 1000.0)[0][50:-50]).max() < 0.02


def test_low_pass_of_corrected_features_equals_that_of_printed_ones():
    view = PhaseView(noise(50_000), FS)
    (own, factor), (shared, same) = low_passed(view, 100.0), low_passed(view, 100.0, shared=True)
    assert factor == same
    np.testing.assert_allclose(shared, own, atol=1e-6)


def test_bins_above_a_quarter_of_the_rate_come_from_the_full_spectrum():
    fast, slow = PhaseView(noise(2000), FS), PhaseView(noise(2000), 2000.0)
    np.testing.assert_array_equal(first_bins(fast, 501), low_spectrum(fast))
    np.testing.assert_array_equal(first_bins(fast, 600), spectrum(fast)[:600])
    np.testing.assert_array_equal(first_bins(slow, 100), spectrum(slow)[:100])


def test_spectral_moments_equal_those_of_each_frame():
    view = PhaseView(np.cumsum(noise(30_000, 1)), FS)
    frames, f = long_frames(view)
    for power, mean, std in zip(frames.astype(float), *spectral_moments(view), strict=True):
        expected = np.average(f, weights=power)
        assert mean == pytest.approx(expected, rel=1e-9)
        assert std == pytest.approx(np.sqrt(np.average((f - expected) ** 2, weights=power)), rel=1e-6)


def test_a_movement_shorter_than_a_long_frame_is_one_frame():
    power, frequency = long_frames(PhaseView(noise(500, 3), 2000.0))
    assert power.shape == (1, 257)
    assert frequency[-1] == 1000.0


def test_evenly_spaced_starts_reach_the_last_and_keep_the_step():
    assert evenly_spaced(1000, 100, 64).tolist() == list(range(0, 1001, 100))
    assert evenly_spaced(1000, 1, 5).tolist() == [0, 250, 500, 750, 1000]
    assert evenly_spaced(0, 10, 64).tolist() == [0]


def test_mean_spectrum_of_a_slow_sensor_contains_all_power_up_to_half_the_rate():
    for fs, n in ((2000.0, 4000), (2200.0, 13_000), (900.0, 600), (2000.0, 500)):
        mixed = noise(n) + 2 * np.tile([1.0, -1.0], n // 2)
        view = PhaseView(mixed - mixed.mean(), fs)
        x = view.samples / np.abs(view.samples).max()
        frequency, density = mean_spectrum(view)
        width = np.diff(frequency).mean() * np.ones(density.size)
        if width[0] > 1.0 + 1e-9:  # bin by bin
            assert frequency[-1] == fs / 2
        assert density @ width == pytest.approx(np.mean(x**2), rel=2e-3)


@pytest.mark.parametrize("n", [500, 998, 1000, 2000])
def test_the_centroid_of_a_mean_spectrum_does_not_depend_on_the_length(n):
    # Amplitude 1 at fs/2 has twice the power of a sinusoid of amplitude 1: (2 * 500 + 100) / 3 = 366.7 Hz.
    x = np.cos(np.pi * np.arange(n)) + np.sin(2 * np.pi * 100 * np.arange(n) / 1000)
    frequency, density = mean_spectrum(PhaseView(x, 1000.0))
    assert frequency @ density / density.sum() == pytest.approx(366.7, abs=1.5)


def test_windows_and_low_pass_equal_those_of_scipy():
    for name, length in product(("hann", "hamming"), (8, 13, 256)):
        np.testing.assert_allclose(window_of(name, length), signal.get_window(name, length), atol=1e-7)
    x = noise(500)
    expected = np.convolve(x, signal.firwin(13, 1 / 3), "valid")[::3]
    np.testing.assert_allclose(decimated(x, 3 * TAP_RATE)[0], expected, atol=1e-13)


def test_frames_equal_those_of_a_sliding_window():
    for n, length, hop in ((100, 100, 7), (1000, 64, 1), (1003, 250, 150)):
        x = noise(n).astype(np.float32)
        np.testing.assert_array_equal(frames_of(x, length, hop), sliding_window_view(x, length)[::hop])
