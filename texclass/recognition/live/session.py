"""A stream from its blocks to what is known: what is wrong with it is said, and bridged where it is short."""

import math
import time
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from texclass.loaders.timestamps import TIMESTAMPS
from texclass.recognition.live.contact import Event
from texclass.recognition.live.online_recogniser import (
    LONGEST_WINDOW_S,
    RUN_WINDOW_S,
    OnlineRecogniser,
    OnlineSettings,
    Update,
    WindowAnswer,
    scale_of,
)
from texclass.recognition.model import Model, load_model
from texclass.recognition.sources.blocks import Block
from texclass.recognition.sources.source_by_name import is_live, open_source
from texclass.recording import ACCELERATION_UNITS, Recording, RecordingError, Samples


@dataclass(frozen=True)
class Notice:
    """Something is wrong with the stream.

    Attributes
    ----------
    t_s
        Instant of the block by its source, in seconds.
    what
        In words: lost samples, gaps, clock jumps, a wrong rate or unit.
    """

    t_s: float
    what: str


class Defects:
    """Samples that are no measurements: not finite, or a step from the last good one that no surface makes.

    Up to `TIMESTAMPS.max_gap` in a row are replaced by a straight line, as missing messages are; more are
    lost.
    Rows come out the same however they come in blocks: bad ones wait for the next good one.

    Parameters
    ----------
    model : Model
        Whose recordings tell how large a step may be.
    n_axes : int
        Columns of acceleration, the first ones.
    fs : float
        Sampling rate in Hz.
    scale : float
        From a number of the stream to the unit of the model's recordings.
    """

    def __init__(self, model: Model, n_axes: int, fs: float, scale: float) -> None:
        loudest = model.manifest.peak_acceleration
        # A step of a hundred times the largest acceleration of training is a loose wire, not a surface; a tap
        # on a hard surface may make one of 1000 m/s^2, whatever was trained.
        far = 1e6 if loudest is None else 100 * loudest
        far = max(far, 1000.0) if model.manifest.unit == "m/s^2" else far
        self.n_axes, self.far = n_axes, far / scale
        # Far samples that go on for 0.1 s are a new level: the stream goes on there, after a break.
        self._level = max(TIMESTAMPS.max_gap + 2, round(0.1 * fs))
        self._last: Samples | None = None
        self._waiting = self._far_for = 0

    def mended(self, rows: Samples) -> tuple[list[tuple[int, Samples]], int, int]:
        """Take in rows (n, n_columns) in the unit of the stream.

        Returns
        -------
        stretches : list of (int, ndarray)
            How many rows are lost before a stretch, and its rows, good or mended.
        n_broken, n_far : int
            How many of the rows are not finite (or no number a sensor sends), and how many are far.
        """
        # No sensor measures more than 1e15, in any unit, nor NaN.
        broken = np.asarray(~(np.abs(rows) <= 1e15).all(axis=1))
        before = rows[:1] if self._last is None else self._last[None]
        with np.errstate(invalid="ignore"):
            steps = np.abs(np.diff(rows[:, : self.n_axes], axis=0, prepend=before[:, : self.n_axes]))
        if not self._waiting and not broken.any() and (steps <= self.far).all():
            self._last = rows[-1].copy()
            return [(0, rows)], 0, 0
        stretches: list[tuple[int, list[Samples]]] = [(0, [])]
        n_far = 0
        for row, is_broken in zip(rows, broken.tolist(), strict=True):
            last = row if self._last is None else self._last
            is_far = not is_broken and bool((np.abs(row - last)[: self.n_axes] > self.far).any())
            self._far_for = self._far_for + 1 if is_far else 0
            if is_broken or 0 < self._far_for < self._level:
                n_far += is_far
                self._waiting += 1
                continue
            if self._last is None or self._waiting > TIMESTAMPS.max_gap:
                stretches.append((self._waiting, []))
            else:
                shares = np.arange(1, self._waiting + 1)[:, None] / (self._waiting + 1)
                stretches[-1][1].extend(last + shares * (row - last))
            stretches[-1][1].append(row)
            self._last, self._waiting, self._far_for = row.copy(), 0, 0
        kept = [(lost, np.array(some)) for lost, some in stretches if some]
        return kept, int(np.count_nonzero(broken)), n_far


