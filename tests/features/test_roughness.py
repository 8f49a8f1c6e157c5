"""Roughness: the printed equations, and the purpose of each correction."""

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
    """Return the movement below 100 Hz, by a Butterworth filter in both directions at the full rate."""
    return signal.sosfiltfilt(signal.butter(2, 100, fs=FS, output="sos"), x)


def sma(x, n):
    """Return the centred moving average, computed in a loop."""
    return np.array([x[max(0, i - n // 2) : i - n // 2 + n].mean() for i in range(x.size)])


def test_waviness_equals_equation_5_also_in_seconds_at_the_rate_of_the_paper():
    x = centred(60_000) * (1 + 0.5 * np.sin(np.arange(60_000) / 8000))
    m = np.array([np.abs(frame).mean() for frame in low(x).reshape(-1, 200)])
    assert r.waviness_as_printed(view(x)) == pytest.approx(np.log10(np.std(m - sma(m, 100))), abs=0.01)
    assert r.waviness(view(x)) == pytest.approx(r.waviness_as_printed(view(x)), abs=1e-6)


def test_spikiness_as_printed_equals_equation_6_and_the_corrected_one_has_a_floor():
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


def test_regularity_as_printed_equals_equation_7_and_only_it_grows_with_length():
    x = centred(3001)
    scaled = x / np.ptp(x)
    expected = np.maximum(np.diff(np.correlate(scaled, scaled, "full")[x.size - 1 :]), 0).mean()
    assert r.regularity_as_printed(view(x)) == pytest.approx(expected, rel=1e-5)
    short, long = view(centred(20_000)), view(centred(200_000, 1))
    assert r.regularity_as_printed(long) > 2 * r.regularity_as_printed(short)
    assert r.regularity(long) == pytest.approx(r.regularity(short), rel=0.1)


def test_the_moving_average_of_spikiness_has_the_documented_length():
    x = noise(30_000) + 6 * tone(1, 30_000)  # followed by an average over 0.5 s, not by longer ones
    x[1500::3000] += 800
    slow = low(x - x.mean())
    excess = np.maximum(slow - 2 * np.std(slow) - slow.mean() - sma(slow, 5000), 0).mean()
    assert r.spikiness_as_printed(view(x - x.mean())) == pytest.approx(np.log10(excess), abs=0.01)
    expected = np.log10(excess + 1e-3 * np.std(slow))
    assert r.spikiness(view(x - x.mean())) == pytest.approx(expected, abs=0.01)


def test_regularity_is_the_mean_over_frames():
    x = np.concatenate(
        [tone(60, 5000), centred(5000), signal.square(0.1 * np.arange(5000)) + centred(5000, 1)]
    )
    alone = [r.regularity(view(x[start : start + 5000]), band_hz=FS) for start in range(0, 10_001, 2500)]
    assert np.ptp(alone) > 0.5
    assert r.regularity(view(x), band_hz=FS) == pytest.approx(np.mean(alone), rel=1e-3)


def test_regularity_separates_gratings_from_noise_at_any_pitch_and_is_one_for_a_sine():
    noise_only = centred(30_000)
    for pitch_hz in (20.0, 80.0, 300.0):
        assert (
            r.regularity(
                view(signal.square(2 * np.pi * pitch_hz * np.arange(30_000) / FS) + 0.1 * noise_only)
            )
            > 0.7
        )
    assert r.regularity(view(noise_only)) < 0.15
    assert r.regularity(view(tone(100, 30_000))) == pytest.approx(1, abs=0.01)


def test_evenly_spaced_frames_of_a_long_movement_represent_all_frames():
    x = tone(60, 400_000) * (np.arange(400_000) / FS % 5 > 2) + centred(400_000)
    assert r.regularity(view(x)) == pytest.approx(r.regularity(view(x), n_frames=10_000), rel=0.05)


def test_temporal_roughness_as_printed_equals_equation_3():
    x = np.convolve(noise(20_000), np.ones(8) / 8, "same")
    low = signal.firwin(331, 100.0, fs=FS)
    coefficients = pywt.wavedec(x - ndimage.convolve1d(x, low), "coif3", level=5)

    def rebuilt(j):
        only = [c if i == len(coefficients) - j else np.zeros_like(c) for i, c in enumerate(coefficients)]
        return np.abs(pywt.waverec(only, "coif3"))[: x.size]

    d1, d5 = rebuilt(1), rebuilt(5)
    expected = np.log10(np.mean(np.abs(d1 - d1.mean() / d5.mean() * d5)))
    assert r.temporal_roughness_as_printed(view(x)) == pytest.approx(expected, abs=5e-3)


def test_roughness_ratio_of_two_tones_is_the_ratio_of_their_amplitudes():
    assert r.roughness_ratio(view(0.1 * tone(700) + tone(210))) == pytest.approx(-1, abs=0.02)


def test_temporal_roughness_depends_on_the_fine_band_only():
    fine, coarse = tone(700), tone(210)
    level = r.temporal_roughness(view(fine + coarse))
    assert r.temporal_roughness(view(0.1 * fine + coarse)) == pytest.approx(level - 1, abs=0.02)
    assert r.temporal_roughness(view(fine + 10 * coarse)) == pytest.approx(level, abs=0.02)


def changes(x, length, shift):
    """Return D_k^2 of equation 4 in double precision."""
    frames = np.lib.stride_tricks.sliding_window_view(x, length)[::shift]
    return np.mean(np.diff(np.abs(fft.dct(frames, axis=1, norm="ortho")), axis=0) ** 2, axis=1)


def test_spectral_roughness_as_printed_equals_equation_4_even_for_a_weak_change():
    x = noise(2000)
    value = r.spectral_roughness_as_printed(view(x), length=500, shift=20)
    assert value == pytest.approx(np.log10(changes(x, 500, 20).sum()), abs=1e-6)
    x = tone(2, 20_000) + 1e-3 * noise(20_000)  # slow and smooth: adjacent spectra are almost equal
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


def test_evenly_spaced_pairs_of_frames_rank_surfaces_as_all_pairs_do():
    values = []
    for i in range(12):
        strokes = 1 + 0.5 * np.sin(np.arange(40_000) / (400 + 30 * i))
        coloured = view(np.convolve(noise(40_000, i), np.ones(1 + i // 2), "same") * strokes, 2000.0)
        values.append((r.spectral_roughness(coloured), r.spectral_roughness(coloured, n_pairs=10_000)))
    noise_only, every = np.transpose(values)
    assert spearmanr(noise_only, every).statistic > 0.99
    np.testing.assert_allclose(noise_only, every, atol=0.05)


def test_frequencies_above_the_band_have_no_effect():
    in_band = tone(300, 30_000) + 0.1 * noise(30_000)
    with_tone = r.spectral_roughness(view(in_band + tone(3000, 30_000)))
    assert with_tone == pytest.approx(r.spectral_roughness(view(in_band)), abs=0.01)
