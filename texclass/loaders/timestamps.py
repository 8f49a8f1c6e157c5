"""Convert samples with time stamps to a uniform sampling rate, with a flag for every correction.

Time stamps jump when a clock is set. They repeat when a message is sent twice or the clock is coarse.
Messages arrive late, out of order or in bursts, and some are lost.
"""

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.readers import rate_conflict_error, reader_error
from texclass.recording import RecordingError, Samples

Timestamps = NDArray[np.int64]


@dataclass(frozen=True)
class TimestampSettings:
    """Thresholds for the correction of time stamps.

    Attributes
    ----------
    max_overtaking : int
        A message overtaken by at most this many messages is out of order; otherwise the clock was set.
    clock_jump_s : float
        Time in s. If a step of the time stamps exceeds the step of the times of receipt by more than this
        time, the clock was set forward.
    rate_block, min_blocks : int
        Messages per rate measurement, and smallest number of consecutive measurements in a segment with one
        rate.
    other_rate : float
        Relative difference of typical steps above which the rate has changed.
    level_window : int
        Number of messages before and after a gap used to decide whether samples are missing or only late.
    step_tolerance : float
        Relative deviation from the median step. If more than half of the steps deviate more, messages arrive
        in bursts.
    max_gap, max_gap_s : int, float
        Longest gap that is interpolated, in samples and in s, whichever is longer. Longer gaps divide the
        recording.
    same_rate : float
        Relative difference below which two rates are considered equal; crystal oscillators differ by 1e-4.
    near_rate, near_rate_jittering : float
        Relative difference between measured and stated rate up to which signals are resampled to the stated
        rate; a larger difference is an error. The second applies if the jitter exceeds `max_jitter`, because
        the stated rate is then more accurate.
    reported_jitter, even_jitter, max_jitter : float
        Root-mean-square deviation from evenly spaced time stamps, in periods. Jitter is reported above the
        first value and ignored below the second. Above the third, time stamps are too inaccurate to locate
        single samples.
    max_resolution : float
        Resolution of time stamps in periods above which they are too coarse to locate single samples, such as
        whole milliseconds at 100 Hz.
    coarse_clock : float
        Fraction of values that change at equal time stamps, divided by the fraction that change at different
        time stamps. Above this ratio, equal time stamps come from a coarse clock, not from messages sent
        twice.
    shared_ticks : float
        Fraction of ticks with several samples above which a clock is coarse.
    """

    max_overtaking: int = 3
    clock_jump_s: float = 0.5
    rate_block: int = 64
    min_blocks: int = 4
    other_rate: float = 0.25
    level_window: int = 32
    step_tolerance: float = 0.3
    max_gap: int = 10
    max_gap_s: float = 0.01
    same_rate: float = 1e-3
    near_rate: float = 0.02
    near_rate_jittering: float = 0.1
    reported_jitter: float = 0.01
    even_jitter: float = 0.02
    max_jitter: float = 0.5
    max_resolution: float = 0.05
    coarse_clock: float = 0.25
    shared_ticks: float = 0.2


TIMESTAMPS = TimestampSettings()
"""Thresholds for files, bags and streams."""


