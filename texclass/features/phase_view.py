"""Phase views: the samples that features read, and a cache of their transforms."""

import functools
import inspect
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any, Concatenate, Literal, ParamSpec, TypeVar, final

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from texclass.fourier import LANES
from texclass.phases import (
    exclude_outliers,
    find_data,
    find_glitches,
    find_phases,
    get_glitches,
    interpolate_glitches,
)
from texclass.recording import STANDARD_GRAVITY, Phases, Recording, RecordingError, Samples
from texclass.signals import combine, remove_hand_motion

P = ParamSpec("P")
R = TypeVar("R")
Phase = Literal["tap", "movement", "travel", "friction", "pair"]
Channels = Literal["combine", "each", "auto", "all"]
TURN_CHANNELS = ("turn_x", "turn_y", "turn_z")
"""Names of the channels of the turn rate, which follow the channels of the acceleration."""
SOUND_CHANNEL = "sound"
"""Name of the channel of the sound, which is the last channel."""
LONG_SAMPLES = 5000
"""Number of samples above which a movement is shortened to a length with a fast Fourier transform; see
`trimmed_length`."""
MIN_SEGMENT_SAMPLES = 2048
"""Minimum number of samples of a segment. With shorter segments, the features lose more accuracy than voting
gains."""


class UndefinedFeatureError(ValueError):
    """Error that is raised if a feature is undefined for a signal. The message is the reason.

    `FeatureExtractor` catches the error, sets the value to NaN and reports the reason.

    Examples
    --------
    >>> from texclass.features.fineness import fineness
    >>> fineness([0.0] * 1000, fs=1000)
    Traceback (most recent call last):
    ...
    texclass.features.phase_view.UndefinedFeatureError: silence: all 1000 samples are 0
    """


def undefined_if(condition: Any, reason: str) -> None:
    """Raise `UndefinedFeatureError` with `reason` if `condition` is true."""
    if condition:
        raise UndefinedFeatureError(reason)


class Memory(dict[Hashable, Any]):
    """Cache of the transforms of one view, with function and parameters as key.

    Attributes
    ----------
    timed : callable, optional
        Function that measures the time of a transform. If set, ``timed(key, compute)`` is called instead of
        ``compute()``.
    """

    timed: Callable[[tuple[Any, ...], Callable[[], Any]], Any] | None = None


@dataclass(frozen=True, eq=False)
class PhaseView:
    """One phase of one channel: samples, sampling rate and cached transforms.

    Attributes
    ----------
    samples : ndarray of shape (n,), or (n_segments, n) for segments
        Acceleration during the movement (mean removed), or friction voltage during the movement.
    fs : float
        Sampling rate in Hz. For a movement over the path of the tool, samples per m.
    memory : Memory
        Cache of transforms.

    Examples
    --------
    >>> import numpy as np
    >>> from texclass.features.slopes import vibration_level
    >>> view = PhaseView(np.sin(np.arange(1000.0)), fs=1000)
    >>> vibration_level(view).round(2).tolist()  # log10 of 0.71
    [-0.15]
    """

    samples: Samples
    fs: float
    memory: Memory = field(default_factory=Memory, repr=False)

    @property
    def n_samples(self) -> int:
        """Number of samples of the phase, or of each segment."""
        return int(self.samples.shape[-1])


@dataclass(frozen=True, eq=False)
class TapSignal:
    """One tap, split at the contact.

    Attributes
    ----------
    hand : ndarray of shape (n,)
        Acceleration of the hand towards the surface, before the contact; may be empty.
    impulse : ndarray of shape (m,)
        Impact and decay, starting at the contact.
    quality : float
        Confidence that this is a tap, 0 to 1; see `texclass.recording.Tap`.
    """

    hand: Samples
    impulse: Samples
    quality: float = 1.0


@dataclass(frozen=True, eq=False)
class TapView:
    """All taps of one channel of one recording.

    Attributes
    ----------
    taps : tuple of TapSignal
        Taps, at least one.
    fs : float
        Sampling rate in Hz.
    noise : float
        RMS of the quiet start of the recording, in the unit of the samples (0.0 if there is no quiet start).
    memory : Memory
        Cache of transforms.
    """

    taps: tuple[TapSignal, ...]
    fs: float
    noise: float = 0.0
    memory: Memory = field(default_factory=Memory, repr=False)


