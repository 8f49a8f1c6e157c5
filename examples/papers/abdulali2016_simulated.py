"""Simulate hands that stroke the nine surfaces of `texclass.haptics.textures.resonant_surfaces`."""

import numpy as np
from scipy import signal

from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import condition
from texclass.haptics.textures.resonant_surfaces import SURFACES, ResonantSurface, get_surface

__all__ = ["SURFACES", "ResonantSurface", "get_surface", "hand_motion", "simulate_constant", "simulate_scan"]

SPEEDS_MM_S, FORCES_N = (25.0, 200.0), (0.3, 2.5)
"""Ranges of the speed (mm/s) and force (N) of the hand, which are drawn from log-uniform distributions."""
PLATE_MM = 100.0
"""Side length of the plate in mm."""


def hand_motion(duration_s, fs, rng):
    """Simulate position (n, 2), velocity (n, 2) and force (n,) of unconstrained strokes on a plate.

    The hand makes straight strokes of 0.25 to 0.8 s in random directions. Each stroke has its own mean speed
    and force, which vary by about 15 %. Velocity and force have the bandwidth of a hand (6 and 3 Hz) and fade
    in and out at the ends.
    """
    n = round(duration_s * fs)
    target, position, start = np.empty((n, 3)), np.full(2, PLATE_MM / 2), 0
    while start < n:
        stop = min(start + round(rng.uniform(0.25, 0.8) * fs), n)
        speed, force = (np.exp(rng.uniform(*np.log(limits))) for limits in (SPEEDS_MM_S, FORCES_N))
        velocity = speed * _direction(position, rng)
        target[start:stop] = *velocity, force
        position = position + velocity * (stop - start) / fs
        start = stop
    wander = signal.sosfilt(_hand(3.0, fs), rng.standard_normal((n, 2)) * np.sqrt(fs / 6), axis=0)
    target *= np.exp(0.15 * wander[:, [0, 0, 1]])
    fade = min(round(0.1 * fs), n // 4)
    target[:fade] = target[n - fade :] = 0.0
    velocity = signal.sosfilt(_hand(6.0, fs), target[:, :2], axis=0)
    force = signal.sosfilt(_hand(3.0, fs), target[:, 2])
    return PLATE_MM / 2 + np.cumsum(velocity, axis=0) / fs, velocity, np.maximum(force, 0.0)


def _direction(position, rng):
    """Return a random direction; near the edge of the plate, the direction points towards the centre."""
    centre = PLATE_MM / 2 - position
    is_near_edge = np.hypot(*centre) > PLATE_MM / 4
    towards = np.arctan2(centre[1], centre[0])
    angle = towards + rng.uniform(-1.2, 1.2) if is_near_edge else rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _hand(hz, fs):
    return signal.bessel(2, hz, fs=fs, norm="mag", output="sos")


def simulate_scan(surface, duration_s, fs, rng):
    """Simulate a conditioned freehand scan of a surface."""
    return _scan(surface, hand_motion(duration_s, fs, rng), fs, rng)


def simulate_constant(surface, duration_s, fs, rng, *, speed=None, force=None, direction=None):
    """Simulate a conditioned scan in which speed (mm/s), force (N) or direction (rad) is constant."""
    n = round(duration_s * fs)
    t = np.arange(n) / fs
    phase, rate = rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.15, 0.3, 3)
    swing = 0.7 * np.sin(2 * np.pi * rate[:, np.newaxis] * t + phase[:, np.newaxis])
    middle = [np.sqrt(low * high) for low, high in (SPEEDS_MM_S, FORCES_N)]
    v = np.full(n, speed) if speed is not None else middle[0] * np.exp(swing[0])
    f = np.full(n, force) if force is not None else middle[1] * np.exp(swing[1])
    angle = np.full(n, direction) if direction is not None else phase[2] + 2 * np.pi * rate[2] * t
    velocity = v[:, np.newaxis] * np.column_stack([np.cos(angle), np.sin(angle)])
    return _scan(surface, (np.cumsum(velocity, axis=0) / fs, velocity, f), fs, rng)


def _scan(surface, motion, fs, rng):
    position, velocity, force = motion
    vibration = surface.vibration(velocity, force, fs, rng)
    return condition(Scan(vibration, position, velocity, force, fs, surface.name))