def _locate_samples(
    stamps_ns: Timestamps, received_ns: Timestamps, repeats: NDArray[np.bool_], where: str
) -> tuple[NDArray[np.intp], Samples, NDArray[np.int64], list[str]]:
    """Find the usable messages and the position of each one in a uniform series.

    Parameters
    ----------
    stamps_ns, received_ns : ndarray of shape (n,)
        Time stamps and times of receipt in ns.
    repeats : ndarray of bool, shape (n,)
        Whether a message has the same values as the previous one.
    where : str
        File, for messages.

    Returns
    -------
    messages : ndarray of shape (n_used,)
        Indices of the used messages.
    t : ndarray of shape (n_used,)
        Corrected times in s.
    index : ndarray of shape (n_used,)
        Sample number of each message, counted from 0; the numbers of lost messages are left out.
    flags : list of str
        Descriptions of the corrections.
    """
    is_duplicate = _find_duplicates(stamps_ns, received_ns, repeats)
    messages = np.flatnonzero(~is_duplicate)
    t, jump_flag = _bridge_clock_jumps(_seconds(stamps_ns[messages]), _seconds(received_ns[messages]))
    order = np.argsort(t, kind="stable")
    n_moved = int(np.count_nonzero(np.diff(t) < 0))
    messages, (t, coarse_flag) = messages[order], _spread_ticks(t[order])
    first, last, rate_flag = _one_rate(t)
    messages, t = messages[first:last], t[first:last]
    if len(t) < 2 or not t[-1] > t[0] or not np.isfinite(t[-1]):
        problem = f"all {len(t)} messages have the same time stamp"
        raise reader_error(where, problem, "at least two different time stamps")
    period = _period(t)
    n_lost = _count_lost(t, period)
    first, last, gap_flag = _longest_segment(
        n_lost, max(TIMESTAMPS.max_gap, int(TIMESTAMPS.max_gap_s / period)), period
    )
    messages, t, n_lost = messages[first:last], t[first:last], np.append(0, n_lost[first + 1 : last])
    index = np.arange(len(t)) + np.cumsum(n_lost)
    if len(t) < 2 or t[-1] <= t[0]:
        raise reader_error(
            where, f"all time stamps are {stamps_ns[0]} ns", "at least two different time stamps"
        )
    if index[-1] >= 2 * len(t) + TIMESTAMPS.max_gap:
        raise RecordingError(
            f"{where}: according to its time stamps, {n_lost.sum()} of {index[-1] + 1} samples are missing. "
            "Expected at most half. If rows of several sensors are merged, export the accelerometer alone. "
            "To ignore the time stamps, pass --time-column none and --fs HZ (card: `time_column`, `fs_hz`)"
        )
    n_duplicates, n_gaps = int(is_duplicate.sum()), np.count_nonzero(n_lost)
    flags = {
        f"duplicates: {n_duplicates} messages equal the previous one in time stamp and values, dropped": (
            n_duplicates
        ),
        jump_flag: jump_flag,
        coarse_flag: coarse_flag,
        rate_flag: rate_flag,
        f"out of order: {n_moved} messages, sorted by time stamp": n_moved,
        f"gaps: {n_lost.sum()} messages missing in {n_gaps} gaps, interpolated": n_gaps,
        gap_flag: gap_flag,
    }
    return messages, t, index, [flag for flag, is_true in flags.items() if is_true]


def _period(t: Samples) -> float:
    """Return the sampling period in s, unaffected by gaps and bursts."""
    step, window = np.diff(t), TIMESTAMPS.level_window
    typical, mean = float(np.median(step)), float(t[-1] - t[0]) / len(step)
    # With gaps, few steps are longer than the mean; with bursts, many are.
    has_gaps = np.count_nonzero(step > mean) < 0.01 * len(step) and np.percentile(step, 10) > 0.5 * typical
    is_regular = np.mean(np.abs(step - typical) <= TIMESTAMPS.step_tolerance * typical) >= 0.5
    if typical > 0 and (has_gaps or (is_regular and typical > 0.2 * mean)):
        return typical_step(step)
    if len(step) > 2 * window:  # bursts, with gaps between some of them
        return typical_step(t[window:] - t[:-window]) / window or mean
    return mean


