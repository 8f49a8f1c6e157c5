"""References: 60-digit arithmetic (mpmath) where feasible, fractions and fixed point, else 80-bit floats.

Without mpmath those that need it raise `NoReferenceError`, and their checks are reported as not made.
"""

from fractions import Fraction
from functools import cache
from itertools import accumulate
from typing import Any

import numpy as np

from texclass.recording import Samples

DIGITS = 60
BITS = 256
"""Binary digits behind the point of fixed-point references (77 decimal ones)."""
LARGEST_ORDER = 128
"""Orders up to this one are fitted in fixed point; beyond, in 80-bit floats."""
EXTENDED = np.finfo(np.longdouble).eps < 1e-18
"""Whether `numpy.longdouble` has 64 bits of mantissa here."""


class NoReferenceError(Exception):
    """A reference cannot be computed here: the checks that need it, and those after it, are not made."""


def multiprecision() -> Any:
    """Return mpmath's context, set to `DIGITS`, or to more where a caller asked for more.

    Raises
    ------
    NoReferenceError
        If mpmath is not installed.
    """
    try:
        import mpmath
    except ImportError:
        raise NoReferenceError("not checked (mpmath not installed)") from None
    mpmath.mp.dps = max(mpmath.mp.dps, DIGITS)
    return mpmath.mp


def unit(x: Samples) -> Samples:
    """Return the signal divided by a power of two: exact, and out of the way of every range."""
    return np.ldexp(x, -int(np.frexp(np.max(np.abs(x), initial=0.0))[1]))


