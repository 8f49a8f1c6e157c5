"""The RMS spectral error of `oeztuerk2018`, eqs. (3.11) and (3.12), on magnitudes."""

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples

N_DFT = 2800
"""Points of the DFT in `oeztuerk2018`, section 3.1."""


def checked_dft(n_dft: int) -> int:
    """Return the number of points, or say which rule it breaks."""
    if n_dft < 1:
        raise ValueError(f"the DFT has {n_dft} points; the rule is at least 1")
    return n_dft


def relative_error(A: Samples, A_g: Samples, n_dft: int) -> Samples:
    """Return C = RMS(A_g - A) / RMS(A), the RMS taken over all N bins of the DFT.

    Parameters
    ----------
    A : ndarray of shape (N // 2 + 1,)
        Magnitudes of the recorded signal at the bins of `rfft`, not all 0.
    A_g : ndarray of shape (..., N // 2 + 1)
        Those of the synthesized ones.
    n_dft : int
        N; the upper half of the bins mirrors the lower one.

    Returns
    -------
    ndarray of shape (...)
    """
    twice = np.full(n_dft // 2 + 1, 2.0)
    twice[0] = 1.0
    if n_dft % 2 == 0:
        twice[-1] = 1.0
    return np.asarray(root_mean_square(A_g - A, twice) / root_mean_square(A, twice))


def root_mean_square(x: Samples, weight: ArrayLike = 1.0) -> Samples:
    """Return sqrt(sum w x^2 / sum w) over the last axis; no square of a float64 under- or overflows."""
    largest = np.max(np.abs(x), axis=-1, initial=0.0)
    unit = x / np.where(largest > 0, largest, 1.0)[..., np.newaxis]
    w = np.broadcast_to(np.asarray(weight, dtype=np.float64), x.shape[-1:])
    return np.asarray(largest * np.sqrt(unit**2 @ w / w.sum()))
