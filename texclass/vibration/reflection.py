"""Limits of reflection coefficients k, and the levels that follow from them.

This module does not load numba; `recursions` does.
"""

import numpy as np

from texclass.recording import Samples

MAX_REFLECTION = float(np.nextafter(1.0, 0.0))
"""Largest |k| that is returned: the largest float64 below 1."""
MIN_RELATIVE_RESIDUAL = 4 * float(np.finfo(np.float64).eps)
"""RMS of the residual, relative to the signal, below which it is rounding noise and the recursion ends."""
MIN_ANGLE = 1e-60
"""Lower limit of angles in rad. Smaller angles are raised to it, so that no squared product underflows."""


def log_cosines(k: Samples) -> Samples:
    """Return ln sqrt(1 - k^2) with full precision even if |k| is close to 1."""
    return np.asarray((np.log1p(k) + np.log1p(-k)) / 2)


def residual_levels(k: Samples, gain: Samples) -> Samples:
    """Return the residual RMS of the orders m = 0 ... p: gain / prod_{i > m} sqrt(1 - k_i^2).

    Values that exceed the range of float64 are infinite.
    """
    below = np.zeros((*k.shape[:-1], k.shape[-1] + 1))
    below[..., :-1] = -np.cumsum(log_cosines(k)[..., ::-1], axis=-1)[..., ::-1]
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = np.exp(below / 2) * gain[..., np.newaxis] * np.exp(below / 2)
    return np.where(gain[..., np.newaxis] == 0, 0.0, scaled)
