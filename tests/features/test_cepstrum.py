"""Modified MFCC: equal to librosa where comparable, and the purpose of each modification."""

import librosa
import numpy as np
from feature_signals import FS, noise
from numpy.lib.stride_tricks import sliding_window_view
from scipy import fft

from texclass.features.cepstrum import mel_filters, mfcc, mfcc_deviation, use_filter_banks
from texclass.features.phase_view import PhaseView


def movement(n=30_000, seed=0):
    return np.convolve(noise(n, seed), np.hanning(15), "same") * (1 + 0.5 * np.sin(np.arange(n) / 900))


VIEW = PhaseView(movement(), FS)


def test_mfcc_equals_coefficients_2_to_14_of_librosa():
    frames = sliding_window_view(VIEW.samples, 250)[::150] * np.hamming(251)[:-1]
    bank = librosa.filters.mel(sr=FS, n_fft=256, n_mels=20, fmin=0, fmax=1400, dtype=np.float64)
    edges = librosa.mel_frequencies(22, fmin=0, fmax=1400)
    bank *= (edges[2:] - edges[:-2])[
        :, np.newaxis
    ] / 2  # peaks of 1; norm=None compiles for half a minute first
    energies = bank @ (np.abs(np.fft.rfft(frames, 256)) ** 2).T
    expected = fft.dct(np.log(energies), axis=0, norm="ortho").T[:, 1:14]
    np.testing.assert_allclose(mfcc(VIEW), expected.mean(axis=0), atol=2e-5)
    np.testing.assert_allclose(mfcc_deviation(VIEW), expected.std(axis=0), atol=2e-5)
    np.testing.assert_array_equal(mfcc(VIEW, coefficients=(2, 5, 12)), mfcc(VIEW)[[1, 4, 11]])


def test_decay_per_bin_is_almost_a_constant_offset():
    f = np.linspace(0, FS / 2, 129)
    constant, decaying = (mel_filters(FS, 256, 20, 0.0, 1400.0, d) for d in (np.inf, 500.0))
    np.testing.assert_allclose(decaying, constant * np.exp(-f / 500)[:, np.newaxis], rtol=1e-6)
    views = [PhaseView(movement(seed=s), FS) for s in range(4)]
    offsets = np.array([mfcc(v, decay_hz=500.0) - mfcc(v) for v in views])
    assert np.abs(offsets.mean(axis=0)[0]) > 1
    assert offsets.std(axis=0).max() < 0.02


def test_an_amplitude_per_filter_adds_a_constant_to_each_coefficient():
    key = (FS, 256, 20, 0.0, 1400.0)
    amplitudes = np.exp(-np.arange(20) / 4.0).astype(np.float32)  # 41 dB from the first filter to the last
    decreasing = {(*key, np.inf): mel_filters(*key, np.inf) * amplitudes}
    constant = fft.dct(np.log(amplitudes.astype(float)), norm="ortho")[1:14]
    for seed in range(4):
        view = PhaseView((seed + 1) * movement(seed=seed), FS)
        with use_filter_banks(dict(decreasing)):
            with_amplitudes = mfcc(view), mfcc_deviation(view)
        fresh = PhaseView(view.samples, FS)
        np.testing.assert_allclose(with_amplitudes[0] - mfcc(fresh), constant, atol=1e-4)
        np.testing.assert_allclose(with_amplitudes[1], mfcc_deviation(fresh), atol=1e-4)


def test_frames_are_independent_and_silent_frames_are_skipped():
    quiet, loud = 1e-6 * movement(seed=1)[:250], 1e3 * movement(seed=2)[:250]
    quiet_then_loud = np.concatenate([quiet, np.zeros(200), loud])  # frames start every 150: 0, 150, 300, 450
    alone = mfcc(PhaseView(quiet, FS)) + mfcc(PhaseView(loud, FS))
    np.testing.assert_allclose(2 * mfcc(PhaseView(quiet_then_loud, FS), hop_s=0.045), alone, rtol=2e-5)
    padded, aligned = (PhaseView(np.append(VIEW.samples[:3000], np.zeros(n)), FS) for n in (6000, 250))
    np.testing.assert_allclose(mfcc(padded), mfcc(aligned), rtol=1e-5)


def test_band_ends_at_half_a_low_sampling_rate():
    slow = PhaseView(movement(), 2200.0)
    np.testing.assert_array_equal(mfcc(slow), mfcc(slow, high_hz=1100.0))
