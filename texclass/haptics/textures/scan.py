"""Define scans: vibration, position, velocity and force of a tool that strokes a surface."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from texclass.haptics.textures.contract import freeze
from texclass.phases import exclude_outliers
from texclass.recording import AUXILIARY_UNITS, Recording, Samples
from texclass.signals import positive


@dataclass(frozen=True, eq=False)
class Scan:
    """Signals of a tool that strokes one surface. The scan is frozen, and its arrays are read-only float64.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,)
        Vibration of the tool in m/s^2. If it has another unit, fitted textures have the same unit. Combine
        several axes into one first.
    position : array_like of shape (n_samples, 2)
        Position of the tip on the surface in mm.
    velocity : array_like of shape (n_samples, 2)
        Tangential velocity in mm/s.
    force : array_like of shape (n_samples,)
        Normal force in N, positive when pressing.
    fs : float
        Sampling rate of all signals in Hz.
    name : str, optional
        Name of the surface.

    Raises
    ------
    ValueError
        If the shapes do not match, a value is NaN or infinite, or `fs` is not positive.

    Warns
    -----
    UserWarning
        If samples of position, velocity or force are outliers; see
        `texclass.phases.find_motion_outliers`. Their values are interpolated.

    Examples
    --------
    >>> scan = Scan.along_line(np.zeros(500), speed=80.0, force=1.0, fs=1000.0, name="felt")
    >>> len(scan), round(float(scan.distance_mm[-1]), 2), len(scan.crop(100, 200))
    (500, 39.92, 100)
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
        for name, unit in (("position", "mm"), ("velocity", "mm/s"), ("force", "N")):
            cleaned = exclude_outliers(getattr(self, name), self.fs, name, unit, f"scan {self.name!r}")
            object.__setattr__(self, name, cleaned)
        freeze(self, position=("n", 2), velocity=("n", 2), force=("n",))
        object.__setattr__(self, "speed", np.hypot(*self.velocity.T))
        freeze(self, speed=("n",))
        if not len(self):
            raise ValueError(f"scan {self.name!r} is empty. Expected at least one sample")

    def __len__(self) -> int:
        return int(self.acceleration.size)

    @property
    def time_s(self) -> Samples:
        """Time of each sample in s from the first sample, shape (n_samples,)."""
        return np.arange(len(self)) / self.fs

    @property
    def distance_mm(self) -> Samples:
        """Length of the path up to each sample in mm, shape (n_samples,)."""
        steps = np.hypot(*np.diff(self.position, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def crop(self, start: int, stop: int) -> Self:
        """Return the part of the scan from sample `start` up to, but not including, sample `stop`."""
        names = ("acceleration", "position", "velocity", "force")
        return replace(self, **{name: getattr(self, name)[start:stop] for name in names})

    @classmethod
    def along_line(
        cls, acceleration: ArrayLike, speed: ArrayLike, force: ArrayLike, fs: float, name: str = ""
    ) -> Self:
        """Create the scan of a straight stroke along x from its speed.

        Parameters
        ----------
        acceleration : array_like of shape (n_samples,)
            Vibration in m/s^2.
        speed, force : array_like of shape (n_samples,) or ()
            Speed in mm/s and force in N; a scalar is constant over the stroke.
        fs : float
            Sampling rate in Hz.
        name : str, optional
            Name of the surface.
        """
        a = np.asarray(acceleration, dtype=np.float64)
        v = np.broadcast_to(np.asarray(speed, dtype=np.float64), a.shape)
        if np.isfinite(v).all():  # otherwise the constructor raises the error
            v = exclude_outliers(v, fs, "speed", "mm/s", f"scan {name!r}")
        x = np.concatenate([[0.0], np.cumsum((v[:-1] + v[1:]) / 2)]) / fs if a.size else v
        zero = np.zeros(a.shape)
        f = np.broadcast_to(np.asarray(force, dtype=np.float64), a.shape)
        return cls(a, np.column_stack([x, zero]), np.column_stack([v, zero]), f, fs, name)

    @classmethod
    def from_recording(cls, recording: Recording, acceleration: ArrayLike | None = None) -> Self:
        """Create the scan of a straight stroke from a recording with speed and normal force.

        Parameters
        ----------
        recording : Recording
            Recording with the channels `speed` (mm/s) and `normal_force` (N).
        acceleration : array_like of shape (n_samples,), optional
            Vibration of all axes combined into one (default: the only axis of the recording).

        Raises
        ------
        ValueError
            If speed or force is missing, or if the recording has several axes and `acceleration` is not
            passed.
        """
        a = np.asarray(recording.acceleration if acceleration is None else acceleration)
        where = recording.source or recording.recording_id
        recording = motion_at_acceleration(recording)
        if recording.speed is None or recording.normal_force is None:
            raise ValueError(f"{where} has no speed or no normal force. Expected both channels")
        if a.ndim == 2 and a.shape[1] == 1:
            a = a[:, 0]
        if a.ndim != 1:
            raise ValueError(
                f"{where}: acceleration must have one axis, got shape {a.shape}. Combine the axes, "
                "for example with texclass.signals.combine"
            )
        name = recording.surface or recording.recording_id
        return cls.along_line(a, recording.speed, recording.normal_force, recording.fs, name)


def motion_at_acceleration(recording: Recording) -> Recording:
    """Return a recording with speed and force at the times of the acceleration, interpolated if necessary.

    Outlier samples are excluded before the interpolation, at the rate of the signal.
    """
    where, changes = recording.source or recording.recording_id, {}
    for name in ("speed", "normal_force"):
        if name in recording.auxiliary_fs:
            rate, unit = recording.rate_of(name), AUXILIARY_UNITS[name]
            changes[name] = exclude_outliers(getattr(recording, name), rate, name, unit, where)
    return recording.with_(**changes).with_interpolated("speed", "normal_force")
