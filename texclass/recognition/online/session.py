"""From a source of blocks to answers: what is wrong with the stream is said, and survived."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from texclass.recognition.blocks import Block
from texclass.recognition.model import Model
from texclass.recognition.online.recogniser import OnlineRecogniser
from texclass.recognition.online.settings import OnlineSettings, Update
from texclass.recognition.reasons import RATE_TOLERANCE
from texclass.recording import ACCELERATION_UNITS, Samples


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


class Session:
    """Feeds an online recogniser from blocks.

    Lost samples and samples that are not finite interrupt the stream. A rate or unit other than the model's
    is said once; answers then count as unknown. A rate that changes begins the stream anew.

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
    """

    def __init__(self, model: Model, *, raw: bool = True, settings: OnlineSettings | None = None) -> None:
        self.model, self.raw, self.settings = model, raw, settings
        self.live: OnlineRecogniser | None = None
        self.n_lost = 0
        self.start_s = 0.0
        """Instant of sample 0 by the source."""

    def run(self, blocks: Iterable[Block]) -> Iterator[Update | Notice]:
        """Yield what is known, block by block."""
        for block in blocks:
            yield from self.take(block)

    def take(self, block: Block) -> tuple[Update | Notice, ...]:
        """Take in a block.

        Raises
        ------
        ValueError
            If its columns are not those the model was trained with.
        """
        found: list[Update | Notice] = [Notice(block.t_s, flag) for flag in block.flags]
        if not len(block.samples):
            return tuple(found)
        if self.live is None or (block.fs, block.unit) != self._given:
            found += self._begin(block)
        assert self.live is not None
        if block.lost:
            self.n_lost += block.lost
            found += self.live.interrupt(block.lost)
        for lost, samples in finite_stretches(block.samples):
            if lost:
                self.n_lost += lost
                found.append(Notice(block.t_s, f"not finite: {lost} samples left out"))
                found += self.live.interrupt(lost)
            found += self.live.push(samples)
        return tuple(found)

    def _begin(self, block: Block) -> list[Notice]:
        manifest, said = self.model.manifest, []
        if self.live is not None:
            said.append(f"the stream is now {block.fs:g} Hz, {block.unit}: begun anew")
        self._given = (block.fs, block.unit)
        self.live = OnlineRecogniser(
            self.model, fs=block.fs, unit=block.unit, raw=self.raw, settings=self.settings
        )
        self.start_s = block.t_s
        if abs(block.fs / manifest.fs - 1) > RATE_TOLERANCE:
            said.append(f"wrong rate: {block.fs:g} Hz, trained at {manifest.fs:g} Hz; --resample converts")
        kept = "m/s^2" if block.unit in ACCELERATION_UNITS else block.unit
        if kept != manifest.unit:
            said.append(f"wrong unit: {block.unit}, trained with {manifest.unit}; nothing converts these")
        return [Notice(block.t_s, what) for what in said]


def finite_stretches(samples: Samples) -> Iterator[tuple[int, Samples]]:
    """Yield (number of rows left out before it, rows) of stretches whose numbers are finite."""
    rows = samples[:, None] if samples.ndim == 1 else samples
    good = np.isfinite(rows).all(axis=1)
    if good.all():
        yield 0, rows
        return
    edges = np.flatnonzero(np.diff(good, prepend=False, append=False))
    before = 0
    for start, stop in edges.reshape(-1, 2).tolist():
        yield start - before, rows[start:stop]
        before = stop
    if before < len(rows):
        yield len(rows) - before, rows[:0]
