"""Roughness: the printed equations written out, and what each correction is for."""

import numpy as np
import pytest
import pywt
from feature_signals import FS, noise, tone
from scipy import fft, ndimage, signal
from scipy.stats import spearmanr

from texclass.features import roughness as r
from texclass.features.phase_view import PhaseView


def view(x, fs=FS):
    return PhaseView(np.asarray(x), fs)


def centred(n, seed=0):
    x = noise(n, seed)
    return x - x.mean()


def low(x):
    """The 100 Hz low-pass by another road: a Butterworth filter run both ways over the full rate."""
    return signal.sosfiltfilt(signal.butter(2, 100, fs=FS, output="sos"), x)


def sma(x, n):
    """Centred moving average by a loop."""
    return np.array([x[max(0, i - n // 2) : i - n // 2 + n].mean() for i in range(x.size)])


def test_waviness_as_printed_is_equation_5_and_that_in_seconds_the_same_at_the_rate_of_the_paper():
    x = centred(60_000) * (1 + 0.5 * np.sin(np.arange(60_000) / 8000))
    m = np.array([np.abs(frame).mean() for frame in low(x).reshape(-1, 200)])
    assert r.waviness_as_printed(view(x)) == pytest.approx(np.log10(np.std(m - sma(m, 100))), abs=0.01)
    assert r.waviness(view(x)) == pytest.approx(r.waviness_as_printed(view(x)), abs=1e-6)


def test_spikiness_as_printed_is_equation_6_and_has_a_floor_where_it_is_corrected():
    x = noise(30_000)
    x[1500::3000] += 80
    slow = low(x - x.mean())
    threshold = 2 * np.std(slow) + slow.mean() + sma(slow, 5000)
    expected = np.log10(np.maximum(slow - threshold, 0).mean())
    assert r.spikiness_as_printed(view(x - x.mean())) == pytest.approx(expected, abs=0.02)
    smooth = view(tone(50, 30_000))  # never reaches 2 sigma
    expected = np.log10(np.maximum(slow - threshold, 0).mean() + 1e-3 * np.std(slow))
    assert r.spikiness(view(x - x.mean())) == pytest.approx(expected, abs=0.03)
    sigma = np.sqrt(0.5) / (1 + 0.5**4)
    assert r.spikiness(smooth) == pytest.approx(np.log10(1e-3 * sigma), abs=0.01)


def test_regularity_as_printed_is_equation_7_and_grows_with_length_as_the_corrected_one_does_not():
    x = centred(3001)
    scaled = x / np.ptp(x)
    expected = np.maximum(np.diff(np.correlate(scaled, scaled, "full")[x.size - 1 :]), 0).mean()
    assert r.regularity_as_printed(view(x)) == pytest.approx(expected, rel=1e-5)
    short, long = view(centred(20_000)), view(centred(200_000, 1))
    assert r.regularity_as_printed(long) > 2 * r.regularity_as_printed(short)
    assert r.regularity(long) == pytest.approx(r.regularity(short), rel=0.1)


def test_the_average_that_spikes_stand_above_is_as_long_as_said():
    x = noise(30_000) + 6 * tone(1, 30_000)  # what half a second follows, and longer ones do not
    x[1500::3000] += 800
    slow = low(x - x.mean())
    excess = np.maximum(slow - 2 * np.std(slow) - slow.mean() - sma(slow, 5000), 0).mean()
    assert r.spikiness_as_printed(view(x - x.mean())) == pytest.approx(np.log10(excess), abs=0.01)
    expected = np.log10(excess + 1e-3 * np.std(slow))
    assert r.spikiness(view(x - x.mean())) == pytest.approx(expected, abs=0.01)


def test_regularity_is_the_mean_over_frames_of_what_each_says_alone():
    x = np.concatenate(
        [tone(60, 5000), centred(5000), signal.square(0.1 * np.arange(5000)) + centred(5000, 1)]
    )
    alone = [r.regularity(view(x[start : start + 5000]), band_hz=FS) for start in range(0, 10_001, 2500)]
    assert np.ptp(alone) > 0.5
    assert r.regularity(view(x), band_hz=FS) == pytest.approx(np.mean(alone), rel=1e-3)


def test_regularity_tells_a_grating_from_noise_at_any_pitch_and_is_one_for_a_sine():
    some = centred(30_000)
    for pitch_hz in (20.0, 80.0, 300.0):
        assert (
            r.regularity(view(signal.square(2 * np.pi * pitch_hz * np.arange(30_000) / FS) + 0.1 * some))
            > 0.7
        )
    assert r.regularity(view(some)) < 0.15
    assert r.regularity(view(tone(100, 30_000))) == pytest.approx(1, abs=0.01)


def test_frames_spread_over_a_long_movement_say_what_all_of_them_say():
    x = tone(60, 400_000) * (np.arange(400_000) / FS % 5 > 2) + centred(400_000)
    assert r.regularity(view(x)) == pytest.approx(r.regularity(view(x), n_frames=10_000), rel=0.05)


def test_temporal_roughness_as_printed_is_equation_3_written_out():
    x = np.convolve(noise(20_000), np.ones(8) / 8, "same")
    low = signal.firwin(331, 100.0, fs=FS)
    coefficients = pywt.wavedec(x - ndimage.convolve1d(x, low), "coif3", level=5)

    def rebuilt(j):
        only = [c if i == len(coefficients) - j else np.zeros_like(c) for i, c in enumerate(coefficients)]
        return np.abs(pywt.waverec(only, "coif3"))[: x.size]

    d1, d5 = rebuilt(1), rebuilt(5)
    expected = np.log10(np.mean(np.abs(d1 - d1.mean() / d5.mean() * d5)))
    assert r.temporal_roughness_as_printed(view(x)) == pytest.approx(expected, abs=5e-3)


def test_ratio_of_two_tones_in_the_bands_is_that_of_their_amplitudes():
    assert r.roughness_ratio(view(0.1 * tone(700) + tone(210))) == pytest.approx(-1, abs=0.02)


def test_roughness_in_time_is_that_of_the_fine_band_whatever_the_level_of_the_coarse_one():
    fine, coarse = tone(700), tone(210)
    level = r.temporal_roughness(view(fine + coarse))
    assert r.temporal_roughness(view(0.1 * fine + coarse)) == pytest.approx(level - 1, abs=0.02)
    assert r.temporal_roughness(view(fine + 10 * coarse)) == pytest.approx(level, abs=0.02)


def changes(x, length, shift):
    """D_k^2 of equation 4, in double precision."""
    frames = np.lib.stride_tricks.sliding_window_view(x, length)[::shift]
    return np.mean(np.diff(np.abs(fft.dct(frames, axis=1, norm="ortho")), axis=0) ** 2, axis=1)


def test_spectral_roughness_as_printed_is_equation_4_even_on_a_weak_change():
    x = noise(2000)
    value = r.spectral_roughness_as_printed(view(x), length=500, shift=20)
    assert value == pytest.approx(np.log10(changes(x, 500, 20).sum()), abs=1e-6)
    x = tone(2, 20_000) + 1e-3 * noise(20_000)  # slow and smooth: neighbouring spectra nearly agree
    expected = np.log10(changes(x, 5000, 100).sum())
    assert r.spectral_roughness_as_printed(view(x)) == pytest.approx(expected, abs=1e-5)


def test_printed_sum_grows_with_length_and_the_mean_over_pairs_does_not():
    short, long = view(noise(30_000)), view(noise(120_000, 1))
    grown = r.spectral_roughness_as_printed(long) - r.spectral_roughness_as_printed(short)
    assert grown == pytest.approx(np.log10(1150 / 250), abs=0.01)
    assert r.spectral_roughness(long) == pytest.approx(r.spectral_roughness(short), abs=0.01)
    x = noise(2200, 2)  # short enough for all pairs
    expected = np.log10(changes(x, 1000, 20).mean())
    assert r.spectral_roughness(view(x, 2000.0)) == pytest.approx(expected, abs=1e-6)


def test_pairs_spread_over_a_long_movement_rank_surfaces_as_all_pairs_do():
    values = []
    for i in range(12):
        strokes = 1 + 0.5 * np.sin(np.arange(40_000) / (400 + 30 * i))
        coloured = view(np.convolve(noise(40_000, i), np.ones(1 + i // 2), "same") * strokes, 2000.0)
        values.append((r.spectral_roughness(coloured), r.spectral_roughness(coloured, n_pairs=10_000)))
    some, every = np.transpose(values)
    assert spearmanr(some, every).statistic > 0.99
    np.testing.assert_allclose(some, every, atol=0.05)


def test_what_lies_above_the_band_does_not_count():
    felt = tone(300, 30_000) + 0.1 * noise(30_000)
    heard = r.spectral_roughness(view(felt + tone(3000, 30_000)))
    assert heard == pytest.approx(r.spectral_roughness(view(felt)), abs=0.01)
