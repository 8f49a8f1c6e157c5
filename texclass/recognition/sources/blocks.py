"""Blocks: uniformly sampled data from a live source, with flags for faults of the source.

`BlockAssembler` converts messages with time stamps to blocks; `resampled` changes the sampling rate of a
source.
"""

from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.timestamps import TIMESTAMPS, nominal_rate, typical_step
from texclass.recording import RecordingError, Samples

Nanoseconds = NDArray[np.int64]

FILTER_HALF_WIDTH = 10
"""Half the length of the resampling filter in samples of the slower rate, as in `resample_poly` of SciPy."""


@dataclass(frozen=True)
class RateSettings:
    """Settings for the measurement of the sampling rate of a live source.

    Attributes
    ----------
    measure_s, min_messages
        Duration (s) and smallest number of messages over which the rate is measured, if none is stated.
    min_ties
        The clock counts as coarse if at least this many messages have the time stamp of their predecessor,
        but other samples.
    max_waiting
        Largest number of messages that are stored until the rate is measured.
    check_s
        Duration (s) over which the measured rate is compared with the stated one.
    change_s, change_ratio, step_tolerance
        The rate counts as changed if three conditions hold over `change_s` (s). The median step of the time
        stamps differs from the period by more than the fraction `change_ratio`. The mean step differs from
        the median by at most this fraction. At least 90 % of the steps agree with the median within the
        fraction `step_tolerance`.
    """

    measure_s: float = 1.0
    min_messages: int = 20
    min_ties: int = 3
    max_waiting: int = 100_000
    check_s: float = 2.0
    change_s: float = 0.25
    change_ratio: float = 0.25
    step_tolerance: float = 0.2


