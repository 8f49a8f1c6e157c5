"""What a feature reads: one view per phase of a recording, its transforms computed once and when asked."""

import functools
import inspect
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any, Concatenate, Literal, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from texclass.fourier import LANES
from texclass.phases import find_data, find_glitches, find_phases, get_glitches, interpolate_glitches
from texclass.recording import STANDARD_GRAVITY, Phases, Recording, RecordingError, Samples
from texclass.signals import combine, remove_hand_motion

P = ParamSpec("P")
R = TypeVar("R")
Phase = Literal["tap", "movement", "travel", "friction", "pair"]
Channels = Literal["combine", "each", "auto", "all"]
TURN = ("turn_x", "turn_y", "turn_z")
"""Names of the channels of a turn rate, after those of the acceleration."""
LONG = 5000
"""Movements of more samples are cut to a length that transforms take quickly; see `kept_length`."""
MIN_SEGMENT_SAMPLES = 2048
"""Samples that a piece must hold: with fewer, what is gained by voting is lost in each piece."""


class UndefinedFeatureError(ValueError):
    """The feature has no value for this signal; the message is the reason (value and rule).

    Extraction turns it into NaN and keeps the reason for the user.
    """


def undefined_if(wrong: Any, reason: str) -> None:
    """Raise `UndefinedFeatureError` with a reason (value and rule) if something is wrong."""
    if wrong:
        raise UndefinedFeatureError(reason)


class Memory(dict[Hashable, Any]):
    """Results of the transforms of one view, by function and parameters.

    Attributes
    ----------
    timed : callable, optional
        Called as timed(key, compute) in place of compute() where a transform is computed, to measure it.
    """

    timed: Callable[[tuple[Any, ...], Callable[[], Any]], Any] | None = None


@dataclass(frozen=True, eq=False)
class PhaseView:
    """One phase of one channel: samples, sampling rate, and a memory for shared transforms.

    Attributes
    ----------
    samples : ndarray of shape (n,), or (n_segments, n) of pieces side by side
        The movement's acceleration (without its mean) or the friction voltage during it.
    fs : float
        Sampling rate in Hz; of a movement over its way, in samples per m.
    """

    samples: Samples
    fs: float
    memory: Memory = field(default_factory=Memory, repr=False)

    @property
    def n_samples(self) -> int:
        """Number of samples, of a piece if there are pieces."""
        return int(self.samples.shape[-1])


@dataclass(frozen=True, eq=False)
class TapSignal:
    """One tap, split at the contact.

    Attributes
    ----------
    hand : ndarray of shape (n,)
        Acceleration of the hand towards the surface, before the contact; may be empty.
    impulse : ndarray of shape (m,)
        Impact and decay, from the contact on.
    quality : float
        How surely it is a tap, 0 to 1; see `texclass.recording.Tap`.
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
        At least one.
    fs : float
        Sampling rate in Hz.
    noise : float
        Root mean square of the quiet stretch (same unit as the samples); 0.0 when there is none.
    """

    taps: tuple[TapSignal, ...]
    fs: float
    noise: float = 0.0
    memory: Memory = field(default_factory=Memory, repr=False)


@dataclass(frozen=True, eq=False)
class PairView:
    """The movements of two channels that are kept apart, side by side.

    Attributes
    ----------
    sides : tuple of two PhaseView
        As long as each other; the transforms of one serve all of its pairs.
    """

    sides: tuple[PhaseView, PhaseView]
    memory: Memory = field(default_factory=Memory, repr=False)

    @property
    def fs(self) -> float:
        """Sampling rate in Hz."""
        return self.sides[0].fs

    @property
    def n_samples(self) -> int:
        """Number of samples of either."""
        return self.sides[0].n_samples


View = PhaseView | TapView | PairView
"""What a feature reads."""
V = TypeVar("V", PhaseView, TapView, PairView)


