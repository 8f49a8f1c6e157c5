"""Single gestures on demand: a tap, a slow, a fast or a hard stroke, each from a rest of its own."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from texclass.recording import Recording
from texclass.simulate.controlled import record_rising_taps
from texclass.simulate.freehand import Seed, generators, record_freehand
from texclass.simulate.hand import Operator
from texclass.simulate.surfaces import Surface


class Stroke(NamedTuple):
    """How a stroke differs from the operator's own: factors of speed and force; its seconds, with a rest."""

    speed: float
    force: float
    seconds: float


GESTURES: Mapping[str, Stroke | None] = MappingProxyType(
    {
        "tap": None,
        "slow stroke": Stroke(0.4, 1.0, 2.0),
        "fast stroke": Stroke(2.0, 1.0, 1.0),
        "hard stroke": Stroke(1.0, 2.5, 1.2),
    }
)
"""Gestures by name; None is a tap."""


def record_gesture(
    gesture: str, surface: Surface, operator: Operator, *, seed: Seed, fs: float = 10_000.0
) -> Recording:
    """Simulate one gesture of a tool that comes to a surface, explores it once, and no more.

    Parameters
    ----------
    gesture : str
        One of `GESTURES`.
    surface, operator
        What is explored, by whom: habits are drawn anew around the operator's, as in `record_freehand`.
    seed : int or sequence of int
        Of everything that is random in it.
    fs : float
        Sampling rate in Hz.

    Raises
    ------
    ValueError
        If there is no such gesture.

    References
    ----------
    Fishel, Loeb: Bayesian exploration for intelligent identification of textures, Frontiers in Neurorobotics
    6:4, 2012: gestures that are made on demand, of which the next is chosen by what is known.
    """
    if gesture not in GESTURES:
        raise ValueError(f"gesture is {gesture!r}; the rule is one of {', '.join(GESTURES)}")
    stroke = GESTURES[gesture]
    if stroke is None:
        person = operator.redrawn(generators(seed)[0])
        speed = (person.tap_speed_mm_s, person.tap_speed_mm_s)
        made = record_rising_taps(surface, person, n_taps=1, fs=fs, seed=seed, tap_speed_mm_s=speed)
    else:
        person = replace(
            operator, speed_mm_s=stroke.speed * operator.speed_mm_s, force_n=stroke.force * operator.force_n
        )
        seconds = stroke.seconds
        made = record_freehand(surface, person, duration_s=seconds, fs=fs, seed=seed, with_taps=False)
    return made.with_(recording_id=f"{gesture} on {surface.name} by {operator.name}")
