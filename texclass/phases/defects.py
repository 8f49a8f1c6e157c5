"""Defects of recordings: padding at the ends, single-sample glitches, outliers of motion, and fades."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Recording, Samples

HELD_S = 0.005
"""Shortest padding in s. All channels must keep their value for this time at the start or end of the
recording."""
MIN_HELD = 8
"""Shortest padding in samples."""
STEP_RATIO = 8.0
"""Smallest step from padding to data (for example due to gravity), relative to the spread of the first data
samples."""
GLITCH_RATIO = 6.0
"""Smallest deviation of a glitch from the median of its neighbours, relative to the range of the
neighbours."""
MAX_OUTLIER_S = 0.02
"""Longest duration of an outlier of speed, force or position in s: half a period at 25 Hz, the bandwidth of
recorded motion (`abdulali2016`, section 2.2)."""
N_NEIGHBOURS = 4
"""Number of neighbours of a sample on each side."""
FADE_DB = 2.5
"""Smallest rise of the level in dB per doubling of time during a fade-in. In a linear fade, the level rises
by 6 dB."""
MAX_FADE_DB, TOTAL_FADE_DB = 25.0, 12.0
"""Largest rise in dB per doubling of time, and smallest rise of the whole fade."""
FADE_FASTER_DB = 6.0
"""Largest increase in dB from one rise of a fade to the next. A fade slows down, so a larger increase is a
tap."""
MAX_FADE_S = 0.6
"""Longest fade-in in s."""
BLOCK = 1 << 13
"""Number of samples per block, chosen so that a block fits into the cache of the processor."""
GLITCHES: WeakKeyDictionary[Recording, NDArray[np.intp]] = WeakKeyDictionary()
"""Cache of the glitches that the search for phases has detected, kept for the lifetime of each recording."""


@dataclass(frozen=True, eq=False)
class Data:
    """The range of a recording that contains data of the sensor.

    Attributes
    ----------
    first, stop : int
        Half-open range [first, stop) of samples with data. The samples outside this range are padding.
    rest : ndarray of shape (n_channels,)
        Level at which the data start. It replaces the padding at the start.
    """

    first: int
    stop: int
    rest: Samples


def find_data(axes: Samples, fs: float) -> Data:
    """Return the range of samples without padding at the ends.

    Padding consists of zeros or of the repeated first or last value. It must be excluded, because it does not
    contain the noise of the sensor, and because a step from padding to the level at rest is not an impulse.

    Parameters
    ----------
    axes : ndarray of shape (n, n_channels)
        Samples.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    Data
        Range of the data, and the level at its start.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal((1000, 1))
    >>> x[:200] = 0.0
    >>> data = find_data(x, fs=1000)
    >>> data.first, data.stop
    (200, 1000)
    """
    n = len(axes)
    n_min = max(MIN_HELD, round(HELD_S * fs))
    n_start, n_end = _n_held(axes), _n_held(axes[::-1])
    first = n_start if n_start >= n_min else 0
    stop = n - n_end if n_end >= n_min and n_end < n else n
    if first == n:
        return Data(0, n, axes[0])
    opening = axes[first : first + max(3, round(0.02 * fs))]
    if not first:
        return Data(0, stop, _start_of_line(opening))
    level = np.median(opening, axis=0)
    spread = np.median(np.abs(opening - level), axis=0)
    has_step = bool((np.abs(level - axes[0]) > STEP_RATIO * spread).any() and spread.any())
    return Data(first, stop, level if has_step else axes[0])


def _n_held(axes: Samples) -> int:
    """Return how many samples at the start have the value of the first sample."""
    start, size = 1, 64
    while start < len(axes):
        differs = (axes[start : start + size] != axes[0]).any(axis=1)
        index = int(np.argmax(differs))
        if differs[index]:
            return start + index
        start, size = start + size, min(2 * size, BLOCK)
    return len(axes)


def get_glitches(recording: Recording, stop: int) -> NDArray[np.intp]:
    """Return the glitches before sample `stop`; reuse the result of an earlier search for phases.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal(1000)
    >>> x[300] = 100.0
    >>> get_glitches(Recording(x, fs=1000), stop=1000).tolist()
    [300]
    """
    glitches = GLITCHES.get(recording)
    if glitches is None:
        glitches = find_glitches(recording.acceleration.reshape(recording.n_samples, -1), stop)
    return glitches[: np.searchsorted(glitches, stop)]


def find_glitches(axes: Samples, stop: int | None = None) -> NDArray[np.intp]:
    """Return the indices of glitches: single samples that deviate strongly from their neighbours.

    In contrast to a glitch, a contact of the tool lasts more than one sample, and the tool rings afterwards.
    Glitches are caused by bit errors, loose connections and lost data words.

    Parameters
    ----------
    axes : ndarray of shape (n, n_channels)
        Samples.
    stop : int, optional
        Sample up to which all glitches must be found (default: all samples). Later glitches may be missing.

    Returns
    -------
    ndarray of int
        Indices in ascending order.

    Examples
    --------
    >>> x = np.random.default_rng(0).standard_normal((1000, 3))
    >>> x[300, 1] = 100.0
    >>> find_glitches(x).tolist()
    [300]
    """
    n, n_channels = axes.shape
    if n < 2 * N_NEIGHBOURS + 1 or stop == 0:
        return np.zeros(0, dtype=np.intp)
    candidates, unit = list[NDArray[np.intp]](), 64  # comparing 64 rows at a time is much faster
    n_rows = min(BLOCK, -(-n // unit) * unit)
    jumps, smaller_jumps = np.empty((n_rows + 1) * n_channels), np.empty(n_rows * n_channels)
    ones, threshold = np.ones(n_rows), np.empty((unit, n_channels))
    for start in range(0, min(n - 2 * N_NEIGHBOURS, n if stop is None else stop), BLOCK):
        offset = max(0, start - 1)
        rows = axes[offset : start + BLOCK + 1].reshape(-1)
        jump = np.subtract(rows[n_channels:], rows[:-n_channels], out=jumps[: len(rows) - n_channels])
        np.abs(jump, out=jump)
        size = len(jump) - n_channels
        np.minimum(jump[n_channels:], jump[:-n_channels], out=smaller_jumps[:size])
        smaller_jumps[size:] = 0.0
        threshold[:] = ones @ smaller_jumps.reshape(-1, n_channels) * (GLITCH_RATIO * n_channels / size)
        (jump_index,) = np.nonzero(
            (smaller_jumps.reshape(-1, threshold.size) > threshold.reshape(-1)).reshape(-1)
        )
        change = np.abs(rows[jump_index + 2 * n_channels] - rows[jump_index])
        jump_index = jump_index[smaller_jumps[jump_index] > (GLITCH_RATIO - 2.0) * change]
        candidates.append(jump_index + (offset + 1) * n_channels)
    samples, channels = np.divmod(np.concatenate(candidates), n_channels)
    first = np.minimum(np.maximum(samples - N_NEIGHBOURS, 0), n - 2 * N_NEIGHBOURS - 1)
    neighbours = axes[first[:, None] + np.arange(2 * N_NEIGHBOURS + 1), channels[:, None]]
    row, column = np.arange(len(samples)), samples - first  # the sample itself is replaced by its predecessor
    neighbours[row, column] = neighbours[row, column - 1]
    neighbours.sort(axis=1)
    deviation = np.abs(axes[samples, channels] - neighbours[:, N_NEIGHBOURS])
    is_glitch = deviation > GLITCH_RATIO * (neighbours[:, -1] - neighbours[:, 0])
    return np.unique(samples[is_glitch]) if is_glitch.any() else samples[:0]


def interpolate_glitches(axes: Samples, glitches: NDArray[np.intp]) -> Samples:
    """Return the samples with each glitch replaced by the mean of its two neighbours.

    Parameters
    ----------
    axes : ndarray of shape (n, n_channels)
        Samples.
    glitches : ndarray of int
        Indices from `find_glitches`.

    Examples
    --------
    >>> interpolate_glitches(np.array([[1.0], [90.0], [3.0]]), np.array([1])).ravel().tolist()
    [1.0, 2.0, 3.0]
    """
    if not len(glitches):
        return axes
    axes = axes.copy()
    previous, following = np.maximum(glitches - 1, 0), np.minimum(glitches + 1, len(axes) - 1)
    axes[glitches] = (axes[previous] + axes[following]) / 2
    return axes


# Outliers of speed, force and position ----------------------------------------------------------------------


def find_motion_outliers(x: Samples, fs: float) -> NDArray[np.intp]:
    """Return the indices of outlier samples in a speed, a force or a coordinate of the hand or robot.

    Motion is slow: no hand leaves its course and returns to it within `MAX_OUTLIER_S`. Such excursions are
    wrong samples, which a mean, a filter or an integral would spread over the recording.

    A sample is an outlier if its deviation from the median of its `N_NEIGHBOURS` neighbours on each side
    exceeds

    - `GLITCH_RATIO` times the range of these neighbours, without the two that are farthest from the median;
    - `GLITCH_RATIO` times the median step between consecutive samples;
    - twice the range of 90 % of the signal. Smaller deviations hardly move a fit, and may be taps.

    Up to three consecutive samples are found, because interpolation to uniform time stamps spreads one sample
    over two. Repeated values count once, because merged logs repeat the last value.

    Parameters
    ----------
    x : ndarray of shape (n,)
        Speed, force or coordinate.
    fs : float
        Sampling rate in Hz.

    Returns
    -------
    ndarray of int
        Indices in ascending order.

    Examples
    --------
    >>> force = 1 + 0.2 * np.sin(np.arange(1000) / 50)
    >>> force[300:302] = 505_831.0
    >>> find_motion_outliers(force, fs=1000).tolist()
    [300, 301]
    """
    starts = np.flatnonzero(np.diff(x, prepend=np.nan) != 0)
    values, lengths = x[starts], np.diff(np.append(starts, x.size))
    is_outlier = np.zeros(values.size, dtype=bool)
    if values.size < 2 * N_NEIGHBOURS + 1:
        return np.flatnonzero(np.repeat(is_outlier, lengths))
    steps = np.abs(np.diff(values))
    smallest = max(GLITCH_RATIO * np.median(steps), 2 * np.subtract(*np.quantile(x, [0.95, 0.05])))
    jumps = np.flatnonzero(steps > smallest / 4)  # an excursion of three samples may rise in two steps
    index = np.unique(np.clip(jumps[:, np.newaxis] + np.arange(-1, 3), 0, values.size - 1))
    padded = np.pad(values, N_NEIGHBOURS, mode="reflect")  # the ends need neighbours, too
    windows = padded[index[:, np.newaxis] + np.arange(2 * N_NEIGHBOURS + 1)]
    neighbours = np.delete(windows, N_NEIGHBOURS, axis=1)
    median = np.median(neighbours, axis=1, keepdims=True)
    order = np.argsort(np.abs(neighbours - median), axis=1)
    nearest = np.take_along_axis(neighbours, order[:, :-2], axis=1)
    deviation = np.abs(values[index] - median[:, 0])
    is_outlier[index] = deviation > np.maximum(GLITCH_RATIO * np.ptp(nearest, axis=1), smallest)
    edges = np.flatnonzero(np.diff(is_outlier, prepend=False, append=False))
    for first, last in edges.reshape(-1, 2):
        is_outlier[first:last] = lengths[first:last].sum() <= max(last - first, MAX_OUTLIER_S * fs)
    return np.flatnonzero(np.repeat(is_outlier, lengths))


def describe_outliers(x: Samples, outliers: NDArray[np.intp], fs: float, name: str, unit: str) -> str:
    """Describe outliers, for example "1 sample of normal_force (505831 N at 7.616 s)"."""
    worst = int(outliers[np.argmax(np.abs(x[outliers] - np.median(x)))])
    samples = "1 sample" if len(outliers) == 1 else f"{len(outliers)} samples"
    example = "" if len(outliers) == 1 else "for example "
    return f"{samples} of {name} ({example}{x[worst]:.6g} {unit} at {worst / fs:.4g} s)"


def interpolate_outliers(x: Samples, outliers: NDArray[np.intp]) -> Samples:
    """Return samples (n,) in which outliers are replaced by linear interpolation between valid samples."""
    if not len(outliers):
        return x
    valid, cleaned = np.setdiff1d(np.arange(len(x)), outliers), x.copy()
    cleaned[outliers] = np.interp(outliers, valid, x[valid])
    return cleaned


def exclude_outliers(x: Samples, fs: float, name: str, unit: str, where: str) -> Samples:
    """Return a speed, force or position with its outlier samples interpolated, and warn about them once.

    Parameters
    ----------
    x : ndarray of shape (n,) or (n, n_axes)
        Signal; each axis is treated separately.
    fs : float
        Sampling rate in Hz.
    name, unit, where : str
        Name and unit of the signal, and its recording, for the warning.

    Warns
    -----
    UserWarning
        If samples are excluded; see `find_motion_outliers`.

    Examples
    --------
    >>> exclude_outliers(np.linspace(1, 2, 11), 1000.0, "normal_force", "N", "oak.csv").round(1)[:3].tolist()
    [1.0, 1.1, 1.2]
    """
    columns = x.reshape(len(x), -1).T
    outliers = [find_motion_outliers(column, fs) for column in columns]
    pairs = list(zip(columns, outliers, strict=True))
    notes = [describe_outliers(column, found, fs, name, unit) for column, found in pairs if len(found)]
    if not notes:
        return x
    warnings.warn(f"{where}: excluded {' and '.join(notes)}. Check the sensor", UserWarning, stacklevel=3)
    return np.column_stack([interpolate_outliers(*pair) for pair in pairs]).reshape(x.shape)


def fade_length(power: Callable[[int, int], float], n_bins: int, bin_s: float) -> int:
    """Return the number of bins of a fade-in at the start, or 0 if there is none.

    In a fade-in, the level rises with each doubling of time: by 6 dB if the fade is linear.

    Parameters
    ----------
    power : callable
        Function ``power(start, stop)`` that returns the mean power of the bins [start, stop).
    n_bins : int
        Number of bins.
    bin_s : float
        Duration of a bin in s.
    """

    def level_db(start: int, stop: int) -> float:
        return 10.0 * float(np.log10(max(power(start, stop), 1e-300)))

    start, edge = 0, max(4, round(0.01 / bin_s))
    if n_bins < edge:
        return 0
    first = last = level_db(start, edge)
    step_db = MAX_FADE_DB
    while 2 * edge <= n_bins and edge * bin_s < MAX_FADE_S:
        start, edge = edge, 2 * edge
        current = level_db(start, edge)
        if not FADE_DB <= current - last <= min(MAX_FADE_DB, step_db + FADE_FASTER_DB):
            break
        last, step_db = current, current - last
    else:
        return 0
    return start if last - first >= TOTAL_FADE_DB else 0


def _start_of_line(rows: Samples) -> Samples:
    """Fit a regression line to the rows, and return its value at the first row."""
    t = np.arange(len(rows)) - (len(rows) - 1) / 2
    return np.asarray((1 / len(rows) + t[0] * t / max(float(t @ t), 1.0)) @ rows)