class Session:
    """Feeds an online recogniser from blocks.

    Samples that are no measurements are bridged, or interrupt the stream as lost ones do; see `Defects`. A
    rate or unit other than the model's is said; answers then count as unknown. A rate that changes begins the
    stream anew. Of notices of one kind, one in 5 s is said, with how many there were.

    Parameters
    ----------
    model : Model
        What answers.
    raw : bool
        See `OnlineRecogniser`.
    settings : OnlineSettings
        How it listens.

    Attributes
    ----------
    live : OnlineRecogniser or None
        None before the first block.
    n_lost : int
        Samples that were lost or no measurements.
    start_s : float
        Instant of sample 0 by the source.
    """

    def __init__(self, model: Model, *, raw: bool = True, settings: OnlineSettings | None = None) -> None:
        self.model, self.raw, self.settings = model, raw, settings
        self.live: OnlineRecogniser | None = None
        self.n_lost, self.start_s = 0, 0.0
        self._sent_s = -math.inf
        self._said: dict[str, tuple[float, int, str]] = {}
        """Kind of a notice -> when it was said, how many like it came since, the last of these."""

    @property
    def age_s(self) -> float:
        """How old the last sample is, in seconds, as far as the source knows; infinite before the first."""
        return time.monotonic() - self._sent_s

    def run(self, blocks: Iterable[Block]) -> Iterator[Update | Notice]:
        """Yield what is known, block by block, and the last of it when they end; let go of them then."""
        with closing(blocks) if isinstance(blocks, Generator) else nullcontext():
            for block in blocks:
                yield from self.take(block)
            yield from self.finish()

    def take(self, block: Block) -> tuple[Update | Notice, ...]:
        """Take in a block.

        Raises
        ------
        ValueError
            If its columns are not those the model was trained with.
        """
        found: list[Update | Notice] = []
        for flag in block.flags:
            found += self._noticed(block.t_s, flag)
        if not len(block.samples):
            return (*found, *self._interrupted(block.lost))
        self._sent_s = time.monotonic() - block.age_s
        if self.live is None or (block.fs, block.unit) != self._given:
            found += self._begin(block)
        assert self.live is not None
        found += self._interrupted(block.lost)
        rows = block.samples.reshape(len(block.samples), -1)
        stretches, n_broken, n_far = self._defects.mended(rows)
        self.n_lost += n_broken + n_far
        if n_broken:
            found += self._noticed(block.t_s, f"not finite: {n_broken} samples left out")
        if n_far:
            what = f"glitch: {n_far} samples left out, steps above {self._defects.far:.3g} {block.unit}"
            found += self._noticed(block.t_s, f"{what} (no recording of the training was near that)")
        for lost, samples in stretches:
            if lost:
                found += self.live.interrupt(lost)
            told = self.live.push(samples)
            found += told
            for event in told:
                if isinstance(event, Event) and event.kind == "lift-off" and event.what:
                    found += self._noticed(block.t_s, f"noise: {event.what}")
                elif isinstance(event, WindowAnswer) and (before := event.verdict.previous_surface):
                    what = f"the last windows are of {event.verdict.surface}, not {before}: evidence restarts"
                    found += self._noticed(block.t_s, f"surface: {what}")
        return tuple(found)

    def _interrupted(self, n_lost: int) -> tuple[Update, ...]:
        """Count lost samples; no window crosses the gap."""
        self.n_lost += n_lost
        return self.live.interrupt(n_lost) if n_lost and self.live else ()

    def finish(self) -> tuple[Update | Notice, ...]:
        """Say that the stream has ended, and return the last of what is known."""
        unsaid = [Notice(at, f"{what} ({n} like it)") for at, n, what in self._said.values() if n]
        self._said.clear()
        return (*unsaid, *(self.live.finish() if self.live else ()))

    def _noticed(self, t_s: float, what: str) -> list[Notice]:
        """Return a notice, or none if one like it was said a moment ago."""
        kind = what.partition(":")[0]
        said_s, n, _ = self._said.get(kind, (-math.inf, 0, ""))
        if abs(t_s - said_s) < 5.0:
            self._said[kind] = (said_s, n + 1, what)
            return []
        self._said[kind] = (t_s, 0, "")
        return [Notice(t_s, what + f" ({n} like it in between)" * (n > 0))]

    def _begin(self, block: Block) -> list[Update | Notice]:
        found: list[Update | Notice] = []
        if self.live is not None:
            found += self.live.finish()
            found += self._noticed(block.t_s, f"begun anew: the stream is now {block.fs:g} Hz, {block.unit}")
        self._given = (block.fs, block.unit)
        self.live = OnlineRecogniser(
            self.model, fs=block.fs, unit=block.unit, raw=self.raw, settings=self.settings
        )
        self.start_s = block.t_s
        n_axes = self.model.needs.n_axes(block.samples[0].size)
        self._defects = Defects(self.model, n_axes, block.fs, scale_of(self.model, block.unit, self.raw))
        felt_s, trained_s = self.live.window / block.fs, self.model.manifest.shortest_s or 0.0
        if felt_s == RUN_WINDOW_S < LONGEST_WINDOW_S < trained_s and self.model.manifest.window_s is None:
            found += self._noticed(
                block.t_s,
                f"window: {felt_s:g} s, trained on runs of {trained_s:.3g} s and more; a model of such "
                f"windows (texclass train --window {felt_s:g}) knows how sure it may be",
            )
        kept = "m/s^2" if block.unit in ACCELERATION_UNITS else block.unit
        for unlike in self.model.rate_and_unit_problems(block.fs, kept):
            found += self._noticed(block.t_s, unlike)
        if narrow := self.model.bandwidth_problems(block.native_fs or block.fs):
            raise RecordingError(f"the source cannot be judged: {narrow[0]}")
        return found


