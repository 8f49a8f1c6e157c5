"""Simulated hands that stroke the nine surfaces of `texclass.haptics.textures.resonant_surfaces`."""

import numpy as np
from scipy import signal

from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import condition
from texclass.haptics.textures.resonant_surfaces import SURFACES, ResonantSurface, get_surface

__all__ = ["SURFACES", "ResonantSurface", "get_surface", "hand_motion", "simulate_constant", "simulate_scan"]

SPEEDS_MM_S, FORCES_N = (25.0, 200.0), (0.3, 2.5)
"""What a hand does; drawn geometrically."""
PLATE_MM = 100.0


def hand_motion(duration_s, fs, rng):
    """Return position (n, 2), velocity (n, 2) and force (n,) of unconstrained stroking on a plate.

    Straight strokes in random directions, 0.25 to 0.8 s long, each at a speed and force of its own, which
    wander by some 15 % meanwhile; velocity and force follow with the bandwidth of a hand (6 and 3 Hz). Both
    fade in and out at the ends.
    """
    n = round(duration_s * fs)
    wished, position, start = np.empty((n, 3)), np.full(2, PLATE_MM / 2), 0
    while start < n:
        stop = min(start + round(rng.uniform(0.25, 0.8) * fs), n)
        speed, force = (np.exp(rng.uniform(*np.log(between))) for between in (SPEEDS_MM_S, FORCES_N))
        velocity = speed * _direction(position, rng)
        wished[start:stop] = *velocity, force
        position = position + velocity * (stop - start) / fs
        start = stop
    wander = signal.sosfilt(_hand(3.0, fs), rng.standard_normal((n, 2)) * np.sqrt(fs / 6), axis=0)
    wished *= np.exp(0.15 * wander[:, [0, 0, 1]])
    fade = min(round(0.1 * fs), n // 4)
    wished[:fade] = wished[n - fade :] = 0.0
    velocity = signal.sosfilt(_hand(6.0, fs), wished[:, :2], axis=0)
    force = signal.sosfilt(_hand(3.0, fs), wished[:, 2])
    return PLATE_MM / 2 + np.cumsum(velocity, axis=0) / fs, velocity, np.maximum(force, 0.0)


def _direction(position, rng):
    """Return a random direction, homewards where the edge of the plate is near."""
    home = PLATE_MM / 2 - position
    far = np.hypot(*home) > PLATE_MM / 4
    angle = np.arctan2(home[1], home[0]) + rng.uniform(-1.2, 1.2) if far else rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _hand(hz, fs):
    return signal.bessel(2, hz, fs=fs, norm="mag", output="sos")


def simulate_scan(what, duration_s, fs, rng):
    """Return a freehand scan of a surface, conditioned as a recorded one would be; `rng` draws all."""
    return _scan(what, hand_motion(duration_s, fs, rng), fs, rng)


def simulate_constant(what, duration_s, fs, rng, *, speed=None, force=None, direction=None):
    """Return a conditioned scan in which what is given (mm/s, N, rad) stays; the rest wanders slowly."""
    n = round(duration_s * fs)
    t = np.arange(n) / fs
    phase, rate = rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.15, 0.3, 3)
    swing = 0.7 * np.sin(2 * np.pi * rate[:, np.newaxis] * t + phase[:, np.newaxis])
    middle = [np.sqrt(low * high) for low, high in (SPEEDS_MM_S, FORCES_N)]
    v = np.full(n, speed) if speed is not None else middle[0] * np.exp(swing[0])
    f = np.full(n, force) if force is not None else middle[1] * np.exp(swing[1])
    angle = np.full(n, direction) if direction is not None else phase[2] + 2 * np.pi * rate[2] * t
    velocity = v[:, np.newaxis] * np.column_stack([np.cos(angle), np.sin(angle)])
    return _scan(what, (np.cumsum(velocity, axis=0) / fs, velocity, f), fs, rng)


def _scan(what, motion, fs, rng):
    position, velocity, force = motion
    return condition(Scan(what.vibration(velocity, force, fs, rng), position, velocity, force, fs, what.name))
