"""What a live source yields: blocks of samples at a uniform rate; what was wrong is said and survived.

Stamped messages become blocks in `Timing`; `resampled` gives a source another rate.
"""

from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.timestamps import TIMESTAMPS, nominal_rate, typical_step
from texclass.recording import RecordingError, Samples

Stamps = NDArray[np.int64]

HALF_WIDTH = 10
"""Samples of the slower rate on either side that count for one sample; as in `scipy.signal.resample_poly`."""


@dataclass(frozen=True)
class RateRules:
    """How the sampling rate of a live source is measured and checked.

    Attributes
    ----------
    learned_s, learned_messages
        A rate that nobody states is measured over so many seconds, and at least so many messages.
    shared
        Messages that differ at an equal stamp from which a clock is coarse, not a message sent twice.
    max_waiting
        Messages that may wait for the rate to be known.
    checked_s
        The rate is checked against the stated one over so many seconds.
    changed_s, other_rate, same_step
        The rate has changed by more than the share `other_rate` when stamps of so many seconds say so: nine
        steps in ten alike within the share `same_step`.
    """

    learned_s: float = 1.0
    learned_messages: int = 20
    shared: int = 3
    max_waiting: int = 100_000
    checked_s: float = 2.0
    changed_s: float = 0.25
    other_rate: float = 0.25
    same_step: float = 0.2


RATES = RateRules()


@dataclass(frozen=True, eq=False)
class Block:
    """Samples that follow each other at a uniform rate.

    Attributes
    ----------
    t_s : float
        Instant of the first sample, seconds: by the clock of the stamps of a topic, else since the start.
    samples : ndarray of shape (n, n_channels)
        n is 0 in a block that only reports (nothing came for a while).
    fs : float
        Sampling rate in Hz.
    unit : str
        Of the samples.
    lost : int
        Samples missing between the block before and this one: what is not to be bridged must start anew.
    flags : tuple of str
        What was wrong since the block before: gaps, duplicates, clock jumps, a wrong rate.
    age_s : float
        Seconds that the last sample took to come, as far as the source knows.
    native_fs : float, optional
        Rate in Hz of the sensor, where the samples are resampled.
    """

    t_s: float
    samples: Samples
    fs: float
    unit: str
    lost: int = 0
    flags: tuple[str, ...] = ()
    age_s: float = 0.0
    native_fs: float | None = None


BlockSource = Generator[Block, None, None]
"""Yields blocks until the source ends, all of the same channels and unit; `close` lets go of it."""


