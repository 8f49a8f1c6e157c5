"""What a hand does as it is told: controlled runs, and single gestures.

In the controlled runs of `strese2015` (Sec. III) one condition rises linearly and the others stay; a gesture
is a tap, a slow, a fast or a hard stroke, each from a rest of its own.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from texclass.recording import Recording
from texclass.simulate import hand
from texclass.simulate.freehand import (
    Seed,
    check_duration_and_rate,
    generators,
    perform,
    pressing_depth,
    record_freehand,
)
from texclass.simulate.hand import Operator
from texclass.simulate.surfaces import Surface
from texclass.simulate.tool import Sensor

GESTURES: Mapping[str, tuple[float, float, float] | None] = MappingProxyType(
    {
        "tap": None,
        "slow stroke": (0.4, 1.0, 2.0),
        "fast stroke": (2.0, 1.0, 1.0),
        "hard stroke": (1.0, 2.5, 1.2),
    }
)
"""Gestures by name; of a stroke, factors of the operator's speed and force, and its seconds with a rest."""


def record_rising_speed(
    surface: Surface,
    operator: Operator,
    *,
    duration_s: float = 10.0,
    fs: float = 10_000.0,
    seed: Seed,
    speed_mm_s: tuple[float, float] = (20.0, 200.0),
    force_n: float = 1.0,
    sensor: Sensor | None = None,
) -> Recording:
    """Simulate a rotary plate that turns faster and faster under a constant normal force.

    Parameters
    ----------
    surface, operator, fs, seed, sensor
        As in `record_freehand`; the operator gives grip and pose, without variation.
    duration_s : float
        The first 0.3 s the plate stands still.
    speed_mm_s : (float, float)
        First and last speed.
    force_n : float
        Normal force.
    """
    told = f"{surface.name}, rising speed"
    return _record_plate(
        surface, operator, duration_s, fs, seed, speed_mm_s, (force_n, force_n), sensor, told
    )


def record_rising_force(
    surface: Surface,
    operator: Operator,
    *,
    duration_s: float = 10.0,
    fs: float = 10_000.0,
    seed: Seed,
    force_n: tuple[float, float] = (0.4, 2.5),
    speed_mm_s: float = 100.0,
    sensor: Sensor | None = None,
) -> Recording:
    """Simulate a rotary plate at constant speed under a rising normal force; see `record_rising_speed`."""
    told = f"{surface.name}, rising force"
    return _record_plate(
        surface, operator, duration_s, fs, seed, (speed_mm_s, speed_mm_s), force_n, sensor, told
    )


def record_rising_taps(
    surface: Surface,
    operator: Operator,
    *,
    n_taps: int = 8,
    fs: float = 10_000.0,
    seed: Seed,
    tap_speed_mm_s: tuple[float, float] = (10.0, 45.0),
    sensor: Sensor | None = None,
) -> Recording:
    """Simulate taps of rising strength and nothing else; see `record_rising_speed`.

    Parameters
    ----------
    surface, operator, fs, seed, sensor
        As in `record_freehand`.
    n_taps : int
        Number of taps.
    tap_speed_mm_s : (float, float)
        Speed of the hand at the contact of the first and the last.
    """
    if n_taps < 1 or min(tap_speed_mm_s) <= 0:
        raise ValueError(
            f"n_taps and tap_speed_mm_s must be positive, got {n_taps} and {tap_speed_mm_s} mm/s"
        )
    check_duration_and_rate(float(n_taps), fs, shortest_s=0.0)
    rngs = generators(seed)
    rhythm_s = np.tile([0.06, 0.15, 0.25, 0.1], (n_taps, 1))
    taps = np.column_stack([1e-3 * np.linspace(*tap_speed_mm_s, n_taps), rhythm_s])
    depth = float(pressing_depth(surface, operator, 0.3 * operator.force_n))
    normal, times = hand.tap_path(taps, 0.4, depth, stay=False)
    n = len(normal)
    still = np.zeros(n)
    path = hand.Gesture(normal + hand.tremor(operator, n, rngs[0]), still, still, still, times)
    return perform(
        path,
        surface,
        operator,
        duration_s=n / hand.CONTROL_RATE,
        fs=fs,
        rngs=rngs,
        sensor=sensor,
        recording_id=f"{surface.name}, rising taps",
    )


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
        raise ValueError(f"gesture must be one of {', '.join(GESTURES)}, got {gesture!r}")
    if (stroke := GESTURES[gesture]) is None:
        person = operator.redrawn(generators(seed)[0])
        met = (person.tap_speed_mm_s, person.tap_speed_mm_s)
        made = record_rising_taps(surface, person, n_taps=1, fs=fs, seed=seed, tap_speed_mm_s=met)
    else:
        speed, force, seconds = stroke
        person = replace(operator, speed_mm_s=speed * operator.speed_mm_s, force_n=force * operator.force_n)
        made = record_freehand(surface, person, duration_s=seconds, fs=fs, seed=seed, with_taps=False)
    return made.with_(recording_id=f"{gesture} on {surface.name} by {operator.name}")


def _record_plate(
    surface: Surface,
    operator: Operator,
    duration_s: float,
    fs: float,
    seed: Seed,
    speed: tuple[float, float],
    force: tuple[float, float],
    sensor: Sensor | None,
    recording_id: str,
) -> Recording:
    """Return what is felt of a plate that turns after a rest; speed and force then rise linearly."""
    check_duration_and_rate(duration_s, fs, shortest_s=1.0)
    n_knots = int(np.ceil(duration_s * hand.CONTROL_RATE)) + 2
    rest_s = 0.3
    begin = int(rest_s * hand.CONTROL_RATE)
    since = np.maximum(np.arange(n_knots) - begin, 0) / hand.CONTROL_RATE
    rising = since / since[-1]
    velocity = 1e-3 * (speed[0] + (speed[1] - speed[0]) * rising) * np.minimum(since / 0.05, 1.0)
    normal = -pressing_depth(surface, operator, force[0] + (force[1] - force[0]) * rising)
    straight = np.zeros(n_knots)
    path = hand.Gesture(normal, velocity, straight, straight, strokes_s=rest_s)
    return perform(
        path,
        surface,
        operator,
        duration_s=duration_s,
        fs=fs,
        rngs=generators(seed),
        sensor=sensor,
        recording_id=recording_id,
    )
