"""What files hold that no sensor felt: values held at an end, single wild samples, a volume that is faded."""

from collections.abc import Callable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Recording, Samples

HELD_S = 0.005
"""All channels keep their value so long at an end of a recording: padding, not a sensor."""
LEAST_HELD = 8
"""And at least for so many samples."""
STEP = 8.0
"""Ratio to their spread by which samples leave a held value if something steps in, as gravity does."""
WILD = 6.0
"""A glitch leaves its neighbours so many times as far as these lie apart."""
NEAR = 4
"""Samples on each side that are its neighbours."""
FADE_DB = 2.5
"""Least rise of the level, each time as much time has passed again, while a volume is turned up."""
FADE_MOST_DB, FADE_TOTAL_DB = 25.0, 12.0
FADE_FASTER_DB = 6.0
"""A fade slows down: a rise that exceeds the one before by more than this is a tap."""
LONGEST_FADE_S = 0.6
BLOCK = 1 << 13
"""Rows looked at at a time, so few that they stay near the processor."""
GLITCHES: WeakKeyDictionary[Recording, NDArray[np.intp]] = WeakKeyDictionary()
"""Those of recordings whose phases were searched, as long as there are these."""


@dataclass(frozen=True, eq=False)
class Data:
    """The part of a recording that a sensor felt.

    Attributes
    ----------
    first, stop : int
        Data are the samples [first, stop); outside, a value is held.
    rest : ndarray of shape (n_channels,)
        What stands in for what is held before: the level at which the data begin.
    """

    first: int
    stop: int
    rest: Samples


def find_data(axes: Samples, fs: float) -> Data:
    """Find the data of (n, n_channels) samples between values held at the ends.

    Zeros before and after, or a first or last value repeated, say nothing of the noise, and a step from them
    to what a sensor feels at rest is no impulse.
    """
    n = len(axes)
    least = max(LEAST_HELD, round(HELD_S * fs))
    before, after = _held(axes), _held(axes[::-1])
    first = before if before >= least else 0
    stop = n - after if after >= least and after < n else n
    if first == n:
        return Data(0, n, axes[0])
    opening = axes[first : first + max(3, round(0.02 * fs))]
    if not first:
        return Data(0, stop, _start(opening))
    level = np.median(opening, axis=0)
    spread = np.median(np.abs(opening - level), axis=0)
    steps_in = bool((np.abs(level - axes[0]) > STEP * spread).any() and spread.any())
    return Data(first, stop, level if steps_in else axes[0])


def _held(axes: Samples) -> int:
    """Return how many samples from the first on keep its value; 1 if the second differs."""
    start, size = 1, 64
    while start < len(axes):
        differs = (axes[start : start + size] != axes[0]).any(axis=1)
        at = int(np.argmax(differs))
        if differs[at]:
            return start + at
        start, size = start + size, min(2 * size, BLOCK)
    return len(axes)


def get_glitches(recording: Recording, stop: int) -> NDArray[np.intp]:
    """Return the glitches before sample `stop`: those that the search for phases found, if it was made."""
    found = GLITCHES.get(recording)
    if found is None:
        found = find_glitches(recording.acceleration.reshape(recording.n_samples, -1), stop)
    return found[: np.searchsorted(found, stop)]


def find_glitches(axes: Samples, stop: int | None = None) -> NDArray[np.intp]:
    """Return the samples of (n, n_channels) that leave alone, and by far, the line of their neighbours.

    What strikes a tool moves it for longer than a sample, and it rings; a bit that flips, a loose contact or
    a lost word do not. If only those before `stop` are asked for, some after it may be missing.
    """
    n, n_channels = axes.shape
    if n < 2 * NEAR + 1 or stop == 0:
        return np.zeros(0, dtype=np.intp)
    found, unit = list[NDArray[np.intp]](), 64  # rows compared at once: one by one takes far longer
    n_rows = min(BLOCK, -(-n // unit) * unit)
    jumps, lows = np.empty((n_rows + 1) * n_channels), np.empty(n_rows * n_channels)
    ones, least = np.ones(n_rows), np.empty((unit, n_channels))
    for start in range(0, min(n - 2 * NEAR, n if stop is None else stop), BLOCK):
        before = max(0, start - 1)
        rows = axes[before : start + BLOCK + 1].reshape(-1)
        jump = np.subtract(rows[n_channels:], rows[:-n_channels], out=jumps[: len(rows) - n_channels])
        np.abs(jump, out=jump)
        size = len(jump) - n_channels
        np.minimum(jump[n_channels:], jump[:-n_channels], out=lows[:size])
        lows[size:] = 0.0
        least[:] = ones @ lows.reshape(-1, n_channels) * (WILD * n_channels / size)
        (at,) = np.nonzero((lows.reshape(-1, least.size) > least.reshape(-1)).reshape(-1))
        at = at[lows[at] > (WILD - 2.0) * np.abs(rows[at + 2 * n_channels] - rows[at])]
        found.append(at + (before + 1) * n_channels)
    wild, channels = np.divmod(np.concatenate(found), n_channels)
    first = np.minimum(np.maximum(wild - NEAR, 0), n - 2 * NEAR - 1)
    near = axes[first[:, None] + np.arange(2 * NEAR + 1), channels[:, None]]
    its = np.arange(len(wild)), wild - first
    near[its] = near[its[0], its[1] - 1]
    near.sort(axis=1)
    alone = np.abs(axes[wild, channels] - near[:, NEAR]) > WILD * (near[:, -1] - near[:, 0])
    return np.unique(wild[alone]) if alone.any() else wild[:0]


def interpolate_glitches(axes: Samples, glitches: NDArray[np.intp]) -> Samples:
    """Return samples with the mean of both neighbours in place of each glitch."""
    if not len(glitches):
        return axes
    axes = axes.copy()
    before, after = np.maximum(glitches - 1, 0), np.minimum(glitches + 1, len(axes) - 1)
    axes[glitches] = (axes[before] + axes[after]) / 2
    return axes


def fade(power: Callable[[int, int], float], n_bins: int, bin_s: float) -> int:
    """Return the bins at the start in which the level is turned up from nothing; 0 if it is not.

    `power` is asked for the mean of bins [start, stop). Such a level keeps rising each time as much time has
    passed again: a linear fade by 6 dB.
    """

    def level_db(start: int, stop: int) -> float:
        return 10.0 * float(np.log10(max(power(start, stop), 1e-300)))

    start, edge = 0, max(4, round(0.01 / bin_s))
    if n_bins < edge:
        return 0
    first = last = level_db(start, edge)
    step_db = FADE_MOST_DB
    while 2 * edge <= n_bins and edge * bin_s < LONGEST_FADE_S:
        start, edge = edge, 2 * edge
        now = level_db(start, edge)
        if not FADE_DB <= now - last <= min(FADE_MOST_DB, step_db + FADE_FASTER_DB):
            break
        last, step_db = now, now - last
    else:
        return 0
    return start if last - first >= FADE_TOTAL_DB else 0


def _start(rows: Samples) -> Samples:
    """Return where the line through the rows begins."""
    t = np.arange(len(rows)) - (len(rows) - 1) / 2
    return np.asarray((1 / len(rows) + t[0] * t / max(float(t @ t), 1.0)) @ rows)
