"""Line spectral frequencies of an AR model, to and from its reflection coefficients, at any order.

Sign convention: A(z) = 1 + a_1 z^-1 + ... + a_p z^-p, and k_m is the last coefficient of the model of order
m, so the model of order 1 is A = 1 + k_1 z^-1. With A~(z) = z^-p A(1/z), as in `abdulali2016` section 4.1,

    P = A + z^-1 A~,    Q = A - z^-1 A~,    A = (P + Q) / 2.

Apart from z = 1 and -1, the roots of P and Q lie on the unit circle and interlace; the angles of those in the
upper half are the line spectral frequencies: the first, third, ... of P, the second, fourth, ... of Q.

No polynomial is formed. P and Q are the characteristic polynomials of a product of two reflections, each of
blocks [[-k_j, s_j], [s_j, k_j]], s_j^2 = 1 - k_j^2, one with the odd and one with the even j, where k_0 = 1
and k_{p+1} = 1 for P, -1 for Q (Ammar, Gragg, Reichel, "On the eigenproblem for orthogonal matrices", 1986).
A product of two reflections turns by twice the angle between their subspaces, so cos(theta/2) and
sin(theta/2) are the singular values of bidiagonal matrices whose squared entries are products of two of

    u_j = (1 + k_j)/2,    v_j = (1 - k_j)/2,

which float64 holds to full relative accuracy. The way back is the inverse problem of the same two matrices.

There, a **path** is the sequence g_0, g_1, ... of squared entries of a bidiagonal matrix, read as one walks
along it: diagonal, off-diagonal, diagonal, ... An odd number of entries is a square matrix, an even number
one with one more column than rows. Every quantity is a sum, product or quotient of positive numbers, so each
keeps its relative accuracy, however small it is.
"""

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.vibration.reflection import LARGEST, SMALLEST_ANGLE

MIN_GAP = 1e-12
"""Least gap between line spectral frequencies, in rad: far above rounding, far below any felt resonance's."""


def from_reflection(k: ArrayLike) -> Samples:
    """Return the line spectral frequencies of the AR models with reflection coefficients `k`.

    Parameters
    ----------
    k : array_like of shape (..., p)
        Reflection coefficients, |k| < 1.

    Returns
    -------
    ndarray of shape (..., p)
        In rad per sample, strictly increasing, in (0, pi); even places belong to P, odd ones to Q.

    Raises
    ------
    ValueError
        If there is no coefficient, or one is not below 1 in size.

    Notes
    -----
    The relative accuracy is about 1e-15 (3e-14 for the lowest of p = 400 with all k = -0.3), close to 0 too.
    Roots of P and Q that lie closer than rounding come out in their order, one float64
    apart or more, and `conditioning` tells. Frequencies below 1e-60 rad are returned as 1e-60.

    Examples
    --------
    >>> import numpy as np
    >>> from_reflection([0.0, 0.0, 0.0]) / np.pi
    array([0.25, 0.5 , 0.75])
    """
    frames = _checked(k, "k", -1.0, 1.0)
    lsf = np.empty_like(frames)
    lsf[:, 0::2] = _upper_angles(frames, 1.0)
    lsf[:, 1::2] = _upper_angles(frames, -1.0)
    _separate(lsf)
    return lsf.reshape(np.shape(k))


def _upper_angles(k: Samples, last: float) -> Samples:
    """Return the angles in (0, pi) of the roots of P (`last` = 1) or Q (`last` = -1), increasing."""
    n = k.shape[1] + 1
    ends = np.empty((len(k), n + 1))
    ends[:, 0], ends[:, 1:-1], ends[:, -1] = 1.0, k, last
    u, v = (1 + ends) / 2, (1 - ends) / 2
    sines = v[:, :-1] * v[:, 1:]
    sines[:, 1::2] = (u[:, :-1] * u[:, 1:])[:, 1::2]
    sines = sines[:, 1 : n if (n % 2 == 0) == (last > 0) else n - 1]
    cosines = u[:, : n - 1] * v[:, 1:n] if last > 0 else v[:, 1 : n - 1] * u[:, 2:n]
    s2, c2 = squared_singular_values(sines)[:, ::-1], squared_singular_values(cosines)
    return np.asarray(2 * np.arctan2(np.sqrt(s2), np.sqrt(c2)))