class Timing:
    """Turns batches of stamped messages into blocks.

    A gap of up to `TIMESTAMPS.max_gap` messages is interpolated; after a longer one, the next block says
    what is lost.
    Where the stamps advance by another step than before, and regularly, blocks are of that rate from then on.

    Parameters
    ----------
    fs : float or None
        Rate of the samples in Hz; None: measured first, from the stamps. It follows them where it changes.
    unit : str
        Of the samples.

    Attributes
    ----------
    n_lost : int
        Samples that were missing, interpolated or not.
    """

    def __init__(self, fs: float | None, unit: str) -> None:
        self.fs, self.unit = fs, unit
        self.n_lost = 0
        self._waiting: list[tuple[Stamps, Stamps, Samples]] = []
        self._distinct = set[int]()
        self._n_waiting = 0
        self._by_receipt = False
        self._n_shared, self._rank = (
            0,
            0,
        )  # messages that changed at an equal stamp; place of the last in its tick
        self._last: tuple[float, float, Samples] | None = None  # stamp, sent (s), message
        self._start_ns: int | None = None
        self._shape: tuple[int, ...] = ()
        self._periods: list[float] = []
        self._steps = np.empty(0)
        self._is_wrong = False

    def push(self, stamps_ns: Stamps, sent_ns: Stamps, samples: Samples) -> list[Block]:
        """Take messages and return the blocks they make.

        Parameters
        ----------
        stamps_ns, sent_ns : ndarray of shape (n,)
            Stamps, and when they were sent or received, nanoseconds.
        samples : ndarray of shape (n, k, n_channels)
            k samples a message, the last one at the stamp.

        Returns
        -------
        blocks : list of Block
            Empty while the rate is being measured.

        Raises
        ------
        RecordingError
            If the size of the messages changes, or all have one stamp and one time of receipt.
        """
        if self._by_receipt:
            stamps_ns = sent_ns
        if self._start_ns is None:
            self._start_ns, self._shape = int(stamps_ns[0]), samples.shape[1:]
        if samples.shape[1:] != self._shape:
            raise RecordingError(
                f"messages of {samples.shape[1:]} samples and channels after {self._shape}. Expected one size"
            )
        if self.fs is None:
            self._waiting.append((stamps_ns, sent_ns, samples))
            self._distinct.update(stamps_ns.tolist())
            self._n_waiting += len(stamps_ns)
            first_stamps, first_sent, _ = self._waiting[0]
            is_stuck = len(self._distinct) == 1 and sent_ns[-1] - first_sent[0] >= RATES.learned_s * 1e9
            is_enough = (
                len(self._distinct) > RATES.learned_messages
                and stamps_ns.max() - first_stamps.min() >= RATES.learned_s * 1e9
            )
            if not (is_enough or is_stuck) and self._n_waiting < RATES.max_waiting:
                return []
            stamps_ns, sent_ns, samples = (np.concatenate(all_) for all_ in zip(*self._waiting, strict=True))
            self._waiting, self._distinct = [], set()
            if is_stuck:
                self._by_receipt, self._start_ns, stamps_ns = True, int(sent_ns[0]), sent_ns
            self.fs = nominal_rate(self._shape[0] / _period(stamps_ns / 1e9))
            told = "stamps: those of the headers stand still, times of receipt are used"
            blocks = self.push(stamps_ns, sent_ns, samples)
            return [replace(block, flags=(told,) * bool(is_stuck) + block.flags) for block in blocks]
        t, sent = (stamps_ns - self._start_ns) / 1e9, (sent_ns - self._start_ns) / 1e9
        return self._blocks(t, sent, samples, self._start_ns / 1e9, self.fs)

    def _blocks(self, t: Samples, sent: Samples, samples: Samples, start_s: float, fs: float) -> list[Block]:
        period = samples.shape[1] / fs
        kept, flags = self._usable(t, sent, samples, period)
        t, sent, samples = t[kept], sent[kept], samples[kept]
        if not len(t):
            at = start_s + (self._last[0] if self._last else 0.0)
            nothing = np.empty((0, samples.shape[2]))
            return [Block(at, nothing, fs, self.unit, 0, tuple(flags))] if flags else []
        if self._last is None:
            self._last = (t[0] - period, sent[0] - period, samples[0])
        step, jumps = _steps(t, sent, self._last, period)
        least = 1.5
        if is_coarse := self._n_shared >= RATES.shared:
            step, least = self._evenly_in_ticks(step, period), 2.5
        changed = None if is_coarse else self._changed(step, period)
        lost = np.where(step > least * period, np.rint(step / period) - 1, 0).astype(np.int64)
        flags += jumps + self._contradicted(step / (1 + lost), period, fs)
        first_s = start_s - period + 1 / fs  # the last sample of a message stands at its stamp
        made, previous = [], self._last[2]
        starts = [0, *np.flatnonzero(lost[1:] > TIMESTAMPS.max_gap) + 1]
        for start, stop in zip(starts, [*starts[1:], len(t)], strict=True):
            gaps, missing = lost[start:stop].copy(), 0
            if gaps[0] > TIMESTAMPS.max_gap:
                missing, gaps[0] = int(gaps[0]) * samples.shape[1], 0
            pieces = _bridged(previous, samples[start:stop], gaps)
            previous = samples[stop - 1]
            n_bridged = int(gaps.sum()) * samples.shape[1]
            flags += [f"gaps: {n_bridged} samples interpolated"] * (n_bridged > 0)
            flags += [f"lost: {missing} samples"] * (missing > 0)
            self.n_lost += n_bridged + missing
            at = first_s + t[start] - int(gaps[0]) * period
            made.append(Block(at, pieces, fs, self.unit, missing, tuple(flags)))
            flags = []
        self._last = (float(t[-1]), float(sent[-1]), samples[-1])
        if changed is not None:
            self.fs, self._last, self._is_wrong = nominal_rate(samples.shape[1] / changed), None, False
            self._periods, self._steps = [], np.empty(0)
        return made

    def _changed(self, step: Samples, period: float) -> float | None:
        """Return the period of the last messages, if it is another; messages lost here and there are not."""
        self._steps = np.append(self._steps, step)
        n = max(
            RATES.learned_messages, int(np.searchsorted(np.cumsum(self._steps[::-1]), RATES.changed_s)) + 1
        )
        self._steps = self._steps[-n:]
        typical = float(np.median(self._steps))
        is_old = abs(typical - period) <= RATES.other_rate * period
        if len(self._steps) < n or is_old or not 1e-2 < typical / period < 1e2:
            return None
        alike = self._steps[np.abs(self._steps - typical) <= RATES.same_step * typical]
        # Stamps of receipt come in bursts: alike within one, and their mean is the old period.
        is_even = abs(self._steps.mean() - typical) <= RATES.other_rate * typical
        return float(alike.mean()) if is_even and len(alike) >= 0.9 * n else None

    def _evenly_in_ticks(self, step: Samples, period: float) -> Samples:
        """Return the steps of messages that share the ticks of a coarse clock, one period apart there."""
        even = step.copy()
        for i, is_same in enumerate((step == 0).tolist()):
            even[i] = period if is_same else step[i] - self._rank * period
            self._rank = self._rank + 1 if is_same else 0
        return even

    def _usable(
        self, t: Samples, sent: Samples, samples: Samples, period: float
    ) -> tuple[NDArray[np.bool_], list[str]]:
        """Return which messages neither come twice nor after a later one, and what is left out.

        Where values change at equal stamps, the clock is coarse: then only messages that were also received
        together come twice.
        """
        before = np.concatenate(([self._last[0] if self._last else -np.inf], t))
        previous = samples[:1] if self._last is None else self._last[2][None]
        same = np.all(samples == np.concatenate((previous, samples[:-1])), axis=(1, 2))
        late = np.maximum.accumulate(before)[:-1] - t
        is_equal = np.diff(before) == 0
        self._n_shared += int(np.count_nonzero(is_equal & ~same))
        twice = is_equal & same
        if self._n_shared >= RATES.shared:
            twice &= np.diff(sent, prepend=self._last[1] if self._last else -np.inf) < 0.1 * period
        wrong = {
            "duplicates": twice,
            "out of order": (late > 0) & (late <= TIMESTAMPS.max_overtaking * period),
            "not finite": ~np.isfinite(samples).all(axis=(1, 2)),
        }
        said = [f"{what}: {n} messages left out" for what, bad in wrong.items() if (n := bad.sum())]
        return ~np.any(list(wrong.values()), axis=0), said

    def _contradicted(self, periods: Samples, period: float, fs: float) -> list[str]:
        """Say when the stamps contradict the rate, once until they agree again."""
        self._periods += periods.tolist()
        if len(self._periods) < max(RATES.learned_messages, RATES.checked_s / period):
            return []
        measured = period / max(float(np.mean(self._periods)), 1e-12)
        self._periods, was_wrong = [], self._is_wrong
        self._is_wrong = abs(measured - 1) > TIMESTAMPS.near_rate
        if not self._is_wrong or was_wrong:
            return []
        return [f"rate: {measured * fs:.4g} Hz by the stamps, {fs:g} Hz is assumed"]


