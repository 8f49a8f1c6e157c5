"""Angles on the unit circle as singular values of bidiagonal matrices, and back: both without subtraction.

A **path** is the sequence g_0, g_1, ... of squared entries of a bidiagonal matrix, read as one walks along
it: diagonal, off-diagonal, diagonal, ... An odd number of entries is a square matrix, an even number one with
one more column than rows. Every quantity is a sum, product or quotient of positive numbers, so each keeps its
relative accuracy, however small it is.
"""

import ctypes
from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit
from numba.extending import get_cython_function_address

from texclass.recording import Samples

SMALLEST_ANGLE = 1e-60
"""Angles in rad below this one are taken as this one, so that no square of a product underflows."""


@cache
def _dlasq2() -> Callable[..., None]:
    """LAPACK's dqds: singular values, squared, to high relative accuracy, from the squared entries."""
    address = get_cython_function_address("scipy.linalg.cython_lapack", "dlasq2")
    pointer = ctypes.POINTER(ctypes.c_int)
    return ctypes.CFUNCTYPE(None, pointer, ctypes.c_void_p, pointer)(address)


def squared_singular_values(path: Samples) -> Samples:
    """Return the non-zero singular values, squared, of the bidiagonal matrix of each row.

    Parameters
    ----------
    path : ndarray of shape (n_frames, n)
        Positive.

    Returns
    -------
    ndarray of shape (n_frames, (n + 1) // 2)
        Decreasing.

    Raises
    ------
    ArithmeticError
        If the iteration of LAPACK does not converge.

    References
    ----------
    Fernando, Parlett, "Accurate singular values and differential qd algorithms", 1994.
    """
    m = (path.shape[1] + 1) // 2
    work = np.zeros((len(path), 4 * max(m, 1)))
    if m:
        _as_square(np.ascontiguousarray(path), work)
    order, info = ctypes.c_int(m), ctypes.c_int(0)
    dlasq2, start = _dlasq2(), work.ctypes.data
    for row in range(len(work) if m else 0):
        dlasq2(order, start + row * work.strides[0], info)
        if info.value:
            raise ArithmeticError(f"dlasq2 returned {info.value}; the rule is convergence, info = 0")
    return work[:, :m]


@njit(cache=True, error_model="numpy")
def _as_square(path, out):  # type: ignore[no-untyped-def]
    """One dqd sweep turns the extra column of a rectangular matrix into zeros."""
    n = path.shape[1]
    if n % 2:
        out[:, :n] = path
        return
    for row in range(path.shape[0]):
        g, z = path[row], out[row]
        d = g[0]
        for i in range(0, n - 2, 2):
            z[i] = d + g[i + 1]
            ratio = g[i + 2] / z[i]
            z[i + 1] = g[i + 1] * ratio
            d *= ratio
        z[n - 2] = d + g[n - 1]


@njit(cache=True, error_model="numpy")
def paths_from_angles(lsf):  # type: ignore[no-untyped-def]
    """Return the paths of cos(theta/2) and sin(theta/2), theta the roots of P, each from its end backwards.

    Parameters
    ----------
    lsf : ndarray of shape (n_frames, p)
        Increasing, in (0, pi): roots of P at even places, of Q at odd ones.

    Returns
    -------
    cosines : ndarray of shape (n_frames, p)
        u_j v_{j+1} for j = p - 1, ..., 0, where u = (1 + k)/2, v = (1 - k)/2, k_0 = 1.
    sines : ndarray of shape (n_frames, p)
        u_j u_{j+1} and v_j v_{j+1} in turn, v for j = p - 2; the last is 0 when p is even.
    """
    n_frames, p = lsf.shape
    cosines, sines = np.zeros((n_frames, p)), np.zeros((n_frames, p))
    for row in range(n_frames):
        P, Q = np.maximum(lsf[row, 0::2], SMALLEST_ANGLE), np.maximum(lsf[row, 1::2], SMALLEST_ANGLE)
        m = P.size
        s2, c2 = np.sin(P / 2) ** 2, np.cos(P / 2) ** 2
        gaps = _gap(P[1:], P[:-1])
        b = _residues(P, Q)
        if p % 2:
            _path(np.append(gaps, c2[m - 1]), b * s2, cosines[row])
            _path(np.append(gaps[::-1], s2[0]), (b * c2)[::-1], sines[row])
        else:
            at_pi = np.prod(np.cos(Q / 2) ** 2 / c2)
            nodes = np.append(np.append(gaps, c2[m - 1]), 0.0)
            _path(nodes, np.append(b * s2 / c2, at_pi), cosines[row])
            _path(np.append(gaps[::-1], s2[0]), b[::-1], sines[row])
    return cosines, sines


