"""The perceptual distance on signals whose distance is known, and its threshold against published values."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from texclass.vibration.perceptual_distance import (
    BAND_CENTRES_HZ,
    band_powers,
    detection_threshold,
    perceptual_distance,
)
from texclass.vibration.scores import goodness_of_fit

FS = 2500.0
T_S = np.arange(10 * round(FS)) / FS


def noise(seed, n=25_000):
    return np.random.default_rng(seed).standard_normal(n)


def tone(frequency_hz, level_db):
    """Return a sinusoid with a sensation level in dB at its frequency."""
    rms = detection_threshold(frequency_hz) * 10 ** (level_db / 20)
    return np.sqrt(2) * rms * np.sin(2 * np.pi * frequency_hz * T_S)


def test_the_threshold_of_displacement_falls_by_12_db_per_octave_to_250_hz():
    """Verrillo (1963): 12 dB per octave from 40 Hz to a minimum at about 250 Hz."""
    f = np.arange(20.0, 1001.0)
    displacement = detection_threshold(f) / (2 * np.pi * f) ** 2
    assert f[displacement.argmin()] == 250
    fall_db = 20 * np.log10(displacement[f == 40] / displacement[f == 250])
    assert_allclose(fall_db, 12 * np.log2(250 / 40), atol=0.5)
    assert_allclose(np.sqrt(2) * displacement.min(), 0.1e-6)


def test_from_40_hz_the_threshold_of_acceleration_is_lowest_near_160_hz():
    """Griffin (2012): greatest sensitivity to acceleration around 125 Hz."""
    f = np.arange(40.0, 1001.0)
    assert f[detection_threshold(f).argmin()] == 157
    assert detection_threshold(125.0) < 1.1 * detection_threshold(f).min()


def test_the_threshold_is_that_of_the_reference_software():
    """50 dB (log10(c f + b) / log10 b)^2 - 45 dB, with c = 1/550 and b = 1 - 250 c, relative to 250 Hz."""
    f = np.array([20.0, 100.0, 250.0, 400.0])
    b = 1 - 250 / 550
    printed_db = 50 / np.log10(b) ** 2 * np.log10(f / 550 + b) ** 2 - 45
    displacement_db = 20 * np.log10(detection_threshold(f) / (2 * np.pi * f) ** 2)
    assert_allclose(displacement_db - displacement_db[2], printed_db + 45, atol=1e-9)


def test_bands_are_one_third_octaves_with_the_whole_power():
    assert_allclose(BAND_CENTRES_HZ[[0, 7, 17]], [19.95, 100.0, 1000.0], atol=0.01)
    powers = band_powers(noise(0, 250_000), FS)
    assert_allclose(powers, (10**0.05 - 10**-0.05) * BAND_CENTRES_HZ / (FS / 2), rtol=0.1)
    assert band_powers(noise(0), 500.0).size == 11  # 200 Hz ends at 224 Hz


def test_equal_spectra_have_no_distance():
    x = 10 * noise(0)
    assert perceptual_distance(x, x, FS) == 0
    assert perceptual_distance(x, 10 * noise(1), FS) < 0.8


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_a_gain_gives_its_decibels_or_nothing(gain):
    x = 30 * noise(0)
    assert_allclose(perceptual_distance(x, gain * x, 900.0), 20 * abs(np.log10(gain)), rtol=1e-9)
    assert perceptual_distance(x, gain * x, FS, equal_level=True) == pytest.approx(0, abs=1e-9)


def test_differences_below_the_threshold_do_not_count():
    x = tone(100.0, 30)
    assert perceptual_distance(x, x + tone(800.0, -6), FS) < 1e-3
    assert perceptual_distance(x, x + tone(800.0, 6), FS) > 1


def test_one_band_of_n_that_is_missing_counts_with_its_sensation_level():
    frequencies = (50.0, 100.0, 200.0)
    x = np.sum([tone(f, 20) for f in frequencies], axis=0)
    without = x - tone(200.0, 20)
    n_felt = np.sum(band_powers(x, FS) > detection_threshold(BAND_CENTRES_HZ) ** 2)
    lost = 20 - 0.2  # the tone is not at the centre of its band
    assert perceptual_distance(x, without, FS) >= lost / np.sqrt(n_felt)
    assert perceptual_distance(x, without, FS) < 20


def test_the_assumed_level_replaces_the_unit():
    x, y = noise(0), signal.lfilter([1], [1, -0.9], noise(1))
    distances = [perceptual_distance(g * x, g * y, FS, strongest_db=30) for g in (1e-6, 1.0, 1e6)]
    assert_allclose(distances, distances[0], rtol=1e-9)
    with pytest.raises(ValueError, match="recorded must exceed the detection threshold"):
        perceptual_distance(1e-3 * x, y, FS)


def test_tilted_noise_is_far_from_white_noise_although_its_gfc_is_high():
    """A slope of 1 dB per octave, 5.6 dB from 20 to 1000 Hz."""
    x = noise(0)
    X = np.fft.rfft(noise(1))
    f = np.fft.rfftfreq(x.size, 1 / FS)
    tilted = np.fft.irfft(X * np.maximum(f, 20) ** -0.167, x.size)
    assert goodness_of_fit(x, tilted) > 0.97
    assert perceptual_distance(x, tilted, FS, strongest_db=40, equal_level=True) > 2
    assert perceptual_distance(x, noise(1), FS, strongest_db=40, equal_level=True) < 0.6


def test_invalid_arguments_are_named():
    x = noise(0)
    for call, message in (
        (lambda: perceptual_distance(0 * x, x, FS), "recorded must not be silent"),
        (lambda: perceptual_distance(x, x, 40.0), "fs must be at least 44.8 Hz"),
        (lambda: perceptual_distance(x, x, FS, strongest_db=-3.0), "strongest_db must be positive"),
        (lambda: perceptual_distance([1.0, 2.0], x, FS), "at least 4 samples"),
        (lambda: detection_threshold([0.0, 1.0]), "frequency_hz must be positive"),
        (lambda: detection_threshold(100.0, reference_um=0.0), "reference_um must be positive"),
    ):
        with pytest.raises(ValueError, match=message):
            call()


def test_a_silent_synthesis_has_the_sensation_levels_as_its_distance():
    x = 10 * noise(0)
    levels = 10 * np.log10(band_powers(x, FS) / detection_threshold(BAND_CENTRES_HZ) ** 2)
    is_felt = levels > 0
    assert_allclose(perceptual_distance(x, 0 * x, FS), np.sqrt(np.mean(levels[is_felt] ** 2)))
