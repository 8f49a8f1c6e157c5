"""How strongly the tool vibrates over time against the noise, and when it keeps vibrating."""

import functools
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from texclass.phases.defects import BLOCK, LONGEST_FADE_S, Data, fade, find_data, find_glitches, mended
from texclass.phases.impulses import CALM_S, Levels, mean_over, quantiles
from texclass.recording import Recording, Samples
from texclass.signals import STEPS, butterworth, causal

TRACK_RATE_HZ = 10_000.0
"""Faster recordings are averaged down to about this rate before they are searched."""
SOFT_BAND_HZ = (30.0, 150.0)
"""Where soft contacts push and ring: searched by itself, so that noise above it does not drown them."""
SOFT_S = 0.008
"""Its level is averaged over this: about the time in which it can change."""
SOFT_MARGIN = 3.0
"""The hand's unrest reaches into the soft band and varies."""
SURPRISE = 2.8
"""How many times the distance (in dB) from the median to the 90 % quantile noise exceeds the median once in
100,000 bins; so it is for chi-squared powers of 5 to 20 degrees of freedom (2.5 to 2.9)."""
CLEAR = 50.0
"""Ratio that stands for what is clear in the soft band: a little more than that of a tap."""
UNREST = 1.4
"""Power over noise that the hand's unrest, felt in the soft band alone, does not reach."""
KEPT = 16
"""So many filtered blocks are kept, for taps are looked at again."""
LEAST_SAMPLES = 20
"""Samples without which a level is too uncertain to call vibration."""
ALIKE, ALIKE_SAMPLES = 2.5, 60.0
"""Power ratio up to which the fifths of a stretch are alike, so that it is steady; more of few samples."""
MOST_CHANCE, MOST_UNREST, FAR = 1.6, 6.0, 1000.0
"""Power of all rest over that of its quietest stretch: by chance, and with vibration `FAR` above it, so that
noise that comes and goes (a room, other machines) is no stroke."""
VARYING = 0.75
"""Where it does, vibration that lasts must stand so much further above it."""
_DEAD = 1e-14
"""Power below this share of the strongest is rounding."""


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
    data : Data
        What a sensor felt; the filter is at rest on what stands before it.
    glitches : ndarray of int
        Samples that are replaced by the mean of their neighbours.
    size : int
        Rows of a block: from its state on, a filter does the same as at once.
    """

    axes: Samples
    steps: tuple[int, ...]
    sos: Samples
    data: Data
    glitches: NDArray[np.intp]
    size: int = BLOCK
    _states: list[Samples] = field(default_factory=list, repr=False)
    _newest: dict[int, Samples] = field(default_factory=dict, repr=False)

    @functools.cached_property
    def _moved(self) -> Samples:
        """Room for a block, channel by channel, as a filter takes it."""
        return np.empty((self.axes.shape[1], min(self.size, len(self))))

    def __len__(self) -> int:
        n = len(self.axes)
        for step in self.steps:
            n = -(-n // step)
        return n

    def power(self, per: int) -> Samples:
        """Return the mean square of every `per` rows, summed over channels; `per` divides `size`."""
        mean, n = np.empty(-(-len(self) // per)), self.size // per
        for k, rows in enumerate(self._blocks()):
            mean[k * n : (k + 1) * n] = block_mean(np.einsum("ij,ij->j", rows.T, rows.T), per)
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
            rows = self._rows(i * self.size, (i + 1) * self.size)
            moved = self._moved[:, : len(rows)].T
            for channel, level in enumerate(self.data.rest):
                np.subtract(rows[:, channel], level, out=moved[:, channel])
            block, after = causal(self.sos, moved, state)
            if i == len(self._states) and after is not None:
                self._states.append(after)
            if len(self._newest) == KEPT:
                self._newest.clear()
            self._newest[i] = block
        return self._newest[k]

    def _rows(self, first: int, stop: int) -> Samples:
        step = int(np.prod(self.steps))
        start = first * step
        rows = self.axes[start : stop * step]
        inside = self.glitches[(self.glitches >= start) & (self.glitches < start + len(rows))] - start
        if len(inside) or start < self.data.first:
            rows = mended(rows, inside)
            rows = np.where((np.arange(len(rows)) + start < self.data.first)[:, None], self.data.rest, rows)
        for each in self.steps:
            rows = block_mean(rows, each)
        return rows


def block_mean(x: Samples, size: int) -> Samples:
    """Mean of blocks of `size` rows; an incomplete last block is averaged over what it holds."""
    if size == 1:
        return x
    whole = len(x) // size * size
    blocks = np.einsum("ij...->i...", x[:whole].reshape(-1, size, *x.shape[1:])) / size
    rest = x[whole:]
    return np.concatenate([blocks, rest.mean(axis=0)[np.newaxis]]) if len(rest) else blocks


@dataclass(frozen=True, eq=False)
class Track:
    """The vibration of one recording over time.

    Attributes
    ----------
    levels : Levels
        Against the noise.
    vibration : Filtered
        Acceleration above the hand's own motion, `step` samples of the recording a row.
    noise : float
        Mean square vibration at rest, summed over channels.
    steady : bool
        Whether the quietest stretch is steady enough to be called quiet.
    data, full : tuple of int
        Bins [first, stop) with data; of these, those whose volume is not turned up or down.
    step, bin_size : int
        Samples a row, rows a bin.
    """

    levels: Levels
    vibration: Filtered
    noise: float
    steady: bool
    data: tuple[int, int]
    full: tuple[int, int]
    step: int
    bin_size: int

    @property
    def bin_samples(self) -> int:
        """Samples of the recording a bin."""
        return self.bin_size * self.step

    def samples(self, first: int, stop: int) -> Samples:
        """Return samples [first, stop) without glitches, shape (stop - first, n_channels)."""
        glitches = self.vibration.glitches
        near = glitches[(glitches >= first) & (glitches < stop)] - first
        return mended(self.vibration.axes[first:stop], near)


def track(recording: Recording, *, hand_hz: float, bin_s: float, quiet_s: float) -> Track:
    """Remove gravity, tremor and the hand's motion, and compare what is left with the noise."""
    axes = recording.acceleration.reshape(recording.n_samples, -1)
    step = max(1, int(recording.fs // TRACK_RATE_HZ))
    rate = recording.fs / step
    bin_size = max(1, round(bin_s * rate))
    n_bins, bin_s = -(-len(axes) // (step * bin_size)), bin_size / rate
    felt, glitches = find_data(axes, recording.fs), find_glitches(axes)
    sos = _above_the_hand(hand_hz, rate)
    size = BLOCK // bin_size * bin_size
    size -= size % (STEPS * bin_size) if size > STEPS * bin_size else 0  # whole groups are filtered sooner
    vibration = Filtered(axes, (step,), sos, felt, glitches, size)
    data = -(-felt.first // (step * bin_size)), n_bins
    if felt.stop < len(axes):
        data = data[0], max(data[0], felt.stop // (step * bin_size))
    loud = _only(vibration.power(bin_size), data)
    full = _full(axes[felt.first : felt.stop], loud, data, step * bin_size, bin_s)
    n_quiet = max(1, min(round(quiet_s / bin_s), n_bins // 16))
    usable = slice(*(full if full[1] - full[0] >= n_quiet else (data[0], max(data[1], data[0] + 1))))
    noise, steady, varies = _quietest(loud[usable], n_quiet, bin_size * axes.shape[1])
    noise = max(noise, _DEAD * float(loud.max()))
    some = axes[:1000]
    if not np.ptp(some, axis=0).all() or _rounding(some) > noise:  # of more samples it is less
        noise = max(noise, _rounding(axes[:50_000]))
    found = vibration, noise, steady, data, full, step, bin_size
    least = -(-LEAST_SAMPLES // (step * bin_size))
    if noise == 0:
        nothing = np.zeros_like(loud)
        return Track(Levels(nothing, nothing, nothing, bin_s, least), *found)
    loud /= noise
    soft = Filtered(axes, (step, bin_size), _soft_band(1.0 / bin_s), felt, glitches).power(1)
    levels = _levels(loud, _only(soft, data), usable, bin_s, least)
    return Track(replace(levels, strokes=VARYING * levels.strokes) if varies else levels, *found)


def _levels(loud: Samples, soft: Samples, usable: slice, bin_s: float, least: int) -> Levels:
    """Join what is felt in the soft band, in a unit of its own, to the level of all bands.

    Noise reaches a certain level now and then, the more often the more it is spread. Where the soft band
    surpasses what it reaches once in 100,000 bins, that is an impulse, however weak.
    """
    soft = mean_over(soft, max(1, round(SOFT_S / bin_s)))
    calm = mean_over(loud, max(1, round(CALM_S / bin_s)))
    at_rest = soft[usable][calm[usable] < UNREST]
    if len(at_rest) * bin_s < 0.05:
        return Levels(loud, loud, loud, bin_s, least)
    middle, high = quantiles(at_rest, 0.5, 0.9)
    if middle == 0.0:
        return Levels(loud, loud, loud, bin_s, least)
    surprising = middle * (high / middle) ** SURPRISE
    clear = soft > surprising
    soft /= max(SOFT_MARGIN * middle, _DEAD * float(soft.max()))
    strokes = loud.copy()
    np.maximum(loud, 0.5 * soft, out=strokes, where=calm > UNREST)
    np.maximum(soft, CLEAR, out=soft, where=clear)
    return Levels(loud, np.maximum(loud, soft, out=soft), strokes, bin_s, least)


@functools.cache
def _above_the_hand(hand_hz: float, rate: float) -> Samples:
    return butterworth("highpass", min(hand_hz, 0.2 * rate), rate)


@functools.cache
def _soft_band(rate: float) -> Samples:
    low, high = SOFT_BAND_HZ
    return butterworth("bandpass", (min(low, 0.1 * rate), min(high, 0.4 * rate)), rate, order=2)


def _only(level: Samples, data: tuple[int, int]) -> Samples:
    level[: data[0]] = level[data[1] :] = 0.0
    return level


def _full(axes: Samples, loud: Samples, data: tuple[int, int], size: int, bin_s: float) -> tuple[int, int]:
    """Return the bins of `data` between a volume that is turned up, and one that is turned down.

    A fade is seen in the vibration, or in what gravity leaves of the samples.
    """
    n, bins = round(2 * LONGEST_FADE_S / bin_s) * size, loud[slice(*data)]
    raw = [block_mean(end[:n] ** 2 @ np.ones(axes.shape[1]), size) for end in (axes, axes[::-1])]
    up, down = (max(fade(x, bin_s), fade(y, bin_s)) for x, y in zip(raw, (bins, bins[::-1]), strict=True))
    return data[0] + up, data[1] - down


def _quietest(level: Samples, n: int, per_bin: int) -> tuple[float, bool, bool]:
    """Return the level of rest, whether the quietest stretch of `n` bins is steady, and whether rest varies.

    A stretch is steady if its fifths are alike. Rest is the quietest stretch and, as noise comes and goes,
    what is up to 4 dB above the mean of what is taken for rest so far; but without vibration far above it,
    what comes and goes may be the strokes.
    """
    n = min(n, len(level))
    means = mean_over(level, n)[n // 2 : len(level) - (n - 1) // 2]
    stretch = level[int(np.argmin(means)) :][:n]
    fifths = [float(part.mean()) for part in np.array_split(stretch, min(5, n))]
    steady = max(fifths) <= ALIKE * (1.0 + ALIKE_SAMPLES / (n * per_bin)) * min(fifths)
    rest = quietest = float(stretch.mean())
    some = means[:: max(1, n // 5)]
    most = MOST_UNREST if some.max() > FAR * quietest else MOST_CHANCE
    for _ in range(4):
        alike = some[some <= min(2.5 * rest, most * quietest)]
        rest = max(quietest, float(alike.mean()) if len(alike) else quietest)
    return rest, steady, rest > MOST_CHANCE * quietest


def _rounding(axes: Samples) -> float:
    """Mean square error of the converter's rounding, from its smallest step, summed over channels."""
    steps = np.abs(np.diff(np.ascontiguousarray(axes.T)))
    steps[steps == 0] = np.inf
    smallest = steps.min(axis=1, initial=np.inf)
    return float((smallest[np.isfinite(smallest)] ** 2).sum()) / 12
