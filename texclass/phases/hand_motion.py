"""Detection of hand motion before a tap, and of recordings that contain a single tap."""

import numpy as np
from scipy import ndimage

from texclass.phases.impulses import bin_means
from texclass.recording import Recording, Samples, Tap


def find_hand_start(axes: Samples, fs: float) -> int:
    """Return the sample at which the hand starts to accelerate towards the impact.

    The impact follows the last sample.

    Parameters
    ----------
    axes : ndarray of shape (n_samples, n_channels)
        Acceleration before the impact, starting at the earliest possible start of the hand motion.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    int
        Index of the sample, or the number of samples if the hand does not move.

    Examples
    --------
    >>> t = np.arange(2500) / 10_000
    >>> pull = 1.5 * np.clip((t - 0.15) / 0.1, 0.0, 1.0)  # the hand moves from 0.15 s to the impact at 0.25 s
    >>> 1400 < find_hand_start(pull[:, np.newaxis], fs=10_000) < 2000
    True
    """
    step = max(1, round(fs / 500))  # the hand moves below 250 Hz
    slow = bin_means(axes[: len(axes) // step * step].T, step).T
    if len(slow) < 3:
        return 0
    slow = ndimage.uniform_filter1d(slow, round(0.02 * fs / step), axis=0, mode="nearest")
    slow -= np.median(slow, axis=0)
    deviation = np.einsum("ij,ij->i", slow, slow)
    half = len(slow) // 2
    peak = half + int(deviation[half:].argmax())
    at_rest = np.flatnonzero(deviation[:peak] < 0.2**2 * deviation[peak])  # 20 % of the largest deviation
    return min(len(axes), (int(at_rest[-1]) + 1 if len(at_rest) else 0) * step)


def find_single_tap(recording: Recording) -> Tap | None:
    """Return the tap of a short recording, or None if the recording neither starts nor ends at rest."""
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    n_start, n_end = max(3, len(axes) // 50), len(axes) // 10
    if n_end < 3:
        return None
    for rest in (slice(n_start), slice(-n_end, None)):
        deviation = axes - np.median(axes[rest], axis=0)
        power = np.einsum("ij,ij->i", deviation, deviation)
        if power[rest].max() < 3e-3 * power.max():  # at rest: 25 dB below the largest deviation
            loud = np.flatnonzero(power > 4e-3 * power.max())
            return Tap(int(loud[0]), int(loud[0]), int(loud[-1]) + 1)
    return None
