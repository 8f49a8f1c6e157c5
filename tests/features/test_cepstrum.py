import math

import numpy as np
import pytest

from texclass.features.cepstrum import mel_filters, mfcc, mfcc_deviation
from texclass.features.contract import UndefinedFeatureError, find
from texclass.features.phase_view import PhaseView
from texclass.recording import Samples

FS = 10_000.0


def movement(n: int = 30_000, seed: int = 0) -> Samples:
    x = np.convolve(np.random.default_rng(seed).standard_normal(n), np.hanning(15), "same")
    return x * (1 + 0.5 * np.sin(np.arange(n) / 900))


def librosa_cepstra(x: Samples) -> Samples:
    import librosa

    frames = librosa.util.frame(x, frame_length=250, hop_length=150, axis=0) * np.hamming(251)[:-1]
    power = np.abs(np.fft.rfft(frames, 256)) ** 2
    bank = librosa.filters.mel(sr=FS, n_fft=256, n_mels=20, fmin=0, fmax=1400, norm=None, dtype=np.float64)
    return librosa.feature.mfcc(S=np.log(bank @ power.T), n_mfcc=14, dct_type=2, norm="ortho").T[:, 1:]


def test_mfcc_agrees_with_librosa_and_keeps_numbers_2_to_14() -> None:
    x = movement()
    expected = librosa_cepstra(x)
    np.testing.assert_allclose(mfcc(PhaseView(x, FS)), expected.mean(axis=0), atol=2e-5)
    np.testing.assert_allclose(mfcc_deviation(PhaseView(x, FS)), expected.std(axis=0), atol=2e-5)


def test_subset_of_the_paper_is_named_by_its_numbers() -> None:
    view, numbers = PhaseView(movement(), FS), (2, 5, 6, 8, 12)
    np.testing.assert_array_equal(mfcc(view, coefficients=numbers), mfcc(view)[[1, 4, 5, 7, 11]])
    assert find("mfcc").columns("m", {"coefficients": numbers}) == ("m.c2", "m.c5", "m.c6", "m.c8", "m.c12")


def test_decaying_amplitudes_differ_from_constant_ones_by_nearly_a_constant() -> None:
    views = [PhaseView(movement(seed=s), FS) for s in range(4)]
    offsets = np.array([mfcc(v, decay_hz=500.0) - mfcc(v) for v in views])
    assert np.abs(offsets.mean(axis=0)[0]) > 1
    assert offsets.std(axis=0).max() < 0.02


def test_decay_acts_on_every_bin() -> None:
    constant, decaying = (mel_filters(FS, 256, 20, 0.0, 1400.0, d) for d in (math.inf, 500.0))
    f = np.linspace(0, FS / 2, 129)
    np.testing.assert_allclose(decaying, constant * np.exp(-f / 500)[:, np.newaxis], rtol=1e-6)


def test_a_frame_does_not_depend_on_other_frames() -> None:
    quiet, loud = 1e-6 * movement(seed=1)[:250], 1e3 * movement(seed=2)[:250]
    both = np.concatenate([quiet, np.zeros(200), loud])  # frames start every 150: 0, 150, 300, 450
    alone = mfcc(PhaseView(quiet, FS))
    with_loud = mfcc(PhaseView(both, FS), hop_s=0.045)
    np.testing.assert_allclose(2 * with_loud, alone + mfcc(PhaseView(loud, FS)), rtol=2e-5)


def test_silent_frames_are_left_out() -> None:
    x = movement()
    padded = np.concatenate([x[:3000], np.zeros(6000)])
    aligned = np.concatenate([x[:3000], np.zeros(250)])
    np.testing.assert_allclose(mfcc(PhaseView(padded, FS)), mfcc(PhaseView(aligned, FS)), rtol=1e-5)


def test_a_filter_without_a_bin_is_named() -> None:
    with pytest.raises(UndefinedFeatureError, match=r"mel filter 1 .* holds no bin"):
        mfcc(PhaseView(movement(), FS), n_filters=80)


def test_band_ends_at_half_a_low_rate() -> None:
    view = PhaseView(movement(), 2200.0)
    np.testing.assert_array_equal(mfcc(view), mfcc(view, high_hz=1100.0))


def test_a_coefficient_beyond_the_filters_is_refused() -> None:
    with pytest.raises(UndefinedFeatureError, match=r"coefficient 20; the rule is 1 \.\.\. 19"):
        mfcc(PhaseView(movement(), FS), coefficients=(1, 20))
