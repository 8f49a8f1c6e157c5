"""References: 60-digit arithmetic (mpmath) where feasible, integers and fixed point, else 80-bit floats.

Nothing here shares code with what it judges. Without mpmath the references that need it raise
`NoReferenceError`, and their checks are reported as not made.
"""

from collections.abc import Callable
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
Choice = Callable[[int, Any, Any], Callable[[Any], Any] | None]


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


def _energies(f: Any, order: int, choose: Choice) -> list[float]:
    """Return the residual energy sum f^2 + b^2 over that of order 0, at the orders 0 ... p of a lattice.

    Of each order `choose` gives what multiplies by its reflection coefficient; None, if nothing is left.
    """
    b, whole, energies = f, 2 * (f @ f), [1.0]
    for m in range(min(order, f.size - 1)):
        f, b = f[1:], b[:-1]
        if (times := choose(m, f, b)) is None:
            break
        f, b = f + times(b), b + times(f)
        energies.append(float((f @ f + b @ b) / whole))
    return energies


def burg_energies(x: Samples, order: int) -> list[float]:
    """Return the residual energies at the orders 0 ... p of Burg's optimum, over that of order 0.

    In 77-digit fixed point up to `LARGEST_ORDER`, beyond in 80-bit floats. It ends where nothing is left.
    """
    samples = np.ascontiguousarray(x).tobytes()
    if order > LARGEST_ORDER:
        return _burg(samples, order, wide=True)
    return _burg(samples, 18 if order <= 18 else LARGEST_ORDER, wide=False)[: order + 1]


@cache
def _burg(samples: bytes, order: int, *, wide: bool) -> list[float]:
    f = _scaled(np.frombuffer(samples))

    def in_floats(_: int, f: Any, b: Any) -> Callable[[Any], Any] | None:
        total = f @ f + b @ b
        return (lambda v: -2 * (f @ b) / total * v) if total > 0 else None

    def in_integers(_: int, f: Any, b: Any) -> Callable[[Any], Any] | None:
        total = f @ f + b @ b
        k = (-2 * (f @ b) << BITS) // (total or 1)
        return (lambda v: (k * v) >> BITS) if total else None

    if wide:
        return _energies(f.astype(np.longdouble), order, in_floats)
    whole = np.array([v << BITS for v in integers(f)[0]], dtype=object)
    shift = max((abs(v).bit_length() for v in whole), default=0) - BITS
    return _energies(whole >> shift if shift > 0 else whole << -shift, order, in_integers)


def lattice_energies(x: Samples, k: Samples, padding: int = 0) -> Samples:
    """Return the residual energies at the orders 0 ... p that reflection coefficients leave, over order 0.

    In 80-bit floats. With p zeros of `padding` on both sides it is the energy of the autocorrelation method.
    """
    f, steps = np.pad(_scaled(x), padding).astype(np.longdouble), k.astype(np.longdouble)
    return np.array(_energies(f, steps.size, lambda m, f, b: lambda v: steps[m] * v))


def direct_energy(x: Samples, a: Samples, padding: int = 0) -> float:
    """Return the residual energy, both ways, of coefficients 1, a_1 ... a_p, over that of order 0."""
    padded = np.pad(_scaled(x), padding).astype(np.longdouble)
    wide = a.astype(np.longdouble)
    f, b = np.convolve(padded, wide, "valid"), np.convolve(padded, wide[::-1], "valid")
    return float((f @ f + b @ b) / (2 * padded @ padded))


def autocorrelation_energies(x: Samples, order: int) -> list[float]:
    """Return the residual energies of the autocorrelation method's optimum over that of order 0, by order.

    Burg's formula on the zero-padded signal is the same method.
    """
    return burg_energies(np.pad(x, max(order, LARGEST_ORDER)), order)


# Models, from their reflection coefficients, in 60 digits ---------------------------------------------------


def _digits(x: Any) -> Any:
    """Return an array of floats as an array of mpmath's numbers."""
    return np.frompyfunc(multiprecision().mpf, 1, 1)(np.asarray(x, dtype=np.float64).astype(object))


def _float64(values: Any) -> Samples:
    return np.array(values, dtype=np.float64)


def coefficients(k: Samples) -> Any:
    """Return 1, a_1 ... a_p of reflection coefficients, in the digits mpmath works with."""
    a = _digits([1.0])
    for step in _digits(k):
        longer = np.append(a, 0)
        a = longer + step * longer[::-1]
    return a