def transform(function: Callable[Concatenate[V, P], R]) -> Callable[Concatenate[V, P], R]:
    """Remember the result of a transform of a view on the view, by the values of its (hashable) parameters.

    Whoever receives a remembered array must not write to it.
    """
    parameters = list(inspect.signature(function).parameters.values())[1:]
    defaults: dict[str, Any] = {p.name: p.default for p in parameters}
    in_order: tuple[Any, ...] = tuple(defaults.values())

    @functools.wraps(function)
    def remembered(view: V, /, *args: P.args, **kwargs: P.kwargs) -> R:
        if kwargs:  # by hand: what inspect offers takes as long as a short feature
            given: dict[str, Any] = defaults | dict(zip(defaults, args, strict=False)) | kwargs
            key = (function, *given.values())
        else:
            key = (function, *args, *in_order[len(args) :])
        memory = view.memory
        if key not in memory:
            timed = memory.timed
            compute = functools.partial(function, view, *args, **kwargs)
            memory[key] = compute() if timed is None else timed(key, compute)
        result: R = memory[key]
        return result

    return remembered


def cut_segments(view: PhaseView, n_segments: int) -> PhaseView:
    """Return the view of equal pieces of the movement side by side, or `view` where it is too short for them.

    Too short is less than `n_segments` times `MIN_SEGMENT_SAMPLES` samples; at most n_segments - 1 samples at
    the end are left out.
    """
    return (
        view
        if n_segments == 1 or view.n_samples < n_segments * MIN_SEGMENT_SAMPLES
        else _cut(view, n_segments)
    )


@transform
def _cut(view: PhaseView, n_segments: int) -> PhaseView:
    size, timed = view.n_samples // n_segments, view.memory.timed
    cut = PhaseView(view.samples[: n_segments * size].reshape(n_segments, size), view.fs)
    if timed is not None:
        cut.memory.timed = lambda key, compute: timed((*key, f"{n_segments} segments"), compute)
    return cut


@transform
def segment_views(view: PhaseView) -> tuple[PhaseView, ...]:
    """Return a view of each piece by itself."""
    each, timed = tuple(PhaseView(samples, view.fs) for samples in view.samples), view.memory.timed
    if timed is not None:
        for i, piece in enumerate(each, 1):
            piece.memory.timed = lambda key, compute, i=i: timed((*key, f"segment {i}"), compute)
    return each


