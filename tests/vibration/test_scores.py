import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from texclass.vibration.scores import (
    BAND_EDGES_HZ,
    band_energy_distance,
    goodness_of_fit,
    log_spectral_distance,
    rms_spectral_error,
)

FS = 10_000.0
SOS = signal.butter(4, [80, 400], "bandpass", fs=FS, output="sos")


def _texture(seed, n=20_000):
    return signal.sosfilt(SOS, np.random.default_rng(seed).standard_normal(n))


def test_rms_spectral_error_is_the_printed_ratio_of_magnitudes():
    a, b = _texture(0), _texture(1)
    A, B = (np.abs(np.fft.fft(x[:2800])) for x in (a, b))
    assert_allclose(rms_spectral_error(a, b), np.sqrt(np.mean((A - B) ** 2) / np.mean(A**2)), rtol=1e-12)
    assert_allclose(rms_spectral_error(a, 0 * a), 1.0)
    assert_allclose(rms_spectral_error(a, 3 * a), 2.0)


def test_gfc_is_the_printed_sum_over_windows():
    a, b = _texture(0, 1300), _texture(1, 1300)
    expected = []
    for start in (0, 250, 500, 750):
        A, B = (
            np.sqrt(signal.welch(x[start : start + 500], window="hamming", nperseg=50, detrend=False)[1])
            for x in (a, b)
        )
        expected.append(np.sum(A * B) / np.sqrt(np.sum(A**2) * np.sum(B**2)))
    assert_allclose(goodness_of_fit(a, b), np.mean(expected), rtol=1e-12)


def test_silent_windows_count_as_documented():
    quiet, loud = np.zeros(500), _texture(0, 500)
    assert goodness_of_fit(quiet, quiet) == 1.0
    assert goodness_of_fit(quiet, loud) == 0.0


@pytest.mark.parametrize("gain", [0.1, 2.0])
def test_a_gain_gives_its_decibels_in_both_logarithmic_distances(gain):
    a = np.random.default_rng(0).standard_normal(20_000)
    decibels = abs(20 * np.log10(gain))
    assert_allclose(log_spectral_distance(a, gain * a), decibels, rtol=1e-9)
    assert_allclose(band_energy_distance(a, gain * a, FS), decibels, rtol=1e-9)


def test_band_energies_sum_to_the_power_in_the_range():
    """A change of one of the nine bands by 10 dB gives 10 / sqrt(9) dB."""
    assert_allclose(BAND_EDGES_HZ[1:] / BAND_EDGES_HZ[:-1], np.full(9, 50 ** (1 / 9)))
    t = np.arange(50_000) / FS
    centres = np.sqrt(BAND_EDGES_HZ[1:] * BAND_EDGES_HZ[:-1])
    tones = np.sin(2 * np.pi * centres[:, np.newaxis] * t)
    louder = tones.copy()
    louder[3] *= np.sqrt(10)
    assert_allclose(band_energy_distance(tones.sum(axis=0), louder.sum(axis=0), FS), 10 / 3, rtol=1e-3)


def test_vibration_outside_the_perceptible_range_is_ignored():
    t = np.arange(50_000) / FS
    a = _texture(0, 50_000)
    slow = a + 0.5 * np.sin(2 * np.pi * 3 * t) + 0.1 * np.sin(2 * np.pi * 4000 * t)
    assert band_energy_distance(a, slow, FS) < 0.01


def test_bands_above_half_the_sampling_rate_are_ignored():
    a = np.random.default_rng(0).standard_normal(3000)
    assert_allclose(band_energy_distance(a, 2 * a, 500.0), 20 * np.log10(2))


def test_a_silent_synthesis_has_a_finite_distance():
    a = np.random.default_rng(0).standard_normal(5000)
    assert 100 < log_spectral_distance(a, 0 * a) <= 120
    assert 90 < band_energy_distance(a, 0 * a, FS) <= 120
