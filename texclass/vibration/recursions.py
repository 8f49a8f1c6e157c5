"""Compiled loops of the fits. Callers import this module late, because loading numba takes half a second.

Sign convention of the whole package: A(z) = 1 + sum_i a_i z^-i. The last coefficient a_m of the model of
order m is the reflection coefficient k_m.
"""

import numpy as np
from numpy.typing import NDArray

from texclass.compilation import njit
from texclass.recording import Samples
from texclass.vibration.reflection import MAX_REFLECTION, MIN_ANGLE, MIN_RELATIVE_RESIDUAL

Indices = NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def levinson(r: Samples) -> tuple[Samples, Samples, Samples, Indices]:
    """Solve the Yule-Walker equations of each row of autocorrelations by Levinson's recursion.

    k_m = -(r_m + sum_i a_i r_{m-i}) / E_{m-1},    E_m = E_{m-1} (1 - k_m^2)

    Each row of `r` starts with r_0 = 1. The results are the reflection coefficients (n, p), the energies E_m
    (n, p + 1), the magnification of the rounding errors of r in E, max_m |a|^2 / E_m (n,), and the number of
    orders that were solved (n,). The recursion ends before the first |k_m| that is not below 1; from there on
    k = 0, and the magnification is infinite.
    """
    n_frames, p = r.shape[0], r.shape[1] - 1
    k, energy, magnification = np.zeros((n_frames, p)), np.ones((n_frames, p + 1)), np.ones(n_frames)
    solved = np.full(n_frames, p)
    a, previous = np.zeros(p + 1), np.zeros(p + 1)
    for row in range(n_frames):
        a[:] = 0.0
        a[0] = 1.0
        for m in range(1, p + 1):
            numerator = 0.0
            for i in range(m):
                numerator += a[i] * r[row, m - i]
            step = -numerator / energy[row, m - 1]
            if not abs(step) < 1.0:
                magnification[row], solved[row], energy[row, m:] = np.inf, m - 1, energy[row, m - 1]
                break
            previous[: m + 1] = a[: m + 1]
            norm = 0.0
            for i in range(m + 1):
                a[i] = previous[i] + step * previous[m - i]
                norm += a[i] * a[i]
            k[row, m - 1] = step
            energy[row, m] = energy[row, m - 1] * (1.0 - step) * (1.0 + step)
            magnification[row] = max(magnification[row], norm / energy[row, m])
    return k, energy, magnification, solved


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _sums(f: Samples, b: Samples) -> tuple[float, float]:
    """Return sum f b and sum f^2 + b^2."""
    product, energy = 0.0, 0.0
    for i in range(f.size):
        product += f[i] * b[i]
        energy += f[i] * f[i] + b[i] * b[i]
    return product, energy


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _cross(f: Samples, b: Samples, k: float) -> None:
    """Apply one lattice stage to both residuals in place: f, b = f + k b, b + k f."""
    for i in range(f.size):
        forward = f[i]
        f[i] = forward + k * b[i]
        b[i] = b[i] + k * forward


@njit(cache=True, error_model="numpy")
def burg(x: Samples, order: int, padding: int) -> tuple[Samples, Samples, Indices]:
    """Fit each row by Burg's method.

    k_m = -2 sum_t f[t] b[t-1] / sum_t (f[t]^2 + b[t-1]^2),    t = m ... n-1

    The residual energy is summed again at each order. With a `padding` of `order` zeros at both ends no
    product is lost there, and the same formula is the autocorrelation method.

    The results are the reflection coefficients (rows, order), the residual deviations (rows, order + 1), and
    the number of fitted orders (rows,). A |k| that reaches 1 is clipped to `MAX_REFLECTION`. The recursion
    ends where the residual falls below `MIN_RELATIVE_RESIDUAL` or has no sample left; beyond it k = 0, and
    the deviation is constant.
    """
    rows, n = x.shape[0], x.shape[1] + 2 * padding
    k, deviation, fitted = np.zeros((rows, order)), np.zeros((rows, order + 1)), np.zeros(rows, np.int64)
    for row in range(rows):
        f = np.zeros(n)
        f[padding : n - padding] = x[row]
        b = f.copy()
        deviation[row, :] = np.sqrt(_sums(f, b)[1] / (2 * x.shape[1]))
        product, total = _sums(f[1:], b[:-1])
        for m in range(1, min(order, n - 1) + 1):
            count = x.shape[1] if padding else n - m
            if total <= 2 * count * (MIN_RELATIVE_RESIDUAL * deviation[row, 0]) ** 2:
                break
            step = min(max(-2.0 * product / total, -MAX_REFLECTION), MAX_REFLECTION)
            _cross(f[m:], b[: n - m], step)
            product, total = _sums(f[m + 1 :], b[: n - m - 1])
            energy = (
                total + f[m] ** 2 + b[n - m - 1] ** 2
            )  # the sum for the next stage omits these two samples
            k[row, m - 1], fitted[row] = step, m
            deviation[row, m:] = np.sqrt(energy / (2 * count))
    return k, deviation, fitted


