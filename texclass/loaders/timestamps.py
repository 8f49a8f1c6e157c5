"""Samples at the instants of time stamps -> samples at a uniform rate; every correction is reported.

Time stamps jump when a clock is set, repeat when a message is sent twice or the clock is coarse, arrive out
of order, late and in bursts, and are missing where messages were lost.
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
    """Thresholds by which time stamps are judged.

    Attributes
    ----------
    most_late : int
        A message that at most so many others overtook is out of order; else the clock jumped.
    clock_jump_s : float
        A step of the time stamps that is so much longer than that of the times of receipt is the clock's.
    rate_block, least_blocks : int
        Messages for one measurement of the rate, and measurements that make a stretch of one rate.
    other_rate : float
        Relative difference of usual steps from which the rate has changed.
    level_window : int
        Messages on either side of a gap that show whether something is missing or was only late.
    alike : float
        Relative deviation from the median step; where half of the steps deviate more, they come in bursts.
    most_lost, most_lost_s : int, float
        Missing samples in a row, or their seconds if that is more, that are interpolated; a longer gap
        divides the recording.
    same_rate : float
        Rates that differ by less are one rate: crystals differ by 1e-4.
    near_rate, near_jittering : float
        Rates that differ by less are resampled; by more, one of them is wrong. The second counts beyond
        `most_jitter`: the stated rate is then the better one.
    shown_jitter, kept_jitter, most_jitter : float
        Deviation from evenly spaced time stamps, in periods (root mean square): reported above the first,
        taken as evenly spaced below the second, unrelated to when a sample was taken above the third.
    most_resolution : float
        Time stamps in coarser units, in periods (whole milliseconds at 100 Hz and more), are unrelated, too.
    coarse_clock : float
        Ratio of how often values change at equal time stamps to how often they change at others; from here
        on, equal time stamps come from a coarse clock and not from messages that were sent twice.
    shared : float
        Share of ticks with several samples from which a clock is coarse.
    """

    most_late: int = 3
    clock_jump_s: float = 0.5
    rate_block: int = 64
    least_blocks: int = 4
    other_rate: float = 0.25
    level_window: int = 32
    alike: float = 0.3
    most_lost: int = 10
    most_lost_s: float = 0.01
    same_rate: float = 1e-3
    near_rate: float = 0.02
    near_jittering: float = 0.1
    shown_jitter: float = 0.01
    kept_jitter: float = 0.02
    most_jitter: float = 0.5
    most_resolution: float = 0.05
    coarse_clock: float = 0.25
    shared: float = 0.2


TIMESTAMPS = TimestampSettings()


def _locate_samples(
    stamps_ns: Timestamps, received_ns: Timestamps, repeats: NDArray[np.bool_], where: str
) -> tuple[NDArray[np.intp], Samples, NDArray[np.int64], list[str]]:
    """Return which messages are used, their instants (s), which sample each one is, and what was wrong.

    Samples are numbered from 0; numbers are missing where messages are lost. `repeats` says whether a message
    holds the same values as the one before.
    """
    again = _find_duplicates(stamps_ns, received_ns, repeats)
    kept = np.flatnonzero(~again)
    t, jumps = _bridge_clock_jumps(_seconds(stamps_ns[kept]), _seconds(received_ns[kept]))
    order = np.argsort(t, kind="stable")
    n_moved = int(np.count_nonzero(np.diff(t) < 0))
    kept, (t, coarse) = kept[order], _spread_ticks(t[order])
    first, last, changed = _one_rate(t)
    kept, t = kept[first:last], t[first:last]
    if len(t) < 2 or not t[-1] > t[0] or not np.isfinite(t[-1]):
        raise reader_error(where, f"{len(t)} messages at one instant", "at least two instants")
    period = _period(t)
    lost = _lost_before(t, period)
    first, last, cut = _longest_segment(
        lost, max(TIMESTAMPS.most_lost, int(TIMESTAMPS.most_lost_s / period)), period
    )
    kept, t, lost = kept[first:last], t[first:last], np.append(0, lost[first + 1 : last])
    index = np.arange(len(t)) + np.cumsum(lost)
    if len(t) < 2 or t[-1] <= t[0]:
        raise reader_error(where, f"all its stamps are {stamps_ns[0]} ns", "two instants")
    if index[-1] >= 2 * len(t) + TIMESTAMPS.most_lost:
        raise RecordingError(
            f"{where}: {lost.sum()} of {index[-1] + 1} samples are missing by its time stamps, expected at "
            "most half. Are rows of several sensors merged? Export those of the accelerometer alone, or "
            "ignore the time stamps with --time-column none and --fs HZ (`time_column`, `fs_hz` in a card)"
        )
    said = {
        f"duplicates: {again.sum()} messages repeat stamp and values of the one before, dropped": again.any(),
        jumps: jumps,
        coarse: coarse,
        changed: changed,
        f"out of order: {n_moved} messages, put in the order of their stamps": n_moved,
        f"gaps: {lost.sum()} messages missing in {np.count_nonzero(lost)} gaps, interpolated": lost.any(),
        cut: cut,
    }
    return kept, t, index, [text for text, holds in said.items() if holds]


def _period(t: Samples) -> float:
    """Return the time from one sample to the next, in seconds, without gaps and bursts."""
    step, window = np.diff(t), TIMESTAMPS.level_window
    typical, mean = float(np.median(step)), float(t[-1] - t[0]) / len(step)
    # the mean step is long because of a few long gaps, not because messages come in bursts
    has_gaps = np.count_nonzero(step > mean) < 0.01 * len(step) and np.percentile(step, 10) > 0.5 * typical
    is_alike = np.mean(np.abs(step - typical) <= TIMESTAMPS.alike * typical) >= 0.5
    if typical > 0 and (has_gaps or (is_alike and typical > 0.2 * mean)):
        return typical_step(step)
    if len(step) > 2 * window:  # bursts, with gaps between some of them
        return typical_step(t[window:] - t[:-window]) / window or mean
    return mean


def _find_duplicates(
    stamps_ns: Timestamps, received_ns: Timestamps, repeats: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which messages repeat the one before, with the same stamp and the same values.

    Where values change about as often at equal stamps as at others, the clock is coarse and equal values are
    those of a sensor at rest; then only messages that were also received together are repeats.
    """
    equal = np.diff(stamps_ns, prepend=stamps_ns[:1] - 1) == 0
    again: NDArray[np.bool_] = equal & repeats
    if not again.any() or np.mean(~repeats[equal]) < TIMESTAMPS.coarse_clock * np.mean(~repeats[~equal]):
        return again
    step = np.diff(received_ns, prepend=received_ns[:1])
    together = step < 0.1 * np.median(step)
    return np.asarray(again & (received_ns != stamps_ns) & together)


