"""Real Fourier transforms in single precision, made of four interleaved short ones.

Four short transforms at once fill the vector unit of a processor, which one long one does not, and stay near
it. With Y_p the transform of every fourth of N samples from p on, of period N/4 = M, the bins of the whole::

    X_(k+qM) = sum_p (-i)^(pq) exp(-2 pi i k p / N) Y_p(k)
"""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.recording import read_only

INTERLEAVED = 4
"""Transforms at once: lanes of single precision in the narrowest vector unit."""
BLOCK = 2048
"""Bins of each of the four that are joined at a time, so few that they stay near the processor."""
Bins = NDArray[np.complex64]
_FOUR = np.exp(-0.5j * np.pi * np.outer(np.arange(4), np.arange(4))).round().astype(np.complex64)


def folded(x: NDArray[np.float32]) -> Bins:
    """Return the Fourier transform of real samples, each quarter of the frequencies in a column.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Single precision; 4 divides `n_samples`.

    Returns
    -------
    ndarray of shape (n_samples // 8 + 1, 4)
        X_(k+qM) in row k and column q; what is missing are their complex conjugates.
    """
    Y: Bins = fft.rfft(x.reshape(-1, INTERLEAVED), axis=0)
    for rows, turns, join, _ in _blocks(x.size):
        Y[rows] = (Y[rows] * turns) @ join
    return Y


def unfolded(X: Bins, n: int) -> NDArray[np.float32]:
    """Return the n real samples whose bins are `X`, as `folded` has them; `X` is overwritten."""
    for rows, turns, _, part in _blocks(n):
        np.multiply(X[rows] @ part, turns.conj(), out=X[rows])
    return np.asarray(fft.irfft(X, n // INTERLEAVED, axis=0, overwrite_x=True)).reshape(n)


def rfft(x: NDArray[np.float32], *, quarter: bool = False) -> Bins:
    """Return the discrete Fourier transform of real samples, as `numpy.fft.rfft` has it.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        Single precision; 4 divides `n_samples`.
    quarter : bool
        Whether only the bins 0 ... n_samples/4 are asked for.

    Returns
    -------
    ndarray of shape (n_samples // 2 + 1,), or (n_samples // 4 + 1,)
    """
    Y, M = folded(x), x.size // INTERLEAVED
    X = np.empty(M + 1 if quarter else 2 * M + 1, dtype=np.complex64)
    X[: len(Y)] = Y[:, 0]
    np.conj(Y[::-1, 3], out=X[M + 1 - len(Y) : M + 1])  # X_(M-k) = conj X_(3M+k)
    if not quarter:
        X[M : M + len(Y)] = Y[:, 1]
        np.conj(Y[::-1, 2], out=X[2 * M + 1 - len(Y) :])
    return X


@functools.lru_cache(maxsize=8)
def _blocks(n: int) -> tuple[tuple[slice, Bins, Bins, Bins], ...]:
    """Return blocks of bins k; what multiplies Y_p(k) to join them, bin by bin and as a matrix; its inverse.

    exp(-2 pi i k p / n) is that of the block's first bin, which the matrix takes, times that from there on.
    """
    found, n_bins = [], n // INTERLEAVED // 2 + 1
    angle = -2j * np.pi / n * np.outer(np.arange(BLOCK), np.arange(INTERLEAVED))
    turns = read_only(np.exp(angle).astype(np.complex64))
    for k in range(0, n_bins, BLOCK):
        first = np.exp(-2j * np.pi * k / n * np.arange(INTERLEAVED)).astype(np.complex64)
        join = first[:, np.newaxis] * _FOUR
        found.append((slice(k, k + BLOCK), turns[: n_bins - k], join, join.conj().T / INTERLEAVED))
    return tuple(found)
