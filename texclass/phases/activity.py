"""How strongly the tool vibrates over time against the noise, and when it keeps vibrating."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from texclass.filters import butterworth
from texclass.phases.filtered import BLOCK, Filtered, block_mean
from texclass.recording import Recording, Samples

TRACK_RATE_HZ = 10_000.0
"""Faster recordings are averaged down to about this rate before they are searched."""
SOFT_BAND_HZ = (30.0, 300.0)
"""Where soft contacts ring: searched by itself, so that noise above it does not drown them."""
SOFT_MARGIN = 3.0
"""The hand's unrest reaches into the soft band and varies: typical over quietest power."""
SOFT_SHARE = 0.2
"""Least noise of the soft band, relative to all noise: the hand's unrest is no vibration."""
UNREST = 1.4
"""Power over noise that the hand's unrest, felt in the soft band alone, does not reach."""
LEAST_SAMPLES = 20
"""Samples without which a level is too uncertain to call vibration."""
ALIKE = 2.5
"""Power ratio up to which the fifths of a stretch are alike, and the stretch is steady."""
_DEAD = 1e-14
"""Power below this share of the strongest is rounding."""


@dataclass(frozen=True, eq=False)
class Track:
    """The vibration of one recording over time.

    Attributes
    ----------
    ratio : ndarray of shape (n_bins,)
        Power of the vibration over the power of the noise.
    soft : ndarray of shape (n_bins,)
        The same in the band in which soft contacts ring; equal to `ratio` where that band is not to be had.
    strokes : ndarray of shape (n_bins,)
        The greater of both where all bands together stand out a little, so that it is not the hand's unrest.
    vibration : Filtered
        Acceleration above the hand's own motion, `step` samples of the recording a row.
    noise : float
        Mean square vibration in the quietest stretch, summed over channels.
    steady : bool
        Whether the quietest stretch is steady enough to be called quiet.
    step, bin_size : int
        Samples a row, rows a bin.
    fs : float
        Sampling rate of the recording in Hz.
    """

    ratio: Samples
    soft: Samples
    strokes: Samples
    vibration: Filtered
    noise: float
    steady: bool
    step: int
    bin_size: int
    fs: float

    @property
    def bin_samples(self) -> int:
        """Samples of the recording a bin."""
        return self.bin_size * self.step

    def n_bins(self, seconds: float) -> int:
        """Return how many bins come nearest to `seconds`, at least one."""
        return max(1, round(seconds * self.fs / self.bin_samples))

    def impulses(self, seconds: float) -> Samples:
        """Return the greater of both ratios, as a centred mean over about `seconds`."""
        return smooth(np.maximum(self.ratio, self.soft), self.n_bins(seconds))