@njit(cache=True, error_model="numpy")
def _residues(P, Q):  # type: ignore[no-untyped-def]
    """Return prod_j |x_i - y_j| / prod_{j != i} |x_i - x_j| with x, y = cos^2(theta/2) at the roots of P, Q.

    Interlacing keeps every partial product between the narrowest gap and its inverse. Of

        x_i - x_j = sin((theta_j - theta_i)/2) sin((theta_j + theta_i)/2)

    the first factor is taken from the difference of the angles where that is small, j = i - 1, i, i + 1, the
    second never from their sum, which rounds what is left to 2 pi.
    """
    m = P.size
    s, c = np.sin(P / 2), np.cos(P / 2)
    b = np.ones(m)
    for j in range(m):
        sj, cj = s[j], c[j]
        if j == Q.size:  # one root of P more than of Q
            for i in range(m - 1):
                b[i] /= _gap(P[j], P[i])
            break
        sq, cq = np.sin(Q[j] / 2), np.cos(Q[j] / 2)
        near = np.ones(3)
        first = max(j - 1, 0)
        last = min(j + 2, m)
        for i in range(first, last):
            near[i - first] = b[i] * _gap(Q[j], P[i])
            if i != j:
                near[i - first] /= _gap(P[j], P[i])
        for i in range(m):
            up = (sq * c[i] - cq * s[i]) * (sq * c[i] + cq * s[i])
            b[i] *= up / ((sj * c[i] - cj * s[i]) * (sj * c[i] + cj * s[i]))
        b[first:last] = near[: last - first]
    return np.abs(b)


@njit(cache=True, inline="always", error_model="numpy")
def _gap(a, b):  # type: ignore[no-untyped-def]
    """Return cos^2(b/2) - cos^2(a/2)."""
    total = np.sin(a / 2) * np.cos(b / 2) + np.cos(a / 2) * np.sin(b / 2)  # sin((a + b)/2)
    return np.sin((a - b) / 2) * total


@njit(cache=True, error_model="numpy")
def _path(gaps, weights, out):  # type: ignore[no-untyped-def]
    """Write to `out` the path whose squared singular values are given, with their weights at its start.

    Values enter from the largest, x_1, to the smallest, x_m. `gaps` holds x_1 - x_2, ..., x_{m-1} - x_m, x_m.
    With the q_i, e_i of what is already there, less its smallest value, one more value at 0 of weight w
    (W: the weights so far) does

        d_1 = q_1 w / (W + w),    q'_1 = q_1 W / (W + w),
        e'_i = e_i + d_i,    q'_{i+1} = e_i q_{i+1} / e'_i,    d_{i+1} = q_{i+1} d_i / e'_i

    and moving all up by t_1 = tau to the next value (stationary qd) then does

        Q_i = q'_i + t_i,  E_i = e'_i q'_i / Q_i,  t_{i+1} = tau + e'_i t_i / Q_i.

    Both run in one loop. This is Laurie, "Accurate recovery of recursion coefficients from Gaussian
    quadrature formulas", 1999, in the form that subtracts nothing.
    """
    m = weights.size
    q, e = np.zeros(m + 1), np.zeros(m + 1)
    q[0], total = gaps[0], weights[0]
    for size in range(1, m):
        w, tau = weights[size], gaps[size]
        d = q[0] * (w / (total + w))
        new_q = q[0] * (total / (total + w))
        total += w
        t = tau
        for i in range(size):  # e[size - 1] and q[size] are still 0
            new_e = e[i] + d
            shifted = new_q + t
            ratio = q[i + 1] / new_e
            q[i] = shifted
            t = tau + new_e * (t / shifted)
            shifted_e = new_e * (new_q / shifted)
            new_q = e[i] * ratio
            d *= ratio
            e[i] = shifted_e
        q[size] = new_q + t
    for i in range(m):
        if 2 * i < out.size:
            out[2 * i] = q[i]
        if 2 * i + 1 < out.size and i < m - 1:
            out[2 * i + 1] = e[i]
