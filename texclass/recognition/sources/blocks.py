"""What a live source yields: blocks of samples, what was wrong on the way; which columns a model needs."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from texclass.features.phase_view import TURN
from texclass.recording import Recording, RecordingError, Samples

Beside = Literal["turn_rate", "friction"]


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
    """

    t_s: float
    samples: Samples
    fs: float
    unit: str
    lost: int = 0
    flags: tuple[str, ...] = ()


BlockSource = Generator[Block, None, None]
"""Yields blocks until the source ends, all of the same channels and unit; `close` lets go of it."""


@dataclass(frozen=True)
class Needs:
    """The columns of a stream, in this order: axes of the acceleration, turn rate, friction.

    Attributes
    ----------
    axes
        Names of the axes of the acceleration; empty: any number of them.
    beside
        Signals of `Recording` whose columns follow: "turn_rate" (3), then "friction" (1).
    of_friction
        Features that need the friction.
    """

    axes: tuple[str, ...] = ()
    beside: tuple[Beside, ...] = ()
    of_friction: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns; "acceleration" stands for any number of axes."""
        turn = TURN if "turn_rate" in self.beside else ()
        friction = ("friction",) if "friction" in self.beside else ()
        return (*(self.axes or ("acceleration",)), *turn, *friction)

    def columns_of(self, recording: Recording) -> Samples:
        """Return the columns of a recording, shape (n_samples, n_columns).

        Raises
        ------
        RecordingError
            If it lacks a signal.
        """
        where, n = recording.source or recording.recording_id, recording.n_samples
        signals = [recording.acceleration.reshape(n, -1)]
        for name in self.beside:
            if (signal := getattr(recording, name)) is None:
                raise RecordingError(f"{where}: {self.lacks(name)}")
            signals.append(signal.reshape(n, -1))
        return np.column_stack(signals)

    def lacks(self, name: Beside) -> str:
        """Return what to say of a source without one of the signals, and what to train instead."""
        rule = f"the rule is {', '.join(self.names)}, as the model was trained"
        if name == "friction":
            return (
                f"no friction, needed by {', '.join(self.of_friction)}; {rule} (texclass train with a --row "
                "of acceleration only makes a model that needs none)"
            )
        return f"no turn rate; {rule} (recordings without turn rate make a model that needs none)"

    def n_axes(self, n_columns: int) -> int:
        """Return how many of the columns of a stream are axes of the acceleration.

        Raises
        ------
        ValueError
            If it has too few columns, or other than as many as the model was trained with.
        """
        n_beside = len(self.names) - (len(self.axes) or 1)
        if n_columns <= n_beside or (self.axes and n_columns != len(self.names)):
            more = "" if self.axes else " or more"
            raise ValueError(
                f"the stream has {n_columns} columns; the rule is {len(self.names)}{more}, "
                f"{', '.join(self.names)}, as the model was trained"
            )
        return n_columns - n_beside


ACCELERATION_ONLY = Needs()
