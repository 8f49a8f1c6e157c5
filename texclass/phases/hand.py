"""What the hand does before a tap, and single taps that were cut out of a longer recording."""

import numpy as np
from scipy import ndimage

from texclass.phases.vibration_track import block_mean
from texclass.recording import Recording, Samples, Tap

HAND_RATE_HZ = 500.0
"""Rate at which the hand's motion is followed."""
STILL = 0.2
"""Share of its greatest deviation below which the hand has not begun to accelerate."""


def hand_start(axes: Samples, fs: float) -> int:
    """Return the sample from which the hand accelerates towards an impact right after the last sample.

    Parameters
    ----------
    axes : ndarray of shape (n_samples, n_channels)
        What was felt before the impact, from the earliest time at which the hand can have begun.
    fs : float
        Sampling rate in Hz.
    """
    step = max(1, round(fs / HAND_RATE_HZ))
    before = block_mean(axes[: len(axes) // step * step], step)
    if len(before) < 3:
        return 0
    before = ndimage.uniform_filter1d(before, round(0.02 * fs / step), axis=0, mode="nearest")
    half, ordered = len(before) // 2, np.sort(before, axis=0)
    before -= (ordered[(len(before) - 1) // 2] + ordered[half]) / 2
    deviation = np.einsum("ij,ij->i", before, before)
    peak = half + int(deviation[half:].argmax())
    (still,) = np.nonzero(deviation[:peak] < STILL**2 * deviation[peak])
    return min(len(axes), (int(still[-1]) + 1 if len(still) else 0) * step)


def lone_tap(recording: Recording) -> Tap | None:
    """Return the tap of a short recording that starts at rest, or starts in the contact and ends at rest."""
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
