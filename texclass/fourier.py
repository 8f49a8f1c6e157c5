"""Real Fourier transforms in single precision, computed as four interleaved short transforms.

Four interleaved transforms use the full width of the vector unit and fit into the processor cache. They take
about half the time of `scipy.fft.rfft`. Let Y_p be the transform, with M = N/4 bins, of the samples p, p + 4,
p + 8, ... of N samples. The bins of the full transform are::

    X_(k+qM) = sum_p (-i)^(pq) exp(-2 pi i k p / N) Y_p(k)
"""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.recording import make_read_only

LANES = 4
"""Number of short transforms: single-precision lanes of the narrowest vector unit."""
BLOCK = 2048
"""Number of bins combined at a time, small enough for the processor cache."""
Bins = NDArray[np.complex64]


def rfft_quarters(x: NDArray[np.float32]) -> Bins:
    """Return the Fourier transform of real samples, with one quarter of the bins in each column.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Samples in single precision; `n_samples` must be a multiple of 4.

    Returns
    -------
    ndarray of shape (n_samples // 8 + 1, 4)
        X_(k+qM) in row k and column q; the other bins are their complex conjugates.
    """
    Y: Bins = fft.rfft(x.reshape(-1, LANES), axis=0)
    for rows, turns, join in _blocks(x.size):
        Y[rows] = (Y[rows] * turns) @ join
    return Y


def irfft_quarters(X: Bins, n: int) -> NDArray[np.float32]:
    """Invert `rfft_quarters`: return the n real samples. `X` is overwritten."""
    for rows, turns, join in _blocks(n):
        X[rows] = X[rows] @ (join.conj().T / LANES) * turns.conj()
    return np.asarray(fft.irfft(X, n // LANES, axis=0, overwrite_x=True)).reshape(n)


def rfft(x: NDArray[np.float32], *, quarter: bool = False) -> Bins:
    """Return the discrete Fourier transform of real samples, like `scipy.fft.rfft`.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Samples in single precision; `n_samples` must be a multiple of 4.
    quarter : bool
        Return only the bins 0 ... n_samples/4 (default False).

    Returns
    -------
    ndarray of shape (n_samples // 2 + 1,), or (n_samples // 4 + 1,) if `quarter`
        Bins of the transform.
    """
    Y, M = rfft_quarters(x), x.size // LANES
    X = np.empty(M + 1 if quarter else 2 * M + 1, dtype=np.complex64)
    X[: len(Y)] = Y[:, 0]
    np.conj(Y[::-1, 3], out=X[M + 1 - len(Y) : M + 1])  # X_(M-k) = conj X_(3M+k)
    if not quarter:
        X[M : M + len(Y)] = Y[:, 1]
        np.conj(Y[::-1, 2], out=X[2 * M + 1 - len(Y) :])
    return X


@functools.lru_cache(maxsize=8)
def _blocks(n: int) -> tuple[tuple[slice, Bins, Bins], ...]:
    """Return blocks of bins k, each with the factor per bin and the matrix by which Y_p(k) are combined.

    The factor exp(-2 pi i k p / n) is the product of two factors: one for the first bin of the block, which
    is part of the matrix, and one for the distance from this bin.
    """
    n_bins, p = n // LANES // 2 + 1, np.arange(LANES)
    turns = make_read_only(np.exp(-2j * np.pi / n * np.outer(np.arange(BLOCK), p)).astype(np.complex64))
    quarters = np.exp(-0.5j * np.pi * np.outer(p, p)).round().astype(np.complex64)
    return tuple(
        (
            slice(k, k + BLOCK),
            turns[: n_bins - k],
            np.exp(-2j * np.pi * k / n * p).astype(np.complex64)[:, np.newaxis] * quarters,
        )
        for k in range(0, n_bins, BLOCK)
    )
