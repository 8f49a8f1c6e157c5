"""From a recording to what features read: one view per phase, made when the first feature asks for it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy import fft

from texclass.features.contract import Phase, UndefinedFeatureError
from texclass.features.view import PhaseView, TapSignal, TapView
from texclass.phases import segment
from texclass.recording import STANDARD_GRAVITY, Phases, Recording, Samples
from texclass.signals import combine, remove_hand_motion

Channels = Literal["combine", "each", "auto", "all"]
TURN = ("turn_x", "turn_y", "turn_z")
"""Names of the channels of a turn rate, after those of the acceleration."""
LONG = 5000
"""Movements of more samples lose up to 1.6 % at their end, so that their length has no large prime factor.

With one, every Fourier transform takes several times as long.
"""


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
    """

    recording: Recording
    phases: Phases
    channel: int | None = None

    def of(self, phase: Phase) -> PhaseView | TapView:
        """Return the view of a phase.

        Raises
        ------
        UndefinedFeatureError
            If the recording does not have it; the message is the reason.
        """
        match phase:
            case "movement":
                return self.movement
            case "tap":
                return self.tap
            case "friction":
                return self.friction

    @cached_property
    def movement(self) -> PhaseView:
        """Acceleration during the movement: mean removed, and with gravity the path of the hand.

        A sensor that feels gravity feels how the hand turns and moves it, too; one that does not (a
        microphone, an accelerometer behind a high-pass) has nothing to remove: its low frequencies are the
        surface's.
        """
        if self.phases.movement is None:
            raise UndefinedFeatureError("no movement found")
        start, stop = self.phases.movement
        if stop - start > LONG:
            stop = start + fft.prev_fast_len(stop - start)
        axes = self._axes(start, stop)
        vibration = combine(axes)
        if self.recording.unit == "m/s^2" and _holds_gravity(axes):
            vibration = remove_hand_motion(vibration, self.recording.fs)
        return PhaseView(vibration, self.recording.fs)

    @cached_property
    def tap(self) -> TapView:
        """The taps, resting level removed, with the root mean square of the quiet stretch before them."""
        taps = self.phases.taps
        if not taps:
            raise UndefinedFeatureError("no tap found")
        # The quiet stretch, the taps and nothing of the movement: one signal, so that all share one level.
        quiet = taps[0].start
        signal = combine(self._axes(0, taps[-1].end))
        signal = signal - np.median(signal[:quiet] if quiet else signal)
        parts = (TapSignal(signal[t.start : t.impact], signal[t.impact : t.end]) for t in taps)
        return TapView(tuple(parts), self.recording.fs, self._noise(quiet))

    @cached_property
    def friction(self) -> PhaseView:
        """Friction voltage during the movement, or all of it when no movement was found."""
        if self.recording.friction is None:
            raise UndefinedFeatureError("no friction signal")
        start, stop = self.phases.movement or (0, self.recording.n_samples)
        return PhaseView(self.recording.friction[start:stop], self.recording.fs)

    def _axes(self, start: int, stop: int) -> Samples:
        axes, turn = self.recording.acceleration[start:stop], self.recording.turn_rate
        n_axes = len(self.recording.channels)
        if self.channel is not None and self.channel >= n_axes and turn is not None:
            return turn[start:stop, self.channel - n_axes]
        return axes if self.channel is None or axes.ndim == 1 else axes[:, self.channel]

    def _noise(self, n_quiet: int) -> float:
        # On the axes, not on their combination: DFT321 leaks the taps into the quiet stretch.
        if n_quiet == 0:
            return 0.0
        axes = self._axes(0, n_quiet)
        return float(np.sqrt(np.sum(np.var(axes, axis=0))))


def _holds_gravity(axes: Samples) -> bool:
    """Whether the mean of the axes (m/s^2), taken together, is nearer to 1 g than to 0."""
    mean = np.ones(len(axes)) @ axes / len(axes)  # numpy's mean of short rows takes ten times as long
    return math.hypot(*np.atleast_1d(mean)) > STANDARD_GRAVITY / 2


def views_of(recording: Recording, channels: Sequence[str] = ()) -> dict[str, Views]:
    """Return the views of a recording by column prefix.

    Parameters
    ----------
    recording : Recording
        The recording; its phases are segmented unless they are declared.
    channels : sequence of str, optional
        Names of channels to keep apart (prefix "x/" for channel x); by default all are combined (prefix "").

    Raises
    ------
    ValueError
        If the recording's channels are not the ones named.
    """
    phases = segment(recording)
    if channels and tuple(channels) not in (recording.channels, _with_turn_rate(recording)):
        raise ValueError(
            f"{recording.source or recording.recording_id}: channels are {_with_turn_rate(recording)}; "
            f"the rule is {tuple(channels)}, as in the first recording"
        )
    combined = {"": Views(recording, phases)}
    return combined | {f"{name}/": Views(recording, phases, i) for i, name in enumerate(channels)}


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
        raise ValueError(f"channels is {channels!r}; the rule is 'combine', 'each', 'auto' or 'all'")
    if channels == "all":
        return _with_turn_rate(recording)
    names = recording.channels
    one_sensor = len(names) == 1 or {name.lower()[-1] for name in names} <= set("xyz")
    return () if channels == "combine" or (channels == "auto" and one_sensor) else names


def _with_turn_rate(recording: Recording) -> tuple[str, ...]:
    return recording.channels + (() if recording.turn_rate is None else TURN)
