"""Fourier transforms of the rows of a tensor as products of small matrices, and filters based on them.

The `DFT` operator of ONNX Runtime is slow for lengths that are not powers of two. A transform of length
N = N1 N2 is therefore factorised (Cooley, Tukey 1965) into N2 transforms of length N1, a rotation of each
element (twiddle factor), and N1 transforms of length N2. The ONNX file contains one period of cosine and
sine; the matrices are built from it when the file is loaded.
"""

from collections.abc import Callable

import numpy as np
from scipy import fft

from texclass.features import movement_filters
from texclass.recording import Samples
from texclass.robot.export.graph import Graph, Tensor
from texclass.robot.export.graph_view import GraphView, once


def rfft(rows: Tensor, n: int, n_fft: int, n_bins: int) -> tuple[Tensor, Tensor]:
    """Add the first bins of the discrete Fourier transform of real rows, zero-padded to `n_fft`.

    Parameters
    ----------
    rows : Tensor
        Rows (n_rows, n) in double precision.
    n, n_fft, n_bins : int
        Number of samples in a row, length of the transform, and number of bins (at most n_fft // 2 + 1).

    Returns
    -------
    real, imaginary : Tensor
        Real and imaginary parts, shape (n_rows, n_bins).
    """
    graph = rows.graph
    N1, N2 = factors(n_fft)
    K1 = N1 // 2 + 1
    if N2 == 1 or n * n_bins <= K1 * N2 * (N1 + 2 * N2):
        cos, sin = _rotation_matrices(graph, n, n_bins, n_fft)
        return rows @ cos, -(rows @ sin)
    # X[k1 + N1 k2] = sum_n2 W_N^(n2 k1) (sum_n1 x[N2 n1 + n2] W_N1^(n1 k1)) W_N2^(n2 k2),
    # W_N = exp(-2 pi i / N). The variable `minus` is the negative imaginary part.
    if n < n_fft:
        rows = graph.add("Pad", rows, np.array([0, 0, 0, n_fft - n], dtype=np.int64))
    x = rows.reshape(0, N1, N2)
    cos, sin = _rotation_matrices(graph, K1, N1, N1)
    real, minus = _rotate(cos @ x, sin @ x, K1, N2, n_fft)
    cos, sin = _rotation_matrices(graph, N2, N2, N2)
    M = _block_matrix(graph, ("rfft", N2), lambda: [[cos, sin], [-sin, cos]])
    X = (graph.concatenate(real, minus, axis=2) @ M).reshape(0, K1 * 2 * N2)
    # Bins with k1 above N1/2 follow from symmetry: X[k] = conj X[N - k].
    k = np.arange(n_bins)
    is_mirrored = k % N1 >= K1
    k = np.where(is_mirrored, n_fft - k, k)
    indices = (k % N1) * 2 * N2 + k // N1
    real, minus = X.take(indices), X.take(indices + N2)
    return real, minus * np.where(is_mirrored, 1.0, -1.0)


def power(rows: Tensor, n: int, n_fft: int, n_bins: int) -> Tensor:
    """Add the power spectrum |X_k|^2, shape (n_rows, n_bins); the arguments are those of `rfft`."""
    real, imaginary = rfft(rows, n, n_fft, n_bins)
    return real * real + imaginary * imaginary


def irfft(real: Tensor, imaginary: Tensor, n: int) -> Tensor:
    """Add the inverse transform of n // 2 + 1 bins, shape (n_rows, n).

    The imaginary parts at 0 and at half the sampling rate must be 0.
    """
    graph, n_bins, (N1, N2) = real.graph, n // 2 + 1, factors(n)
    if N2 == 1 or n_bins <= 2 * N1 + N2:
        cos, sin = _rotation_matrices(graph, n_bins, n, n)
        weights = np.where((np.arange(n_bins) == 0) | (2 * np.arange(n_bins) == n), 1.0, 2.0) / n
        real, imaginary = real * weights, imaginary * weights
        return real @ cos - imaginary @ sin
    # x[c + N1 d] = 1/N sum_b V_N^(b c) (sum_a X[N2 a + b] V_N1^(a c)) V_N2^(b d), V_N = exp(2 pi i/N)
    k = np.arange(n)
    is_mirrored = k >= n_bins
    k = np.where(is_mirrored, n - k, k)
    real = real.take(k) * (1 / n)
    imaginary = imaginary.take(k) * np.where(is_mirrored, -1 / n, 1 / n)
    X = graph.concatenate(real.reshape(0, N1, N2), imaginary.reshape(0, N1, N2))
    cos, sin = _rotation_matrices(graph, N1, N1, N1)
    X = _block_matrix(graph, ("irfft", N1), lambda: [[cos, -sin], [sin, cos]]) @ X
    real, imaginary = X.cut(0, N1, axis=1), X.cut(N1, 2 * N1, axis=1)
    real, imaginary = _rotate(real, imaginary, N1, N2, n)
    cos, sin = _rotation_matrices(graph, N2, N2, N2)
    x = real @ cos - imaginary @ sin
    return graph.add("Transpose", x, perm=[0, 2, 1]).reshape(0, n)