def moving_average(x: Samples, n: int) -> Samples:
    """Return the centred mean over `n` samples, the window cut at the ends, each rounded once."""
    sums = [Fraction(0), *accumulate(map(Fraction, x.tolist()))]
    edges = [(max(i - n // 2, 0), min(i - n // 2 + n, x.size)) for i in range(x.size)]
    return np.array([float((sums[last] - sums[first]) / (last - first)) for first, last in edges])


# Linear prediction ------------------------------------------------------------------------------------------


def burg_energies(x: Samples, order: int, padding: int = 0) -> list[float]:
    """Return the residual energies at the orders 0 ... p of Burg's optimum, over that of order 0.

    In 77-digit fixed point up to `LARGEST_ORDER`, beyond in 80-bit floats. It ends where nothing is left.
    With p zeros of `padding` on both sides it is the optimum of the autocorrelation method.
    """
    fitted = next((p for p in (18, LARGEST_ORDER) if order <= p), order)
    between = np.pad(x, max(padding, LARGEST_ORDER)) if padding else x  # more zeros change nothing
    return _burg(np.ascontiguousarray(between).tobytes(), fitted)[: order + 1]


@cache
def _burg(samples: bytes, order: int) -> list[float]:
    x, fixed = unit(np.frombuffer(samples)), order <= LARGEST_ORDER
    f: Any = np.array([int(v) for v in np.ldexp(x, BITS)], object) if fixed else x.astype(np.longdouble)
    b, whole, energies = f, 2 * (f @ f), [1.0]
    for _ in range(min(order, x.size - 1)):
        f, b = f[1:], b[:-1]
        total = f @ f + b @ b
        if not total:
            break
        if fixed:
            k = (-2 * (f @ b) << BITS) // total
            f, b = f + (k * b >> BITS), b + (k * f >> BITS)
        else:
            k = -2 * (f @ b) / total
            f, b = f + k * b, b + k * f
        energies.append(float((f @ f + b @ b) / whole))
    return energies


def lattice_energies(x: Samples, k: Samples, padding: int = 0) -> Samples:
    """Return the residual energies at the orders 0 ... p that reflection coefficients leave, over order 0.

    In 80-bit floats. With p zeros of `padding` on both sides it is the energy of the autocorrelation method.
    """
    f = b = np.pad(unit(x), padding).astype(np.longdouble)
    energies = [2 * (f @ f)]
    for step in k[: f.size - 1].astype(np.longdouble):
        f, b = f[1:] + step * b[:-1], b[:-1] + step * f[1:]
        energies.append(f @ f + b @ b)
    return np.array(energies / energies[0], dtype=np.float64)


def direct_energy(x: Samples, a: Samples, padding: int = 0) -> float:
    """Return the residual energy, both ways, of coefficients 1, a_1 ... a_p, over that of order 0."""
    padded, wide = np.pad(unit(x), padding).astype(np.longdouble), a.astype(np.longdouble)
    f, b = np.convolve(padded, wide, "valid"), np.convolve(padded, wide[::-1], "valid")
    return float((f @ f + b @ b) / (2 * padded @ padded))


# Models, from their reflection coefficients, in 60 digits ---------------------------------------------------


def digits(x: Any) -> Any:
    """Return an array of floats as an array of mpmath's numbers."""
    return np.frompyfunc(multiprecision().mpf, 1, 1)(np.asarray(x, dtype=np.float64).astype(object))


def coefficients(k: Samples) -> Any:
    """Return 1, a_1 ... a_p of reflection coefficients, in the digits mpmath works with."""
    a = digits([1.0])
    for step in digits(k):
        longer = np.append(a, 0)
        a = longer + step * longer[::-1]
    return a


def step_down(a: Samples) -> Samples:
    """Return the reflection coefficients of direct-form coefficients as they stand; NaN below a |k| >= 1."""
    with multiprecision().workdps(DIGITS + a.size // 2):
        now, k = digits(a), np.full(a.size - 1, np.nan)
        for m in range(a.size - 1, 0, -1):
            step = now[m]
            if not abs(step) < 1:
                break
            k[m - 1] = float(step)
            now = (now[:m] - step * now[m:0:-1]) / (1 - step * step)
    return k


def log_spectrum_db(k: Samples, omega: Samples) -> Samples:
    """Return -20 log10 |A(e^jw)| of reflection coefficients."""
    mp = multiprecision()
    turn = np.array([mp.expj(-w) for w in digits(omega)])
    forward = backward = np.ones_like(turn)
    for step in digits(k):
        delayed = turn * backward
        forward, backward = forward + step * delayed, step * forward + delayed
    return np.array([-20 * mp.log10(abs(value)) for value in forward], dtype=np.float64)


def line_spectrum_error(k: Samples, lsf: Samples) -> float:
    """Return the largest relative distance of a frequency from its root of P or Q (Newton's step)."""
    mp = multiprecision()
    with mp.workdps(DIGITS + 20 * k.size):  # roots that crowd at 1 or -1 cancel one another
        a, w = np.append(coefficients(k), 0), digits(lsf)
        z, errors = np.array([mp.expj(each) for each in w]), [0.0]
        for first, poly in enumerate((a + a[::-1], a - a[::-1])):
            at = z[first::2]
            step = np.polyval(poly, at) / (np.polyval(np.polyder(poly), at) * at * mp.mpc(0, 1))
            errors += [float(error) for error in np.abs(step) / w[first::2]]
    return max(errors)


def cepstrum(k: Samples, n: int) -> Samples:
    """Return c_1 ... c_{n-1} of ln |1/A| as cosine coefficients, by the recursion on the coefficients."""
    a, c = np.append(coefficients(k), np.zeros(n, dtype=int)), digits([0.0])
    for i in range(1, n):
        c = np.append(c, -a[i] - np.arange(i) * c @ a[i:0:-1] / i)
    return np.asarray(c[1:], dtype=np.float64)


def all_pole_response(k: Samples, excitation: Samples) -> Samples:
    """Return the excitation through 1/A of reflection coefficients, at rest before, by the lattice."""
    steps, out = digits(k), []
    b = digits(np.zeros(k.size + 1))
    for e in digits(excitation):
        f = e
        for m in range(k.size - 1, -1, -1):
            f = f - steps[m] * b[m]
            b[m + 1] = b[m] + steps[m] * f
        b[0] = f
        out.append(f)
    return np.array(out, dtype=np.float64)


# Filters, in 60 digits --------------------------------------------------------------------------------------


def _settled(sos: Samples, x: Any) -> Any:
    """Return a signal of mpmath's numbers through sections that are settled on its first sample."""
    level = x[0]
    for b0, b1, b2, _, a1, a2 in digits(sos):
        gain = (b0 + b1 + b2) / (1 + a1 + a2)
        s1, s2 = level * (gain - b0), level * (b2 - a2 * gain)
        level *= gain
        out = np.empty_like(x)
        for i, v in enumerate(x):
            out[i] = b0 * v + s1
            s1, s2 = b1 * v - a1 * out[i] + s2, b2 * v - a2 * out[i]
        x = out
    return x


def causal(sos: Samples, x: Samples) -> Samples:
    """Return `x` through second-order sections that are settled on its first sample."""
    return np.asarray(_settled(sos, digits(x)), dtype=np.float64)


def zero_phase(sos: Samples, x: Samples, padding: int) -> Samples:
    """Return `x` forwards and backwards through second-order sections, continued by point reflection."""
    s = digits(x)
    before, after = 2 * s[0] - s[padding:0:-1], 2 * s[-1] - s[-2 : -padding - 2 : -1]
    forwards = _settled(sos, np.concatenate([before, s, after]))
    both = _settled(sos, forwards[::-1])[::-1]
    return np.asarray(both[padding : padding + s.size], dtype=np.float64)


def butterworth_gain(kind: str, cutoff_hz: float, fs: float, order: int, f_hz: Samples) -> Samples:
    """Return the magnitude of the bilinear Butterworth low- or high-pass: 1 / sqrt(1 + w^(2 order))."""
    mp = multiprecision()
    edge, *w = (mp.tan(mp.pi * f / mp.mpf(fs)) for f in digits([cutoff_hz, *f_hz]))
    power = 2 * order if kind == "lowpass" else -2 * order
    return np.array([1 / mp.sqrt(1 + (warped / edge) ** power) for warped in w], dtype=np.float64)


def sections_gain(sos: Samples, f: Samples) -> Samples:
    """Return the magnitude of the response of second-order sections at f (cycles per sample)."""
    mp = multiprecision()
    z, gain = np.array([mp.expj(2 * mp.pi * cycles) for cycles in digits(f)]), mp.mpf(1)
    for section in digits(sos):
        gain = gain * np.abs(np.polyval(section[:3], z) / np.polyval(section[3:], z))
    return np.asarray(gain, dtype=np.float64)