def _spread_ticks(t: Samples) -> tuple[Samples, str]:
    """Space samples that share the ticks of a coarse clock evenly; only whole ticks count as missing."""
    first = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0)
    if len(first) < 4:
        return t, ""
    n_samples, step = np.diff(first, append=len(t)), np.diff(t[first])
    within = n_samples[1:-1]  # the recording begins and ends inside a tick
    tick = float(np.median(step))
    is_even = np.abs(step / tick - np.rint(step / tick)) < 0.01
    is_alike = within <= 2 * np.median(within) + 1
    if np.mean(n_samples > 1) < TIMESTAMPS.shared or min(is_even.mean(), is_alike.mean()) < 0.9:
        return t, ""
    is_whole = step < 1.5 * tick
    period = float(step[1:][is_whole[1:]].sum() / within[is_whole[1:]].sum())
    missing = np.append(0, np.cumsum(np.where(is_whole, 0.0, step - tick)))
    spread = t[0] + period * np.arange(len(t)) + np.repeat(missing, n_samples)
    return spread, f"coarse clock: {tick / period:.3g} samples per tick of {tick:.3g} s, evenly spaced"


def _one_rate(t: Samples) -> tuple[int, int, str]:
    """Return the longest half-open range of messages at one rate, and report a change of the rate."""
    n_blocks = len(t) // TIMESTAMPS.rate_block
    if n_blocks < 2 * TIMESTAMPS.least_blocks:
        return 0, len(t), ""
    steps = np.diff(t[: n_blocks * TIMESTAMPS.rate_block], prepend=t[0]).reshape(
        n_blocks, TIMESTAMPS.rate_block
    )[:, 1:]
    period = np.array([typical_step(row) for row in steps])
    if not (period > 0).all():
        return 0, len(t), ""
    is_new = np.abs(np.diff(np.log(period))) > np.log(1 + TIMESTAMPS.other_rate) / 2
    edges = np.concatenate(([0], np.flatnonzero(is_new) + 1, [n_blocks]))
    long = [(a, b) for a, b in pairwise(edges) if b - a >= TIMESTAMPS.least_blocks]
    rates = [float(np.median(period[a:b])) for a, b in long]
    if len(long) < 2 or max(rates) < (1 + TIMESTAMPS.other_rate) * min(rates):
        return 0, len(t), ""
    a, b = max(long, key=lambda run: run[1] - run[0])
    first, last = int(a) * TIMESTAMPS.rate_block, len(t) if b == n_blocks else int(b) * TIMESTAMPS.rate_block
    told = (
        f"divided: time stamps advance by {rates[0]:.4g} s, later by {rates[-1]:.4g} s; only the longest "
        f"stretch of one rate is used, {last - first} of {len(t)} messages"
    )
    return first, last, told


