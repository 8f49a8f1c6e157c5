"""Which columns a model needs of a stream: axes of the acceleration, then turn rate, then friction."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from texclass.features.phase_view import TURN
from texclass.recognition.model import Model
from texclass.recording import Recording, RecordingError, Samples

Beside = Literal["turn_rate", "friction"]
FRICTION: Beside = "friction"


@dataclass(frozen=True)
class Needs:
    """The columns of a stream, in this order.

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

    @classmethod
    def of(cls, model: Model) -> "Needs":
        """Return what a model needs; axes that friction follows must be as many as in training."""
        apart = model.plan.channels
        axes = tuple(name for name in apart if name not in TURN)
        beside: list[Beside] = ["turn_rate"] if len(axes) < len(apart) else []
        members = [member for _, part in model.plan.parts for member in part.members]
        of_friction = tuple(member.name for member in members if member.feature.phase == FRICTION)
        if of_friction:
            beside.append(FRICTION)
            axes = axes or tuple(model.manifest.input.get("axes", ()))
        return cls(axes, tuple(beside), of_friction)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns; "acceleration" stands for any number of axes."""
        turn = TURN if "turn_rate" in self.beside else ()
        return (*(self.axes or ("acceleration",)), *turn, *((FRICTION,) if FRICTION in self.beside else ()))

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
        return signals[0] if len(signals) == 1 else np.column_stack(signals)

    def lacks(self, name: Beside) -> str:
        """Return what to say of a source without one of the signals, and what to train instead."""
        rule = f"the rule is {', '.join(self.names)}, as the model was trained"
        if name == FRICTION:
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