@njit(cache=True, error_model="numpy")
def residual(x: Samples, k: Samples) -> float:
    """Return the RMS of the forward and backward residuals of `x` (n,) under `k` (order,), for n > order."""
    f, b, n = x.copy(), x.copy(), x.size
    for m in range(1, k.size + 1):
        _cross(f[m:], b[: n - m], k[m - 1])
    count = n - k.size
    return float(np.sqrt(_sums(f[k.size :], b[:count])[1] / (2 * count)))


@njit(cache=True, error_model="numpy")
def step_up(k: Samples) -> Samples:
    """Return the direct-form coefficients 1, a_1 ... a_p of each row of reflection coefficients (n, p)."""
    n, p = k.shape
    a, previous = np.zeros((n, p + 1)), np.zeros(p + 1)
    a[:, 0] = 1.0
    for row in range(n):
        for m in range(1, p + 1):
            previous[: m + 1] = a[row, : m + 1]
            for i in range(m + 1):
                a[row, i] = previous[i] + k[row, m - 1] * previous[m - i]
    return a


@njit(cache=True, error_model="numpy")
def step_down(a: Samples) -> Samples:
    """Return the reflection coefficients (n, p) of each row 1, a_1 ... a_p.

    For an unstable row the recursion stops at the first |k| that is not below 1; all lower k are 0.
    """
    n, p = a.shape[0], a.shape[1] - 1
    k, current, lower = np.zeros((n, p)), np.zeros(p + 1), np.zeros(p + 1)
    for row in range(n):
        current[:] = a[row]
        for m in range(p, 0, -1):
            step = current[m]
            k[row, m - 1] = step
            if not abs(step) < 1.0:
                break
            for i in range(m):
                lower[i] = (current[i] - step * current[m - i]) / ((1.0 - step) * (1.0 + step))
            current[:m] = lower[:m]
    return k


@njit(cache=True, error_model="numpy")
def log_magnitudes(k: Samples, omega: Samples) -> Samples:
    """Return ln |A_m(e^jw)| for the orders m = 0 ... p of one model (p,), shape (p + 1, n_frequencies).

    On the unit circle the ratio of the backward to the forward residual is e^jt. Stage m maps it by tan(t/2)
    -> (1-k)/(1+k) tan(t/2), and |f| grows by |1 + k e^jt|; a delay then rotates the ratio by -w. So::

        |A_m(e^jw)| = | D(k_m) R D(k_m-1) R ... D(k_1) R (1, 0) |,    D(k) = diag(1+k, 1-k)

    where R is the rotation by -w/2. All numbers are real, nothing cancels, and the vector is normalised after
    each stage.
    """
    p = k.size
    out = np.zeros((p + 1, omega.size))
    for j in range(omega.size):
        cosine, sine = np.cos(omega[j] / 2), np.sin(omega[j] / 2)
        x, y, total = 1.0, 0.0, 0.0
        for m in range(p):
            u = (1.0 + k[m]) * (cosine * x + sine * y)
            v = (1.0 - k[m]) * (cosine * y - sine * x)
            length = np.sqrt(u * u + v * v)
            x, y = u / length, v / length
            total += np.log(length)
            out[m + 1, j] = total
    return out


@njit(cache=True, error_model="numpy")
def unit_spectra(k: Samples, omega: Samples) -> Samples:
    """Return g_m^2 / |A_m(e^jw)|^2 for the orders m = 0 ... p of one model, shape (p + 1, n_frequencies).

    g_m^2 = prod_{i <= m} (1 - k_i^2)

    This is the recursion of `log_magnitudes`, with each stage divided by sqrt(1 - k^2). Its determinant is
    then 1, so the result neither overflows nor underflows unless the spectrum itself does.
    """
    p, n = k.size, omega.size
    out = np.ones((p + 1, n))
    x, y = np.ones(n), np.zeros(n)
    cosine, sine = np.cos(omega / 2), np.sin(omega / 2)
    for m in range(p):
        gain = np.sqrt((1.0 + k[m]) / (1.0 - k[m]))
        per_gain = 1.0 / gain
        for j in range(n):
            u = gain * (cosine[j] * x[j] + sine[j] * y[j])
            v = per_gain * (cosine[j] * y[j] - sine[j] * x[j])
            x[j], y[j] = u, v
            out[m + 1, j] = 1.0 / (u * u + v * v)
    return out