def _seconds(stamps_ns: Timestamps) -> Samples:
    """Return nanoseconds as seconds after the first; differences of hostile stamps may exceed 64 bits."""
    return (stamps_ns.astype(np.longdouble) - np.longdouble(stamps_ns[0])).astype(np.float64) / 1e9


def _bridge_clock_jumps(t: Samples, received: Samples) -> tuple[Samples, str]:
    """Replace the steps at which the clock of the stamps was set by those of the times of receipt."""
    if len(t) < 3:
        return t, ""
    step, real = np.diff(t), np.diff(received)
    typical = float(np.median(step))
    later = np.full(len(step), -np.inf)  # the largest of the next: does it pass the one before the step?
    for k in range(1, TIMESTAMPS.most_late + 1):
        later[:-k] = np.maximum(later[:-k], t[1 + k :])
    back = (step < 0) & (later <= t[:-1])
    back[-1] = False  # nothing follows that could tell
    forward = (step > TIMESTAMPS.clock_jump_s) & (step - real > TIMESTAMPS.clock_jump_s)
    jumped = back | forward
    if not jumped.any():
        return t, ""
    largest = float(step[jumped][np.argmax(np.abs(step[jumped]))])
    step[jumped] = np.maximum(real[jumped], max(typical, 0.0))
    told = (
        f"clock jumps: {np.count_nonzero(jumped)} (largest {largest:+.3g} s), bridged by the times of receipt"
    )
    return np.concatenate(([t[0]], t[0] + np.cumsum(step))), told


def typical_step(step: Samples) -> float:
    """Return the mean of the steps near their median: of 2 and 3 ms, where stamps are whole ones, 2.5."""
    typical = float(np.median(step))
    near = step[np.abs(step - typical) <= 0.6 * typical]
    return float(near.mean()) if len(near) else typical


def _lost_before(t: Samples, period: float) -> NDArray[np.int64]:
    """Return how many messages are missing before each one.

    After a loss all messages are later than counted; a message that was held up is late alone, for those
    after it catch up. Lateness is l[i] = t[i] - i T, and what counts is its smallest value on either side.
    """
    lost = np.zeros(len(t), np.int64)
    at = np.flatnonzero(np.diff(t) > 1.5 * period) + 1
    if not len(at):
        return lost
    late = np.append(t - period * np.arange(len(t)), np.inf)
    before = np.maximum(np.concatenate(([0], at[:-1])), at - TIMESTAMPS.level_window)
    after = np.minimum(np.concatenate((at[1:], [len(t)])), at + TIMESTAMPS.level_window)
    level_before = np.minimum.reduceat(late, np.column_stack((before, at)).ravel())[::2]
    level_after = np.minimum.reduceat(late, np.column_stack((at, after)).ravel())[::2]
    lost[at] = np.clip(np.rint((level_after - level_before) / period), 0, 2**40).astype(np.int64)
    return lost


def _longest_segment(lost: NDArray[np.int64], most: int, period: float) -> tuple[int, int, str]:
    """Return the longest half-open range of messages without a gap of more than `most` samples."""
    cuts = np.concatenate(([0], np.flatnonzero(lost[1:] > most) + 1, [len(lost)]))
    if len(cuts) == 2:
        return 0, len(lost), ""
    longest = int(np.argmax(np.diff(cuts)))
    first, last = int(cuts[longest]), int(cuts[longest + 1])
    told = (
        f"divided: {len(cuts) - 2} gaps of up to {lost[cuts[1:-1]].max() * period:.3g} s; only the longest "
        f"stretch between them is used, {last - first} of {len(lost)} messages"
    )
    return first, last, told


def nominal_rate(rate: float) -> float:
    """Return the roundest rate near a measured one, both in Hz: 100 for 99.98; 104.2 stays."""
    for digits in range(1, 6):
        if abs((rounded := float(f"{rate:.{digits}g}")) - rate) <= TIMESTAMPS.same_rate * rate:
            return rounded
    return rate


def resample(samples: Samples, fs: float, to: float) -> Samples:
    """Resample along the first axis, band-limited: a polyphase filter ends below both Nyquist frequencies.

    Parameters
    ----------
    samples : ndarray of shape (n,) or (n, n_channels)
        At `fs`.
    fs, to : float
        Rates in Hz.

    Returns
    -------
    resampled : ndarray of shape (round(n * to / fs), ...)

    Raises
    ------
    ValueError
        If a rate is not above 0, or they differ by more than a factor of 1000.
    """
    if not (fs > 0 and to > 0 and 1e-3 <= to / fs <= 1e3):
        raise ValueError(f"rates must be positive and at most a factor 1000 apart, got {fs} and {to} Hz")
    ratio = Fraction(to / fs).limit_denominator(1000)
    from scipy.signal import resample_poly  # a second, which a refusal before would wait for

    return np.asarray(resample_poly(samples, ratio.numerator, ratio.denominator, axis=0, padtype="line"))


