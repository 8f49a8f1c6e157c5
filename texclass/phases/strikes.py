"""Where a tap begins, strikes and has died away."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal

from texclass.phases.vibration_track import Track, block_mean
from texclass.recording import Recording, Samples, Tap

SMOOTHING_S = 0.003
"""Length over which the level is averaged before its peaks are searched."""
LOOK_BACK_S = 0.03
"""Longest rise of an impact: a soft contact's half period."""
LEAST_PUSH = 0.08
"""Change of velocity of a weak tap, relative to that of the strongest."""
CLEAR = 12.0
"""Ratio to its mean that a single sample of noise does not reach."""
HAND_RATE_HZ = 500.0
"""Rate at which the hand's motion is followed."""


@dataclass(frozen=True)
class Strike:
    """Impact and end of the decay, in bins of a track, and the peak power of the vibration in dB."""

    impact: int
    end: int
    power_db: float


def find_strikes(
    found: Track, first: int, last: int, *, ratio: float, end_ratio: float, spacing_s: float
) -> list[Strike]:
    """Return the isolated impulses among the bins [first, last).

    An impulse rises `ratio` times above the noise and is the strongest within `spacing_s` (what is nearer is
    its echo or a rebound).
    """
    level = found.impulses(SMOOTHING_S)[first:last]
    padded = 10.0 * np.log10(np.maximum(np.pad(level, 1), 1.0))
    peaks, _ = signal.find_peaks(
        padded, height=10.0 * np.log10(ratio), prominence=10.0, distance=found.n_bins(spacing_s)
    )
    strikes: list[Strike] = []
    limit = len(level)
    for peak in (int(p) - 1 for p in reversed(peaks)):
        # back to the first bin that is above the noise and within 20 dB of the peak; on to where the level
        # has come down to the noise, or to 30 dB below the peak
        start = max(0, peak - found.n_bins(LOOK_BACK_S))
        (below,) = np.nonzero(level[start:peak] < max(end_ratio, 1e-2 * level[peak]))
        impact = start + (int(below[-1]) + 1 if len(below) else 0)
        (below,) = np.nonzero(level[peak:limit] < max(end_ratio, 1e-3 * level[peak]))
        end = peak + int(below[0]) if len(below) else limit
        around = (first + peak - found.n_bins(0.01), first + peak + found.n_bins(0.01))
        near = found.vibration.between(around[0] * found.bin_size, around[1] * found.bin_size)
        power = max(np.einsum("ij,ij->i", near, near).max(), 1e-300)
        strikes.append(Strike(first + impact, first + end, 10.0 * float(np.log10(power))))
        limit = impact
    return strikes[::-1]


def only_taps(
    strikes: list[Strike], hand: "Hand", found: Track, *, range_db: float, sure_db: float
) -> list[Strike]:
    """Leave out the impulses of a tool that is lifted or set down.

    Down to `sure_db` below the strongest impulse, all are taps. Weaker ones, down to `range_db`, are if they
    push against the hand and stop the tool: their change of velocity is not small beside that of the others.
    """
    strongest = max((strike.power_db for strike in strikes), default=0.0)
    pushes = [hand.push(strike.impact * found.bin_samples) for strike in strikes]
    greatest = max((abs(push) for push in pushes), default=0.0)
    return [
        strike
        for strike, push in zip(strikes, pushes, strict=True)
        if strike.power_db >= strongest - sure_db
        or (strike.power_db >= strongest - range_db and push >= LEAST_PUSH * greatest)
    ]


def impact_sample(found: Track, strike: Strike) -> int:
    """Return the sample at which the vibration leaves the noise, near the bin of the impact."""
    margin = found.n_bins(SMOOTHING_S)
    start = max(0, strike.impact - margin) * found.bin_size
    near = found.vibration.between(start, (strike.impact + 2 * margin) * found.bin_size)
    power = np.einsum("ij,ij->i", near, near)
    least = max(CLEAR * found.noise, 1e-3 * float(power.max()))
    if power.max() < 2.0 * least:
        return strike.impact * found.bin_samples
    return (start + int(np.argmax(power >= least))) * found.step


@dataclass(frozen=True, eq=False)
class Hand:
    """The hand's own motion: acceleration averaged over 2 ms.

    Attributes
    ----------
    acceleration : ndarray of shape (n, n_channels)
        Averaged over `step` samples.
    rate : float
        In Hz.
    step : int
        Samples of the recording a row.
    """

    acceleration: Samples
    rate: float
    step: int

    def push(self, impact: int) -> float:
        """Return the mean acceleration after the impact, negative if it goes on the way the hand accelerated.

        A tap pushes against the hand's acceleration towards the surface; a lifted tool follows it.
        """
        at = impact // self.step
        before = self._mean(at, -0.07, -0.006) - self._mean(at, -0.25, -0.15)
        after = self._mean(at, 0.0, 0.012) - self._mean(at, -0.012, -0.004)
        return float(np.linalg.norm(after)) * (-1.0 if np.dot(before, after) > 0 else 1.0)

    def start(self, earliest: int, impact: int) -> int:
        """Return the sample from which the hand accelerates towards the `impact`."""
        first, last = earliest // self.step, (impact - 1) // self.step
        before = (
            ndimage.uniform_filter1d(
                self.acceleration[first:last], round(0.02 * self.rate), axis=0, mode="nearest"
            )
            if last - first >= 3
            else np.zeros((0, 1))
        )
        if not len(before):
            return min(earliest, impact)
        deviation = np.linalg.norm(before - np.median(before, axis=0), axis=1)
        half = len(before) // 2
        peak = half + int(np.argmax(deviation[half:]))
        (still,) = np.nonzero(deviation[:peak] < 0.2 * deviation[peak])
        return min(impact, (first + (int(still[-1]) + 1 if len(still) else 0)) * self.step)

    def _mean(self, at: int, start_s: float, stop_s: float) -> Samples:
        first = max(0, at + round(start_s * self.rate))
        stop = max(first + 1, at + round(stop_s * self.rate))
        return (
            np.asarray(self.acceleration[first:stop].mean(axis=0))
            if first < len(self.acceleration)
            else np.zeros(self.acceleration.shape[1])
        )


def follow_hand(recording: Recording) -> Hand:
    """Follow the hand through the recording."""
    step = max(1, round(recording.fs / HAND_RATE_HZ))
    rate = recording.fs / step
    rows = block_mean(recording.acceleration.reshape(recording.n_samples, -1), step)
    return Hand(rows, rate, step)


def lone_tap(recording: Recording) -> Tap | None:
    """Return the tap of a short recording that starts at rest, or starts in the contact and ends at rest."""
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    n_start, n_end = max(3, len(axes) // 50), len(axes) // 10
    if n_end < 3:
        return None
    starts, start = _at_rest(axes[:n_start], axes)
    ends, end = _at_rest(axes[-n_end:], axes)
    if not (starts or ends):
        return None
    power = ((axes - (start if starts else end)) ** 2).sum(axis=1)
    loud = np.flatnonzero(power > 4e-3 * power.max())
    return Tap(int(loud[0]), int(loud[0]), int(loud[-1]) + 1)


def _at_rest(part: Samples, whole: Samples) -> tuple[bool, Samples]:
    """Whether `part` stays 25 dB below the greatest distance from it, and its median."""
    median = np.median(part, axis=0)
    peak = float(((whole - median) ** 2).sum(axis=1).max())
    return peak > 0.0 and float(((part - median) ** 2).sum(axis=1).max()) < 3e-3 * peak, median