@final
@dataclass(frozen=True, eq=False)
class PairView:
    """The movements of two channels.

    Attributes
    ----------
    sides : tuple of two PhaseView
        Movements of the same length. All pairs that contain a channel share the transforms of its movement.
    memory : Memory
        Cache of transforms of the pair.
    """

    sides: tuple[PhaseView, PhaseView]
    memory: Memory = field(default_factory=Memory, repr=False)

    @property
    def fs(self) -> float:
        """Sampling rate in Hz."""
        return self.sides[0].fs

    @property
    def n_samples(self) -> int:
        """Number of samples of each channel."""
        return self.sides[0].n_samples


View = PhaseView | TapView | PairView
"""View of any phase."""
V = TypeVar("V", PhaseView, TapView, PairView)
S = TypeVar("S", PhaseView, PairView)


def transform(function: Callable[Concatenate[V, P], R]) -> Callable[Concatenate[V, P], R]:
    """Decorate a transform so that its results are cached on the view.

    The parameters must be hashable. Callers must not modify cached arrays.
    """
    parameters = list(inspect.signature(function).parameters.values())[1:]
    defaults: dict[str, Any] = {p.name: p.default for p in parameters}
    in_order: tuple[Any, ...] = tuple(defaults.values())

    @functools.wraps(function)
    def cached(view: V, /, *args: P.args, **kwargs: P.kwargs) -> R:
        if kwargs:  # not inspect.Signature.bind, which takes as long as a fast feature
            arguments: dict[str, Any] = defaults | dict(zip(defaults, args, strict=False)) | kwargs
            key = (function, *arguments.values())
        else:
            key = (function, *args, *in_order[len(args) :])
        memory = view.memory
        if key not in memory:
            timed = memory.timed
            compute = functools.partial(function, view, *args, **kwargs)
            memory[key] = compute() if timed is None else timed(key, compute)
        result: R = memory[key]
        return result

    return cached


def cut_segments(view: S, n_segments: int) -> S:
    """Return a view of equal segments of the movement, or `view` itself if the movement is too short.

    A movement needs at least `n_segments` times `MIN_SEGMENT_SAMPLES` samples. Up to n_segments - 1 samples
    at the end are dropped.

    Parameters
    ----------
    view : PhaseView or PairView
        Movement of shape (n,), or movements of two channels.
    n_segments : int
        Number of segments.

    Returns
    -------
    PhaseView or PairView
        View with samples of shape (n_segments, n // n_segments), or with two sides of this shape.
    """
    if n_segments == 1 or view.n_samples < n_segments * MIN_SEGMENT_SAMPLES:
        return view
    if isinstance(view, PairView):
        first, second = (_cut(side, n_segments) for side in view.sides)
        return PairView((first, second))
    return _cut(view, n_segments)


@transform
def _cut(view: PhaseView, n_segments: int) -> PhaseView:
    size, timed = view.n_samples // n_segments, view.memory.timed
    segments = PhaseView(view.samples[: n_segments * size].reshape(n_segments, size), view.fs)
    if timed is not None:
        segments.memory.timed = lambda key, compute: timed((*key, f"{n_segments} segments"), compute)
    return segments


def segment_views(view: S) -> tuple[S, ...]:
    """Return one view per segment."""
    if isinstance(view, PairView):
        return tuple(PairView(sides) for sides in zip(*map(_views_of_segments, view.sides), strict=True))
    return _views_of_segments(view)


@transform
def _views_of_segments(view: PhaseView) -> tuple[PhaseView, ...]:
    segments, timed = tuple(PhaseView(samples, view.fs) for samples in view.samples), view.memory.timed
    if timed is not None:
        for i, segment in enumerate(segments, 1):
            segment.memory.timed = lambda key, compute, i=i: timed((*key, f"segment {i}"), compute)
    return segments