def _period(stamps: Samples) -> float:
    """Return the period in seconds by stamps, of which several may be equal.

    Raises
    ------
    RecordingError
        If all are equal.
    """
    ticks, n = np.unique(stamps, return_counts=True)
    if len(ticks) < 2:
        raise RecordingError(f"{len(stamps)} messages have one time stamp. Expected an increase, or --fs")
    step = np.diff(ticks)
    if (
        len(ticks) > 3 and np.mean(n[1:-1] > 1) >= TIMESTAMPS.shared_ticks
    ):  # the first and the last may be cut
        return float(ticks[-1] - ticks[1]) / float(n[1:-1].sum())
    return typical_step(step) if np.median(step) > 0.2 * step.mean() else float(step.mean())


def _steps(
    t: Samples, sent: Samples, last: tuple[float, float, Samples], period: float
) -> tuple[Samples, list[str]]:
    """Return the steps of stamps, those of the times of sending where the clock jumps, and say if it does."""
    step, real = np.diff(t, prepend=last[0]), np.diff(sent, prepend=last[1])
    jumped = (step < -TIMESTAMPS.max_overtaking * period) | (
        (step > TIMESTAMPS.clock_jump_s) & (step - real > TIMESTAMPS.clock_jump_s)
    )
    if not jumped.any():
        return step, []
    largest = np.max(np.abs(step[jumped]))
    said = f"clock jumps: {np.count_nonzero(jumped)} (largest {largest:.3g} s)"
    return np.where(jumped, np.maximum(real, period), step), [said]


