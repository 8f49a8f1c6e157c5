"""Which stretches of a stream are answered, and the recordings they are."""

from dataclasses import dataclass

import numpy as np

from texclass.features.phase_view import TURN
from texclass.phases import HAND_RATE_HZ, Hand, block_mean
from texclass.recognition.model import Model
from texclass.recognition.needs import FRICTION, Needs
from texclass.recording import ACCELERATION_UNITS, Phases, Recording, Samples, Tap


@dataclass(frozen=True, eq=False)
class Tapped:
    """What was felt before a movement: a stretch of samples with its taps, counted from its start."""

    samples: Samples
    taps: tuple[Tap, ...]


class Shape:
    """How samples of a stream become recordings that a model answers.

    Parameters
    ----------
    model : Model
        Says which channels are kept apart, and whether files lost their resting level.
    n_columns : int
        Columns of the stream: axes of the acceleration, then, where the model has them, of the turn rate, and
        the friction.
    fs : float
        Sampling rate of the stream in Hz.
    unit : str
        Of its acceleration.
    raw : bool
        Whether samples are as in the files the model was trained on, so that the scale of these applies, if
        they are in their unit.

    Raises
    ------
    ValueError
        If the model needs other columns.
    """

    def __init__(self, model: Model, n_columns: int, fs: float, unit: str, raw: bool = True) -> None:
        needs = Needs.of(model)
        self.n_axes = needs.n_axes(n_columns)
        self._n_turn = len(TURN) * ("turn_rate" in needs.beside)
        self._has_friction = FRICTION in needs.beside
        physical = unit in ACCELERATION_UNITS
        self.fs, self.unit = fs, "m/s^2" if physical else unit
        source = model.manifest.input
        scale = float(source.get("scale", 1.0)) if raw and unit == source.get("unit", unit) else 1.0
        self._factor = (ACCELERATION_UNITS[unit] if physical else 1.0) * scale
        self._channels = needs.axes if model.plan.channels else ()
        self._level = bool(source.get("remove_resting_level", False))

    def conditioned(self, rows: Samples) -> Samples:
        """Return samples (n, n_columns) in the unit that recordings keep, scaled as the files were."""
        if self._factor == 1.0:
            return rows
        return np.column_stack([rows[:, : self.n_axes] * self._factor, rows[:, self.n_axes :]])

    def window(self, samples: Samples, start: int, tapped: Tapped | None = None) -> Recording:
        """Return samples (n, n_columns), all movement, as a recording, after what was tapped before."""
        name, movement = f"window at {start / self.fs:.3f} s", self._at_rest_removed(samples)
        if tapped is None:
            return self._recording(movement, Phases(movement=(0, len(movement))), name)
        n = len(tapped.samples)
        whole = np.concatenate([self._at_rest_removed(tapped.samples), movement])
        return self._recording(whole, Phases(tapped.taps, (n, len(whole))), name)

    def tap(self, tapped: Tapped, start: int) -> Recording:
        """Return taps alone as a recording."""
        samples = self._at_rest_removed(tapped.samples)
        return self._recording(samples, Phases(tapped.taps), f"tap at {start / self.fs:.3f} s")

    def hand(self, rows: Samples) -> Hand:
        """Follow the hand through samples (n, n_columns)."""
        step = max(1, round(self.fs / HAND_RATE_HZ))
        return Hand(block_mean(rows[:, : self.n_axes], step), self.fs / step, step)

    def _at_rest_removed(self, samples: Samples) -> Samples:
        """Remove what files of the training data had lost too: the resting level, by its median."""
        if not self._level:
            return samples
        levelled = samples.copy()
        levelled[:, : self.n_axes] -= np.median(samples[:, : self.n_axes], axis=0)
        return levelled

    def _recording(self, samples: Samples, phases: Phases, name: str) -> Recording:
        axes, turn = samples[:, : self.n_axes], samples[:, self.n_axes : self.n_axes + self._n_turn]
        return Recording(
            axes[:, 0] if self.n_axes == 1 else axes,
            self.fs,
            self.unit,
            name,
            turn_rate=turn if self._n_turn else None,
            friction=samples[:, -1] if self._has_friction else None,
            channels=self._channels,
            phases=phases,
        )
