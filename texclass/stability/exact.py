"""References: 60-digit arithmetic (mpmath) where feasible, integers and fixed point, else 80-bit floats.

Nothing here shares code with what it judges. Without mpmath the references that need it raise
`NoReferenceError`, and their checks are reported as not made.
"""

from fractions import Fraction
from functools import cache
from math import isqrt
from typing import Any

import numpy as np

from texclass.recording import Samples
from texclass.stability.judging import NoReferenceError

DIGITS = 60
BITS = 256
"""Binary digits behind the point of fixed-point references (77 decimal ones)."""
LARGEST_ORDER = 128
"""Orders up to this one are fitted in fixed point; beyond, in 80-bit floats."""
EXTENDED = np.finfo(np.longdouble).eps < 1e-18
"""Whether `numpy.longdouble` has 64 bits of mantissa here."""


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


# Sums, exactly ----------------------------------------------------------------------------------------------


def integers(x: Samples) -> tuple[list[int], int]:
    """Return integers m_i and e with x_i = m_i 2^e, exactly."""
    mantissa, exponent = np.frexp(np.asarray(x, dtype=np.float64))
    least = int(exponent[mantissa != 0].min(initial=2000))
    least = 0 if least == 2000 else least
    m = (mantissa * 2.0**53).astype(np.int64)
    return [int(a) << int(max(e - least, 0)) for a, e in zip(m, exponent, strict=True)], least - 53


def _ratio(numerator: int, denominator: int, exponent: int) -> float:
    scale = Fraction(2) ** exponent
    return float(Fraction(numerator, denominator) * scale)


def mean(x: Samples) -> float:
    """Return the mean, rounded once."""
    m, e = integers(x)
    return _ratio(sum(m), len(m), e)


def mean_square(x: Samples) -> Fraction:
    """Return the mean of squares as a fraction."""
    m, e = integers(x)
    return Fraction(sum(a * a for a in m), len(m)) * Fraction(2) ** (2 * e)


def variance(x: Samples) -> Fraction:
    """Return the mean squared deviation from the mean as a fraction."""
    m, e = integers(x)
    n, total = len(m), sum(m)
    return Fraction(n * sum(a * a for a in m) - total * total, n * n) * Fraction(2) ** (2 * e)


