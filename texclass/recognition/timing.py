"""Stamped messages as they arrive -> blocks at a uniform rate; what is wrong is said and survived."""

import numpy as np
from numpy.typing import NDArray

from texclass.loaders.stamps import CLOCK_JUMP_S, MOST_LATE, MOST_LOST, usual_step
from texclass.loaders.uniform import NEAR_RATE, nominal_rate
from texclass.recognition.blocks import Block
from texclass.recording import RecordingError, Samples

Stamps = NDArray[np.int64]

LEARNED_S, LEARNED_MESSAGES = 1.0, 20
"""A rate that nobody states is measured over so many seconds, and at least so many messages."""
MOST_WAITING = 100_000
"""Messages that may wait for the rate to be known."""
CHECKED_S = 2.0
"""The rate is checked against the stated one over so many seconds."""


class Timing:
    """Turns batches of stamped messages into blocks.

    A gap of up to `MOST_LOST` messages is interpolated; after a longer one, the next block says what is lost.

    Parameters
    ----------
    fs : float or None
        Rate of the samples in Hz; None: measured first, from the stamps.
    unit : str
        Of the samples.
    """

    def __init__(self, fs: float | None, unit: str) -> None:
        self.fs, self.unit = fs, unit
        self.n_lost = 0
        self._waiting: list[tuple[Stamps, Stamps, Samples]] = []
        self._last: tuple[float, float, Samples] | None = None  # stamp, sent (s), message
        self._start_ns: int | None = None
        self._shape: tuple[int, ...] = ()
        self._checked: list[float] = []
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
            If the size of the messages changes, or all bear one stamp.
        """
        if self._start_ns is None:
            self._start_ns, self._shape = int(stamps_ns[0]), samples.shape[1:]
        if samples.shape[1:] != self._shape:
            raise RecordingError(
                f"messages of {samples.shape[1:]} samples and channels after {self._shape}; "
                "the rule is one size"
            )
        if self.fs is None:
            self._waiting.append((stamps_ns, sent_ns, samples))
            if not self._learn():
                return []
            stamps_ns, sent_ns, samples = (
                np.concatenate(parts) for parts in zip(*self._waiting, strict=True)
            )
            self._waiting = []
        return self._blocks((stamps_ns - self._start_ns) / 1e9, (sent_ns - self._start_ns) / 1e9, samples)

    def _learn(self) -> bool:
        """Measure the rate if there is enough to do so; return whether it is known."""
        stamps = np.concatenate([part[0] for part in self._waiting])
        t = np.unique(stamps) / 1e9
        is_enough = len(t) > LEARNED_MESSAGES and t[-1] - t[0] >= LEARNED_S
        if not is_enough and len(stamps) < MOST_WAITING:
            return False
        if len(t) < 2:
            raise RecordingError(
                f"{len(stamps)} messages bear one stamp; the rule is stamps that advance, or --fs"
            )
        step = np.diff(t)
        period = usual_step(step) if np.median(step) > 0.2 * step.mean() else float(step.mean())
        self.fs = nominal_rate(self._waiting[0][2].shape[1] / period)
        return True

    def _blocks(self, t: Samples, sent: Samples, samples: Samples) -> list[Block]:
        assert self.fs is not None
        period = samples.shape[1] / self.fs
        flags: list[str] = []
        t, sent, samples = self._in_order(t, sent, samples, period, flags)
        if not len(t):
            return [self._report(samples, flags)] if flags else []
        if self._last is None:
            self._last = (t[0] - period, sent[0] - period, samples[0])
        step = np.diff(t, prepend=self._last[0])
        real = np.diff(sent, prepend=self._last[1])
        jumped = (step < -MOST_LATE * period) | ((step > CLOCK_JUMP_S) & (step - real > CLOCK_JUMP_S))
        if jumped.any():
            flags.append(
                f"clock jumps: {np.count_nonzero(jumped)} (largest {np.max(np.abs(step[jumped])):.3g} s)"
            )
            step = np.where(jumped, np.maximum(real, period), step)
        lost = np.where(step > 1.5 * period, np.rint(step / period) - 1, 0).astype(np.int64)
        self._check_rate(t, step, lost, period, flags)
        made = self._cut(t, samples, lost, flags)
        self._last = (float(t[-1]), float(sent[-1]), samples[-1])
        return made

    def _in_order(
        self, t: Samples, sent: Samples, samples: Samples, period: float, flags: list[str]
    ) -> tuple[Samples, Samples, Samples]:
        """Leave out messages that come twice, or after a later one."""
        before = np.concatenate(([self._last[0] if self._last else -np.inf], t))
        step = np.diff(before)
        previous = samples[:1] if self._last is None else self._last[2][None]
        same = np.all(samples == np.concatenate((previous, samples[:-1])), axis=(1, 2))
        twice = (step == 0) & same
        late = np.maximum.accumulate(before)[:-1] - t
        overtaken = (late > 0) & (late <= MOST_LATE * period)
        broken = ~np.isfinite(samples).all(axis=(1, 2))
        for wrong, what in ((twice, "duplicates"), (overtaken, "out of order"), (broken, "not finite")):
            if n := np.count_nonzero(wrong):
                flags.append(f"{what}: {n} messages left out")
        kept = ~(twice | overtaken | broken)
        return t[kept], sent[kept], samples[kept]

    def _cut(self, t: Samples, samples: Samples, lost: NDArray[np.int64], flags: list[str]) -> list[Block]:
        """Return blocks divided where more than can be bridged is missing."""
        assert self.fs is not None
        assert self._last is not None
        n_channels, per_message = samples.shape[2], samples.shape[1]
        first_s = (self._start_ns or 0) / 1e9 - (per_message - 1) / self.fs
        starts = [0, *np.flatnonzero(lost[1:] > MOST_LOST) + 1]
        blocks = []
        for start, stop in zip(starts, [*starts[1:], len(t)], strict=True):
            gap = int(lost[start])
            previous = self._last[2] if start == 0 else samples[start - 1]
            bridged = gap if gap <= MOST_LOST else 0
            pieces = _bridge(previous, samples[start:stop], np.append(bridged, lost[start + 1 : stop]))
            said = (
                [f"gaps: {n * per_message} samples interpolated"]
                if (n := _total(lost, start, stop, bridged))
                else []
            )
            missing = (gap - bridged) * per_message
            said += [f"lost: {missing} samples"] if missing else []
            self.n_lost += (gap + int(lost[start + 1 : stop].sum())) * per_message
            at = first_s + t[start] - bridged * per_message / self.fs
            blocks.append(
                Block(at, pieces.reshape(-1, n_channels), self.fs, self.unit, missing, (*flags, *said))
            )
            flags = []
        return blocks

    def _check_rate(
        self, t: Samples, step: Samples, lost: NDArray[np.int64], period: float, flags: list[str]
    ) -> None:
        """Say when the stamps contradict the rate, once until they agree again."""
        self._checked += (step / (1 + lost)).tolist()
        if len(self._checked) < max(LEARNED_MESSAGES, CHECKED_S / period):
            return
        measured = 1 / max(float(np.mean(self._checked)), 1e-12)
        self._checked = []
        is_wrong = abs(measured * period - 1) > NEAR_RATE
        if is_wrong and not self._is_wrong:
            assert self.fs is not None
            flags.append(
                f"rate: {measured * period * self.fs:.4g} Hz by the stamps, {self.fs:g} Hz is assumed"
            )
        self._is_wrong = is_wrong

    def _report(self, samples: Samples, flags: list[str]) -> Block:
        assert self.fs is not None
        at = (self._start_ns or 0) / 1e9 + (self._last[0] if self._last else 0.0)
        return Block(at, np.empty((0, samples.shape[2])), self.fs, self.unit, 0, tuple(flags))


def _total(lost: NDArray[np.int64], start: int, stop: int, bridged: int) -> int:
    return bridged + int(lost[start + 1 : stop].sum())


def _bridge(previous: Samples, samples: Samples, lost: NDArray[np.int64]) -> Samples:
    """Return messages with straight lines where some are missing before them.

    Parameters
    ----------
    previous : ndarray of shape (k, n_channels)
        The message before the first one.
    samples : ndarray of shape (n, k, n_channels)
    lost : ndarray of shape (n,)
        How many are missing before each.
    """
    if not lost.any():
        return samples
    k = samples.shape[1]
    flat = np.concatenate((previous, samples.reshape(-1, samples.shape[2])))
    where = np.arange(len(flat)) + np.concatenate((np.zeros(k), np.repeat(np.cumsum(lost), k) * k))
    grid = np.arange(k, where[-1] + 1)
    return np.stack([np.interp(grid, where, column) for column in flat.T], axis=-1)
