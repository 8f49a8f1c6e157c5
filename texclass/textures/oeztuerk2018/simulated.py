"""What the thesis recorded and did not publish, simulated: people's speeds, and surfaces at fixed speeds."""

from collections.abc import Sequence

import numpy as np

from texclass.recording import Samples
from texclass.signals import combine, remove_hand_motion
from texclass.simulate import Operator, Surface, record_rising_speed

N_SPEEDS = 240
"""`oeztuerk2018`, figure 4.2: samples per friction coefficient, one each 0.2 s."""
MEAN_MM_S, FRICTION_SCALE, SHAPE = 150.0, 0.64, 4.0
"""Ours: mean speed 150 mm/s exp(-friction / 0.64), gamma distribution of shape 4 about it."""
REST_S = 0.6
"""What is cut off a simulated plate's start."""


def stroking_speeds(friction: float, rng: np.random.Generator, *, n: int = N_SPEEDS) -> Samples:
    """Draw speeds (mm/s) of a person on a surface of this friction coefficient, shape (n,).

    The thesis prints no mean speeds, only histograms as pictures and the number of notable bins. The law here
    was chosen by us so that the histograms have about as many bins: it tests the rule, not the thesis.
    """
    mean = MEAN_MM_S * np.exp(-friction / FRICTION_SCALE)
    return np.asarray(rng.gamma(SHAPE, mean / SHAPE, n))


def plate_recordings(
    surface: Surface,
    operator: Operator,
    speeds: Sequence[float],
    *,
    duration_s: float = 3.0,
    fs: float = 10_000.0,
    seed: int,
) -> list[Samples]:
    """Simulate one surface at fixed speeds (mm/s) under 1 N: axes combined, without the hand's motion, m/s^2.

    Each speed has its own stretch of the surface and its own noise.
    """
    found = []
    for i, v in enumerate(speeds):
        plate = record_rising_speed(
            surface, operator, duration_s=duration_s + REST_S, fs=fs, seed=(seed, i), speed_mm_s=(v, v)
        )
        moving = combine(plate.acceleration[round(REST_S * fs) :])
        found.append(remove_hand_motion(moving, fs))
    return found