def root(value: Fraction) -> float:
    """Return the square root of a fraction, rounded to float64."""
    if value == 0:
        return 0.0
    shift = 2 * max(0, 120 - (value.numerator.bit_length() - value.denominator.bit_length()) // 2)
    whole = isqrt((value.numerator << shift) // value.denominator)
    return _ratio(whole, 1, -shift // 2)


def moving_average(x: Samples, n: int) -> Samples:
    """Return the centred mean over `n` samples, the window cut at the ends, each rounded once."""
    m, e = integers(x)
    cumulative = [0]
    for a in m:
        cumulative.append(cumulative[-1] + a)
    out = np.empty(len(m))
    for i in range(len(m)):
        first, last = max(i - n // 2, 0), min(i - n // 2 + n, len(m))
        out[i] = _ratio(cumulative[last] - cumulative[first], last - first, e)
    return out


# Linear prediction ------------------------------------------------------------------------------------------


def _scaled(x: Samples) -> Samples:
    """Return the signal divided by a power of two: exact, and out of the way of every range."""
    largest = float(np.max(np.abs(x), initial=0.0))
    return np.ldexp(x, -int(np.frexp(largest)[1])) if largest > 0 else x


def burg_energies(x: Samples, order: int) -> list[float]:
    """Return the residual energy sum f^2 + b^2 over that of order 0, at the orders 0 ... p of Burg's optimum.

    In 77-digit fixed point up to `LARGEST_ORDER`, beyond in 80-bit floats. It ends where nothing is left.
    """
    samples = np.ascontiguousarray(x).tobytes()
    if order <= LARGEST_ORDER:
        return _burg_exact(samples, 18 if order <= 18 else LARGEST_ORDER)[: order + 1]
    return _burg_wide(samples, order)


@cache
def _burg_exact(samples: bytes, order: int) -> list[float]:
    f, _ = integers(_scaled(np.frombuffer(samples)))
    f = [v << BITS for v in f]
    shift = max((abs(v).bit_length() for v in f), default=0) - BITS
    f = [v >> shift if shift > 0 else v << -shift for v in f]
    b, whole, energies = list(f), 2 * sum(v * v for v in f), [1.0]
    for _ in range(order):
        f, b = f[1:], b[:-1]
        total = sum(v * v for v in f) + sum(v * v for v in b)
        if total == 0:
            break
        k = (-2 * sum(p * q for p, q in zip(f, b, strict=True)) << BITS) // total
        up = [(k * v) >> BITS for v in b]
        b = [v + ((k * w) >> BITS) for v, w in zip(b, f, strict=True)]
        f = [v + w for v, w in zip(f, up, strict=True)]
        energies.append(float(Fraction(sum(v * v for v in f) + sum(v * v for v in b), whole)))
    return energies


@cache
def _burg_wide(samples: bytes, order: int) -> list[float]:
    f = _scaled(np.frombuffer(samples)).astype(np.longdouble)
    b, whole, energies = f.copy(), 2 * f @ f, [1.0]
    for _ in range(order):
        f, b = f[1:], b[:-1]
        total = f @ f + b @ b
        if not total > 0:
            break
        k = -2 * (f @ b) / total
        f, b = f + k * b, b + k * f
        energies.append(float((f @ f + b @ b) / whole))
    return energies


def lattice_energies(x: Samples, k: Samples, padding: int = 0) -> Samples:
    """Return the residual energy at the orders 0 ... p that the reflection coefficients leave, over order 0.

    In 80-bit floats. With p zeros of `padding` on both sides it is the energy of the autocorrelation method.
    """
    f = np.pad(_scaled(x), padding).astype(np.longdouble)
    b, whole, energies = f.copy(), 2 * f @ f, [1.0]
    for k_m in k.astype(np.longdouble):
        f, b = f[1:], b[:-1]
        if f.size == 0:
            break
        f, b = f + k_m * b, b + k_m * f
        energies.append(float((f @ f + b @ b) / whole))
    return np.array(energies)


def direct_energy(x: Samples, a: Samples, padding: int = 0) -> float:
    """Return the residual energy, both ways, of coefficients 1, a_1 ... a_p, over that of order 0."""
    padded = np.pad(_scaled(x), padding).astype(np.longdouble)
    wide = a.astype(np.longdouble)
    f, b = np.convolve(padded, wide, "valid"), np.convolve(padded, wide[::-1], "valid")
    return float((f @ f + b @ b) / (2 * padded @ padded))


@cache
def _levinson_exact(samples: bytes, order: int) -> list[float]:
    m, _ = integers(np.frombuffer(samples))
    whole = sum(v * v for v in m)
    bits = 4 * BITS  # the energy may fall to 1e-30 of the signal, and its digits with it
    r = [(sum(p * q for p, q in zip(m, m[i:], strict=False)) << bits) // whole for i in range(order + 1)]
    a, energy, energies = [1 << bits], 1 << bits, [1.0]
    for i in range(1, order + 1):
        k = -sum(p * q for p, q in zip(a, r[i:0:-1], strict=True)) // energy
        a = [p + ((k * q) >> bits) for p, q in zip([*a, 0], [0, *a[::-1]], strict=True)]
        energy -= (energy * ((k * k) >> bits)) >> bits
        energies.append(float(Fraction(energy, 1 << bits)))
    return energies


def autocorrelation_energies(x: Samples, order: int) -> list[float]:
    """Return the residual energy of the autocorrelation method's optimum over that of order 0, by order.

    In 300-digit fixed point up to `LARGEST_ORDER`, beyond by Burg's formula on the zero-padded signal in
    80-bit floats, which is the same method.
    """
    if order <= LARGEST_ORDER:
        samples = np.ascontiguousarray(x).tobytes()
        return _levinson_exact(samples, 18 if order <= 18 else LARGEST_ORDER)[: order + 1]
    return _burg_wide(np.pad(_scaled(x), order).tobytes(), order)