def trimmed_length(n: int) -> int:
    """Return how many of the n samples of a movement are used.

    Up to `LONG_SAMPLES`, all samples are used. For longer movements, the length is reduced by at most 7 % to
    four times a product of powers of 2, 3 and 5. Larger prime factors would make Fourier transforms several
    times slower.
    """
    return int(LANES * fft.prev_fast_len(n // LANES, real=True)) if n > LONG_SAMPLES else n


@dataclass(frozen=True, eq=False)
class Views:
    """The phase views of a recording, for one channel or all channels combined.

    Parameters
    ----------
    recording : Recording
        The recording.
    phases : Phases
        Taps and movement of the recording.
    channel : int, optional
        Column of the acceleration. By default, the columns are combined by DFT321 [strese2015, section III].
    sides : tuple of two Views, optional
        Views of two channels. If given, "pair" is the only phase.
    """

    recording: Recording
    phases: Phases
    channel: int | None = None
    sides: "tuple[Views, Views] | None" = None

    def of(self, phase: Phase, *, remove_hand_motion: bool = False) -> View:
        """Return the view of a phase.

        Parameters
        ----------
        phase : {"tap", "movement", "travel", "friction", "pair"}
            Phase.
        remove_hand_motion : bool
            Whether to remove hand motion from the movement (default False); see `vibration`.

        Raises
        ------
        UndefinedFeatureError
            If the recording does not have this phase; the message is the reason.
        """
        if phase == "pair" or self.sides is not None:
            return self._pair(phase, remove_hand_motion=remove_hand_motion)
        view: View = getattr(self, phase)  # a phase is the name of its view
        return self.vibration if remove_hand_motion and phase == "movement" else view

    def _pair(self, phase: Phase, *, remove_hand_motion: bool) -> PairView:
        if self.sides is None:
            raise UndefinedFeatureError("channels are combined or single. Expected two separate channels")
        if phase != "pair":
            raise UndefinedFeatureError(f"got two channels. Expected one channel for the phase {phase!r}")
        one, other = (side.vibration if remove_hand_motion else side.movement for side in self.sides)
        undefined_if(one.fs != other.fs, f"the channels have rates of {one.fs:g} and {other.fs:g} Hz")
        return PairView((one, other))

    @cached_property
    def movement(self) -> PhaseView:
        """Acceleration during the movement, without its mean.

        Frequencies below 10 Hz are kept [strese2015, section IV-D]. The view does not depend on the unit.
        """
        return PhaseView(combine(self._moving, single=True), self.recording.fs)

    @cached_property
    def vibration(self) -> PhaseView:
        """Vibration during the movement, without hand motion if the sensor measures gravity.

        A sensor measures gravity if the unit is m/s^2 and the magnitude of the mean exceeds half of 9.81
        m/s^2. It then also measures rotation and translation of the hand, and `remove_hand_motion` subtracts
        a moving average. Other sensors, such as a microphone or an accelerometer with a high-pass filter, do
        not measure hand motion. Their low frequencies are due to the surface, so the whole movement is
        returned.
        """
        axes = self._moving
        mean = np.ones(len(axes)) @ axes / len(axes)  # ten times faster than np.mean for short rows
        if self.recording.unit != "m/s^2" or math.hypot(*np.atleast_1d(mean)) <= STANDARD_GRAVITY / 2:
            return self.movement
        vibration = remove_hand_motion(self.movement.samples, self.recording.fs)
        return PhaseView(vibration, self.recording.fs)

    @cached_property
    def travel(self) -> PhaseView:
        """Vibration without hand motion, as a function of the distance travelled by the tool.

        The recording must contain the speed of the tool. The method is computed order tracking [Fyfe and
        Munck, Mech. Syst. Signal Process. 11, 1997], with the path s(t) = integral of |v| dt instead of
        revolutions. Samples are means over equal steps of s. The step is at least 0.05 mm, and large enough
        that the number of samples does not increase. A structure with a period in mm then has the same
        frequency at any speed of the hand.
        """
        speed = self.recording.speed
        if speed is None:
            raise UndefinedFeatureError("no speed signal")
        x = self.vibration.samples
        first = self.phases.movement[0] if self.phases.movement else 0
        where = self.recording.source or self.recording.recording_id
        speed = exclude_outliers(speed, self.recording.rate_of("speed"), "speed", "mm/s", where)
        speed = self.recording.with_(speed=speed).at_acceleration("speed")
        steps = 1e-3 * np.abs(speed[first : first + x.size]) / self.recording.fs
        s, integral = (np.concatenate([[0.0], np.cumsum(part)]) for part in (steps, x * steps))
        undefined_if(s[-1] == 0, "the speed of the tool is always 0. Expected a moving tool")
        undefined_if(np.ptp(x) == 0, f"silence: all {x.size} samples are {x[0]:g}")
        step = max(5e-5, s[-1] / x.size)  # in m; 0.05 mm is half of the shortest wavelength of interest
        edges = step * np.arange(int(s[-1] / step) + 1)
        return PhaseView(np.diff(np.interp(edges, s, integral)) / step, 1 / step)

    @cached_property
    def tap(self) -> TapView:
        """The taps without their resting level, and the RMS of the quiet start of the recording.

        Single-sample glitches are interpolated, and padding at the start of the recording is dropped.
        """
        taps = self.phases.taps
        undefined_if(not taps, "no tap found")
        # Quiet start and taps are processed as one signal, so that all taps have the same resting level.
        axes = self._axes(0, taps[-1].end)
        columns = axes.reshape(len(axes), -1)
        first = min(find_data(columns, self.recording.fs).first, taps[0].start)
        n_dropped = (len(axes) - first) - trimmed_length(len(axes) - first)
        first += n_dropped if 2 * n_dropped <= taps[0].start - first else 0
        is_combined = self.channel is None  # then the glitches are known from the search for phases
        glitches = get_glitches(self.recording, len(axes)) if is_combined else find_glitches(columns)
        axes = interpolate_glitches(columns, glitches)[first:].reshape(-1, *axes.shape[1:])
        n_quiet, signal = taps[0].start - first, combine(axes, single=True)
        signal = signal - np.median(signal[:n_quiet] if n_quiet else signal)
        signals = []
        for tap in taps:
            start, impact, end = (index - first for index in (tap.start, tap.impact, tap.end))
            signals.append(TapSignal(signal[start:impact], signal[impact:end], tap.quality))
        # The noise is computed from the single axes, because DFT321 would spread the taps over the quiet
        # start.
        quiet = axes[:n_quiet].reshape(n_quiet, columns.shape[1]).T.copy()
        quiet -= (quiet @ np.ones(n_quiet) / max(n_quiet, 1))[:, np.newaxis]
        noise = math.sqrt(np.vdot(quiet, quiet) / n_quiet) if n_quiet else 0.0
        return TapView(tuple(signals), self.recording.fs, noise)

    @cached_property
    def friction(self) -> PhaseView:
        """Friction voltage during the movement, or during the whole recording if it has no movement."""
        if self.recording.friction is None:
            raise UndefinedFeatureError("no friction signal")
        start, stop = self.phases.movement or (0, self.recording.n_samples)
        span = slice(*self.recording.span_of("friction", start, stop))
        return PhaseView(self.recording.friction[span], self.recording.rate_of("friction"))

    @property
    def _moving(self) -> Samples:
        """Acceleration during the movement, shape (n, n_axes) or (n,)."""
        if self.phases.movement is None:
            raise UndefinedFeatureError("no movement found")
        start, stop = self.phases.movement
        return self._axes(start, start + trimmed_length(stop - start))

    def _axes(self, start: int, stop: int) -> Samples:
        axes = self.recording.acceleration[start:stop]
        return axes if self.channel is None or axes.ndim == 1 else axes[:, self.channel]


def view_of(phase: Phase, signal: ArrayLike, fs: float | None, unit: str = "arbitrary") -> View:
    """Return a view of an array.

    The whole array is used as the movement or the friction signal. Taps are located in it.

    Parameters
    ----------
    phase : {"movement", "travel", "tap", "friction", "pair"}
        Phase. Taps are located by `texclass.phases.find_phases`.
    signal : array_like of shape (n_samples,) or (n_samples, n_axes)
        Samples. Several axes are combined by DFT321. A pair must have two columns.
    fs : float
        Sampling rate in Hz. For a movement over the path of the tool ("travel"), samples per m.
    unit : str
        Unit of the samples (default "arbitrary"), see `Recording`. It does not affect a movement: the mean is
        removed, but hand motion is not (see `texclass.signals.remove_hand_motion`).

    Raises
    ------
    RecordingError
        If `fs` is missing, or a sample is not finite.

    Examples
    --------
    >>> view_of("movement", [[3.0, 1.0], [3.0, 5.0]], fs=100).n_samples
    2
    """
    x = np.asarray(signal, dtype=np.float64)
    recording = Recording(x, fs=fs, unit=unit, friction=x if phase == "friction" else None)  # type: ignore[arg-type]
    whole = Phases(movement=(0, recording.n_samples))
    if phase == "travel":
        return Views(recording, whole).movement
    if phase != "pair":
        return Views(recording, find_phases(recording) if phase == "tap" else whole).of(phase)
    if (n := len(recording.channels)) != 2:
        raise RecordingError(f"a pair must have 2 channels, got {n}. Pass an array of shape (n_samples, 2)")
    sides = Views(recording, whole, 0), Views(recording, whole, 1)
    return Views(recording, whole, sides=sides).of(phase)


def views_of(recording: Recording, channels: Sequence[str] = ()) -> dict[str, Views]:
    """Return the views of a recording, with column prefixes as keys.

    Parameters
    ----------
    recording : Recording
        The recording. Its phases are located unless they are declared.
    channels : sequence of str, optional
        Channels to keep separate, with the prefix "x/" for channel x and "x*y/" for a pair. Each has its own
        sampling rate. By default, all channels are combined, with the prefix "".

    Returns
    -------
    dict
        Mapping from prefix to `Views`.

    Raises
    ------
    RecordingError
        If the channels of the recording differ from `channels`.

    Examples
    --------
    >>> from texclass.recording import Phases, Recording
    >>> moving = Phases(movement=(0, 100))
    >>> recording = Recording([[0.0, 1.0]] * 100, fs=100, phases=moving, channels=("a", "b"))
    >>> list(views_of(recording, ("a", "b")))
    ['', 'a/', 'b/', 'a*b/']
    """
    phases = find_phases(recording)
    if channels and tuple(channels) not in (recording.channels, all_channels(recording)):
        axes = ", ".join(all_channels(recording))
        raise RecordingError(
            f"{recording.source or recording.recording_id} has the axes {axes}. "
            f"Expected {', '.join(channels)}, as in the first recording"
        )
    combined = {"": Views(recording, phases)}
    single = _views_of_channels(recording, phases, channels)
    sides = single
    if "turn_rate" in recording.auxiliary_fs:  # pairs need one rate
        sides = _views_of_channels(recording.with_interpolated("turn_rate"), phases, channels)
    pairs = {
        pair_prefix(a, b): Views(recording, phases, sides=(sides[a], sides[b])) for a, b in pairs_of(channels)
    }
    return combined | {f"{name}/": views for name, views in single.items()} | pairs


def _views_of_channels(recording: Recording, phases: Phases, channels: Sequence[str]) -> dict[str, Views]:
    """Return the views of each channel, at its own sampling rate."""
    views = {name: Views(recording, phases, i) for i, name in enumerate(recording.channels)}
    # With this unit, a turn rate is conditioned like the acceleration, as in exported models.
    signals = (("turn_rate", TURN_CHANNELS, recording.unit), ("sound", (SOUND_CHANNEL,), "arbitrary"))
    for signal, names, unit in signals:
        if not set(names).isdisjoint(channels):
            own = recording.with_(phases=phases).as_acceleration(signal, unit)
            views |= {name: Views(own, own.phases or Phases(), i) for i, name in enumerate(names)}
    return {name: views[name] for name in channels}


def pairs_of(channels: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Return the pairs of channels of one sensor: all channels except the sound.

    Examples
    --------
    >>> pairs_of(("x", "y", "sound"))
    (('x', 'y'),)
    """
    return tuple(combinations((name for name in channels if name != SOUND_CHANNEL), 2))


def pair_prefix(one: str, other: str) -> str:
    """Return the column prefix of a pair of channels, for example "x*turn_z/"."""
    return f"{one}*{other}/"


def separate_channels(recording: Recording, channels: Channels) -> tuple[str, ...]:
    """Return the channels to keep separate.

    Parameters
    ----------
    recording : Recording
        Recording with the names of its channels.
    channels : {"combine", "each", "auto", "all"}
        "combine" combines all channels. "each" keeps all axes separate, and "all" also includes the axes of
        the turn rate, and the sound. "auto" combines the axes of one accelerometer (channel names ending in
        x, y or z) and keeps all other channels separate.

    Raises
    ------
    ValueError
        If `channels` is not one of these four values.
    """
    if channels not in ("combine", "each", "auto", "all"):
        raise ValueError(f"channels must be 'combine', 'each', 'auto' or 'all', got {channels!r}")
    if channels == "all":
        return all_channels(recording)
    names = recording.channels
    one_sensor = len(names) == 1 or {name.lower()[-1] for name in names} <= set("xyz")
    return () if channels == "combine" or (channels == "auto" and one_sensor) else names


def all_channels(recording: Recording) -> tuple[str, ...]:
    """Return the names of all channels of a recording: axes, turn rate, sound."""
    turn = () if recording.turn_rate is None else TURN_CHANNELS
    return recording.channels + turn + (() if recording.sound is None else (SOUND_CHANNEL,))
