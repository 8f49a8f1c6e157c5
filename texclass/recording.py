"""Recordings, each of one exploration of one surface, and their phases."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.phase_settings import PhaseSettings

if TYPE_CHECKING:
    import xarray

Samples = NDArray[np.float64]
A = TypeVar("A", bound=NDArray[Any])

STANDARD_GRAVITY = 9.80665
ACCELERATION_UNITS: dict[str, float] = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000}
"""Factor from a physical unit of acceleration to m/s^2."""
UNITS = (*ACCELERATION_UNITS, "counts", "V", "arbitrary")
"""Units of acceleration. Levels in "counts", "V" and "arbitrary" are comparable only within a dataset."""
if TYPE_CHECKING:  # mypy does not accept a Literal of listed values
    Unit = str
else:
    Unit = Literal[*UNITS]
AUXILIARY_UNITS = {
    "friction": "V",
    "normal_force": "N",
    "speed": "mm/s",
    "sound": "arbitrary",
    "turn_rate": "rad/s",
}
"""Unit of each auxiliary signal of a recording."""

_BLOCK = 1 << 20
"""Number of samples checked at a time, because a mask of the whole recording would need 1/8 of its memory."""


class RecordingError(ValueError):
    """Invalid recording; the message names the file, the value and what was expected."""


@dataclass(frozen=True)
class Tap:
    """One tap: hand motion in samples [start, impact), impact and decay in [impact, end).

    Attributes
    ----------
    start
        First sample of the motion of the hand towards the surface.
    impact
        First sample of the contact.
    end
        One past the last sample of the decay.
    width
        Number of samples from the impact until the vibration is 10 dB below its peak; 0 if not measured.
    quality
        Confidence from 0 to 1: 1 minus the ratio of the amplitude around the tap (noise, ringing, a stroke)
        to the peak amplitude.

    Examples
    --------
    >>> Tap(start=100, impact=200, end=260).end
    260
    """

    start: int
    impact: int
    end: int
    width: int = 0
    quality: float = 1.0

    def __post_init__(self) -> None:
        if not (self.width >= 0 and 0.0 <= self.quality <= 1.0):
            raise ValueError(f"a tap requires width >= 0 and a quality from 0 to 1, got {self}")
        if not 0 <= self.start <= self.impact < self.end:
            raise ValueError(f"a tap requires 0 <= start <= impact < end, got {self}")


@dataclass(frozen=True)
class Phases:
    """Taps and movement of one recording, as sample indices.

    Attributes
    ----------
    taps
        Taps in order of time.
    movement
        Samples [start, stop) of the strokes; None if there are none.
    onset
        Sample at which static friction breaks and sliding begins; None if unknown.
    notes
        Assumptions reported to the user.

    Examples
    --------
    >>> Phases(taps=(Tap(100, 200, 260),), movement=(1000, 5000)).kind
    'taps and movement'
    """

    taps: tuple[Tap, ...] = ()
    movement: tuple[int, int] | None = None
    onset: int | None = None
    notes: tuple[str, ...] = ()

    @property
    def kind(self) -> Literal["taps and movement", "taps only", "movement only", "nothing"]:
        """Description of the phases that the recording contains."""
        match bool(self.taps), self.movement is not None:
            case True, True:
                return "taps and movement"
            case True, False:
                return "taps only"
            case False, True:
                return "movement only"
        return "nothing"

    def at_rate(self, ratio: float, n_samples: int) -> "Phases":
        """Return the phases in samples of another sampling rate.

        Parameters
        ----------
        ratio : float
            New rate divided by the present one.
        n_samples : int
            Number of samples at the new rate. Taps that start after them are left out.

        Examples
        --------
        >>> Phases(movement=(1000, 5000), onset=1000).at_rate(0.1, 500)
        Phases(taps=(), movement=(100, 500), onset=100, notes=())
        """

        def convert(sample: int) -> int:
            return min(n_samples, round(sample * ratio))

        taps = tuple(
            Tap(
                convert(tap.start),
                convert(tap.impact),
                max(convert(tap.end), convert(tap.impact) + 1),
                convert(tap.width),
                tap.quality,
            )
            for tap in self.taps
            if convert(tap.impact) < n_samples
        )
        movement = self.movement and (convert(self.movement[0]), convert(self.movement[1]))
        onset = None if self.onset is None else convert(self.onset)
        return Phases(taps, movement, onset, self.notes)


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals of one exploration of one surface. A recording is immutable, and its arrays are read-only.

    Parameters
    ----------
    acceleration : array_like of shape (n_samples,) or (n_samples, n_channels)
        Acceleration of the tool in `unit` (converted to m/s^2 if the unit is physical).
    fs : float
        Sampling rate in Hz of the acceleration, and of the other signals unless `auxiliary_fs` names them.
    unit : str, default "arbitrary"
        "m/s^2", "g" or "mg" (converted to m/s^2), or "counts", "V", "arbitrary" (not converted). With a
        physical unit and gravity in the signal, corrected feature sets remove hand motion.
    recording_id : str, default "recording"
        Identifier, unique in its dataset.
    surface, operator, session : str, optional
        Surface label, person who held the tool, and recording session.
    repetition : int, optional
        Number of the recording, in chronological order.
    friction, normal_force, speed, sound : array_like of shape (n_samples,), optional
        FSR bridge voltage (V), normal force (N), tangential speed (mm/s), sound (arbitrary), for example of a
        contact microphone.
    turn_rate : array_like of shape (n_samples, 3), optional
        Angular velocity (rad/s).
    auxiliary_fs : mapping of str to float, optional
        Sampling rates in Hz of the signals that have another rate than the acceleration, by name. All signals
        start at the same time and have the same duration.
    channels : tuple of str, optional
        Names of the columns of a two-dimensional `acceleration` (default x, y, z for three columns).
    phases : Phases, optional
        Known taps and movement, from a card or a simulation (default: detected by `find_phases`).
    phase_settings : PhaseSettings, optional
        Settings of `find_phases`.
    source : str, optional
        File or dataset, for messages.
    native_fs : float, optional
        Sampling rate in Hz of the sensor, if the recording was resampled (default `fs`).
    flags : tuple of str, optional
        Warnings about the signal ("clipped: 3.1 % of samples at full scale").

    Raises
    ------
    RecordingError
        If an argument is missing or invalid; the message names the source, the value and what was expected.

    Examples
    --------
    >>> import numpy as np
    >>> Recording(np.zeros((1000, 3)), fs=1000, unit="g", surface="oak")
    <Recording 'recording' of oak: 1 s at 1000 Hz, 3 axes in m/s^2>
    """

    acceleration: Samples
    fs: float
    unit: str = "arbitrary"
    recording_id: str = "recording"
    surface: str | None = None
    operator: str | None = None
    session: str | None = None
    repetition: int | None = None
    friction: Samples | None = None
    normal_force: Samples | None = None
    speed: Samples | None = None
    sound: Samples | None = None
    turn_rate: Samples | None = None
    auxiliary_fs: Mapping[str, float] = field(default_factory=dict)
    channels: tuple[str, ...] = ()
    phases: Phases | None = None
    phase_settings: PhaseSettings = field(default=PhaseSettings())
    source: str = ""
    native_fs: float | None = None
    flags: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        where = self.source or self.recording_id
        fs = _sampling_rate(self.fs, where)
        acceleration = _as_frozen_array(self.acceleration, "acceleration", where)
        if acceleration.ndim not in (1, 2):
            raise RecordingError(
                f"{where}: acceleration has shape {acceleration.shape}. Expected (n,) or (n, channels)"
            )
        if self.unit in ACCELERATION_UNITS and (factor := ACCELERATION_UNITS[self.unit]) != 1.0:
            acceleration = _as_frozen_array(make_read_only(acceleration * factor), "acceleration", where)
        elif self.unit not in UNITS:
            raise RecordingError(f"{where}: unknown unit {self.unit!r}. Expected one of {', '.join(UNITS)}")
        object.__setattr__(self, "fs", fs)
        native_fs = fs if self.native_fs is None else _sampling_rate(self.native_fs, where)
        object.__setattr__(self, "native_fs", min(native_fs, fs))
        object.__setattr__(self, "acceleration", acceleration)
        object.__setattr__(self, "unit", "m/s^2" if self.unit in ACCELERATION_UNITS else self.unit)
        object.__setattr__(self, "channels", self._channel_names(where))
        if unknown := set(self.auxiliary_fs) - set(AUXILIARY_UNITS):
            raise RecordingError(
                f"{where}: auxiliary_fs names {', '.join(sorted(unknown))}. Expected some of "
                f"{', '.join(AUXILIARY_UNITS)}"
            )
        rates = {name: _sampling_rate(rate, where) for name, rate in self.auxiliary_fs.items()}
        other_rates = {
            name: rate for name, rate in rates.items() if rate != fs and getattr(self, name) is not None
        }
        object.__setattr__(self, "auxiliary_fs", other_rates)
        for name in AUXILIARY_UNITS:
            if (signal := getattr(self, name)) is not None:
                array = _as_frozen_array(signal, name, where)
                self._check_length(name, len(array), where)
                object.__setattr__(self, name, array)

    @property
    def n_samples(self) -> int:
        """Number of samples of every signal."""
        return int(self.acceleration.shape[0])

    @property
    def duration_s(self) -> float:
        """Duration in seconds."""
        return self.n_samples / self.fs

    @property
    def facts(self) -> dict[str, str]:
        """Labels, duration, sampling rate, unit, channels, other signals and flags as text, by name."""
        other_signals = ", ".join(
            f"{name} at {self.auxiliary_fs[name]:g} Hz" if name in self.auxiliary_fs else name
            for name in AUXILIARY_UNITS
            if getattr(self, name) is not None
        )
        facts = {
            "recording": self.recording_id,
            "surface": self.surface,
            "operator": self.operator,
            "session": self.session,
            "duration": f"{self.duration_s:.3g} s, {self.n_samples} samples at {self.fs:g} Hz",
            "acceleration": f"{', '.join(self.channels)} in {self.unit}",
            "other signals": other_signals,
            "phases": None if self.phases is None else self.phases.kind,
            "flags": "; ".join(self.flags),
        }
        return {name: text for name, text in facts.items() if text}

    def __repr__(self) -> str:
        """Return a one-line summary: id, surface, duration, sampling rate and axes."""
        surface = f" of {self.surface}" if self.surface else ""
        n = len(self.channels)
        return (
            f"<Recording {self.recording_id!r}{surface}: {self.duration_s:.3g} s at {self.fs:g} Hz, "
            f"{n} {'axis' if n == 1 else 'axes'} in {self.unit}>"
        )

    def _repr_html_(self) -> str:
        """Return a table for notebooks."""
        rows = (f"<tr><th>{name}</th><td>{escape(fact)}</td></tr>" for name, fact in self.facts.items())
        return f"<table>{''.join(rows)}</table>"

    def with_(self, **changes: Any) -> "Recording":
        """Return a copy with some fields replaced, or this recording if nothing changes."""
        values = vars(self)
        is_unchanged = all(name in values and values[name] is value for name, value in changes.items())
        return self if is_unchanged else replace(self, **changes)

    def cut(self, start: int, stop: int, recording_id: str) -> "Recording":
        """Return the part of all signals in the time of the samples [start, stop) of the acceleration.

        The whole part counts as movement.
        """
        signals = {
            name: signal[slice(*self.span_of(name, start, stop))]
            for name in AUXILIARY_UNITS
            if (signal := getattr(self, name)) is not None
        }
        return self.with_(
            acceleration=self.acceleration[start:stop],
            **signals,
            recording_id=recording_id,
            phases=Phases(movement=(0, stop - start)),
        )

    def rate_of(self, name: str) -> float:
        """Return the sampling rate in Hz of an auxiliary signal."""
        return self.auxiliary_fs.get(name, self.fs)

    def span_of(self, name: str, start: int, stop: int) -> tuple[int, int]:
        """Return the samples of an auxiliary signal in the time of acceleration samples [start, stop).

        If the rates differ, start and stop are those of the nearest samples, and the span contains at least
        one sample. Adjacent spans share no sample, unless they are shorter than a sample.

        Examples
        --------
        >>> import numpy as np
        >>> friction = {"friction": np.zeros(500), "auxiliary_fs": {"friction": 100}}
        >>> recording = Recording(np.zeros(5000), fs=1000, **friction)
        >>> recording.span_of("friction", 1000, 2000)
        (100, 200)
        """
        if name not in self.auxiliary_fs:
            return start, stop
        ratio, n = self.auxiliary_fs[name] / self.fs, len(getattr(self, name))
        first = min(round(start * ratio), n - 1)
        return first, min(max(round(stop * ratio), first + 1), n)

    def with_interpolated(self, *names: str) -> "Recording":
        """Return a recording with these auxiliary signals, if present, at the times of the acceleration.

        Signals with another rate are interpolated linearly.
        """
        changed = [name for name in names if name in self.auxiliary_fs]
        rates = {name: rate for name, rate in self.auxiliary_fs.items() if name not in changed}
        signals = {name: self.at_acceleration(name) for name in changed}
        return self.with_(**signals, auxiliary_fs=rates) if changed else self

    def at_acceleration(self, name: str) -> Samples:
        """Return an auxiliary signal at the times of the acceleration, interpolated linearly if necessary."""
        signal: Samples = getattr(self, name)
        if name not in self.auxiliary_fs:
            return signal
        index = np.arange(self.n_samples) * (self.auxiliary_fs[name] / self.fs)
        samples = np.arange(len(signal))
        columns = [np.interp(index, samples, column) for column in signal.reshape(len(signal), -1).T]
        return np.column_stack(columns).reshape(self.n_samples, *signal.shape[1:])

    def as_acceleration(self, name: str, unit: str = "arbitrary") -> "Recording":
        """Return a recording in which an auxiliary signal, at its own rate, replaces the acceleration.

        Phases are converted to its samples; of the other signals, only the speed is kept.
        """
        signal = getattr(self, name)
        rate = self.rate_of(name)
        others = dict.fromkeys(set(AUXILIARY_UNITS) - {"speed"})
        return self.with_(
            acceleration=signal,
            fs=rate,
            unit=unit,
            channels=(),
            phases=self.phases and self.phases.at_rate(rate / self.fs, len(signal)),
            native_fs=None,
            auxiliary_fs={"speed": self.rate_of("speed")},
            **others,
        )

    def to_xarray(self) -> "xarray.DataArray":
        """Return the acceleration as a DataArray over time (s) and axis, with labels as attributes.

        Other signals and phases are not included. `loaders.recordings_of` is the inverse. Requires xarray.
        """
        import xarray

        dims = ("time", "axis")[: self.acceleration.ndim]
        time = ("time", np.arange(self.n_samples) / self.fs, {"units": "s"})
        names = ("fs", "native_fs", "unit", "surface", "operator", "session", "repetition")
        attributes = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        coords = {"time": time, "axis": list(self.channels)}
        coords = {dim: coords[dim] for dim in dims}
        return xarray.DataArray(self.acceleration, coords, dims, self.recording_id, attributes)

    def _check_length(self, name: str, n: int, where: str) -> None:
        rate = self.rate_of(name)
        # Signals start at nearest samples, so that their durations may differ by some samples.
        tolerance_s = 2 / min(rate, self.fs) if name in self.auxiliary_fs else 0.0
        if abs(n / rate - self.duration_s) <= tolerance_s:
            return
        own_rate = f" at {rate:g} Hz" if name in self.auxiliary_fs else ""
        hint = (
            ""
            if own_rate
            else ". If it has another rate, pass it in auxiliary_fs (`auxiliary_fs_hz` in a card)"
        )
        raise RecordingError(
            f"{where}: {name} has {n} samples{own_rate}, but acceleration has {self.n_samples} at "
            f"{self.fs:g} Hz. Expected the same duration for all signals of a recording{hint}"
        )

    def _channel_names(self, where: str) -> tuple[str, ...]:
        n_channels = 1 if self.acceleration.ndim == 1 else self.acceleration.shape[1]
        default = ("x", "y", "z") if n_channels == 3 else tuple(f"c{i + 1}" for i in range(n_channels))
        names = tuple(self.channels) or default
        if len(names) != n_channels or len(set(names)) != n_channels:
            raise RecordingError(
                f"{where}: channels are {names}. Expected {n_channels} different names, one per column"
            )
        return names


