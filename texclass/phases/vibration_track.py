"""How strongly the tool vibrates over time against the noise, and when it keeps vibrating."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from texclass.recording import Recording, Samples
from texclass.signals import butterworth, causal

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
BLOCK = 1 << 19
"""Rows filtered at a time, about (4 MB a channel): from its state on, a filter does the same as at once."""


@dataclass(frozen=True, eq=False)
class Filtered:
    """Channels averaged down and filtered forwards, so that nothing rings before an impact.

    Attributes
    ----------
    axes : ndarray of shape (n_samples, n_channels)
        What is filtered.
    steps : tuple of int
        Factors by which it is averaged down first, one after the other.
    sos : ndarray of shape (n_sections, 6)
        The filter.
    n_rest : int
        The filter is at rest on the mean of so many rows at the start.
    size : int
        Rows of a block.
    """

    axes: Samples
    steps: tuple[int, ...]
    sos: Samples
    n_rest: int
    size: int = BLOCK
    _states: list[Samples] = field(default_factory=list, repr=False)
    _newest: dict[int, Samples] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        n = len(self.axes)
        for step in self.steps:
            n = -(-n // step)
        return n

    def power(self, per: int) -> Samples:
        """Return the mean square of every `per` rows, summed over channels; `per` divides `size`."""
        mean, n = np.empty(-(-len(self) // per)), self.size // per
        for k, rows in enumerate(self._blocks()):
            mean[k * n : (k + 1) * n] = block_mean(np.einsum("ij,ij->i", rows, rows), per)
        return mean

    def between(self, first: int, stop: int) -> Samples:
        """Return the filtered rows [first, stop), as far as there are any."""
        start = max(0, first) // self.size
        found = [self._block(k) for k in range(start, -(-min(stop, len(self)) // self.size))]
        rows = found[0] if len(found) == 1 else np.concatenate([self._rows(0, 0), *found])
        return rows[max(0, first) - start * self.size : max(0, stop - start * self.size)]

    def correlation(self, lag: int) -> float:
        """Return the mean over rows of what a row and the one `lag` (0 or 1) later have in common."""
        total, before = 0.0, self._rows(0, 0)
        for block in self._blocks():
            rows = np.concatenate([before, block])
            total += float(np.einsum("ij,ij->i", rows[lag:], rows[: len(rows) - lag]).sum())
            before = block[len(block) - lag :]
        return total / max(1, len(self) - lag)

    def _blocks(self) -> Iterator[Samples]:
        return (self._block(k) for k in range(-(-len(self) // self.size)))

    def _block(self, k: int) -> Samples:
        """Return block k; the states at the starts of all blocks before it are found first."""
        while k not in self._newest:
            i = min(k, len(self._states))
            state = self._states[i - 1] if i else np.zeros((len(self.sos), 2, self.axes.shape[1]))
            rest = self._rows(0, self.n_rest).mean(axis=0)
            block, after = causal(self.sos, self._rows(i * self.size, (i + 1) * self.size) - rest, state)
            if i == len(self._states) and after is not None:
                self._states.append(after)
            self._newest.clear()
            self._newest[i] = block
        return self._newest[k]

    def _rows(self, first: int, stop: int) -> Samples:
        step = int(np.prod(self.steps))
        rows = self.axes[first * step : stop * step]
        for each in self.steps:
            rows = block_mean(rows, each)
        return rows


def block_mean(x: Samples, size: int) -> Samples:
    """Mean of blocks of `size` rows; an incomplete last block is averaged over what it holds."""
    if size == 1:
        return x
    whole = len(x) // size * size
    blocks = x[:whole].reshape(-1, size, *x.shape[1:]).mean(axis=1)
    rest = x[whole:]
    return np.concatenate([blocks, rest.mean(axis=0)[np.newaxis]]) if len(rest) else blocks


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
    # mean square error of the converter's rounding, from its smallest step
    steps = np.abs(np.diff(axes[:50_000], axis=0))
    rounding = sum(float(s[s > 0].min()) ** 2 / 12 for s in steps.T if (s > 0).any())
    noise = max(noise, rounding, _DEAD * float(level.max()))
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