def track(recording: Recording, *, hand_hz: float, bin_s: float, quiet_s: float) -> Track:
    """Remove gravity, tremor and the hand's motion, and compare what is left with the noise."""
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    step = max(1, int(recording.fs // TRACK_RATE_HZ))
    rate = recording.fs / step
    n_rows, bin_size = -(-len(axes) // step), max(1, round(bin_s * rate))
    n_quiet = max(1, min(round(quiet_s * rate / bin_size), n_rows // (16 * bin_size)))
    sos = butterworth("highpass", min(hand_hz, 0.2 * rate), rate)
    vibration = Filtered(axes, (step,), sos, _n_rest(rate), BLOCK // bin_size * bin_size)
    level = vibration.power(bin_size)
    noise, steady = _quietest(level, n_quiet)
    noise = max(noise, _rounding(axes), _DEAD * float(level.max()))
    ratio = np.divide(level, noise, out=level) if noise > 0 else np.zeros_like(level)
    in_soft_band = strokes = ratio
    if rate > 6 * SOFT_BAND_HZ[1] and noise > 0:
        soft = _soft_level(axes, step, rate, bin_size)
        quiet = _quietest(soft, n_quiet)[0]
        soft /= max(SOFT_MARGIN * quiet, SOFT_SHARE * noise, _DEAD * float(soft.max()))
        felt = smooth(ratio, max(1, round(0.02 * rate / bin_size))) > UNREST
        in_soft_band, strokes = soft, ratio.copy()
        np.maximum(ratio, 0.5 * soft, out=strokes, where=felt)
    return Track(ratio, in_soft_band, strokes, vibration, noise, steady, step, bin_size, recording.fs)


def smooth(level: Samples, n: int) -> Samples:
    """Centred mean over `n` bins, the ends repeated; not below zero (rounding)."""
    mean = _running_mean(level, n)
    return np.asarray(np.maximum(mean, 0.0, out=mean))


def _running_mean(level: Samples, n: int) -> Samples:
    """Centred mean over `n` bins, the ends repeated; in blocks, for scipy buffers all that it is given."""
    mean = np.empty_like(level)
    for k in range(0, len(level), BLOCK):
        first = max(0, k - n)
        near = ndimage.uniform_filter1d(level[first : k + BLOCK + n], n, mode="nearest")
        mean[k : k + BLOCK] = near[k - first : k - first + BLOCK]
    return mean


def sustained_span(
    found: Track, *, ratio: float, window_s: float, share: float, gap_s: float
) -> tuple[int, int] | None:
    """Return the bins [first, last) between which the tool keeps vibrating, pauses included; None if never.

    It does where at least `share` of a window exceeds `ratio`: isolated impulses leave most of a window
    quiet, however strong they are. The ends are then moved to the outermost vibration that hangs
    together with them (gaps below `gap_s`).
    """
    coarse = found.n_bins(max(0.005, LEAST_SAMPLES / found.fs))
    level = block_mean(found.strokes, coarse)
    window = max(1, round(found.n_bins(window_s) / coarse))
    low = ndimage.percentile_filter(level, 100.0 * (1.0 - share), size=window, mode="constant")
    (steady,) = np.nonzero(low > ratio)
    if not len(steady):
        return None
    active = smooth(level, 3) > ratio
    gap = max(1, round(found.n_bins(gap_s) / coarse))
    first = len(active) - 1 - _outermost(active[::-1], len(active) - 1 - int(steady[0]), gap)
    last = _outermost(active, int(steady[-1]), gap)
    return first * coarse, min((last + 1) * coarse, len(found.ratio))


def _outermost(active: NDArray[np.bool_], start: int, gap: int) -> int:
    """Follow `active` forwards from `start` to its last true element before a gap of `gap` elements."""
    (where,) = np.nonzero(active[start:])
    if not len(where):
        return start
    (breaks,) = np.nonzero(np.diff(where) > gap)
    return start + int(where[breaks[0]] if len(breaks) else where[-1])


def _soft_level(axes: Samples, step: int, rate: float, bin_size: int) -> Samples:
    """Level in the soft band, from rows averaged down, looked up at the centres of the bins."""
    inner = max(1, bin_size // 2)
    sos = butterworth("bandpass", SOFT_BAND_HZ, rate / inner, order=2)
    power = Filtered(axes, (step, inner), sos, _n_rest(rate / inner)).power(1)
    power = smooth(power, max(1, bin_size // inner))
    soft = np.empty(-(-len(axes) // (step * bin_size)))
    for k in range(0, len(soft), BLOCK):  # all centres at once would take the memory of a level
        centres = (np.arange(k, min(k + BLOCK, len(soft))) * bin_size + bin_size // 2) // inner
        soft[k : k + BLOCK] = power[np.minimum(centres, len(power) - 1)]
    return soft


def _n_rest(rate: float) -> int:
    """Rows of the first 20 ms."""
    return max(1, round(0.02 * rate))


def _quietest(level: Samples, n: int) -> tuple[float, bool]:
    """Level of the quietest stretch of `n` bins, and whether its fifths are alike."""
    n = min(n, len(level))
    means = _running_mean(level, n)[n // 2 : len(level) - (n - 1) // 2]
    stretch = level[int(np.argmin(means)) :][:n]
    fifths = [float(part.mean()) for part in np.array_split(stretch, min(5, n))]
    return float(stretch.mean()), max(fifths) <= ALIKE * min(fifths)


def _rounding(axes: Samples) -> float:
    """Mean square error of the converter's rounding, from its smallest step, summed over channels."""
    steps = np.abs(np.diff(axes[:50_000], axis=0))
    return sum(float(s[s > 0].min()) ** 2 / 12 for s in steps.T if (s > 0).any())