def to_uniform_rate(
    samples: Samples,
    stamps_ns: Timestamps,
    received_ns: Timestamps,
    given: float | None,
    *,
    by_header: bool,
    where: str,
    by: str = "",
    rate_of: str = "",
) -> tuple[Samples, float, float, tuple[str, ...]]:
    """Return samples of messages at a uniform rate.

    Time stamps of a header are the times of samples, which are put there and interpolated (monotone cubic).
    Times of receipt are not: samples are then taken as evenly spaced, as where time stamps nearly are.

    Parameters
    ----------
    samples : ndarray of shape (n, k, n_channels)
        k samples a message.
    stamps_ns : ndarray of shape (n,)
        Time stamps, nanoseconds.
    received_ns : ndarray of shape (n,)
        When each message was received, nanoseconds; the order of the messages.
    given : float or None
        Rate in Hz that the user states; None: the nominal rate nearest to the measured one.
    by_header : bool
        Whether the stamps are of headers.
    where, by : str
        For messages of errors and flags: the file, and what the stamps are.
    rate_of : str
        File that states `given`; by default the user does.

    Returns
    -------
    uniform : ndarray of shape (n_uniform, n_channels)
    fs : float
        Its rate in Hz.
    start_s : float
        Stamp of its first sample, in seconds.
    flags : tuple of str
        What was wrong, measured and chosen.

    Raises
    ------
    RecordingError
        If fewer than two different instants are left, or the measured rate contradicts the given one.
    """
    limits = TIMESTAMPS
    repeats = np.append(False, np.all(samples[1:] == samples[:-1], axis=(1, 2)))
    messages, t, index, flags = _locate_samples(stamps_ns, received_ns, repeats, where)
    used, per_message = stamps_ns[messages], samples.shape[1]
    # t = T i + t0 by least squares; what is left over is the jitter, in periods
    centred = index - index.mean()
    period, level = np.polyfit(centred, t, 1)
    offset = (t - level) / period - centred
    jitter = float(np.sqrt(np.mean(offset**2)))
    resolution = float(np.gcd.reduce(np.diff(used))) / 1e9 / float(period)
    measured = float(1 / period) * per_message
    fs = nominal_rate(measured) if given is None else given
    by = by or ("header stamps" if by_header else "times of receipt")
    is_rough = jitter > limits.most_jitter
    if abs(measured - fs) > (limits.near_jittering if is_rough else limits.near_rate) * fs:
        raise rate_conflict_error(where, f"{measured:.6g} Hz by its {by}", fs, rate_of)
    tells = limits.kept_jitter < jitter <= limits.most_jitter and resolution <= limits.most_resolution
    at_stamps = tells and by_header and per_message == 1
    uniform = _interpolate_on_grid(samples[messages], index, offset if at_stamps else None)
    rate = f"rate: {measured:.6g} Hz by the {by}"
    if abs(measured - fs) > limits.same_rate * fs and not is_rough:
        uniform = resample(uniform, measured, fs)
        rate += f", resampled (band-limited) to {fs:g} Hz"
    elif f"{measured:.6g}" != f"{fs:.6g}":
        rate += f", taken as {fs:g} Hz"
    flags.append(rate)
    if jitter > limits.shown_jitter:
        chosen = "samples interpolated at their stamps" if at_stamps else "samples taken as evenly spaced"
        flags.append(f"jitter: {100 * jitter:.2g} % of a period (rms), {chosen}")
    return uniform, fs, float(used[0]) / 1e9, tuple(flags)


def _interpolate_on_grid(samples: Samples, index: NDArray[np.int64], offset: Samples | None) -> Samples:
    """Return samples at 0, 1, 2, ... periods; what is missing is interpolated.

    The messages are at `index`, in periods of theirs, or by an offset beside it.
    """
    n, per_message, n_channels = samples.shape
    flat = samples.reshape(n * per_message, n_channels)
    index = (index[:, None] * per_message + np.arange(per_message)).ravel()
    if offset is None and index[-1] + 1 == len(flat):
        return flat
    position = index.astype(np.float64)
    if offset is not None:
        position += offset
        later = np.concatenate(([True], np.diff(np.maximum.accumulate(position)) > 1e-6))
        position, flat = position[later], flat[later]
    grid = np.arange(index[-1] + 1, dtype=np.float64)
    if len(position) < 2:
        return flat
    with np.errstate(all="ignore"):  # of damaged numbers: what becomes infinite is refused as such
        from scipy.interpolate import PchipInterpolator

        return np.asarray(PchipInterpolator(position, flat, axis=0)(np.clip(grid, position[0], position[-1])))