def _find_duplicates(
    stamps_ns: Timestamps, received_ns: Timestamps, repeats: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which messages repeat the time stamp and the values of the previous message.

    If values change at equal time stamps about as often as at different ones, the clock is coarse, and equal
    values come from a sensor at rest. Then only messages that were also received together are duplicates.
    """
    equal = np.diff(stamps_ns, prepend=stamps_ns[:1] - 1) == 0
    is_duplicate: NDArray[np.bool_] = equal & repeats
    if not is_duplicate.any() or np.mean(~repeats[equal]) < TIMESTAMPS.coarse_clock * np.mean(
        ~repeats[~equal]
    ):
        return is_duplicate
    step = np.diff(received_ns, prepend=received_ns[:1])
    together = step < 0.1 * np.median(step)
    return np.asarray(is_duplicate & (received_ns != stamps_ns) & together)


def _spread_ticks(t: Samples) -> tuple[Samples, str]:
    """Distribute the samples of each tick of a coarse clock evenly; only whole ticks count as missing."""
    first = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0)
    if len(first) < 4:
        return t, ""
    n_samples, step = np.diff(first, append=len(t)), np.diff(t[first])
    n_inner = n_samples[1:-1]  # the recording starts and ends inside a tick
    tick = float(np.median(step))
    is_even = np.abs(step / tick - np.rint(step / tick)) < 0.01
    is_regular = n_inner <= 2 * np.median(n_inner) + 1
    if np.mean(n_samples > 1) < TIMESTAMPS.shared_ticks or min(is_even.mean(), is_regular.mean()) < 0.9:
        return t, ""
    is_whole = step < 1.5 * tick
    period = float(step[1:][is_whole[1:]].sum() / n_inner[is_whole[1:]].sum())
    missing = np.append(0, np.cumsum(np.where(is_whole, 0.0, step - tick)))
    spread = t[0] + period * np.arange(len(t)) + np.repeat(missing, n_samples)
    return spread, f"coarse clock: {tick / period:.3g} samples per tick of {tick:.3g} s, evenly spaced"


def _one_rate(t: Samples) -> tuple[int, int, str]:
    """Return the longest half-open range of messages with one rate, and a flag if the rate changes."""
    n_blocks = len(t) // TIMESTAMPS.rate_block
    if n_blocks < 2 * TIMESTAMPS.min_blocks:
        return 0, len(t), ""
    steps = np.diff(t[: n_blocks * TIMESTAMPS.rate_block], prepend=t[0]).reshape(
        n_blocks, TIMESTAMPS.rate_block
    )[:, 1:]
    period = np.array([typical_step(row) for row in steps])
    if not (period > 0).all():
        return 0, len(t), ""
    is_new = np.abs(np.diff(np.log(period))) > np.log(1 + TIMESTAMPS.other_rate) / 2
    edges = np.concatenate(([0], np.flatnonzero(is_new) + 1, [n_blocks]))
    segments = [(a, b) for a, b in pairwise(edges) if b - a >= TIMESTAMPS.min_blocks]
    rates = [float(np.median(period[a:b])) for a, b in segments]
    if len(segments) < 2 or max(rates) < (1 + TIMESTAMPS.other_rate) * min(rates):
        return 0, len(t), ""
    a, b = max(segments, key=lambda segment: segment[1] - segment[0])
    first, last = int(a) * TIMESTAMPS.rate_block, len(t) if b == n_blocks else int(b) * TIMESTAMPS.rate_block
    flag = (
        f"divided: time stamps advance by {rates[0]:.4g} s, later by {rates[-1]:.4g} s; only the longest "
        f"segment with one rate is used, {last - first} of {len(t)} messages"
    )
    return first, last, flag


def _seconds(stamps_ns: Timestamps) -> Samples:
    """Return the time in s since the first time stamp; differences in damaged files may exceed 64 bits."""
    return (stamps_ns.astype(np.longdouble) - np.longdouble(stamps_ns[0])).astype(np.float64) / 1e9


def _bridge_clock_jumps(t: Samples, received: Samples) -> tuple[Samples, str]:
    """Replace the steps at which a clock was set with the steps of the times of receipt."""
    if len(t) < 3:
        return t, ""
    step, received_step = np.diff(t), np.diff(received)
    typical = float(np.median(step))
    next_max = np.full(len(step), -np.inf)  # largest of the next time stamps
    for k in range(1, TIMESTAMPS.max_overtaking + 1):
        next_max[:-k] = np.maximum(next_max[:-k], t[1 + k :])
    is_backward = (step < 0) & (next_max <= t[:-1])
    is_backward[-1] = False  # no message follows, so it may be out of order
    is_forward = (step > TIMESTAMPS.clock_jump_s) & (step - received_step > TIMESTAMPS.clock_jump_s)
    is_jump = is_backward | is_forward
    if not is_jump.any():
        return t, ""
    largest = float(step[is_jump][np.argmax(np.abs(step[is_jump]))])
    step[is_jump] = np.maximum(received_step[is_jump], max(typical, 0.0))
    n_jumps = np.count_nonzero(is_jump)
    flag = f"clock jumps: {n_jumps} (largest {largest:+.3g} s), corrected by the times of receipt"
    return np.concatenate(([t[0]], t[0] + np.cumsum(step))), flag


def typical_step(step: Samples) -> float:
    """Return the mean of the steps near their median, such as 2.5 ms for steps of 2 and 3 ms."""
    typical = float(np.median(step))
    near = step[np.abs(step - typical) <= 0.6 * typical]
    return float(near.mean()) if len(near) else typical


def _count_lost(t: Samples, period: float) -> NDArray[np.int64]:
    """Return the number of missing messages before each message.

    The delay of message i is l[i] = t[i] - i T, where T is the period. A loss increases the delay of all
    later messages, whereas a late message increases only its own delay. The number of missing messages is
    therefore the increase of the minimum of l, in periods, from a window before a gap to one after it.
    """
    n_lost = np.zeros(len(t), np.int64)
    gaps = np.flatnonzero(np.diff(t) > 1.5 * period) + 1
    if not len(gaps):
        return n_lost
    delay = np.append(t - period * np.arange(len(t)), np.inf)
    start = np.maximum(np.concatenate(([0], gaps[:-1])), gaps - TIMESTAMPS.level_window)
    stop = np.minimum(np.concatenate((gaps[1:], [len(t)])), gaps + TIMESTAMPS.level_window)
    level_before = np.minimum.reduceat(delay, np.column_stack((start, gaps)).ravel())[::2]
    level_after = np.minimum.reduceat(delay, np.column_stack((gaps, stop)).ravel())[::2]
    n_lost[gaps] = np.clip(np.rint((level_after - level_before) / period), 0, 2**40).astype(np.int64)
    return n_lost


def _longest_segment(n_lost: NDArray[np.int64], max_gap: int, period: float) -> tuple[int, int, str]:
    """Return the longest half-open range of messages without a gap of more than `max_gap` samples."""
    cuts = np.concatenate(([0], np.flatnonzero(n_lost[1:] > max_gap) + 1, [len(n_lost)]))
    if len(cuts) == 2:
        return 0, len(n_lost), ""
    longest = int(np.argmax(np.diff(cuts)))
    first, last = int(cuts[longest]), int(cuts[longest + 1])
    flag = (
        f"divided: {len(cuts) - 2} gaps of up to {n_lost[cuts[1:-1]].max() * period:.3g} s; only the longest "
        f"segment between them is used, {last - first} of {len(n_lost)} messages"
    )
    return first, last, flag


def nominal_rate(rate: float) -> float:
    """Round a rate in Hz to the fewest digits within 0.1 % of it: 99.98 becomes 100, 104.2 stays."""
    for digits in range(1, 6):
        if abs((rounded := float(f"{rate:.{digits}g}")) - rate) <= TIMESTAMPS.same_rate * rate:
            return rounded
    return rate


def resample(samples: Samples, fs: float, to: float) -> Samples:
    """Resample along the first axis with a band-limiting polyphase filter.

    Parameters
    ----------
    samples : ndarray of shape (n,) or (n, n_channels)
        Samples at `fs`.
    fs : float
        Sampling rate in Hz.
    to : float
        Target sampling rate in Hz.

    Returns
    -------
    resampled : ndarray of shape (round(n * to / fs), ...)
        Samples at `to`, without content above the lower Nyquist frequency.

    Raises
    ------
    ValueError
        If a rate is not positive, or the rates differ by more than a factor of 1000.

    Examples
    --------
    >>> import numpy as np
    >>> resample(np.zeros((1000, 3)), fs=1000.0, to=250.0).shape
    (250, 3)
    """
    if not (fs > 0 and to > 0 and 1e-3 <= to / fs <= 1e3):
        raise ValueError(
            f"fs and to must be positive and differ at most by a factor of 1000, got {fs} and {to} Hz"
        )
    ratio = Fraction(to / fs).limit_denominator(1000)
    from scipy.signal import resample_poly  # slow import

    return np.asarray(resample_poly(samples, ratio.numerator, ratio.denominator, axis=0, padtype="line"))


def to_uniform_rate(
    samples: Samples,
    stamps_ns: Timestamps,
    received_ns: Timestamps,
    user_fs: float | None,
    *,
    by_header: bool,
    where: str,
    by: str = "",
    rate_of: str = "",
) -> tuple[Samples, float, float, tuple[str, ...]]:
    """Convert the samples of messages to a uniform sampling rate.

    Header time stamps are the times at which samples were taken. If their jitter matters, samples are
    interpolated (monotone cubic) at uniform times. Times of receipt are delayed, so samples are assumed to be
    evenly spaced.

    Parameters
    ----------
    samples : ndarray of shape (n, k, n_channels)
        k samples per message.
    stamps_ns : ndarray of shape (n,)
        Time stamps in ns.
    received_ns : ndarray of shape (n,)
        Times of receipt in ns, in the order of the messages.
    user_fs : float or None
        Sampling rate in Hz set by the user (None: nominal rate nearest to the measured rate).
    by_header : bool
        Whether the time stamps are from message headers.
    where : str
        File, for messages.
    by : str
        Description of the time stamps, for messages.
    rate_of : str
        File from which `user_fs` was read; "" if it is set by the user.

    Returns
    -------
    uniform : ndarray of shape (n_uniform, n_channels)
        Samples at `fs`.
    fs : float
        Sampling rate in Hz.
    start_s : float
        Time stamp of the first sample in s.
    flags : tuple of str
        Measured rate and corrections.

    Raises
    ------
    RecordingError
        If fewer than two different time stamps remain, or the measured rate contradicts `user_fs`.
    """
    limits = TIMESTAMPS
    repeats = np.append(False, np.all(samples[1:] == samples[:-1], axis=(1, 2)))
    messages, t, index, flags = _locate_samples(stamps_ns, received_ns, repeats, where)
    used, per_message = stamps_ns[messages], samples.shape[1]
    # Least squares t = T i + t0; the residual is the jitter, in periods.
    centred = index - index.mean()
    period, level = np.polyfit(centred, t, 1)
    offset = (t - level) / period - centred
    jitter = float(np.sqrt(np.mean(offset**2)))
    resolution = float(np.gcd.reduce(np.diff(used))) / 1e9 / float(period)
    measured = float(1 / period) * per_message
    fs = nominal_rate(measured) if user_fs is None else user_fs
    by = by or ("header time stamps" if by_header else "times of receipt")
    is_rough = jitter > limits.max_jitter
    if abs(measured - fs) > (limits.near_rate_jittering if is_rough else limits.near_rate) * fs:
        raise rate_conflict_error(where, f"{measured:.6g} Hz according to its {by}", fs, rate_of)
    is_informative = limits.even_jitter < jitter <= limits.max_jitter and resolution <= limits.max_resolution
    at_stamps = is_informative and by_header and per_message == 1
    uniform = _interpolate_on_grid(samples[messages], index, offset if at_stamps else None)
    rate_flag = f"rate: {measured:.6g} Hz by the {by}"
    if abs(measured - fs) > limits.same_rate * fs and not is_rough:
        uniform = resample(uniform, measured, fs)
        rate_flag += f", resampled (band-limited) to {fs:g} Hz"
    elif f"{measured:.6g}" != f"{fs:.6g}":
        rate_flag += f", used as {fs:g} Hz"
    flags.append(rate_flag)
    if jitter > limits.reported_jitter:
        method = "samples interpolated at their time stamps" if at_stamps else "samples assumed evenly spaced"
        flags.append(f"jitter: {100 * jitter:.2g} % of a period (rms), {method}")
    return uniform, fs, float(used[0]) / 1e9, tuple(flags)


def align(samples: Samples, fs: float, start_s: float, to_fs: float, n: int) -> tuple[Samples, float, float]:
    """Align uniform samples with another signal, which they need not cover completely.

    Samples before and after the signal repeat its first and last sample. The start is that of the nearest
    sample. Samples with nearly the rate of the other signal are interpolated (linearly) at its times.

    Parameters
    ----------
    samples : ndarray of shape (n_samples, n_channels)
        Samples.
    fs : float
        Their sampling rate in Hz.
    start_s : float
        Time of the first sample in s after the start of the other signal.
    to_fs : float
        Sampling rate of the other signal in Hz.
    n : int
        Number of samples of the other signal.

    Returns
    -------
    aligned : ndarray of shape (n_aligned, n_channels)
        Samples from the start of the other signal on, with the same duration.
    rate : float
        Their sampling rate in Hz: `fs`, or `to_fs` after an interpolation.
    coverage : float
        Fraction of the duration of the other signal in which the samples were measured.

    Examples
    --------
    >>> slow = np.arange(5.0)[:, np.newaxis]  # starts 0.1 s before the other signal
    >>> aligned, rate, coverage = align(slow, 10.0, -0.1, to_fs=100.0, n=50)
    >>> aligned.ravel().tolist(), rate, coverage
    ([1.0, 2.0, 3.0, 4.0, 4.0], 10.0, 0.8)
    """
    is_near = abs(fs / to_fs - 1) <= TIMESTAMPS.near_rate_jittering
    rate, count = (to_fs, n) if is_near else (fs, max(1, round(n * fs / to_fs)))
    first = -start_s * fs if is_near else round(-start_s * fs)
    position = first + np.arange(count) * (fs / rate)
    coverage = float(np.mean((position > -1) & (position < len(samples))))
    columns = [np.interp(position, np.arange(len(samples)), column) for column in samples.T]
    return np.column_stack(columns), rate, coverage


def _interpolate_on_grid(samples: Samples, index: NDArray[np.int64], offset: Samples | None) -> Samples:
    """Interpolate samples at 0, 1, 2, ... periods; message k is at `index[k] + offset[k]` periods."""
    n, per_message, n_channels = samples.shape
    flat = samples.reshape(n * per_message, n_channels)
    index = (index[:, None] * per_message + np.arange(per_message)).ravel()
    if offset is None and index[-1] + 1 == len(flat):
        return flat
    position = index.astype(np.float64)
    if offset is not None:
        position += offset
        is_later = np.concatenate(([True], np.diff(np.maximum.accumulate(position)) > 1e-6))
        position, flat = position[is_later], flat[is_later]
    grid = np.arange(index[-1] + 1, dtype=np.float64)
    if len(position) < 2:
        return flat
    with np.errstate(all="ignore"):  # damaged numbers may become infinite, which is an error later
        from scipy.interpolate import PchipInterpolator

        return np.asarray(PchipInterpolator(position, flat, axis=0)(np.clip(grid, position[0], position[-1])))
