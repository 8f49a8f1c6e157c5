"""References of models, filters and transforms in 60 digits (mpmath); see `exact` where it is missing."""

from functools import lru_cache
from typing import Any

import numpy as np

from texclass.recording import Samples
from texclass.stability.exact import DIGITS, multiprecision


def coefficients(k: Samples) -> list[Any]:
    """Return 1, a_1 ... a_p of reflection coefficients, in the digits mpmath works with."""
    mp = multiprecision()
    a = [mp.mpf(1)]
    for k_m in k:
        step = mp.mpf(float(k_m))
        a = [p + step * q for p, q in zip([*a, 0], [0, *a[::-1]], strict=True)]
    return a


def is_stable(a: Samples) -> bool:
    """Whether 1, a_1 ... a_p, as they stand, are a stable filter: the step-down in 60 digits and more."""
    return not np.isnan(step_down(a)).any()


def step_down(a: Samples) -> Samples:
    """Return the reflection coefficients of direct-form coefficients as they stand; NaN below a |k| >= 1."""
    return _step_down(np.ascontiguousarray(a, dtype=np.float64).tobytes())


@lru_cache(maxsize=1024)
def _step_down(coefficients: bytes) -> Samples:
    a = np.frombuffer(coefficients)
    mp = multiprecision()
    with mp.workdps(DIGITS + a.size // 2):
        now, k = [mp.mpf(float(v)) for v in a], np.full(a.size - 1, np.nan)
        for m in range(a.size - 1, 0, -1):
            step = now[m]
            if not abs(step) < 1:
                break
            k[m - 1] = float(step)
            room = 1 / (1 - step * step)
            now = [(now[i] - step * now[m - i]) * room for i in range(m)]
    return k


def log_spectrum_db(k: Samples, omega: Samples) -> Samples:
    """Return -20 log10 |A(e^jw)| of reflection coefficients."""
    mp = multiprecision()
    steps, out = [mp.mpf(float(v)) for v in k], []
    for w in omega:
        turn = mp.expj(-mp.mpf(float(w)))
        forward, backward = mp.mpc(1), mp.mpc(1)
        for step in steps:
            delayed = turn * backward
            forward, backward = forward + step * delayed, step * forward + delayed
        out.append(float(-20 * mp.log10(abs(forward))))
    return np.array(out)


def line_spectrum_error(k: Samples, lsf: Samples) -> float:
    """Return the largest relative distance of a frequency from its root of P or Q (Newton's step)."""
    mp = multiprecision()
    with mp.workdps(DIGITS + 20 * k.size):  # roots that crowd at 1 or -1 cancel one another
        a, errors = coefficients(k), []
        for i, w in enumerate(lsf):
            sign = 1 if i % 2 == 0 else -1
            poly = [p + sign * q for p, q in zip([*a, 0], [0, *a[::-1]], strict=True)]
            z, value, slope = mp.expj(mp.mpf(float(w))), mp.mpc(0), mp.mpc(0)
            for c in poly:
                slope, value = slope * z + value, value * z + c
            step = value / (slope * mp.mpc(0, 1) * z)
            errors.append(float(abs(step) / mp.mpf(float(w))))
    return max(errors)


def cepstrum(k: Samples, n: int) -> Samples:
    """Return c_1 ... c_{n-1} of ln |1/A| as cosine coefficients, by the recursion on the coefficients."""
    mp = multiprecision()
    a, c = coefficients(k), [mp.mpf(0)]
    for i in range(1, n):
        known = mp.fsum(j * c[j] * a[i - j] for j in range(max(1, i - len(a) + 1), i))
        c.append(-(a[i] if i < len(a) else 0) - known / i)
    return np.array([float(v) for v in c[1:]])


def all_pole_response(k: Samples, excitation: Samples) -> Samples:
    """Return the excitation through 1/A of reflection coefficients, at rest before, by the lattice."""
    return _all_pole_response(k.tobytes(), excitation.tobytes())


@lru_cache(maxsize=4096)
def _all_pole_response(reflection: bytes, excitation: bytes) -> Samples:
    mp = multiprecision()
    steps = [mp.mpf(v) for v in np.frombuffer(reflection).tolist()]
    b, out = [mp.mpf(0)] * (len(steps) + 1), []
    for e in np.frombuffer(excitation).tolist():
        f = mp.mpf(e)
        for m in range(len(steps) - 1, -1, -1):
            f -= steps[m] * b[m]
            b[m + 1] = b[m] + steps[m] * f
        b[0] = f
        out.append(f)
    return np.array([float(v) for v in out])


# Filters -------------------------------------------------------------------------------------


def _through(sos: Samples, x: list[Any], *, settled: bool) -> list[Any]:
    """Return the signal through second-order sections, at rest or settled on its first sample."""
    mp = multiprecision()
    level = x[0] if settled else mp.mpf(0)
    for section in sos:
        b0, b1, b2, _, a1, a2 = (mp.mpf(float(v)) for v in section)
        gain = (b0 + b1 + b2) / (1 + a1 + a2)
        s1, s2 = level * (gain - b0), level * (b2 - a2 * gain)
        level *= gain
        out = []
        for v in x:
            y = b0 * v + s1
            s1, s2 = b1 * v - a1 * y + s2, b2 * v - a2 * y
            out.append(y)
        x = out
    return x


def causal(sos: Samples, x: Samples) -> Samples:
    """Return `x` through second-order sections that are settled on its first sample."""
    mp = multiprecision()
    return np.array([float(v) for v in _through(sos, [mp.mpf(float(v)) for v in x], settled=True)])


def zero_phase(sos: Samples, x: Samples, padding: int) -> Samples:
    """Return `x` forwards and backwards through second-order sections, continued by point reflection."""
    mp = multiprecision()
    s = [mp.mpf(float(v)) for v in x]
    before = [2 * s[0] - v for v in s[padding:0:-1]]
    after = [2 * s[-1] - v for v in s[-2 : -padding - 2 : -1]]
    forwards = _through(sos, [*before, *s, *after], settled=True)
    both = _through(sos, forwards[::-1], settled=True)[::-1]
    return np.array([float(v) for v in both[padding : padding + len(s)]])


def butterworth_gain(kind: str, edges_hz: tuple[float, ...], fs: float, order: int, f_hz: Samples) -> Samples:
    """Return the magnitude of the bilinear Butterworth filter: 1 / sqrt(1 + w^(2 order)) of the warped w."""
    mp = multiprecision()

    def warped(f: float) -> Any:
        return mp.tan(mp.pi * mp.mpf(float(f)) / mp.mpf(float(fs)))

    edges = [warped(f) for f in edges_hz]
    out = []
    for f in f_hz:
        w = warped(f)
        if kind == "lowpass":
            ratio = w / edges[0]
        elif kind == "highpass":
            ratio = edges[0] / w
        else:
            ratio = (w * w - edges[0] * edges[1]) / (w * (edges[1] - edges[0]))
        out.append(float(1 / mp.sqrt(1 + ratio ** (2 * order))))
    return np.array(out)


def sections_gain(sos: Samples, f: Samples) -> Samples:
    """Return the magnitude of the response of second-order sections at f (cycles per sample)."""
    mp = multiprecision()
    out = []
    for cycles in f:
        z, gain = mp.expj(-2 * mp.pi * mp.mpf(float(cycles))), mp.mpf(1)
        for section in sos:
            b0, b1, b2, a0, a1, a2 = (mp.mpf(float(v)) for v in section)
            gain *= abs((b0 + z * (b1 + z * b2)) / (a0 + z * (a1 + z * a2)))
        out.append(float(gain))
    return np.array(out)