def factors(n: int) -> tuple[int, int]:
    """Return the factors N1 and N2 of n for which the transform needs the fewest operations.

    N1 is at least N2, and N1 + 2 N2 is as small as possible.

    Examples
    --------
    >>> factors(10_000)
    (125, 80)
    """
    cost = {N1 + 2 * (n // N1): N1 for N1 in range(1, n + 1) if n % N1 == 0 and n // N1 <= N1}
    N1 = cost[min(cost)]
    return N1, n // N1


def _rotate(real: Tensor, imaginary: Tensor, n_rows: int, n_columns: int, n: int) -> tuple[Tensor, Tensor]:
    """Add the rotation of element (r, c) of the last two axes by 2 pi r c / n (twiddle factors)."""
    graph = real.graph
    angle = 2 * np.pi / n * np.outer(np.arange(n_rows, dtype=np.float64), np.arange(n_columns))
    cos, sin = graph.once(("twiddle", n_rows, n_columns, n), lambda: _constants(graph, angle))
    return real * cos - imaginary * sin, real * sin + imaginary * cos


def _rotation_matrices(graph: Graph, n_rows: int, n_columns: int, period: int) -> tuple[Tensor, Tensor]:
    """Add the matrices cos(2 pi r c / period) and sin(2 pi r c / period) for row r and column c."""

    def create() -> tuple[Tensor, Tensor]:
        angle = 2 * np.pi / period * np.arange(period, dtype=np.float64)
        cos, sin = graph.once(("period", period), lambda: _constants(graph, angle))
        r, c = np.arange(n_rows, dtype=np.int64)[:, None], np.arange(n_columns, dtype=np.int64)
        indices = graph.add("Mod", graph.add("Mul", r, c), np.array(period, dtype=np.int64))
        return graph.add("Gather", cos, indices), graph.add("Gather", sin, indices)

    return graph.once(("rotation", n_rows, n_columns, period), create)


def _constants(graph: Graph, angle: Samples) -> tuple[Tensor, Tensor]:
    return graph.constant(np.cos(angle)), graph.constant(np.sin(angle))


def _block_matrix(graph: Graph, key: tuple[str, int], blocks: Callable[[], list[list[Tensor]]]) -> Tensor:
    """Add a matrix that consists of blocks, only once for each key."""

    def create() -> Tensor:
        return graph.concatenate(*(graph.concatenate(*row) for row in blocks()), axis=0)

    return graph.once(key, create)


# Filters in the frequency domain, as in `texclass.features.movement_filters`


def _padded_length(view: GraphView) -> int:
    factor = movement_filters.MAX_DECIMATION
    return factor * int(fft.next_fast_len(-(-view.n_samples // factor)))


@once
def _spectrum(view: GraphView, n_bins: int) -> tuple[Tensor, Tensor]:
    return rfft(view.unit, view.n_samples, _padded_length(view), n_bins)


def _filter(view: GraphView, response: Samples, n: int) -> Tensor:
    """Add the movement filtered with a frequency response and resampled to n samples, shape (n_rows, n)."""
    real, imaginary = _spectrum(view, n // 2 + 1)
    bins = np.arange(n // 2 + 1)
    scale = response * n / _padded_length(view)
    return irfft(real * scale, imaginary * np.where((bins == 0) | (2 * bins == n), 0.0, scale), n)


@once
def low_passed(view: GraphView, cutoff_hz: float) -> tuple[Tensor, int, int]:
    """Add the low-pass filtered movement; return it with its decimation factor and number of samples."""
    n_fft, rate = _padded_length(view), cutoff_hz * 10
    factor = next((k for k in (movement_filters.MAX_DECIMATION, 10, 5, 4, 2) if view.fs / k >= rate), 1)
    size = -(-view.n_samples // factor)
    f = np.arange(n_fft // factor // 2 + 1) * (view.fs / n_fft)
    slow = _filter(view, 1 / (1 + (f / cutoff_hz) ** 4), n_fft // factor).cut(0, size)
    return slow, factor, size


@once
def band_magnitude(view: GraphView, band_hz: tuple[float, float], rate_hz: float) -> Tensor:
    """Add the magnitude of the movement in a band; see `movement_filters.band_passed`."""
    low_hz, high_hz = band_hz
    n_fft = _padded_length(view)
    n = 2 * int(fft.next_fast_len(int(np.ceil(n_fft * rate_hz / view.fs / 2)), real=True))
    n = min(n_fft, n)
    f = np.arange(n // 2 + 1) * (view.fs / n_fft)
    numerator, stop = (f * (high_hz - low_hz)) ** 4, (f**2 - low_hz * high_hz) ** 4
    return abs(_filter(view, numerator / (numerator + stop), n).cut(0, view.n_samples * n // n_fft))


@once
def band_limited(view: GraphView, band_hz: float) -> tuple[Tensor, int, float]:
    """Add the band-limited movement; return it with its number of samples and its rate in Hz.

    See `movement_filters.band_limited`.
    """
    if view.fs <= 2 * band_hz:
        return view.unit, view.n_samples, view.fs
    n_fft = _padded_length(view)
    n = 2 * int(band_hz * n_fft / view.fs)
    size = view.n_samples * n // n_fft
    return _filter(view, np.ones(n // 2 + 1), n).cut(0, size), size, view.fs * n / n_fft
