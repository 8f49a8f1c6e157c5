"""Simulation of controlled recordings and of single gestures.

In the controlled recordings of `strese2015` (section III), one condition rises linearly and the others are
constant, or speed and force change in steps. A gesture is a tap or a slow, fast or hard stroke that starts
from rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Recording, Samples
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

REST_S, RAMP_S = 0.3, 0.05
"""Time in s for which a plate rests at first, and time in which it reaches a new speed."""
GESTURES: Mapping[str, tuple[float, float, float] | None] = MappingProxyType(
    {
        "tap": None,
        "slow stroke": (0.4, 1.0, 2.0),
        "fast stroke": (2.0, 1.0, 1.0),
        "hard stroke": (1.0, 2.5, 1.2),
    }
)
"""Mapping from the name of a gesture to its parameters: for a stroke, the factors by which the operator's
speed and force are multiplied, and the duration in s; for a tap, None."""


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
    """Simulate a recording on a rotating plate whose speed rises, under a constant normal force.

    Parameters
    ----------
    surface, operator, fs, seed, sensor
        See `record_freehand`. The grip and the pose of the operator are not varied.
    duration_s : float
        Duration in s (default 10). The plate does not move in the first 0.3 s.
    speed_mm_s : (float, float)
        First and last speed in mm/s (default 20 and 200).
    force_n : float
        Normal force in N (default 1).

    Returns
    -------
    Recording
        Simulated recording, with the same signals as from `record_freehand`.

    Examples
    --------
    >>> from texclass.simulate import operator_catalogue, surface_catalogue
    >>> (surface,), (operator,) = surface_catalogue(1, seed=0), operator_catalogue(1, seed=0)
    >>> recording = record_rising_speed(surface, operator, duration_s=1.0, fs=2_000.0, seed=0)
    >>> recording.recording_id, recording.acceleration.shape
    ('stone-01, rising speed', (2000, 3))
    """
    recording_id = f"{surface.name}, rising speed"
    return _record_plate(
        surface, operator, duration_s, fs, seed, speed_mm_s, (force_n, force_n), sensor, recording_id
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
    """Simulate a recording on a rotating plate of constant speed, under a rising normal force.

    Parameters
    ----------
    surface, operator, duration_s, fs, seed, sensor
        See `record_rising_speed`.
    force_n : (float, float)
        First and last normal force in N (default 0.4 and 2.5).
    speed_mm_s : float
        Speed in mm/s (default 100).

    Returns
    -------
    Recording
        Simulated recording, with the same signals as from `record_freehand`.

    Examples
    --------
    >>> from texclass.simulate import operator_catalogue, surface_catalogue
    >>> (surface,), (operator,) = surface_catalogue(1, seed=0), operator_catalogue(1, seed=0)
    >>> recording = record_rising_force(surface, operator, duration_s=1.0, fs=2_000.0, seed=0)
    >>> recording.recording_id, recording.fs
    ('stone-01, rising force', 2000.0)
    """
    recording_id = f"{surface.name}, rising force"
    return _record_plate(
        surface, operator, duration_s, fs, seed, (speed_mm_s, speed_mm_s), force_n, sensor, recording_id
    )


def record_steps(
    surface: Surface,
    operator: Operator,
    steps: Sequence[tuple[float, float]],
    *,
    step_s: float = 1.0,
    fs: float = 10_000.0,
    seed: Seed,
    sensor: Sensor | None = None,
) -> Recording:
    """Simulate a recording on a rotating plate whose speed and normal force change in steps.

    Parameters
    ----------
    surface, operator, fs, seed, sensor
        See `record_rising_speed`.
    steps : sequence of (float, float)
        Speed in mm/s and normal force in N of each step.
    step_s : float
        Duration of a step in s (default 1). Speed and force change in the first 0.05 s of each step, and the
        tip moves to a neighbouring line of the surface.

    Returns
    -------
    Recording
        Simulated recording, with the same signals as from `record_freehand`. The plate does not move in the
        first `REST_S` = 0.3 s.

    Examples
    --------
    >>> from texclass.simulate import operator_catalogue, surface_catalogue
    >>> (surface,), (operator,) = surface_catalogue(1, seed=0), operator_catalogue(1, seed=0)
    >>> recording = record_steps(surface, operator, [(50.0, 1.0), (100.0, 0.5)], fs=2_000.0, seed=0)
    >>> recording.acceleration.shape, recording.speed[[2000, 4000]].round(-1).tolist()
    ((4600, 3), [50.0, 100.0])
    """
    duration_s = REST_S + len(steps) * step_s
    check_duration_and_rate(duration_s, fs, shortest_s=1.0)
    time_s = np.arange(int(np.ceil(duration_s * hand.CONTROL_RATE)) + 2) / hand.CONTROL_RATE - REST_S
    starts_s = step_s * np.arange(len(steps))
    knots_s = np.column_stack([starts_s, starts_s + RAMP_S]).ravel()

    def follow(values: ArrayLike, first: float) -> Samples:
        """Return a signal that changes from `first` to each of the values in turn."""
        ends = np.concatenate([[first], np.asarray(values, dtype=np.float64)])
        return np.asarray(np.interp(time_s, knots_s, np.column_stack([ends[:-1], ends[1:]]).ravel()))

    speed_mm_s, force_n = np.transpose(np.asarray(steps, dtype=np.float64))
    velocity, force = 1e-3 * follow(speed_mm_s, 0.0), follow(force_n, force_n[0])
    depth, zeros = pressing_depth(surface, operator, force), np.zeros(time_s.size)
    path = hand.Gesture(-depth, velocity, zeros, follow(np.arange(len(steps)), 0.0), strokes_s=REST_S)
    return perform(
        path,
        surface,
        operator,
        duration_s=duration_s,
        fs=fs,
        rngs=generators(seed),
        sensor=sensor,
        recording_id=f"{surface.name}, {len(steps)} steps",
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
    """Simulate a recording of taps with rising strength.

    Parameters
    ----------
    surface, operator, fs, seed, sensor
        See `record_rising_speed`.
    n_taps : int
        Number of taps (default 8).
    tap_speed_mm_s : (float, float)
        Speed of the hand at the contact of the first and the last tap, in mm/s (default 10 and 45).

    Returns
    -------
    Recording
        Simulated recording, with the same signals as from `record_freehand`.

    Examples
    --------
    >>> from texclass.simulate import operator_catalogue, surface_catalogue
    >>> (surface,), (operator,) = surface_catalogue(1, seed=0), operator_catalogue(1, seed=0)
    >>> recording = record_rising_taps(surface, operator, n_taps=2, fs=2_000.0, seed=0)
    >>> len(recording.phases.taps)
    2
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
    zeros = np.zeros(n)
    path = hand.Gesture(normal + hand.tremor(operator, n, rngs[0]), zeros, zeros, zeros, times)
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
    """Simulate a recording of one gesture.

    Parameters
    ----------
    gesture : str
        Name of the gesture, one of `GESTURES`.
    surface : Surface
        Explored surface.
    operator : Operator
        Person who explores the surface. As in `record_freehand`, the habits vary around the typical values.
    seed : int or sequence of int
        Seed of all random numbers.
    fs : float
        Sampling rate in Hz (default 10,000).

    Returns
    -------
    Recording
        Simulated recording, with the same signals as from `record_freehand`.

    Raises
    ------
    ValueError
        If the gesture is unknown.

    References
    ----------
    Fishel, Loeb: Bayesian exploration for intelligent identification of textures, Frontiers in Neurorobotics
    6:4, 2012. The authors perform single gestures, and select the next gesture from the previous results.

    Examples
    --------
    >>> from texclass.simulate import operator_catalogue, surface_catalogue
    >>> (surface,), (operator,) = surface_catalogue(1, seed=0), operator_catalogue(1, seed=0)
    >>> recording = record_gesture("tap", surface, operator, fs=2_000.0, seed=0)
    >>> recording.recording_id, recording.phases.kind
    ('tap on stone-01 by operator-1', 'taps only')
    """
    if gesture not in GESTURES:
        raise ValueError(f"gesture must be one of {', '.join(GESTURES)}, got {gesture!r}")
    if (stroke := GESTURES[gesture]) is None:
        person = operator.vary(generators(seed)[0])
        speeds = (person.tap_speed_mm_s, person.tap_speed_mm_s)
        recording = record_rising_taps(surface, person, n_taps=1, fs=fs, seed=seed, tap_speed_mm_s=speeds)
    else:
        speed, force, seconds = stroke
        person = replace(operator, speed_mm_s=speed * operator.speed_mm_s, force_n=force * operator.force_n)
        recording = record_freehand(surface, person, duration_s=seconds, fs=fs, seed=seed, with_taps=False)
    return recording.with_(recording_id=f"{gesture} on {surface.name} by {operator.name}")


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
    """Simulate a recording on a plate that rests at first; speed and force then rise linearly."""
    check_duration_and_rate(duration_s, fs, shortest_s=1.0)
    n_knots = int(np.ceil(duration_s * hand.CONTROL_RATE)) + 2
    begin = int(REST_S * hand.CONTROL_RATE)
    time = np.maximum(np.arange(n_knots) - begin, 0) / hand.CONTROL_RATE
    ramp = time / time[-1]
    velocity = 1e-3 * (speed[0] + (speed[1] - speed[0]) * ramp) * np.minimum(time / RAMP_S, 1.0)
    normal = -pressing_depth(surface, operator, force[0] + (force[1] - force[0]) * ramp)
    zeros = np.zeros(n_knots)
    path = hand.Gesture(normal, velocity, zeros, zeros, strokes_s=REST_S)
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