RATES = RateSettings()


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples at a uniform sampling rate.

    Attributes
    ----------
    t_s : float
        Time of the first sample in seconds: its time stamp, or the time since the start of the source.
    samples : ndarray of shape (n, n_channels)
        Samples; n is 0 in a block that only reports a fault.
    fs : float
        Sampling rate in Hz.
    unit : str
        Unit of the acceleration.
    n_lost : int
        Number of samples that were lost before this block and are not interpolated.
    flags : tuple of str
        Descriptions of faults since the previous block, such as gaps, duplicates or a wrong rate.
    age_s : float
        Delay of the last sample in seconds; 0 if the source does not measure it.
    native_fs : float, optional
        Sampling rate of the sensor in Hz, if the samples are resampled.

    Examples
    --------
    >>> block = Block(t_s=0.0, samples=np.zeros((25, 3)), fs=1000.0, unit="m/s^2")
    >>> block.samples.shape, block.n_lost
    ((25, 3), 0)
    """

    t_s: float
    samples: Samples
    fs: float
    unit: str
    n_lost: int = 0
    flags: tuple[str, ...] = ()
    age_s: float = 0.0
    native_fs: float | None = None


BlockSource = Generator[Block, None, None]
"""Generator of blocks with the same channels and unit; `close()` releases the source."""


class BlockAssembler:
    """Convert batches of messages with time stamps to blocks.

    - A gap of up to `TIMESTAMPS.max_gap` messages is interpolated; a longer one is counted in
      `Block.n_lost`.
    - If the time stamps advance regularly at another rate, the rate of the blocks changes.

    Parameters
    ----------
    fs : float or None
        Sampling rate in Hz. If None, it is measured from the first time stamps.
    unit : str
        Unit of the samples.

    Attributes
    ----------
    n_lost : int
        Number of missing samples, interpolated or not.

    Examples
    --------
    Three messages of one sample each; one message is missing before the third:

    >>> assembler = BlockAssembler(fs=100.0, unit="m/s^2")
    >>> timestamps = np.array([0, 10_000_000, 30_000_000])
    >>> (block,) = assembler.push(timestamps, timestamps, np.array([[[1.0]], [[2.0]], [[4.0]]]))
    >>> block.samples.ravel(), block.flags
    (array([1., 2., 3., 4.]), ('gaps: 1 samples interpolated',))
    """

    def __init__(self, fs: float | None, unit: str) -> None:
        self.fs, self.unit = fs, unit
        self.n_lost = 0
        self._waiting: list[tuple[Nanoseconds, Nanoseconds, Samples]] = []
        self._distinct = set[int]()
        self._n_waiting = 0
        self._uses_receipt = False
        self._n_ties = 0  # different messages with the time stamp of their predecessor
        self._tie_rank = 0  # number of messages with the time stamp of the last one, before it
        self._last: tuple[float, float, Samples] | None = None  # time stamp (s), receipt (s), message
        self._start_ns: int | None = None
        self._shape: tuple[int, ...] = ()
        self._periods: list[float] = []
        self._steps = np.empty(0)
        self._has_wrong_rate = False

    def push(self, timestamps_ns: Nanoseconds, receipt_ns: Nanoseconds, samples: Samples) -> list[Block]:
        """Process messages and return the blocks that they complete.

        Parameters
        ----------
        timestamps_ns, receipt_ns : ndarray of shape (n,)
            Time stamps, and times of sending or receipt, in nanoseconds.
        samples : ndarray of shape (n, k, n_channels)
            Messages of k samples each; the time stamp is that of the last sample.

        Returns
        -------
        blocks : list of Block
            Completed blocks; none while the rate is being measured.

        Raises
        ------
        RecordingError
            If the size of the messages changes, or all messages have the same time stamp and time of receipt.
        """
        if self._uses_receipt:
            timestamps_ns = receipt_ns
        if self._start_ns is None:
            self._start_ns, self._shape = int(timestamps_ns[0]), samples.shape[1:]
        if samples.shape[1:] != self._shape:
            raise RecordingError(
                f"messages must keep their shape (samples, channels) of {self._shape}, got "
                f"{samples.shape[1:]}"
            )
        if self.fs is None:
            return self._measure_rate(timestamps_ns, receipt_ns, samples)
        t, receipt = (timestamps_ns - self._start_ns) / 1e9, (receipt_ns - self._start_ns) / 1e9
        return self._assemble(t, receipt, samples, self._start_ns / 1e9, self.fs)

    def _measure_rate(
        self, timestamps_ns: Nanoseconds, receipt_ns: Nanoseconds, samples: Samples
    ) -> list[Block]:
        """Collect messages until they suffice to measure the rate, then return their blocks."""
        self._waiting.append((timestamps_ns, receipt_ns, samples))
        self._distinct.update(timestamps_ns.tolist())
        self._n_waiting += len(timestamps_ns)
        first_timestamps, first_receipt, _ = self._waiting[0]
        measure_ns = RATES.measure_s * 1e9
        is_stuck = len(self._distinct) == 1 and receipt_ns[-1] - first_receipt[0] >= measure_ns
        is_enough = (
            len(self._distinct) > RATES.min_messages
            and timestamps_ns.max() - first_timestamps.min() >= measure_ns
        )
        if not (is_enough or is_stuck) and self._n_waiting < RATES.max_waiting:
            return []
        timestamps_ns, receipt_ns, samples = (
            np.concatenate(arrays) for arrays in zip(*self._waiting, strict=True)
        )
        self._waiting, self._distinct = [], set()
        if is_stuck:
            self._uses_receipt, self._start_ns, timestamps_ns = True, int(receipt_ns[0]), receipt_ns
        self.fs = nominal_rate(self._shape[0] / _period(timestamps_ns / 1e9))
        flag = "time stamps: all are equal, times of receipt are used"
        blocks = self.push(timestamps_ns, receipt_ns, samples)
        return [replace(block, flags=(flag,) * bool(is_stuck) + block.flags) for block in blocks]

    def _assemble(
        self, t: Samples, receipt: Samples, samples: Samples, start_s: float, fs: float
    ) -> list[Block]:
        """Return the blocks of messages; each gap that is too long to interpolate starts a new block."""
        period = samples.shape[1] / fs
        is_valid, flags = self._check_messages(t, receipt, samples, period)
        t, receipt, samples = t[is_valid], receipt[is_valid], samples[is_valid]
        if not len(t):
            t_s = start_s + (self._last[0] if self._last else 0.0)
            no_samples = np.empty((0, samples.shape[2]))
            return [Block(t_s, no_samples, fs, self.unit, 0, tuple(flags))] if flags else []
        if self._last is None:
            self._last = (t[0] - period, receipt[0] - period, samples[0])
        step, jump_flags = _steps(t, receipt, self._last, period)
        gap_ratio = 1.5  # a longer step, in periods, is a gap
        if is_coarse := self._n_ties >= RATES.min_ties:
            step, gap_ratio = self._spread_ties(step, period), 2.5
        new_period = None if is_coarse else self._changed_period(step, period)
        n_missing = np.where(step > gap_ratio * period, np.rint(step / period) - 1, 0).astype(np.int64)
        flags += jump_flags + self._check_rate(step / (1 + n_missing), period, fs)
        first_s = start_s - period + 1 / fs  # the time stamp of a message is that of its last sample
        blocks, previous = [], self._last[2]
        starts = [0, *np.flatnonzero(n_missing[1:] > TIMESTAMPS.max_gap) + 1]
        for start, stop in zip(starts, [*starts[1:], len(t)], strict=True):
            gaps, n_lost = n_missing[start:stop].copy(), 0
            if gaps[0] > TIMESTAMPS.max_gap:
                n_lost, gaps[0] = int(gaps[0]) * samples.shape[1], 0
            rows = _interpolate_gaps(previous, samples[start:stop], gaps)
            previous = samples[stop - 1]
            n_interpolated = int(gaps.sum()) * samples.shape[1]
            flags += [f"gaps: {n_interpolated} samples interpolated"] * (n_interpolated > 0)
            flags += [f"lost: {n_lost} samples"] * (n_lost > 0)
            self.n_lost += n_interpolated + n_lost
            t_s = first_s + t[start] - int(gaps[0]) * period
            blocks.append(Block(t_s, rows, fs, self.unit, n_lost, tuple(flags)))
            flags = []
        self._last = (float(t[-1]), float(receipt[-1]), samples[-1])
        if new_period is not None:
            self.fs, self._last = nominal_rate(samples.shape[1] / new_period), None
            self._has_wrong_rate, self._periods, self._steps = False, [], np.empty(0)
        return blocks

    def _changed_period(self, step: Samples, period: float) -> float | None:
        """Return the new period if the period of the last messages has changed, otherwise None."""
        self._steps = np.append(self._steps, step)
        n_recent = int(np.searchsorted(np.cumsum(self._steps[::-1]), RATES.change_s)) + 1
        n = max(RATES.min_messages, n_recent)
        self._steps = self._steps[-n:]
        median = float(np.median(self._steps))
        is_unchanged = abs(median - period) <= RATES.change_ratio * period
        if len(self._steps) < n or is_unchanged or not 1e-2 < median / period < 1e2:
            return None
        similar = self._steps[np.abs(self._steps - median) <= RATES.step_tolerance * median]
        # Times of receipt come in bursts: the steps within a burst are equal, but their mean is the old
        # period.
        is_regular = abs(self._steps.mean() - median) <= RATES.change_ratio * median
        return float(similar.mean()) if is_regular and len(similar) >= 0.9 * n else None

    def _spread_ties(self, step: Samples, period: float) -> Samples:
        """Return steps in which messages that share a tick of a coarse clock are one period apart."""
        spread = step.copy()
        for i, is_tie in enumerate((step == 0).tolist()):
            spread[i] = period if is_tie else step[i] - self._tie_rank * period
            self._tie_rank = self._tie_rank + 1 if is_tie else 0
        return spread

    def _check_messages(
        self, t: Samples, receipt: Samples, samples: Samples, period: float
    ) -> tuple[NDArray[np.bool_], list[str]]:
        """Return a mask of the valid messages, and flags for duplicate, late and non-finite messages.

        If messages with equal time stamps have different values, the clock is coarse. Repeated messages then
        count as duplicates only if they were also received together.
        """
        earlier = np.concatenate(([self._last[0] if self._last else -np.inf], t))
        previous = samples[:1] if self._last is None else self._last[2][None]
        is_repeated = np.all(samples == np.concatenate((previous, samples[:-1])), axis=(1, 2))
        delay = np.maximum.accumulate(earlier)[:-1] - t
        is_tie = np.diff(earlier) == 0
        self._n_ties += int(np.count_nonzero(is_tie & ~is_repeated))
        is_duplicate = is_tie & is_repeated
        if self._n_ties >= RATES.min_ties:
            last_receipt = self._last[1] if self._last else -np.inf
            is_duplicate &= np.diff(receipt, prepend=last_receipt) < 0.1 * period
        faults = {
            "duplicates": is_duplicate,
            "out of order": (delay > 0) & (delay <= TIMESTAMPS.max_overtaking * period),
            "not finite": ~np.isfinite(samples).all(axis=(1, 2)),
        }
        flags = [f"{name}: {n} messages left out" for name, mask in faults.items() if (n := mask.sum())]
        return ~np.any(list(faults.values()), axis=0), flags

    def _check_rate(self, periods: Samples, period: float, fs: float) -> list[str]:
        """Return a flag when the time stamps begin to contradict the sampling rate."""
        self._periods += periods.tolist()
        if len(self._periods) < max(RATES.min_messages, RATES.check_s / period):
            return []
        ratio = period / max(float(np.mean(self._periods)), 1e-12)
        had_wrong_rate = self._has_wrong_rate
        self._periods, self._has_wrong_rate = [], abs(ratio - 1) > TIMESTAMPS.near_rate
        if not self._has_wrong_rate or had_wrong_rate:
            return []
        return [f"rate: {ratio * fs:.4g} Hz by the time stamps, but {fs:g} Hz is assumed"]


def _period(timestamps: Samples) -> float:
    """Return the period in seconds of time stamps, some of which may be equal.

    Raises
    ------
    RecordingError
        If all time stamps are equal.
    """
    ticks, n = np.unique(timestamps, return_counts=True)
    if len(ticks) < 2:
        raise RecordingError(
            f"the time stamps of all {len(timestamps)} messages are equal. Expected increasing time stamps, "
            "or pass the sampling rate with --fs"
        )
    step = np.diff(ticks)
    if (
        len(ticks) > 3 and np.mean(n[1:-1] > 1) >= TIMESTAMPS.shared_ticks
    ):  # the first and last tick may be incomplete
        return float(ticks[-1] - ticks[1]) / float(n[1:-1].sum())
    return typical_step(step) if np.median(step) > 0.2 * step.mean() else float(step.mean())


def _steps(
    t: Samples, receipt: Samples, last: tuple[float, float, Samples], period: float
) -> tuple[Samples, list[str]]:
    """Return the steps of the time stamps (of the times of receipt, where the clock jumps), and any flag."""
    step, receipt_step = np.diff(t, prepend=last[0]), np.diff(receipt, prepend=last[1])
    is_jump = (step < -TIMESTAMPS.max_overtaking * period) | (
        (step > TIMESTAMPS.clock_jump_s) & (step - receipt_step > TIMESTAMPS.clock_jump_s)
    )
    if not is_jump.any():
        return step, []
    largest = np.max(np.abs(step[is_jump]))
    flag = f"clock jumps: {np.count_nonzero(is_jump)} (largest {largest:.3g} s)"
    return np.where(is_jump, np.maximum(receipt_step, period), step), [flag]


def _interpolate_gaps(previous: Samples, samples: Samples, n_missing: NDArray[np.int64]) -> Samples:
    """Return the samples of messages (n, k, n_channels), interpolating `n_missing` messages before each."""
    k, n_channels = samples.shape[1:]
    rows = samples.reshape(-1, n_channels)
    if not n_missing.any():
        return rows
    rows = np.concatenate((previous, rows))
    positions = np.arange(len(rows)) + np.concatenate((np.zeros(k), np.repeat(np.cumsum(n_missing), k) * k))
    grid = np.arange(k, positions[-1] + 1)
    return np.stack([np.interp(grid, positions, column) for column in rows.T], axis=-1)


class Resampler:
    """Polyphase resampling of a stream by the factor P / Q: y[m] = sum over k of h[mQ - kP] x[k].

    The result does not depend on the block size. Each output sample is returned as soon as all input samples
    that it depends on are available.

    Parameters
    ----------
    fs, new_fs : float
        Sampling rates of input and output in Hz.

    Raises
    ------
    ValueError
        If a rate is not positive, or the rates differ by more than a factor of 1000.

    Attributes
    ----------
    n_out : int
        Number of output samples returned so far.

    Examples
    --------
    >>> resampler = Resampler(fs=1000, new_fs=500)
    >>> resampler.push(np.ones((100, 1))).shape, resampler.n_pending
    ((40, 1), 10)
    """

    def __init__(self, fs: float, new_fs: float) -> None:
        if not (fs > 0 and new_fs > 0 and 1e-3 <= new_fs / fs <= 1e3):
            raise ValueError(
                f"cannot resample from {fs} Hz to {new_fs} Hz. Expected positive rates, "
                "at most a factor of 1000 apart"
            )
        ratio = Fraction(new_fs / fs).limit_denominator(1000)
        self._p, self._q = ratio.numerator, ratio.denominator
        slower = max(self._p, self._q)
        self._half = FILTER_HALF_WIDTH * slower
        if slower > 1:
            from scipy.signal import firwin

            self._h = self._p * firwin(2 * self._half + 1, 1 / slower, window=("kaiser", 5.0))
        # Zeros before the first sample align y[0] with the output grid of `upfirdn`.
        self._n_zeros = -FILTER_HALF_WIDTH % self._q if self._p > self._q else 0
        self._x: Samples | None = None
        self._n_in = self.n_out = 0
        self._shift = -(self._half + self._n_zeros * self._p) // self._q

    @property
    def n_pending(self) -> int:
        """Number of output samples that are still in the filter."""
        return round(self._n_in * self._p / self._q) - self.n_out

    def push(self, x: Samples) -> Samples:
        """Filter samples of shape (n, n_channels) and return the output samples that they complete."""
        self._n_in += len(x)
        if self._p == self._q:
            self.n_out += len(x)
            return x
        history = np.zeros((self._n_zeros, x.shape[1])) if self._x is None else self._x
        self._x = np.concatenate((history, x))
        stop = max(self.n_out, -((self._half - self._n_in * self._p) // self._q))
        first = self.n_out - self._shift
        if stop == self.n_out:
            return self._x[:0]
        from scipy.signal import upfirdn

        y = upfirdn(self._h, self._x, self._p, self._q, axis=0)[first : stop - self._shift]
        oldest = ((stop - self._shift) * self._q - 2 * self._half) // self._p
        n_drop = max(0, oldest) // self._q * self._q
        self._x, self._shift = self._x[n_drop:], self._shift + n_drop * self._p // self._q
        self.n_out = stop
        return np.asarray(y)


def resampled(source: BlockSource, rate: float) -> BlockSource:
    """Resample a source to another rate in Hz, with a band-limiting filter.

    The filter restarts after lost samples and after a change of the rate of the source. Samples that were
    still in the filter then count as lost.
    """
    resampler: Resampler | None = None
    start_s, fs, n_lost = 0.0, 0.0, 0
    with closing(source):
        for block in source:
            if block.n_lost:
                n_lost += round(block.n_lost * rate / block.fs)
            if not len(block.samples):  # a report of a fault, perhaps before the rate has been measured
                yield replace(block, fs=rate, n_lost=0)
                if block.n_lost and resampler:
                    n_lost += resampler.n_pending
                    resampler = None
                continue
            flags = block.flags
            if resampler is None or block.n_lost or block.fs != fs:
                if block.fs not in (fs, rate):
                    flags = (*flags, f"resampled (band-limited) from {block.fs:g} Hz to {rate:g} Hz")
                if fs not in (0.0, block.fs):
                    flags = (
                        *flags,
                        f"restart: the source rate changed from {fs:g} to {block.fs:g} Hz",
                    )
                    n_lost = max(n_lost, 1)
                n_lost += resampler.n_pending if resampler else 0
                resampler, start_s, fs = Resampler(block.fs, rate), block.t_s, block.fs
            t_s = start_s + resampler.n_out / rate
            y = resampler.push(block.samples)
            if len(y) or flags:
                n_before = n_lost if len(y) else 0
                yield Block(t_s, y, rate, block.unit, n_before, flags, block.age_s, min(fs, rate))
                n_lost -= n_before
        if n_lost:
            yield Block(start_s, block.samples[:0], rate, block.unit, n_lost)
