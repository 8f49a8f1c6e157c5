"""Conversion between line spectral frequencies and reflection coefficients of an AR model, at any order.

Sign convention: A(z) = 1 + a_1 z^-1 + ... + a_p z^-p. The last coefficient of the model of order m is k_m, so
the model of order 1 is A = 1 + k_1 z^-1. With A~(z) = z^-p A(1/z), as in `abdulali2016` section 4.1,

    P = A + z^-1 A~,    Q = A - z^-1 A~,    A = (P + Q) / 2.

Apart from z = 1 and -1, the roots of P and Q lie on the unit circle and interlace. The angles of the roots in
the upper half-plane are the line spectral frequencies: the first, third, ... belong to P, the second, fourth,
... to Q.

The conversion never computes the coefficients of these polynomials. P and Q are the characteristic
polynomials of products of two reflections with the blocks [[-k_j, s_j], [s_j, k_j]], where s_j^2 = 1 - k_j^2.
One reflection has the blocks with odd j, and the other has the blocks with even j. Here k_0 = 1, and k_{p+1}
is 1 for P and -1 for Q (Ammar, Gragg, Reichel, "On the eigenproblem for orthogonal matrices", 1986). A
product of two reflections rotates by twice the angle between their subspaces. Therefore cos(theta/2) and
sin(theta/2) are the singular values of bidiagonal matrices whose squared entries are products of two of

    u_j = (1 + k_j)/2,    v_j = (1 - k_j)/2,

which float64 represents to full relative accuracy. The conversion from frequencies to reflection coefficients
solves the inverse problem for the same two matrices.

A **path** is the sequence g_0, g_1, ... of squared entries of a bidiagonal matrix, alternately from the
diagonal and the off-diagonal. An odd number of entries describes a square matrix, an even number a matrix
with one more column than rows. Every quantity is a sum, product or quotient of positive numbers, so even the
smallest quantities keep their relative accuracy.
"""

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.vibration.reflection import MAX_REFLECTION, MIN_ANGLE

MIN_GAP = 1e-12
"""Smallest gap between frequencies in rad. It is far above rounding errors, and far too small for the
resonances to be perceptible."""