def _bridged(previous: Samples, samples: Samples, lost: NDArray[np.int64]) -> Samples:
    """Return the samples of messages (n, k, n_channels), straight lines where `lost` are missing."""
    k, n_channels = samples.shape[1:]
    flat = samples.reshape(-1, n_channels)
    if not lost.any():
        return flat
    flat = np.concatenate((previous, flat))
    where = np.arange(len(flat)) + np.concatenate((np.zeros(k), np.repeat(np.cumsum(lost), k) * k))
    grid = np.arange(k, where[-1] + 1)
    return np.stack([np.interp(grid, where, column) for column in flat.T], axis=-1)


class Resampler:
    """y[m] = sum over k of h[mQ - kP] x[k] for a rate P / Q times the old one, as soon as all x[k] are there.

    The same numbers for any division of x into pieces.

    Parameters
    ----------
    fs, to : float
        Rates in Hz.

    Raises
    ------
    ValueError
        If a rate is not above 0, or they differ by more than a factor of 1000.

    Attributes
    ----------
    n_out : int
        Samples returned so far.
    """

    def __init__(self, fs: float, to: float) -> None:
        if not (fs > 0 and to > 0 and 1e-3 <= to / fs <= 1e3):
            raise ValueError(
                f"cannot resample from {fs} Hz to {to} Hz. Expected positive rates, "
                "at most a factor of 1000 apart"
            )
        ratio = Fraction(to / fs).limit_denominator(1000)
        self._p, self._q = ratio.numerator, ratio.denominator
        slower = max(self._p, self._q)
        self._half = HALF_WIDTH * slower
        if slower > 1:
            from scipy.signal import firwin

            self._h = self._p * firwin(2 * self._half + 1, 1 / slower, window=("kaiser", 5.0))
        # Zeros before the first sample, as many as put y[0] on the grid of what `upfirdn` returns.
        self._n_zeros = -HALF_WIDTH % self._q if self._p > self._q else 0
        self._x: Samples | None = None
        self._n_in = self.n_out = 0
        self._shift = -(self._half + self._n_zeros * self._p) // self._q

    @property
    def n_held(self) -> int:
        """Samples at the new rate that were taken and not returned."""
        return round(self._n_in * self._p / self._q) - self.n_out

    def push(self, x: Samples) -> Samples:
        """Take samples of shape (n, n_channels) and return those that are complete, of the same form."""
        self._n_in += len(x)
        if self._p == self._q:
            self.n_out += len(x)
            return x
        before = np.zeros((self._n_zeros, x.shape[1])) if self._x is None else self._x
        self._x = np.concatenate((before, x))
        stop = max(self.n_out, -((self._half - self._n_in * self._p) // self._q))
        first = self.n_out - self._shift
        if stop == self.n_out:
            return self._x[:0]
        from scipy.signal import upfirdn

        y = upfirdn(self._h, self._x, self._p, self._q, axis=0)[first : stop - self._shift]
        oldest = ((stop - self._shift) * self._q - 2 * self._half) // self._p
        drop = max(0, oldest) // self._q * self._q
        self._x, self._shift = self._x[drop:], self._shift + drop * self._p // self._q
        self.n_out = stop
        return np.asarray(y)


def resampled(source: BlockSource, rate: float) -> BlockSource:
    """Return a source at another rate in Hz, band-limited; it starts anew after a loss, and at a new rate.

    What is lost, and what the filter held when it started anew, counts as lost before the next samples.
    """
    resampler: Resampler | None = None
    start_s, was, lost = 0.0, 0.0, 0
    with closing(source):
        for block in source:
            if block.lost:  # else the rate may not be known yet
                lost += round(block.lost * rate / block.fs)
            if not len(block.samples):  # it only reports, perhaps before any rate is known
                yield replace(block, fs=rate, lost=0)
                if block.lost and resampler:
                    lost += resampler.n_held
                    resampler = None
                continue
            flags = block.flags
            if resampler is None or block.lost or block.fs != was:
                if block.fs not in (was, rate):
                    flags = (*flags, f"resampled (band-limited) from {block.fs:g} Hz to {rate:g} Hz")
                if was not in (0.0, block.fs):
                    flags = (*flags, f"begun anew: the source is now {block.fs:g} Hz, was {was:g} Hz")
                    lost = max(lost, 1)
                lost += resampler.n_held if resampler else 0
                resampler, start_s, was = Resampler(block.fs, rate), block.t_s, block.fs
            at = start_s + resampler.n_out / rate
            y = resampler.push(block.samples)
            if len(y) or flags:
                yield Block(at, y, rate, block.unit, lost * bool(len(y)), flags, block.age_s, min(was, rate))
                lost *= not len(y)
        if lost:
            yield Block(start_s, block.samples[:0], rate, block.unit, lost)
