"""The path a renderer is given, checked at the edge and cheap for one sample."""

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.textures.oeztuerk2018 import _kernels as kernels


def checked_path(velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples]:
    """Return velocity (n, 2) and force (n,), or say which rule they break."""
    v, f = np.asarray(velocity, dtype=np.float64), np.asarray(force, dtype=np.float64)
    if f.ndim != 1 or v.shape != (f.size, 2):
        raise ValueError(f"velocity has shape {v.shape}, force {f.shape}; the rule is (n, 2) and (n,)")
    v, f = np.ascontiguousarray(v), np.ascontiguousarray(f)
    if not kernels.all_finite(v, f):
        raise ValueError("the path holds NaN or infinity; the rule is finite velocities and forces")
    return v, f
