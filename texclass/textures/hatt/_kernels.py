"""What a renderer of ARMA models on a mesh does for each sample, compiled.

With white noise e of unit variance the states b_m of the normalised lattice of A are uncorrelated and of unit
variance, b_m = prod_{j > m} c_j Ã_m / A e, where Ã_m(z) = z^-m A_m(1/z). Expanding the MA part in them,

    C(z) = sum_m nu_m prod_{j > m} c_j Ã_m(z),    C / A e = sum_m nu_m b_m,

gives a filter (Gray and Markel, "Digital lattice and ladder filter synthesis", 1973) whose states stay
bounded and whose output has the RMS |nu| at every sample, even while k and nu move.
"""

import numpy as np
from numba import njit

from texclass.vibration._half_angle import paths_from_angles
from texclass.vibration._lattice_kernels import turn
from texclass.vibration._recursions import LARGEST, step_up

SHRINK = 1 - 2 * float(np.finfo(np.float64).eps)


@njit(cache=True, error_model="numpy")
def locate(x, y, points, triangles, nodes, weights):  # type: ignore[no-untyped-def]
    """Write three nodes and their weights at (x, y): inside a triangle, or on the nearest edge."""
    nearest = np.inf
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        vx, vy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
        px, py = x - points[a, 0], y - points[a, 1]
        area = ux * vy - uy * vx
        wb, wc = (px * vy - py * vx) / area, (ux * py - uy * px) / area
        if wb >= 0.0 and wc >= 0.0 and wb + wc <= 1.0:
            nodes[0], nodes[1], nodes[2] = a, b, c
            weights[0], weights[1], weights[2] = max(1.0 - wb - wc, 0.0), wb, wc
            return
        for side in range(3):
            first, second = triangles[t, side], triangles[t, (side + 1) % 3]
            dx, dy = points[second, 0] - points[first, 0], points[second, 1] - points[first, 1]
            qx, qy = x - points[first, 0], y - points[first, 1]
            w = min(max((qx * dx + qy * dy) / (dx * dx + dy * dy), 0.0), 1.0)
            distance = (qx - w * dx) ** 2 + (qy - w * dy) ** 2
            if distance < nearest:
                nearest = distance
                nodes[0], nodes[1], nodes[2] = first, second, first
                weights[0], weights[1], weights[2] = 1.0 - w, w, 0.0


@njit(cache=True, error_model="numpy")
def reflection(lsf, k):  # type: ignore[no-untyped-def]
    """Write the reflection coefficients of line spectral frequencies: one row of `to_reflection`."""
    p = lsf.size
    rows = np.zeros((1, p))
    rows[0] = lsf
    cosines, sines = paths_from_angles(rows)
    ratio = np.zeros(p + 1)
    for j in range(p, 0, -2):
        ratio[j] = cosines[0, p - j] / sines[0, p - j]
    for j in range(p - 1, 0, -2):
        u, v = 1 / (1 + ratio[j - 1]), ratio[j + 1] / (1 + ratio[j + 1])
        ratio[j] = (cosines[0, p - j] / u) / (cosines[0, p - j - 1] / v)
    for j in range(p):
        k[j] = min(max((1 - ratio[j + 1]) / (1 + ratio[j + 1]), -LARGEST), LARGEST)


@njit(cache=True, error_model="numpy")
def ladder(k, numerator, nu):  # type: ignore[no-untyped-def]
    """Write nu_0 ... nu_q of the coefficients C (q + 1,) for the lattice k (at least q stages)."""
    q = numerator.size - 1
    A = np.zeros((q + 1, q + 1))  # row m: A_m
    A[0, 0] = 1.0
    for m in range(1, q + 1):
        for i in range(m + 1):
            A[m, i] = A[m - 1, i] + k[m - 1] * A[m - 1, m - i]
    log_c = 0.0
    for j in range(k.size - 1, q - 1, -1):
        log_c += 0.5 * (np.log1p(k[j]) + np.log1p(-k[j]))
    rest = numerator.copy()
    for m in range(q, -1, -1):
        value = rest[m]
        for i in range(m + 1):
            rest[i] -= value * A[m, m - i]
        nu[m] = value * np.exp(-log_c)
        if m > 0:
            log_c += 0.5 * (np.log1p(k[m - 1]) + np.log1p(-k[m - 1]))


@njit(cache=True, error_model="numpy")
def model(nodes, weights, ar, ma, variance, gain, k, nu):  # type: ignore[no-untyped-def]
    """Write k and nu of the model between three nodes: line spectra, variance and gain mix linearly."""
    p, q = ar.shape[1], ma.shape[1]
    lsf, row, c = np.zeros(max(p, q)), np.zeros((1, q)), np.ones((1, q + 1))
    s2, g = 0.0, 0.0
    for i in range(3):
        s2 += weights[i] * variance[nodes[i]]
        g += weights[i] * gain[nodes[i]]
    if q:
        _mix(nodes, weights, ma, lsf)
        reflection(lsf[:q], row[0])
        c = step_up(row)
    _mix(nodes, weights, ar, lsf)
    reflection(lsf[:p], k)
    ladder(k, c[0], nu)
    for m in range(q + 1):
        nu[m] *= g * np.sqrt(s2)


@njit(cache=True, error_model="numpy")
def _mix(nodes, weights, rows, out):  # type: ignore[no-untyped-def]
    """Write the weighted mean of three rows."""
    for j in range(rows.shape[1]):
        out[j] = 0.0
        for i in range(3):
            out[j] += weights[i] * rows[nodes[i], j]


@njit(cache=True, error_model="numpy")
def render(e, place, hop, limit, now, glide, b, out):  # type: ignore[no-untyped-def]
    """Fill `out` with the samples place, place + 1, ... of `hop` between two aims.

    `now`: k and nu of this sample and c; `glide`: k and nu at its start and its end.
    """
    k, c, nu = now
    for t in range(out.size):
        _move(place + t + 1, hop, k, c, nu, glide)
        x = e[t]
        for m in range(k.size - 1, -1, -1):
            x, up = turn(x, b[m], k[m], c[m])
            b[m + 1] = up
        b[0] = x
        y = 0.0
        for m in range(nu.size):
            y += nu[m] * b[m]
        out[t] = min(max(y, -limit), limit)


@njit(cache=True, error_model="numpy")
def _move(place, hop, k, c, nu, glide):  # type: ignore[no-untyped-def]
    """Take the parameters along the straight line from one model to the next."""
    k0, k1, nu0, nu1 = glide
    w = place / hop
    for m in range(k.size):
        between = min(max((1.0 - w) * k0[m] + w * k1[m], -LARGEST), LARGEST)
        k[m] = between * SHRINK
        c[m] = np.sqrt((1.0 - between) * (1.0 + between)) * SHRINK
    for m in range(nu.size):
        nu[m] = (1.0 - w) * nu0[m] + w * nu1[m]
