"""Reflection coefficients k of autoregressive models: how near to 1 they come, what they say of levels.

Nothing here loads numba, which `recursions` needs.
"""

import numpy as np

from texclass.recording import Samples

LARGEST = float(np.nextafter(1.0, 0.0))
"""The largest |k| that is returned: the last number below 1."""
EXHAUSTED = 4 * float(np.finfo(np.float64).eps)
"""A residual below this part of the signal (RMS) is rounding noise: the recursion ends."""
SMALLEST_ANGLE = 1e-60
"""Angles in rad below this one are taken as this one, so that no square of a product underflows."""


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