def listen(
    model: Model | str | Path,
    source: str | Recording | Iterable[Block] = "-",
    *,
    fs: float | None = None,
    unit: str | None = None,
    resample: bool = False,
    paced: bool = False,
    raw_channels: int | None = None,
    settings: OnlineSettings | None = None,
) -> Iterator[Update | Notice]:
    """Classify a live stream: yield events, answers and notices as soon as they are available.

    Parameters
    ----------
    model : Model, str or Path
        Model, or path of a model file.
    source : str, Recording, or iterable of Block
        "-" (standard input), "FILE", "DATASET:RECORDING", "bag:FILE?topic=/name" or "ros2:/topic", see
        `open_source`; or blocks with samples as in the training recordings.
    fs, unit, paced, raw_channels : optional
        See `open_source`.
    resample : bool
        Resample the stream to the rate of the model (default False).
    settings : OnlineSettings, optional
        Settings of the stream.

    Yields
    ------
    Update or Notice
        Events (tap, contact, lift-off), answers and notices in order of time.

    Raises
    ------
    RecordingError, ValueError
        If the source cannot be opened, see `open_source`, or a block is invalid, see `Session.take`.
    """
    trained = model if isinstance(model, Model) else load_model(model)
    if not isinstance(source, str | Recording):
        return Session(trained, settings=settings).run(source)
    rate = trained.manifest.fs if resample else None
    blocks = open_source(
        source, fs=fs, unit=unit, rate=rate, paced=paced, raw_channels=raw_channels, model=trained
    )
    return Session(trained, raw=is_live(source), settings=settings).run(blocks)