@njit(cache=True, error_model="numpy")
def log_magnitude(k: Samples, omega: Samples) -> Samples:
    """Return ln |A_p(e^jw)| of one model (p,), shape (n_frequencies,): the last row of `log_magnitudes`.

    Faster than `log_magnitudes`, because the vector is normalised only at every sixteenth stage. Nothing
    overflows within sixteen stages.
    """
    out = np.zeros(omega.size)
    for j in range(omega.size):
        cosine, sine = np.cos(omega[j] / 2), np.sin(omega[j] / 2)
        x, y, total = 1.0, 0.0, 0.0
        for m in range(k.size):
            x, y = (1.0 + k[m]) * (cosine * x + sine * y), (1.0 - k[m]) * (cosine * y - sine * x)
            if m % 16 == 15:
                length = np.sqrt(x * x + y * y)
                x, y, total = x / length, y / length, total + np.log(length)
        out[j] = total + 0.5 * np.log(x * x + y * y)
    return out


@njit(cache=True, error_model="numpy")
def paths_from_angles(lsf):  # type: ignore[no-untyped-def]
    """Return the reversed paths of cos(theta/2) and sin(theta/2) for the angles theta of the roots of P.

    Parameters
    ----------
    lsf : ndarray of shape (n_frames, p)
        Line spectral frequencies, increasing, in (0, pi): roots of P at even indices, of Q at odd ones.

    Returns
    -------
    cosines : ndarray of shape (n_frames, p)
        u_j v_{j+1} for j = p - 1, ..., 0, where u = (1 + k)/2, v = (1 - k)/2, k_0 = 1.
    sines : ndarray of shape (n_frames, p)
        Alternately u_j u_{j+1} and v_j v_{j+1}, where j = p - 2 has v; the last entry is 0 if p is even.
    """
    n_frames, p = lsf.shape
    cosines, sines = np.zeros((n_frames, p)), np.zeros((n_frames, p))
    for row in range(n_frames):
        P, Q = np.maximum(lsf[row, 0::2], MIN_ANGLE), np.maximum(lsf[row, 1::2], MIN_ANGLE)
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
    """Return prod_j |x_i - y_j| / prod_{j != i} |x_i - x_j|.

    x and y are cos^2(theta/2) at the roots of P and Q.

    Because the roots interlace, every partial product stays between the narrowest gap and its inverse. In

        x_i - x_j = sin((theta_j - theta_i)/2) sin((theta_j + theta_i)/2)

    the first factor is computed from the difference of the angles where it is small (j = i - 1, i, i + 1).
    The second factor is never computed from the sum of the angles, which loses precision near 2 pi.
    """
    m = P.size
    s, c = np.sin(P / 2), np.cos(P / 2)
    b = np.ones(m)
    for j in range(m):
        sj, cj = s[j], c[j]
        if j == Q.size:  # P has one root more than Q
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
    """Write to `out` the path with the squared singular values of `gaps` and the weights `weights`.

    The values are added from the largest, x_1, to the smallest, x_m; `gaps` contains x_1 - x_2, ...,
    x_{m-1} - x_m, x_m. Let q_i, e_i describe the values added so far, shifted so that the smallest is 0, and
    let W be the sum of their weights. Adding one value at 0 with the weight w gives

        d_1 = q_1 w / (W + w),    q'_1 = q_1 W / (W + w),
        e'_i = e_i + d_i,    q'_{i+1} = e_i q_{i+1} / e'_i,    d_{i+1} = q_{i+1} d_i / e'_i

    and shifting all values by t_1 = tau, the next gap (stationary qd), gives

        Q_i = q'_i + t_i,  E_i = e'_i q'_i / Q_i,  t_{i+1} = tau + e'_i t_i / Q_i.

    Both steps run in one loop without any subtraction (Laurie, "Accurate recovery of recursion coefficients
    from Gaussian quadrature formulas", 1999).
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
