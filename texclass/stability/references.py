"""Reference computations in 60-digit arithmetic (mpmath), fractions, fixed point or 80-bit floats.

If mpmath is not installed, references that need it raise `NoReferenceError`, and their checks are reported as
"not checked".
"""

from fractions import Fraction
from functools import cache
from itertools import accumulate
from typing import Any

import numpy as np

from texclass.recording import Samples

DIGITS = 60
BITS = 256
"""Number of binary digits after the point in fixed-point references (77 decimal digits)."""
MAX_FIXED_POINT_ORDER = 128
"""Largest order whose reference uses fixed point. References of higher orders use 80-bit floats."""
EXTENDED = np.finfo(np.longdouble).eps < 1e-18
"""Whether `numpy.longdouble` has a mantissa of 64 bits on this machine."""


class NoReferenceError(Exception):
    """Raised if a reference cannot be computed. This check and all later checks of the trial are not made."""


def multiprecision() -> Any:
    """Return the mpmath context, with a precision of at least `DIGITS` digits.

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


def scale_to_unit(x: Samples) -> Samples:
    """Divide the signal by a power of two, which is exact and prevents underflow and overflow."""
    return np.ldexp(x, -int(np.frexp(np.max(np.abs(x), initial=0.0))[1]))


def moving_average(x: Samples, n: int) -> Samples:
    """Return the centred moving average over `n` samples, truncated at the ends and rounded only once."""
    sums = [Fraction(0), *accumulate(map(Fraction, x.tolist()))]
    edges = [(max(i - n // 2, 0), min(i - n // 2 + n, x.size)) for i in range(x.size)]
    return np.array([float((sums[last] - sums[first]) / (last - first)) for first, last in edges])


# Linear prediction ------------------------------------------------------------------------------------------


def burg_energies(x: Samples, order: int, padding: int = 0) -> list[float]:
    """Return the smallest residual energies of Burg's method at orders 0 ... p, relative to order 0.

    They are computed in 77-digit fixed point up to order `MAX_FIXED_POINT_ORDER`, and in 80-bit floats for
    higher orders. The list ends where the residual is 0. With a `padding` of p zeros on both sides, the
    result is the optimum of the autocorrelation method.
    """
    fitted = next((p for p in (18, MAX_FIXED_POINT_ORDER) if order <= p), order)
    # More zeros than necessary do not change the result.
    padded = np.pad(x, max(padding, MAX_FIXED_POINT_ORDER)) if padding else x
    return _burg(np.ascontiguousarray(padded).tobytes(), fitted)[: order + 1]


@cache
def _burg(samples: bytes, order: int) -> list[float]:
    x, fixed = scale_to_unit(np.frombuffer(samples)), order <= MAX_FIXED_POINT_ORDER
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
    """Return the residual energies of reflection coefficients at orders 0 ... p, relative to order 0.

    They are computed in 80-bit floats. With a `padding` of p zeros on both sides, they are the energies of
    the autocorrelation method.
    """
    f = b = np.pad(scale_to_unit(x), padding).astype(np.longdouble)
    energies = [2 * (f @ f)]
    for step in k[: f.size - 1].astype(np.longdouble):
        f, b = f[1:] + step * b[:-1], b[:-1] + step * f[1:]
        energies.append(f @ f + b @ b)
    return np.array(energies / energies[0], dtype=np.float64)


def direct_energy(x: Samples, a: Samples, padding: int = 0) -> float:
    """Return the forward and backward residual energy of 1, a_1 ... a_p, relative to order 0."""
    padded, wide = np.pad(scale_to_unit(x), padding).astype(np.longdouble), a.astype(np.longdouble)
    f, b = np.convolve(padded, wide, "valid"), np.convolve(padded, wide[::-1], "valid")
    return float((f @ f + b @ b) / (2 * padded @ padded))


# Models with given reflection coefficients, in 60 digits ----------------------------------------------------


def digits(x: Any) -> Any:
    """Convert an array of floats to an array of mpmath numbers."""
    return np.frompyfunc(multiprecision().mpf, 1, 1)(np.asarray(x, dtype=np.float64).astype(object))


def coefficients(k: Samples) -> Any:
    """Convert reflection coefficients to direct-form coefficients 1, a_1 ... a_p as mpmath numbers."""
    a = digits([1.0])
    for step in digits(k):
        longer = np.append(a, 0)
        a = longer + step * longer[::-1]
    return a


def step_down(a: Samples) -> Samples:
    """Convert direct-form to reflection coefficients, with NaN from the first |k| >= 1 down to order 1."""
    with multiprecision().workdps(DIGITS + a.size // 2):
        current, k = digits(a), np.full(a.size - 1, np.nan)
        for m in range(a.size - 1, 0, -1):
            step = current[m]
            if not abs(step) < 1:
                break
            k[m - 1] = float(step)
            current = (current[:m] - step * current[m:0:-1]) / (1 - step * step)
    return k


def log_spectrum_db(k: Samples, omega: Samples) -> Samples:
    """Return the log spectrum -20 log10 |A(e^jw)| of the model with reflection coefficients `k` in dB."""
    mp = multiprecision()
    delay = np.array([mp.expj(-w) for w in digits(omega)])
    forward = backward = np.ones_like(delay)
    for step in digits(k):
        delayed = delay * backward
        forward, backward = forward + step * delayed, step * forward + delayed
    return np.array([-20 * mp.log10(abs(value)) for value in forward], dtype=np.float64)


def line_spectrum_error(k: Samples, lsf: Samples) -> float:
    """Return the largest relative error of line spectral frequencies, estimated by a Newton step."""
    mp = multiprecision()
    with mp.workdps(DIGITS + 20 * k.size):  # roots close to 1 or -1 cause cancellation
        a, w = np.append(coefficients(k), 0), digits(lsf)
        z, errors = np.array([mp.expj(each) for each in w]), [0.0]
        for first, poly in enumerate((a + a[::-1], a - a[::-1])):
            roots = z[first::2]
            step = np.polyval(poly, roots) / (np.polyval(np.polyder(poly), roots) * roots * mp.mpc(0, 1))
            errors += [float(error) for error in np.abs(step) / w[first::2]]
    return max(errors)


def cepstrum(k: Samples, n: int) -> Samples:
    """Return the cepstral coefficients c_1 ... c_{n-1} of 1/A by the recursion on the coefficients of A."""
    a, c = np.append(coefficients(k), np.zeros(n, dtype=int)), digits([0.0])
    for i in range(1, n):
        c = np.append(c, -a[i] - np.arange(i) * c @ a[i:0:-1] / i)
    return np.asarray(c[1:], dtype=np.float64)


def all_pole_response(k: Samples, excitation: Samples) -> Samples:
    """Filter an excitation by 1/A with a lattice of reflection coefficients that starts at rest."""
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


def _filter_settled(sos: Samples, x: Any) -> Any:
    """Filter mpmath numbers by sections that start in the steady state for the first sample."""
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
    """Filter `x` by second-order sections that start in the steady state for the first sample."""
    return np.asarray(_filter_settled(sos, digits(x)), dtype=np.float64)


def zero_phase(sos: Samples, x: Samples, padding: int) -> Samples:
    """Filter `x` forwards and backwards by second-order sections, with odd extensions at both ends."""
    s = digits(x)
    head, tail = 2 * s[0] - s[padding:0:-1], 2 * s[-1] - s[-2 : -padding - 2 : -1]
    forwards = _filter_settled(sos, np.concatenate([head, s, tail]))
    filtered = _filter_settled(sos, forwards[::-1])[::-1]
    return np.asarray(filtered[padding : padding + s.size], dtype=np.float64)


def butterworth_gain(kind: str, cutoff_hz: float, fs: float, order: int, f_hz: Samples) -> Samples:
    """Return the magnitude response 1 / sqrt(1 + w^(2 order)) of a bilinear-transform Butterworth filter."""
    mp = multiprecision()
    edge, *w = (mp.tan(mp.pi * f / mp.mpf(fs)) for f in digits([cutoff_hz, *f_hz]))
    power = 2 * order if kind == "lowpass" else -2 * order
    return np.array([1 / mp.sqrt(1 + (warped / edge) ** power) for warped in w], dtype=np.float64)


def sections_gain(sos: Samples, f: Samples) -> Samples:
    """Return the magnitude response of second-order sections at f in cycles per sample."""
    mp = multiprecision()
    z, gain = np.array([mp.expj(2 * mp.pi * cycles) for cycles in digits(f)]), mp.mpf(1)
    for section in digits(sos):
        gain = gain * np.abs(np.polyval(section[:3], z) / np.polyval(section[3:], z))
    return np.asarray(gain, dtype=np.float64)