def kept_length(n: int) -> int:
    """Return how many of n samples of a movement are kept: all, or, if `LONG`, at least 93 %.

    A multiple of four without prime factors above 5: with one, every Fourier transform takes several times
    as long.
    """
    return int(LANES * fft.prev_fast_len(n // LANES, real=True)) if n > LONG else n


@dataclass(frozen=True, eq=False)
class Views:
    """The phase views of one recording, for one channel or for all of them combined.

    Parameters
    ----------
    recording : Recording
        The recording.
    phases : Phases
        Where its taps and its movement are.
    channel : int, optional
        Column of the acceleration, or, counted on, of the turn rate; None combines the columns of the
        acceleration by DFT321 [strese2015, section III].
    sides : tuple of two Views, optional
        Of two channels: then there is the `pair` of them, and nothing else.
    """

    recording: Recording
    phases: Phases
    channel: int | None = None
    sides: "tuple[Views, Views] | None" = None

    def of(self, phase: Phase, *, remove_hand_motion: bool = False) -> View:
        """Return the view of a phase, the movement `remove_hand_motion` if that is asked for.

        Raises
        ------
        UndefinedFeatureError
            If the recording does not have it; the message is the reason.
        """
        if phase == "pair" or self.sides is not None:
            return self._pair(phase, remove_hand_motion=remove_hand_motion)
        view: View = getattr(self, phase)  # a phase is the name of its view
        return self.vibration if remove_hand_motion and phase == "movement" else view

    def _pair(self, phase: Phase, *, remove_hand_motion: bool) -> PairView:
        if self.sides is None:
            raise UndefinedFeatureError("one channel, or several combined. Expected two kept apart")
        if phase != "pair":
            raise UndefinedFeatureError(f"two channels. Expected one for a {phase}")
        one, other = (side.vibration if remove_hand_motion else side.movement for side in self.sides)
        return PairView((one, other))

    @cached_property
    def movement(self) -> PhaseView:
        """Acceleration during the movement, its mean removed and nothing else: the same in any unit.

        What lies below 10 Hz is kept [strese2015, section IV-D].
        """
        return PhaseView(combine(self._moving, single=True), self.recording.fs)

    @cached_property
    def vibration(self) -> PhaseView:
        """The movement without hand motion, where the sensor is known to have felt it.

        Known it is where the unit is one of acceleration and the mean is gravity's, above half of 9.81 m/s^2:
        such a sensor feels how the hand turns and moves it, too, and `remove_hand_motion` subtracts a moving
        average. One that does not (a microphone, an accelerometer behind a high-pass) has nothing to remove:
        its low frequencies are the surface's.
        """
        axes = self._moving
        mean = np.ones(len(axes)) @ axes / len(axes)  # numpy's mean of short rows takes ten times as long
        if self.recording.unit != "m/s^2" or math.hypot(*np.atleast_1d(mean)) <= STANDARD_GRAVITY / 2:
            return self.movement
        vibration = remove_hand_motion(self.movement.samples, self.recording.fs)
        return PhaseView(vibration, self.recording.fs)

    @cached_property
    def travel(self) -> PhaseView:
        """The movement `remove_hand_motion` over the way of the tool, where its speed was recorded.

        Computed order tracking [Fyfe and Munck, Mech. Syst. Signal Process. 11, 1997], with the way
        s(t) = integral of |v| dt in place of turns: samples are means over equal steps of s, of 0.05 mm, or
        as many as there were in time. What lies so many mm apart comes so often, however fast the hand is.
        """
        speed = self.recording.speed
        if speed is None:
            raise UndefinedFeatureError("no speed signal")
        x = self.vibration.samples
        first = self.phases.movement[0] if self.phases.movement else 0
        steps = 1e-3 * np.abs(speed[first : first + x.size]) / self.recording.fs
        s, integral = (np.concatenate([[0.0], np.cumsum(part)]) for part in (steps, x * steps))
        undefined_if(s[-1] == 0, "the speed is 0 throughout. Expected a tool that moves")
        undefined_if(np.ptp(x) == 0, f"silence: all {x.size} samples are {x[0]:g}")
        step = max(5e-5, s[-1] / x.size)  # m; half of the shortest wave
        edges = step * np.arange(int(s[-1] / step) + 1)
        return PhaseView(np.diff(np.interp(edges, s, integral)) / step, 1 / step)

    @cached_property
    def tap(self) -> TapView:
        """The taps, resting level removed, with the root mean square of the quiet stretch before them.

        Single wild samples are interpolated, and a value that is held before the data begin is left out.
        """
        taps = self.phases.taps
        undefined_if(not taps, "no tap found")
        # The quiet stretch, the taps and nothing of the movement: one signal, so that all share one level.
        axes = self._axes(0, taps[-1].end)
        columns = axes.reshape(len(axes), -1)
        first = min(find_data(columns, self.recording.fs).first, taps[0].start)
        left_out = (len(axes) - first) - kept_length(len(axes) - first)
        first += left_out if 2 * left_out <= taps[0].start - first else 0
        together = self.channel is None  # then what the search for phases found will do
        wild = get_glitches(self.recording, len(axes)) if together else find_glitches(columns)
        axes = interpolate_glitches(columns, wild)[first:].reshape(-1, *axes.shape[1:])
        quiet, signal = taps[0].start - first, combine(axes, single=True)
        signal = signal - np.median(signal[:quiet] if quiet else signal)
        parts = []
        for tap in taps:
            start, impact, end = (at - first for at in (tap.start, tap.impact, tap.end))
            parts.append(TapSignal(signal[start:impact], signal[impact:end], tap.quality))
        # On the axes, not on their combination: DFT321 leaks the taps into the quiet stretch.
        at_rest = axes[:quiet].reshape(quiet, columns.shape[1]).T.copy()
        at_rest -= (at_rest @ np.ones(quiet) / max(quiet, 1))[:, np.newaxis]
        noise = math.sqrt(np.vdot(at_rest, at_rest) / quiet) if quiet else 0.0
        return TapView(tuple(parts), self.recording.fs, noise)

    @cached_property
    def friction(self) -> PhaseView:
        """Friction voltage during the movement, or all of it when no movement was found."""
        if self.recording.friction is None:
            raise UndefinedFeatureError("no friction signal")
        start, stop = self.phases.movement or (0, self.recording.n_samples)
        return PhaseView(self.recording.friction[start:stop], self.recording.fs)

    @property
    def _moving(self) -> Samples:
        """The axes during the movement."""
        if self.phases.movement is None:
            raise UndefinedFeatureError("no movement found")
        start, stop = self.phases.movement
        return self._axes(start, start + kept_length(stop - start))

    def _axes(self, start: int, stop: int) -> Samples:
        axes, turn = self.recording.acceleration[start:stop], self.recording.turn_rate
        n_axes = len(self.recording.channels)
        if self.channel is not None and self.channel >= n_axes and turn is not None:
            return turn[start:stop, self.channel - n_axes]
        return axes if self.channel is None or axes.ndim == 1 else axes[:, self.channel]


def view_of(phase: Phase, signal: ArrayLike, fs: float | None, unit: str = "arbitrary") -> View:
    """Return the view of a signal without a recording: all of it is the movement or the friction.

    Parameters
    ----------
    phase : {"movement", "travel", "tap", "friction", "pair"}
        Of a signal of taps, those that `texclass.phases.find_phases` finds.
    signal : array_like of shape (n_samples,) or (n_samples, n_axes)
        Axes are combined by DFT321; a pair has two.
    fs : float
        Sampling rate in Hz; of a movement over its way ("travel"), in samples per m.
    unit : str
        See `Recording`. It changes no value of a movement: its mean is removed, the path of the hand is not
        (see `texclass.signals.remove_hand_motion`).

    Raises
    ------
    RecordingError
        If `fs` is missing, or a sample is not finite.
    """
    x = np.asarray(signal, dtype=np.float64)
    recording = Recording(x, fs=fs, unit=unit, friction=x if phase == "friction" else None)  # type: ignore[arg-type]
    whole = Phases(movement=(0, recording.n_samples))
    if phase == "travel":
        return Views(recording, whole).movement
    if phase != "pair":
        return Views(recording, find_phases(recording) if phase == "tap" else whole).of(phase)
    if (n := len(recording.channels)) != 2:
        raise RecordingError(f"a pair of {n} channels. Expected an array of shape (n_samples, 2)")
    sides = Views(recording, whole, 0), Views(recording, whole, 1)
    return Views(recording, whole, sides=sides).of(phase)


def views_of(recording: Recording, channels: Sequence[str] = ()) -> dict[str, Views]:
    """Return the views of a recording by column prefix.

    Parameters
    ----------
    recording : Recording
        The recording; its phases are segmented unless they are declared.
    channels : sequence of str, optional
        Names of channels to keep apart (prefix "x/" for channel x, "x*y/" for two); by default all are
        combined (prefix "").

    Raises
    ------
    ValueError
        If the recording's channels are not the ones named.
    """
    phases = find_phases(recording)
    if channels and tuple(channels) not in (recording.channels, _with_turn_rate(recording)):
        present = ", ".join(_with_turn_rate(recording))
        raise RecordingError(
            f"{recording.source or recording.recording_id}: axes are {present}. "
            f"Expected {', '.join(channels)}, as in the first recording"
        )
    combined = {"": Views(recording, phases)}
    apart = {f"{name}/": Views(recording, phases, i) for i, name in enumerate(channels)}
    pairs = {
        pair_prefix(a, b): Views(recording, phases, sides=(apart[f"{a}/"], apart[f"{b}/"]))
        for a, b in combinations(channels, 2)
    }
    return combined | apart | pairs


def pair_prefix(one: str, other: str) -> str:
    """Return what columns of two channels begin with: "x*turn_z/"."""
    return f"{one}*{other}/"


def channels_apart(recording: Recording, channels: Channels) -> tuple[str, ...]:
    """Return the channels to keep apart: every axis for "each", none for "combine".

    "all" adds the axes of the turn rate, if there is one, to "each". "auto" combines the axes of one
    accelerometer (channels named among x, y and z) and keeps others apart.

    Raises
    ------
    ValueError
        If `channels` is none of the four.
    """
    if channels not in ("combine", "each", "auto", "all"):
        raise ValueError(f"channels is {channels!r}. Expected 'combine', 'each', 'auto' or 'all'")
    if channels == "all":
        return _with_turn_rate(recording)
    names = recording.channels
    one_sensor = len(names) == 1 or {name.lower()[-1] for name in names} <= set("xyz")
    return () if channels == "combine" or (channels == "auto" and one_sensor) else names


def _with_turn_rate(recording: Recording) -> tuple[str, ...]:
    return recording.channels + (() if recording.turn_rate is None else TURN)
