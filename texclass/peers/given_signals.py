"""What peers are given: the movement signals that our features read, or every channel of the sensor."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Literal

import numpy as np

from texclass.features.contract import UndefinedFeatureError
from texclass.features.phase_view import Channels, Views, channels_apart, views_of
from texclass.phases import segment
from texclass.recording import Phases, Recording, Samples

Given = Literal["same", "each"]
DESCRIPTIONS: dict[Given, str] = {
    "same": "the very signals that our movement features read (axes of one accelerometer combined by DFT321, "
    "other channels apart; mean removed, and the path of the hand where the feature set does so)",
    "each": "every axis of accelerometer and gyroscope by itself, cut to the movement, mean removed",
}


def signal_reader(
    given: Given, first: Recording, channels: Channels, *, without_hand: bool = False
) -> Callable[[Recording], Samples]:
    """Return what turns a recording into the signals that peers are given.

    Parameters
    ----------
    given : {"same", "each"}
        See `DESCRIPTIONS`.
    first : Recording
        A recording of the dataset, which decides the channels.
    channels : {"combine", "each", "auto"}
        How the pipeline treats channels.
    without_hand : bool
        Whether its features read movements without the path of the hand.

    Returns
    -------
    callable
        Recording -> ndarray of shape (n_channels, n_samples).
    """
    same = partial(same_signals, apart=channels_apart(first, channels), without_hand=without_hand)
    return every_channel if given == "each" else same


def same_signals(recording: Recording, apart: tuple[str, ...], *, without_hand: bool = False) -> Samples:
    """Return the movement that our features read, one row a channel.

    Where there is no movement, its place is taken by the taps, one after the other; without taps, by the
    whole recording.
    """
    views = views_of(recording, apart)
    kept = [view for prefix, view in views.items() if prefix or not apart]
    return np.stack([_felt(view, without_hand) for view in kept])


def every_channel(recording: Recording) -> Samples:
    """Return each axis without its mean during the movement, one row an axis."""
    start, stop = segment(recording).movement or (0, recording.n_samples)
    parts = (recording.acceleration, recording.turn_rate)
    axes = np.column_stack([part[start:stop] for part in parts if part is not None])
    return np.ascontiguousarray((axes - axes.mean(axis=0)).T)


def _felt(view: Views, without_hand: bool) -> Samples:
    with suppress(UndefinedFeatureError):
        return (view.without_hand if without_hand else view.movement).samples
    with suppress(UndefinedFeatureError):
        return np.concatenate([part for tap in view.tap.taps for part in (tap.hand, tap.impulse)])
    whole = Phases(movement=(0, view.recording.n_samples))
    return _felt(Views(view.recording, whole, view.channel), without_hand)