def _separate(lsf: Samples) -> None:
    """Restore, in place, the strict order that rounding took from pairs closer than itself."""
    np.maximum(lsf, SMALLEST_ANGLE, out=lsf)
    ordered = np.all(np.diff(lsf) > 0, axis=1) & (lsf[:, -1] < np.pi)
    for row in (lsf[i] for i in np.flatnonzero(~ordered)):
        for i in range(1, row.size):
            row[i] = max(row[i], np.nextafter(row[i - 1], 4.0))
        upper = np.pi
        for i in range(row.size - 1, -1, -1):
            row[i] = upper = min(row[i], np.nextafter(upper, 0.0))


def to_reflection(lsf: ArrayLike) -> Samples:
    """Return the reflection coefficients of the AR models with line spectral frequencies `lsf`.

    Parameters
    ----------
    lsf : array_like of shape (..., p)
        In rad per sample, strictly increasing, in (0, pi).

    Returns
    -------
    ndarray of shape (..., p)
        |k| < 1, always: every strictly increasing sequence is a stable model.

    Raises
    ------
    ValueError
        If there is no frequency, or they are not in (0, pi) or not strictly increasing.

    Notes
    -----
    What the rounding of the frequencies themselves does to k is told by `conditioning`.

    Examples
    --------
    >>> import numpy as np
    >>> k = [0.5, -0.25, 0.75]
    >>> bool(np.allclose(to_reflection(from_reflection(k)), k, rtol=0, atol=1e-14))
    True
    """
    from texclass.vibration import recursions

    frames = _checked_lsf(lsf)
    p = frames.shape[1]
    cosines, sines = (path[:, ::-1] for path in recursions.paths_from_angles(frames))
    ratio = np.zeros((len(frames), p + 1))  # v_j / u_j, from k_0 = 1 on
    # u_{j-1} v_j / (u_{j-1} u_j), and the same with v_{j-1}: every second j
    ratio[:, p:0:-2] = cosines[:, p - 1 :: -2] / sines[:, p - 1 :: -2]
    u, v = 1 / (1 + ratio), ratio / (1 + ratio)
    # v_j = (u_{j-1} v_j) / u_{j-1}, u_j = (u_j v_{j+1}) / v_{j+1}: the others
    j = np.arange(p - 1, 0, -2)
    ratio[:, j] = (cosines[:, j - 1] / u[:, j - 1]) / (cosines[:, j] / v[:, j + 1])
    k = (1 - ratio[:, 1:]) / (1 + ratio[:, 1:])
    return np.asarray(np.clip(k, -LARGEST, LARGEST)).reshape(np.shape(lsf))


def conditioning(lsf: ArrayLike) -> Samples:
    """Return how much of the narrowest gap between line spectral frequencies is rounding.

    Parameters
    ----------
    lsf : array_like of shape (..., p)
        In rad per sample, strictly increasing, in (0, pi).

    Returns
    -------
    ndarray of shape (...)
        max_i ulp(lsf_i) / (lsf_i - lsf_{i-1}), the gap to pi counted. Writing the frequencies down leaves the
        height of the sharpest resonance uncertain by 20 log10(1 + conditioning) dB; computing them adds some
        ten times that. 1 or more means a pair that float64 cannot tell apart, or a frequency below 1e-60 rad:
        away from that resonance the spectrum is right, but k is only one of the many models that share it.

    Raises
    ------
    ValueError
        As `to_reflection`.

    Examples
    --------
    >>> bool(conditioning([0.5, 1.0, 1.5]) < 1e-15)
    True
    """
    frames = _checked_lsf(lsf)
    below_pi = np.pi - frames[:, -1:] + 1.2246467991473532e-16  # pi less its float64
    gaps = np.concatenate([np.diff(frames), below_pi], axis=1)
    ulps = np.spacing(np.concatenate([frames[:, 1:], frames[:, -1:]], axis=1))
    at_zero = frames[:, 0] <= SMALLEST_ANGLE
    return np.where(at_zero, 1.0, np.max(ulps / gaps, axis=1)).reshape(np.shape(lsf)[:-1])