def step_down(a: Samples) -> Samples:
    """Return the reflection coefficients of direct-form coefficients as they stand; NaN below a |k| >= 1."""
    with multiprecision().workdps(DIGITS + a.size // 2):
        now, k = _digits(a), np.full(a.size - 1, np.nan)
        for m in range(a.size - 1, 0, -1):
            step = now[m]
            if not abs(step) < 1:
                break
            k[m - 1] = float(step)
            now = (now[:m] - step * now[m:0:-1]) / (1 - step * step)
    return k


def is_stable(a: Samples) -> bool:
    """Whether 1, a_1 ... a_p, as they stand, are a stable filter: the step-down in 60 digits and more."""
    return not np.isnan(step_down(a)).any()


def log_spectrum_db(k: Samples, omega: Samples) -> Samples:
    """Return -20 log10 |A(e^jw)| of reflection coefficients."""
    mp = multiprecision()
    turn = np.array([mp.expj(-w) for w in _digits(omega)])
    forward = backward = np.ones_like(turn)
    for step in _digits(k):
        delayed = turn * backward
        forward, backward = forward + step * delayed, step * forward + delayed
    return _float64([-20 * mp.log10(abs(value)) for value in forward])


def line_spectrum_error(k: Samples, lsf: Samples) -> float:
    """Return the largest relative distance of a frequency from its root of P or Q (Newton's step)."""
    mp = multiprecision()
    with mp.workdps(DIGITS + 20 * k.size):  # roots that crowd at 1 or -1 cancel one another
        a, w = np.append(coefficients(k), 0), _digits(lsf)
        z, worst = np.array([mp.expj(each) for each in w]), 0.0
        for first, poly in enumerate((a + a[::-1], a - a[::-1])):
            at = z[first::2]
            step = np.polyval(poly, at) / (np.polyval(np.polyder(poly), at) * at * mp.mpc(0, 1))
            worst = max([worst, *_float64(np.abs(step) / w[first::2])])
    return float(worst)


def cepstrum(k: Samples, n: int) -> Samples:
    """Return c_1 ... c_{n-1} of ln |1/A| as cosine coefficients, by the recursion on the coefficients."""
    a, c = coefficients(k), _digits([0.0])
    a = np.append(a, np.zeros(max(n - a.size, 0), dtype=int))
    for i in range(1, n):
        known = np.arange(i) * c @ a[i:0:-1]
        c = np.append(c, -a[i] - known / i)
    return _float64(c[1:])


def all_pole_response(k: Samples, excitation: Samples) -> Samples:
    """Return the excitation through 1/A of reflection coefficients, at rest before, by the lattice."""
    steps, out = _digits(k), []
    b = _digits(np.zeros(len(steps) + 1))
    for e in _digits(excitation):
        f = e
        for m in range(len(steps) - 1, -1, -1):
            f = f - steps[m] * b[m]
            b[m + 1] = b[m] + steps[m] * f
        b[0] = f
        out.append(f)
    return _float64(out)


# Filters, in 60 digits --------------------------------------------------------------------------------------


def _through(sos: Samples, x: Any) -> list[Any]:
    """Return the signal through second-order sections that are settled on its first sample."""
    level = x[0]
    for b0, b1, b2, _, a1, a2 in _digits(sos):
        gain = (b0 + b1 + b2) / (1 + a1 + a2)
        s1, s2 = level * (gain - b0), level * (b2 - a2 * gain)
        level *= gain
        out = []
        for v in x:
            y = b0 * v + s1
            s1, s2 = b1 * v - a1 * y + s2, b2 * v - a2 * y
            out.append(y)
        x = out
    return out


def causal(sos: Samples, x: Samples) -> Samples:
    """Return `x` through second-order sections that are settled on its first sample."""
    return _float64(_through(sos, _digits(x)))


def zero_phase(sos: Samples, x: Samples, padding: int) -> Samples:
    """Return `x` forwards and backwards through second-order sections, continued by point reflection."""
    s = _digits(x)
    before, after = 2 * s[0] - s[padding:0:-1], 2 * s[-1] - s[-2 : -padding - 2 : -1]
    forwards = _through(sos, [*before, *s, *after])
    both = _through(sos, forwards[::-1])[::-1]
    return _float64(both[padding : padding + len(s)])


def butterworth_gain(kind: str, edges_hz: tuple[float, ...], fs: float, order: int, f_hz: Samples) -> Samples:
    """Return the magnitude of the bilinear Butterworth filter: 1 / sqrt(1 + w^(2 order)) of the warped w."""
    mp = multiprecision()
    w, edges = (
        np.array([mp.tan(mp.pi * f / mp.mpf(float(fs))) for f in _digits(hz)]) for hz in (f_hz, edges_hz)
    )
    if kind == "lowpass":
        ratio = w / edges[0]
    elif kind == "highpass":
        ratio = edges[0] / w
    else:
        ratio = (w * w - edges[0] * edges[1]) / (w * (edges[1] - edges[0]))
    return _float64([1 / mp.sqrt(1 + r ** (2 * order)) for r in ratio])


def sections_gain(sos: Samples, f: Samples) -> Samples:
    """Return the magnitude of the response of second-order sections at f (cycles per sample)."""
    mp = multiprecision()
    z, gain = np.array([mp.expj(2 * mp.pi * cycles) for cycles in _digits(f)]), mp.mpf(1)
    for section in _digits(sos):
        gain = gain * np.abs(np.polyval(section[:3], z) / np.polyval(section[3:], z))
    return _float64(gain)
