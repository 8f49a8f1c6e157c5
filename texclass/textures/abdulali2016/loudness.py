"""How loud: the extra output of the network, the paper's variance or what a law leaves of the level.

The paper interpolates the variance of the innovation, with zeros at zero speed and force. What lies between
large numbers and zeros is too quiet on average, and where a network swings below zero it is silent. So by
default

    ln level = alpha ln v + beta ln f + g(u)

alpha and beta by regression over the segments, and g, which the network learns, is what remains: the
direction and whatever departs from the law. It needs no points of silence, and is never negative.
"""

from typing import Literal

import numpy as np

from texclass.recording import Samples

Loudness = Literal["level", "variance"]
STEEPEST = 2.0
"""Largest exponent: above, a few segments have misled the regression."""
SILENCE = 1e-6
"""Segments below this part of the loudest one count as this."""


def growth_of(speed: Samples, force: Samples, level: Samples, weight: Samples) -> tuple[float, float]:
    """Return alpha and beta of segments, each 0 ... `STEEPEST`; 0 where speed or force never changed.

    Parameters
    ----------
    speed, force, level : ndarray of shape (n_segments,)
        mm/s, N and the unit of the acceleration; all above 0.
    weight : ndarray of shape (n_segments,)
        Of each segment in the regression.
    """
    columns = np.log(np.column_stack([speed, force, level]))
    centred = (columns - np.average(columns, axis=0, weights=weight)) * np.sqrt(weight)[:, np.newaxis]
    powers = np.linalg.lstsq(centred[:, :2], centred[:, 2], rcond=1e-6)[0]
    alpha, beta = np.clip(powers, 0.0, STEEPEST).tolist()
    return alpha, beta


def residual_of(level: Samples, speed: Samples, force: Samples, growth: tuple[float, float]) -> Samples:
    """Return g = ln level - alpha ln v - beta ln f, shape (n,)."""
    return np.asarray(np.log(level) - growth[0] * np.log(speed) - growth[1] * np.log(force))


def floored(level: Samples) -> Samples:
    """Return levels (n,) none of which is 0."""
    return np.maximum(level, max(SILENCE * float(level.max()), np.finfo(np.float64).tiny))


def level_of(
    kind: Loudness, output: Samples, k: Samples, motion: tuple[Samples, Samples], growth: tuple[float, float]
) -> Samples:
    """Return the RMS of the vibration (n,) from the output of the network.

    Parameters
    ----------
    kind : {"level", "variance"}
        What the output is: g, or the variance of the innovation, of which what is below 0 counts 0.
    output : ndarray of shape (n,)
    k : ndarray of shape (n, p)
        Reflection coefficients.
    motion : tuple of ndarray of shape (n,)
        Speed (mm/s) and force (N), at least 0.
    growth : tuple of float
        alpha and beta.
    """
    if kind == "variance":
        log_cosines = (np.log1p(k) + np.log1p(-k)).sum(axis=1) / 2
        return np.asarray(np.sqrt(np.maximum(output, 0.0)) * np.exp(np.minimum(-log_cosines, 700.0)))
    law = motion[0] ** growth[0] * motion[1] ** growth[1]
    return np.asarray(law * np.exp(np.minimum(output, 300.0)))
