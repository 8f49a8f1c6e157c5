"""Reflection coefficients k of autoregressive models: how near to 1 they come, what they say of levels.

Nothing here loads numba, which `recursions` needs.
"""

import sys

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples

LARGEST = float(np.nextafter(1.0, 0.0))
"""The largest |k| that is returned: the last number below 1."""
EXHAUSTED = 4 * float(np.finfo(np.float64).eps)
"""A residual below this part of the signal (RMS) is rounding noise: the recursion ends."""
SMALLEST_ANGLE = 1e-60
"""Angles in rad below this one are taken as this one, so that no square of a product underflows."""
WORTH_LOADING = 1e7
"""Samples times order from which on it takes less time to load numba than to do without."""


def log_cosines(k: Samples) -> Samples:
    """Return ln sqrt(1 - k^2), to full precision next to |k| = 1."""
    return np.asarray((np.log1p(k) + np.log1p(-k)) / 2)


def residual_of(k: Samples, gain: Samples) -> Samples:
    """Return gain / prod_{i > m} sqrt(1 - k_i^2) for m = 0 ... p; inf where that exceeds a float64."""
    below = np.zeros((*k.shape[:-1], k.shape[-1] + 1))
    below[..., :-1] = -np.cumsum(log_cosines(k)[..., ::-1], axis=-1)[..., ::-1]
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.exp(below / 2) * gain[..., np.newaxis] * np.exp(below / 2)
    return np.where(gain[..., np.newaxis] == 0, 0.0, scaled)


def burg(frames: Samples, order: int) -> tuple[Samples, Samples, NDArray[np.int64]]:
    """Fit each row by Burg's method as `recursions.burg` does, without padding.

    A little work is done in numpy: below `WORTH_LOADING` that is fast enough, and spares answers of `texclass
    predict` the second that loading numba takes.
    """
    if "numba" in sys.modules or frames.size * order > WORTH_LOADING:
        from texclass.vibration import recursions

        return recursions.burg(frames, order, 0)
    n, f, b = frames.shape[1], frames, frames
    deviation = np.repeat(np.sqrt(np.mean(frames**2, axis=1, keepdims=True)), order + 1, axis=1)
    k, fitted = np.zeros((len(frames), order)), np.zeros(len(frames), np.int64)
    going, least = np.ones(len(frames), np.bool_), 2 * (EXHAUSTED * deviation[:, 0]) ** 2
    total = _energy(f[:, 1:]) + _energy(b[:, :-1])
    for m in range(1, min(order, n - 1) + 1):
        going &= total > (n - m) * least
        if not going.any():
            break
        f, b = f[:, 1:], b[:, :-1]
        step = -2.0 * np.einsum("kt,kt->k", f, b) / np.where(going, total, 1.0)
        step = np.where(going, np.clip(step, -LARGEST, LARGEST), 0.0)
        f, b = f + step[:, None] * b, b + step[:, None] * f
        total = _energy(f[:, 1:]) + _energy(b[:, :-1])
        left = total + f[:, 0] ** 2 + b[:, -1] ** 2  # the next stage pairs all but these two
        k[:, m - 1] = step
        fitted[going] = m
        deviation[going, m:] = np.sqrt(left / (2 * (n - m)))[going, np.newaxis]
    return k, deviation, fitted


def _energy(x: Samples) -> Samples:
    return np.asarray(np.einsum("kt,kt->k", x, x))