def axes_differ(axes: Sequence[str], others: Sequence[str]) -> bool:
    """Return whether the axes of two recordings differ, given their names.

    Axes differ if their numbers differ, or if some but not all of their names agree.

    Examples
    --------
    >>> axes_differ(["x", "y"], ["X", "Y"]), axes_differ(["x", "y"], ["y", "z"])
    (False, True)
    """
    a, b = ({name.casefold() for name in names} for names in (axes, others))
    return len(a) != len(b) or (a != b and bool(a & b))


def describe_axes(names: Sequence[str]) -> str:
    """Return number and names of axes as text, such as "3 axes (x, y, z)"; "1 axis" has no name."""
    return "1 axis" if len(names) == 1 else f"{len(names)} axes ({', '.join(names)})"


def _sampling_rate(fs: Any, where: str) -> float:
    try:
        value = float(fs)
    except (TypeError, ValueError):
        value = float("nan")
    if not (np.isfinite(value) and value > 0):
        raise RecordingError(f"{where}: fs is {fs!r}. Expected a positive sampling rate in Hz")
    return value


def make_read_only(array: A) -> A:
    """Make an array and its bases read-only, so that a `Recording` does not copy it; return the array."""
    base: object = array
    while isinstance(base, np.ndarray):
        base.flags.writeable = False
        base = base.base
    return array


def _as_frozen_array(signal: ArrayLike, name: str, where: str) -> Samples:
    try:
        array = np.asarray(signal, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise RecordingError(
            f"{where}: {name} contains a value that is not a number ({error}). Expected numbers"
        ) from error
    if array.size == 0:
        raise RecordingError(f"{where}: {name} is empty. Expected at least one sample")
    rows = np.atleast_1d(array)
    if not all(np.isfinite(rows[k : k + _BLOCK]).all() for k in range(0, len(rows), _BLOCK)):
        n_bad, first = int((~np.isfinite(array)).sum()), np.argwhere(~np.isfinite(array))[0].tolist()
        raise RecordingError(
            f"{where}: {name} contains {n_bad} NaN or infinite values, the first at {first}. "
            "Expected finite samples"
        )
    base: object = array
    while isinstance(base, np.ndarray) and not base.flags.writeable:
        base = base.base
    # A read-only array whose bases are also read-only needs no copy.
    return array if array.flags.c_contiguous and base is None else make_read_only(np.array(array))
