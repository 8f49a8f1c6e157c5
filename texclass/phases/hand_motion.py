"""Locate the acceleration of the hand before a tap, and single taps cut out of a longer recording."""

import numpy as np
from scipy import ndimage

from texclass.phases.impulses import bin_means
from texclass.recording import Recording, Samples, Tap


def find_hand_start(axes: Samples, fs: float) -> int:
    """Return the sample from which the hand accelerates towards an impact right after the last sample.

    Parameters
    ----------
    axes : ndarray of shape (n_samples, n_channels)
        Acceleration before the impact, from the earliest time at which the hand can have started.
    fs : float
        Sampling rate in Hz.
    """
    step = max(1, round(fs / 500))  # the hand moves below 250 Hz
    before = bin_means(axes[: len(axes) // step * step].T, step).T
    if len(before) < 3:
        return 0
    before = ndimage.uniform_filter1d(before, round(0.02 * fs / step), axis=0, mode="nearest")
    before -= np.median(before, axis=0)
    deviation = np.einsum("ij,ij->i", before, before)
    half = len(before) // 2
    peak = half + int(deviation[half:].argmax())
    still = np.flatnonzero(deviation[:peak] < 0.2**2 * deviation[peak])  # 20 % of the largest deviation
    return min(len(axes), (int(still[-1]) + 1 if len(still) else 0) * step)


def find_single_tap(recording: Recording) -> Tap | None:
    """Return the tap of a short recording that starts or ends at rest; None if it does neither."""
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    n_start, n_end = max(3, len(axes) // 50), len(axes) // 10
    if n_end < 3:
        return None
    for part in (slice(n_start), slice(-n_end, None)):
        away = axes - np.median(axes[part], axis=0)
        power = np.einsum("ij,ij->i", away, away)
        if power[part].max() < 3e-3 * power.max():  # at rest: 25 dB below the greatest distance from it
            loud = np.flatnonzero(power > 4e-3 * power.max())
            return Tap(int(loud[0]), int(loud[0]), int(loud[-1]) + 1)
    return None