def from_reflection(k: ArrayLike) -> Samples:
    """Return the line spectral frequencies of the AR models with reflection coefficients `k`.

    Parameters
    ----------
    k : array_like of shape (..., p)
        Reflection coefficients, |k| < 1.

    Returns
    -------
    ndarray of shape (..., p)
        Frequencies in rad per sample, strictly increasing, in (0, pi). Frequencies with even indices belong
        to P, and those with odd indices to Q.

    Raises
    ------
    ValueError
        If there is no coefficient, or a coefficient does not lie between -1 and 1.

    Notes
    -----
    The relative accuracy is about 1e-15, even close to 0. (It is 3e-14 for the lowest frequency if p = 400
    and all k are -0.3.) If roots of P and Q are closer than the rounding error, they are returned in the
    correct order, as different numbers; `conditioning` detects this case. Frequencies below 1e-60 rad are
    returned as 1e-60.

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
    """Restore in place the strict order of frequencies that are closer than the rounding error."""
    np.maximum(lsf, MIN_ANGLE, out=lsf)
    is_ordered = np.all(np.diff(lsf) > 0, axis=1) & (lsf[:, -1] < np.pi)
    for row in (lsf[i] for i in np.flatnonzero(~is_ordered)):
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
        Line spectral frequencies in rad per sample, strictly increasing, in (0, pi).

    Returns
    -------
    ndarray of shape (..., p)
        Reflection coefficients with |k| < 1. Every strictly increasing sequence of frequencies gives a stable
        model.

    Raises
    ------
    ValueError
        If there is no frequency, a frequency is not in (0, pi), or the frequencies are not strictly
        increasing.

    Notes
    -----
    `conditioning` quantifies how strongly the rounding of the frequencies affects k.

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
    # Every second j: u_{j-1} v_j / (u_{j-1} u_j), or the same with v_{j-1}.
    ratio[:, p:0:-2] = cosines[:, p - 1 :: -2] / sines[:, p - 1 :: -2]
    u, v = 1 / (1 + ratio), ratio / (1 + ratio)
    # The other j: v_j = (u_{j-1} v_j) / u_{j-1}, u_j = (u_j v_{j+1}) / v_{j+1}.
    j = np.arange(p - 1, 0, -2)
    ratio[:, j] = (cosines[:, j - 1] / u[:, j - 1]) / (cosines[:, j] / v[:, j + 1])
    k = (1 - ratio[:, 1:]) / (1 + ratio[:, 1:])
    return np.asarray(np.clip(k, -MAX_REFLECTION, MAX_REFLECTION)).reshape(np.shape(lsf))


def conditioning(lsf: ArrayLike) -> Samples:
    """Return the ratio of the rounding error to the narrowest gap between line spectral frequencies.

    Parameters
    ----------
    lsf : array_like of shape (..., p)
        Line spectral frequencies in rad per sample, strictly increasing, in (0, pi).

    Returns
    -------
    ndarray of shape (...)
        max_i ulp(lsf_i) / (lsf_i - lsf_{i-1}), including the gap to pi. Because the frequencies are rounded
        to float64, the height of the sharpest resonance is uncertain by 20 log10(1 + conditioning) dB. The
        computation of the frequencies adds about ten times this uncertainty. A value of 1 or more indicates
        two frequencies that float64 cannot distinguish, or a frequency below 1e-60 rad. The spectrum is then
        correct except at that resonance, but many models have this spectrum, and k is only one of them.

    Raises
    ------
    ValueError
        If there is no frequency, a frequency is not in (0, pi), or the frequencies are not strictly
        increasing.

    Examples
    --------
    >>> bool(conditioning([0.5, 1.0, 1.5]) < 1e-15)
    True
    """
    frames = _checked_lsf(lsf)
    gap_to_pi = np.pi - frames[:, -1:] + 1.2246467991473532e-16  # the difference of pi and its float64
    gaps = np.concatenate([np.diff(frames), gap_to_pi], axis=1)
    ulps = np.spacing(np.concatenate([frames[:, 1:], frames[:, -1:]], axis=1))
    is_at_zero = frames[:, 0] <= MIN_ANGLE
    return np.where(is_at_zero, 1.0, np.max(ulps / gaps, axis=1)).reshape(np.shape(lsf)[:-1])


def spread(lsf: ArrayLike, min_gap: float = MIN_GAP) -> Samples:
    """Return the nearest valid line spectral frequencies: increasing, in (0, pi), at least a gap apart.

    The result minimises sum_i (theta_i - lsf_i)^2 subject to theta_{i+1} - theta_i >= min_gap, with the same
    gap to 0 and pi.

    Parameters
    ----------
    lsf : array_like of shape (..., p)
        Finite numbers in rad per sample in any order, for example predictions of a regression.
    min_gap : float
        Smallest gap in rad, between 0 and pi / (p + 1) (default `MIN_GAP`). The closer two frequencies are,
        the sharper is the resonance between them.

    Returns
    -------
    ndarray of shape (..., p)
        Strictly increasing frequencies, which give a stable model. Rows that are already valid are not
        changed.

    Raises
    ------
    ValueError
        If there is no frequency, a frequency is not finite, or the gap is out of range.

    Notes
    -----
    Let g be the gap. The sequence theta_i - i g must not decrease and must lie in [0, pi - (p + 1) g]. It is
    computed by isotonic regression and clipping.

    Examples
    --------
    >>> spread([0.5, 1.5, 1.0, 2.0], 0.1).round(2)
    array([0.5, 1.2, 1.3, 2. ])
    """
    from scipy import optimize

    frames = _checked(lsf, "lsf", -np.inf, np.inf).copy()
    p = frames.shape[1]
    if not 0 <= min_gap <= np.pi / (p + 1):
        raise ValueError(
            f"min_gap must lie between 0 and pi / (p + 1) = {np.pi / (p + 1):g} rad, got {min_gap}"
        )
    steps = min_gap * np.arange(1, p + 1)
    gaps = np.diff(frames, axis=1, prepend=0.0, append=np.pi)
    for row in (frames[i] for i in np.flatnonzero(np.any(gaps < min_gap, axis=1))):
        increasing = optimize.isotonic_regression(row - steps).x
        row[:] = np.clip(increasing, 0.0, np.pi - (p + 1) * min_gap) + steps
    _separate(frames)
    return frames.reshape(np.shape(lsf))


def _checked(values: ArrayLike, name: str, low: float, high: float) -> Samples:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] == 0:
        raise ValueError(f"{name} must have the shape (..., p) with p >= 1, got {array.shape}")
    is_valid = (array > low) & (array < high)
    if not np.all(is_valid):
        raise ValueError(f"{name} must lie between {low:g} and {high:g}, got {array[~is_valid][0]}")
    return array.reshape(-1, array.shape[-1])


def _checked_lsf(lsf: ArrayLike) -> Samples:
    frames = _checked(lsf, "lsf", 0.0, np.pi)
    steps = np.diff(frames)
    if not np.all(steps > 0):
        row, i = np.argwhere(~(steps > 0))[0]
        pair = f"{frames[row, i]!r}, {frames[row, i + 1]!r}"
        raise ValueError(f"lsf must be strictly increasing, got {pair} in this order")
    return frames


def squared_singular_values(path: Samples) -> Samples:
    """Return the squares of the non-zero singular values of the bidiagonal matrix of each path.

    The matrix is already bidiagonal, so LAPACK skips the reduction and computes the singular values by the
    dqds algorithm, which preserves the relative accuracy of the smallest one.

    Parameters
    ----------
    path : ndarray of shape (n_frames, n)
        Squared entries of the matrices, positive, in the order of the module docstring.

    Returns
    -------
    ndarray of shape (n_frames, (n + 1) // 2)
        Squared singular values in decreasing order.

    References
    ----------
    Fernando, Parlett, "Accurate singular values and differential qd algorithms", 1994.
    """
    n = path.shape[1]
    size = n // 2 + 1  # an extra column makes the matrix square and adds a singular value of 0
    entries, i = np.sqrt(path), np.arange(n)
    B = np.zeros((len(path), size, size))
    B[:, i // 2, (i + 1) // 2] = entries
    return np.asarray(np.linalg.svd(B, compute_uv=False)[:, : (n + 1) // 2] ** 2)