def spread(lsf: ArrayLike, min_gap: float = MIN_GAP) -> Samples:
    """Return the line spectral frequencies nearest to any numbers: increasing, in (0, pi), a gap apart.

    minimise sum_i (theta_i - lsf_i)^2 with theta_{i+1} - theta_i >= min_gap, and as far from 0 and pi.

    Parameters
    ----------
    lsf : array_like of shape (..., p)
        Finite, in rad per sample; in any order, as a regression may give them.
    min_gap : float
        In rad; at least 0, at most pi / (p + 1). The closer two frequencies, the sharper the resonance
        between them.

    Returns
    -------
    ndarray of shape (..., p)
        Strictly increasing, so a stable model. Rows that keep the rule come back as they were.

    Raises
    ------
    ValueError
        If there is no frequency, one is not finite, or the gap is out of its range.

    Notes
    -----
    With g the gap, theta_i - i g must not decrease and lie in [0, pi - (p + 1) g]: isotonic regression, then
    clipping.

    Examples
    --------
    >>> spread([0.5, 1.5, 1.0, 2.0], 0.1).round(2)
    array([0.5, 1.2, 1.3, 2. ])
    """
    from scipy import optimize

    frames = _checked(lsf, "lsf", -np.inf, np.inf).copy()
    p = frames.shape[1]
    if not 0 <= min_gap <= np.pi / (p + 1):
        raise ValueError(f"min_gap is {min_gap}. Expected 0 to pi / (p + 1) = {np.pi / (p + 1):g} rad")
    steps = min_gap * np.arange(1, p + 1)
    gaps = np.diff(frames, axis=1, prepend=0.0, append=np.pi)
    for row in (frames[i] for i in np.flatnonzero(np.any(gaps < min_gap, axis=1))):
        rising = optimize.isotonic_regression(row - steps).x
        row[:] = np.clip(rising, 0.0, np.pi - (p + 1) * min_gap) + steps
    _separate(frames)
    return frames.reshape(np.shape(lsf))


def _checked(values: ArrayLike, name: str, low: float, high: float) -> Samples:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] == 0:
        raise ValueError(f"{name} has shape {array.shape}. Expected (..., p) with p at least 1")
    wrong = ~((array > low) & (array < high))
    if np.any(wrong):
        raise ValueError(f"{name} holds {array[wrong][0]}. Expected {low:g} < {name} < {high:g}")
    return array.reshape(-1, array.shape[-1])


def _checked_lsf(lsf: ArrayLike) -> Samples:
    frames = _checked(lsf, "lsf", 0.0, np.pi)
    steps = np.diff(frames)
    if not np.all(steps > 0):
        row, i = np.argwhere(~(steps > 0))[0]
        pair = f"{frames[row, i]!r}, {frames[row, i + 1]!r}"
        raise ValueError(f"lsf holds {pair} in this order. Expected strictly increasing")
    return frames


def squared_singular_values(path: Samples) -> Samples:
    """Return the non-zero singular values, squared, of the bidiagonal matrix of each row.

    LAPACK leaves a bidiagonal matrix as it is and finds the singular values, without vectors, by the dqds
    algorithm, which keeps the relative accuracy of the smallest one.

    Parameters
    ----------
    path : ndarray of shape (n_frames, n)
        Positive.

    Returns
    -------
    ndarray of shape (n_frames, (n + 1) // 2)
        Decreasing.

    References
    ----------
    Fernando, Parlett, "Accurate singular values and differential qd algorithms", 1994.
    """
    n = path.shape[1]
    size = n // 2 + 1  # an extra column makes a square matrix whose last entry, and last value, is 0
    entries, i = np.sqrt(path), np.arange(n)
    B = np.zeros((len(path), size, size))
    B[:, i // 2, (i + 1) // 2] = entries
    return np.asarray(np.linalg.svd(B, compute_uv=False)[:, : (n + 1) // 2] ** 2)
