"""How strongly the tool vibrates over time against the noise, and when it keeps vibrating."""

import functools
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.phases.defects import GLITCHES, Data, fade, find_data, find_glitches, mended
from texclass.phases.impulses import CALM_S, Levels, mean_over, quantiles
from texclass.recording import Recording, Samples
from texclass.signals import STEPS, butterworth, causal_channels

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
BLOCK = 1 << 15
"""Rows filtered at a time: so many that the calls take little beside the work."""
KEPT = 8
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
SINGLE = 1e-6
"""Single precision filters what is at least this share of the greatest mean of a bin; its rounding, after the
filter, is a tenth of that."""
_DEAD = 1e-14
"""Power below this share of the strongest is rounding."""


@dataclass(frozen=True, eq=False)
class Filtered:
    """Channels averaged down and filtered forwards, so that nothing rings before an impact.

    Attributes
    ----------
    axes : ndarray of shape (n_samples, n_channels)
        What is filtered.
    step, per : int
        Samples that are averaged to a row, and rows a bin.
    sos : ndarray of shape (n_sections, 6)
        The filter.
    data : Data
        What a sensor felt; the filter is at rest on what stands before it.
    glitches : ndarray of int
        Samples that are replaced by the mean of their neighbours.
    kind : {"f", "d"}
        Precision: single or double.
    """

    axes: Samples
    step: int
    per: int
    sos: Samples
    data: Data
    glitches: NDArray[np.intp]
    kind: str = "d"
    _kept: dict[int, Any] = field(default_factory=dict, repr=False)

    @property
    def n_rows(self) -> int:
        """Number of rows; the last may be of fewer samples."""
        return -(-len(self.axes) // self.step)

    @property
    def size(self) -> int:
        """Rows of a block: whole bins and, of both, as many as a filter takes at once."""
        unit = STEPS * self.per
        return max(unit, BLOCK // unit * unit)

    @functools.cached_property
    def _room(self) -> Any:
        """Room for a block, channel by channel, as a filter takes it."""
        n_rows = min(self.size, self.n_rows + STEPS * self.per)
        return np.empty((self.axes.shape[1], n_rows * self.step), self.kind)

    @functools.cached_property
    def _states(self) -> list[Any]:
        """States of the filter before the blocks that were reached so far."""
        return [np.zeros((self.axes.shape[1], 2 * len(self.sos)), self.kind)]

    def levels(self) -> tuple[Samples, Any]:
        """Return the mean square of each bin, summed over channels, and before the filter its mean.

        The mean, of shape (n_channels, n), goes on with zeros so that `STEPS` divides n.
        """
        n_bins, n_channels = -(-self.n_rows // self.per), self.axes.shape[1]
        ones = np.ones(self.per, self.kind)
        power, mean = np.empty(n_bins), np.zeros((n_channels, -(-n_bins // STEPS) * STEPS), self.kind)
        for k in range(-(-self.n_rows // self.size)):
            rows = self._rows(k)
            block = self._block(k, rows)
            squares = np.einsum("ij,ij->j", block, block).reshape(-1, self.per) @ ones
            bins = slice(k * self.size // self.per, (k + 1) * self.size // self.per)
            power[bins] = squares[: n_bins - bins.start]
            mean[:, bins] = (rows.reshape(-1, self.per) @ ones).reshape(n_channels, -1)
        power /= self.per
        mean /= self.per
        held = (self.n_rows - 1) % self.per + 1
        power[-1] *= self.per / held
        mean[:, n_bins - 1] *= self.per / held
        return power, mean

    def between(self, first: int, stop: int) -> Any:
        """Return the filtered rows [first, stop), as far as there are any: shape (n_channels, n)."""
        first, stop = max(0, first), min(stop, self.n_rows)
        start = first // self.size
        found = [self._block(k) for k in range(start, -(-stop // self.size))]
        rows = found[0] if len(found) == 1 else np.concatenate([self._states[0][:, :0], *found], axis=1)
        return rows[:, first - start * self.size : max(0, stop - start * self.size)]

    def correlation(self, lag: int) -> float:
        """Return the mean over rows of what a row and the one `lag` (0 or 1) later have in common."""
        total, before = 0.0, self._states[0][:, :0]
        for k in range(-(-self.n_rows // self.size)):
            rows = np.concatenate([before, self._block(k)], axis=1)
            total += float(np.einsum("ij,ij->i", rows[:, lag:], rows[:, : rows.shape[1] - lag]).sum())
            before = rows[:, rows.shape[1] - lag :]
        return total / max(1, self.n_rows - lag)

    def _block(self, k: int, rows: Any = None) -> Any:
        """Return block k, zero after its last row; the states before all blocks up to it are found first."""
        if k in self._kept:
            return self._kept[k]
        for i in range(min(k, len(self._states) - 1), k + 1):
            x = self._rows(i) if rows is None else rows
            block, after = causal_channels(self.sos, x, self._states[i])
            if i + 1 == len(self._states):
                self._states.append(after)
        block[:, self.n_rows - k * self.size :] = 0.0
        if len(self._kept) < KEPT:
            self._kept[k] = block
        return block

    def _rows(self, k: int) -> Any:
        """Return the rows of block k less the level at rest: (n_channels, n), zero after the last."""
        start = k * self.size * self.step
        samples = self.axes[start : start + self.size * self.step]
        unit = STEPS * self.per * self.step
        x = self._room[:, : -(-len(samples) // unit) * unit]
        for channel, level in enumerate(self.data.rest):
            np.subtract(samples[:, channel], level, out=x[channel, : len(samples)], casting="same_kind")
        glitches = self.glitches[slice(*np.searchsorted(self.glitches, (start, start + len(samples))))]
        if len(glitches):
            near = [self.axes[np.clip(glitches + i, 0, len(self.axes) - 1)] for i in (-1, 1)]
            x[:, glitches - start] = ((near[0] + near[1]) / 2 - self.data.rest).T
        x[:, : max(0, self.data.first - start)] = x[:, len(samples) :] = 0.0
        if self.step == 1:
            return x
        rows = (x.reshape(-1, self.step) @ np.full(self.step, 1 / self.step, self.kind)).reshape(len(x), -1)
        if rest := len(samples) % self.step:
            rows[:, len(samples) // self.step] *= self.step / rest
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
    GLITCHES[recording] = glitches
    data = -(-felt.first // (step * bin_size)), n_bins
    if felt.stop < len(axes):
        data = data[0], max(data[0], felt.stop // (step * bin_size))
    sos = _above_the_hand(hand_hz, rate)
    vibration, loud, mean = _vibration(Filtered(axes, step, bin_size, sos, felt, glitches, "f"), data)
    full = _full(axes[felt.first : felt.stop], loud, data, step * bin_size, bin_s)
    n_quiet = max(1, min(round(quiet_s / bin_s), n_bins // 16))
    usable = slice(*(full if full[1] - full[0] >= n_quiet else (data[0], max(data[1], data[0] + 1))))
    noise, steady, varies = _quietest(loud[usable], n_quiet, bin_size * axes.shape[1])
    noise = max(noise, _DEAD * float(loud.max()))
    some = axes[:200]
    if not np.ptp(some, axis=0).all() or _rounding(some) > noise:  # of more samples it is less
        noise = max(noise, _rounding(axes[:50_000]))
    found = vibration, noise, steady, data, full, step, bin_size
    least = -(-LEAST_SAMPLES // (step * bin_size))
    if noise == 0:
        nothing = np.zeros_like(loud)
        return Track(Levels(nothing, nothing, nothing, bin_s, least), *found)
    loud /= noise
    at_rest = np.zeros((len(mean), 2 * len(_soft_band(1.0 / bin_s))), mean.dtype)
    soft = np.square(causal_channels(_soft_band(1.0 / bin_s), mean, at_rest)[0]).sum(axis=0)
    levels = _levels(loud, _only(soft[:n_bins], data), usable, bin_s, least)
    return Track(replace(levels, strokes=VARYING * levels.strokes) if varies else levels, *found)


def _vibration(single: Filtered, data: tuple[int, int]) -> tuple[Filtered, Samples, Any]:
    """Return what is filtered, its levels and its means: in double precision, if single would be felt."""
    with np.errstate(over="ignore", invalid="ignore"):
        loud, mean = single.levels()
        heard = _only(loud, data)[slice(*data)]
        least = (SINGLE * float(np.abs(mean).max())) ** 2
    if least < heard.min(initial=np.inf) and heard.max(initial=0.0) < np.inf:
        return single, loud, mean
    double = replace(single, kind="d", _kept={})
    loud, mean = double.levels()
    return double, _only(loud, data), mean


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

    def fades(axes: Samples, bins: Samples) -> int:
        def raw(start: int, stop: int) -> float:
            part = axes[start * size : stop * size]
            return float(np.einsum("ij,ij->", part, part)) / len(part)

        n_bins = -(-len(axes) // size)
        vibration = fade(lambda start, stop: float(bins[start:stop].mean()), len(bins), bin_s)
        return max(vibration, fade(raw, n_bins, bin_s))

    bins = loud[slice(*data)]
    up, down = fades(axes, bins), fades(axes[::-1], bins[::-1])
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
