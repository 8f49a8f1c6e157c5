"""A scan: the vibration of a tool that strokes a surface, and where, how fast and how hard it does."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from texclass.haptics.textures.contract import freeze
from texclass.recording import Recording, Samples
from texclass.signals import positive


@dataclass(frozen=True, eq=False)
class Scan:
    """What was recorded while a tool stroked one surface. Frozen; its arrays are read-only float64.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,)
        Vibration of the tool, one axis or combined to one, m/s^2 (or a unit of its own, kept throughout).
    position : array_like of shape (n_samples, 2)
        Of the tool's tip on the surface, mm.
    velocity : array_like of shape (n_samples, 2)
        Tangential, mm/s.
    force : array_like of shape (n_samples,)
        Normal force, N, pressing is positive.
    fs : float
        Sampling rate of all signals, Hz.
    name : str, optional
        Of the surface.

    Raises
    ------
    ValueError
        If a shape does not fit, a value is NaN or infinite, or `fs` is not positive; the message names which.
    """

    acceleration: Samples
    position: Samples
    velocity: Samples
    force: Samples
    fs: float
    name: str = ""
    speed: Samples = field(init=False)

    def __post_init__(self) -> None:
        positive(self.fs, f"scan {self.name!r}: fs")
        freeze(self, acceleration=("n",), position=("n", 2), velocity=("n", 2), force=("n",))
        object.__setattr__(self, "speed", np.hypot(*self.velocity.T))
        freeze(self, speed=("n",))
        if not len(self):
            raise ValueError(f"scan {self.name!r} holds no sample. Expected at least one")

    def __len__(self) -> int:
        return int(self.acceleration.size)

    @property
    def time_s(self) -> Samples:
        """Time of each sample from the first, s, shape (n_samples,)."""
        return np.arange(len(self)) / self.fs

    @property
    def distance_mm(self) -> Samples:
        """Length of the path up to each sample, mm, shape (n_samples,)."""
        steps = np.hypot(*np.diff(self.position, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def part(self, start: int, stop: int) -> Self:
        """Return the samples [start, stop) as a scan."""
        names = ("acceleration", "position", "velocity", "force")
        return replace(self, **{name: getattr(self, name)[start:stop] for name in names})

    @classmethod
    def along_line(
        cls, acceleration: ArrayLike, speed: ArrayLike, force: ArrayLike, fs: float, name: str = ""
    ) -> Self:
        """Return the scan of a straight stroke along x, of which only the speed is known.

        Parameters
        ----------
        acceleration : array_like of shape (n_samples,)
            m/s^2.
        speed, force : array_like of shape (n_samples,) or ()
            mm/s and N; one value holds throughout.
        fs : float
            Hz.
        name : str, optional
            Of the surface.
        """
        a = np.asarray(acceleration, dtype=np.float64)
        v = np.broadcast_to(np.asarray(speed, dtype=np.float64), a.shape)
        x = np.concatenate([[0.0], np.cumsum((v[:-1] + v[1:]) / 2)]) / fs if a.size else v
        zero = np.zeros(a.shape)
        f = np.broadcast_to(np.asarray(force, dtype=np.float64), a.shape)
        return cls(a, np.column_stack([x, zero]), np.column_stack([v, zero]), f, fs, name)

    @classmethod
    def from_recording(cls, recording: Recording, acceleration: ArrayLike | None = None) -> Self:
        """Return the scan of a recording that carries speed and normal force, as a straight stroke.

        Parameters
        ----------
        recording : Recording
            With `speed` (mm/s) and `normal_force` (N).
        acceleration : array_like of shape (n_samples,), optional
            Its axes combined to one; by default the only one.

        Raises
        ------
        ValueError
            If speed or force are missing or there are several axes and none was chosen.
        """
        a = np.asarray(recording.acceleration if acceleration is None else acceleration)
        where = recording.source or recording.recording_id
        if recording.speed is None or recording.normal_force is None:
            raise ValueError(f"{where}: no speed or normal force. Expected a recording with both")
        if a.ndim == 2 and a.shape[1] == 1:
            a = a[:, 0]
        if a.ndim != 1:
            raise ValueError(f"{where}: acceleration has shape {a.shape}. Expected one axis: combine them")
        name = recording.surface or recording.recording_id
        return cls.along_line(a, recording.speed, recording.normal_force, recording.fs, name)
