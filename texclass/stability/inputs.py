"""Extreme inputs by family, each with a name and a sampling rate."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

SEED = 0
N = 2048
"""Number of samples of inputs for models, except in the family "length"."""
LONG = 8192
"""Number of samples of inputs for features. Most features need frames of a few tenths of a second."""
ORDERS = (1, 2, 10, 18, 50, 100, 128, 256, 400, 1000)
RATES_HZ = (500.0, 1000.0, 2000.0, 4000.0, 8000.0, 10_000.0, 22_050.0, 44_100.0, 50_000.0)
FAMILIES = {
    "plain": "coloured and white noise",
    "silent": "zeros, constants",
    "impulse": "one sample that is not 0",
    "sine": "pure, at fs/4, alternating, with 1e-8 noise",
    "poles": "resonances 1e-3 ... 1e-12 inside the unit circle; reflection coefficients up to 1 - 2^-53",
    "oversampled": "low-passed by 20 and 100",
    "gain": "1e-160 ... 1e150",
    "offset": "1e6 + noise 1e-3, 1e3 + noise, ramp",
    "clipped": "full-scale square, clipped, quantised",
    "dtype": "int8, int16, int32, float16, float32, big-endian, bool; full-scale squares",
    "layout": "strided, reversed, column, read-only",
    "broken": "NaN, infinity, gaps; for designs: parameters out of range",
    "length": "0, 1, 2, ... 600 samples",
    "rate": "500 Hz ... 50 kHz; for designs: cut-offs 1e-5 ... 0.4999 fs",
    "order": "signals of order/2, order - 1, order and order + 1 samples",
    "stream": "10^8 samples piece by piece; 5 10^6 at once",
}
"""Family of inputs -> description, in the order of the columns of the report."""
VALUES = ("plain", "silent", "impulse", "sine", "poles", "oversampled", "gain", "offset", "clipped")
FORMS = ("dtype", "layout", "broken")
GAINS = (1e-160, 1e-100, 1e-30, 1e-3, 1e3, 1e30, 1e100, 1e150)


@dataclass(frozen=True, eq=False)
class Case:
    """One input of the battery, with a model order for subjects that need it.

    Attributes
    ----------
    name
        Name, unique among inputs of the same order.
    family
        Family, a key of `FAMILIES`.
    x
        Samples of any real dtype and layout. They are shared, so subjects must not modify them.
    fs
        Sampling rate in Hz.
    order
        Order of the model, or 0 if the subject has no model order.
    required
        Whether the input is ordinary, so that an exception counts as a failure.
    gain
        Factor by which the samples are larger than the samples of `plain`.
    """

    name: str
    family: str
    x: NDArray[Any]
    fs: float = 10_000.0
    order: int = 0
    required: bool = False
    gain: float = 1.0

    def at_order(self, order: int) -> "Case":
        """Return the case with a model order, which becomes part of its name."""
        return replace(self, order=order, name=f"{self.name}, p = {order}")


@cache
def noise(n: int = N, seed: int = SEED) -> NDArray[np.float64]:
    """Return read-only white Gaussian noise of unit variance."""
    x = np.random.default_rng([SEED, seed]).standard_normal(n)
    x.flags.writeable = False
    return x


@cache
def plain(n: int = N) -> NDArray[np.float64]:
    """Return read-only coloured noise that resembles a surface (two resonances, sloping spectrum)."""
    poles = np.array([0.95 * np.exp(0.2j), 0.9 * np.exp(0.7j), 0.5])
    a = np.real(np.poly(np.concatenate([poles, poles[:2].conj()])))
    x: NDArray[np.float64] = scipy.signal.lfilter([1.0], a, noise(n + 200, 1))[200:]
    x.flags.writeable = False
    return x


def low_passed(factor: int, n: int = N) -> NDArray[np.float64]:
    """Return noise that is oversampled by `factor`, with no content above 1/`factor` of the band."""
    spectrum = np.fft.rfft(noise(n))
    spectrum[spectrum.size // factor :] = 0
    return np.fft.irfft(spectrum)


def _samples(n: int) -> dict[str, dict[str, NDArray[Any]]]:
    """Return the samples of all inputs of length `n`: family -> name -> samples."""
    t, noisy = np.arange(n), plain(n)
    sine, square = np.sin(0.3 * t), np.sign(np.sin(0.05 * t) + 1e-9)
    full_scale = noisy / np.abs(noisy).max()
    radii = {f"pole radius 1 - 1e-{digits}": 1 - 10.0**-digits for digits in range(3, 13)}

    def broken(value: float, first: int = 0, stop: int = n) -> NDArray[np.float64]:
        return np.where((t >= first) & (t < stop), value, noisy)

    return {
        "plain": {"plain": noisy, "white": noise(n)},
        "silent": {
            "zeros": np.zeros(n),
            **{f"constant {name}": np.full(n, float(name)) for name in ("1", "0.1", "-1e6", "1e-160")},
        },
        "impulse": {f"impulse at {i}": np.where(t == i, 1.0, 0.0) for i in (0, n // 2, n - 1)},
        "sine": {
            "pure sine": sine,
            "sine at fs/4": np.tile([0.0, 1.0, 0.0, -1.0], n // 4),
            "alternating": np.tile([1.0, -1.0], n // 2),
            "sine + 1e-8 noise": sine + 1e-8 * noise(n),
            "two sines + 1e-8 noise": sine + np.cos(2.9 * t) + 1e-8 * noise(n),
        },
        "poles": {
            name: scipy.signal.lfilter([1.0], [1.0, -2 * r * np.cos(0.7), r * r], noise(n))
            for name, r in radii.items()
        },
        "oversampled": {
            "low-passed by 20": low_passed(20, n),
            "low-passed by 100": low_passed(100, n),
            "low-passed by 20 + 1e-6 noise": low_passed(20, n) + 1e-6 * noise(n, 3),
        },
        "offset": {
            "DC 1e6 + noise 1e-3": 1e6 + 1e-3 * noise(n),
            "DC 1e3 + noise": 1e3 + noisy,
            "ramp": np.linspace(-1, 1, n),
        },
        "clipped": {
            "full-scale square": 32767 * square,
            "clipped noise": np.clip(noisy, -1.0, 1.0),
            "quantised to one step": np.round(0.2 * noisy),
        },
        "gain": {f"gain {g:g}": g * noisy for g in GAINS},
        "dtype": {
            "int8": np.round(127 * full_scale).astype(np.int8),
            "int16": np.round(32767 * full_scale).astype(np.int16),
            "int32": np.round(2**30 * full_scale).astype(np.int32),
            "float32": full_scale.astype(np.float32),
            "float16": full_scale.astype(np.float16),
            "big-endian float64": full_scale.astype(">f8"),
            "int8 square, -128 to 127": np.where(square > 0, 127, -128).astype(np.int8),
            "int16 square, full scale": np.where(square > 0, 32767, -32768).astype(np.int16),
            "bool": full_scale > 0,
        },
        "layout": {
            "every third sample": np.repeat(noisy, 3)[::3],
            "backwards": noisy[::-1].copy()[::-1],
            "column of a table": np.tile(noisy[:, np.newaxis], 3)[:, 1],
            "read-only": noisy,
        },
        "broken": {  # faults are in the first 200 samples, because some subjects use only these
            "one NaN": broken(np.nan, 150, 151),
            "NaN at the start": broken(np.nan, 0, 1),
            "gap of 100 NaN": broken(np.nan, 90, 190),
            "+inf": broken(np.inf, 150, 151),
            "-inf": broken(-np.inf, 20, 21),
            "all NaN": broken(np.nan),
        },
    }


@cache
def inputs(n: int = N) -> tuple[Case, ...]:
    """Return all inputs of length `n` (a multiple of 4), without model orders."""
    ordinary = ("plain", "layout", "float32", "big-endian float64")
    gains = {f"gain {g:g}": g for g in GAINS}
    return tuple(
        Case(name, family, x, required=family in ordinary or name in ordinary, gain=gains.get(name, 1.0))
        for family, samples in _samples(n).items()
        for name, x in samples.items()
    )


def cases_of(*families: str, quick: bool = False, n: int = N) -> tuple[Case, ...]:
    """Return the inputs of some families. A quick run uses every third input of each, including the first."""
    if not quick:
        return tuple(case for case in inputs(n) if case.family in families)
    return tuple(c for family in families for c in [c for c in inputs(n) if c.family == family][::3])


def battery(quick: bool, *, longest: int = 600, with_rates: bool = True, n: int = N) -> tuple[Case, ...]:
    """Return the inputs for most subjects.

    Parameters
    ----------
    quick : bool
        Whether to return only a small part of the inputs.
    longest : int
        Largest length in the family "length" (default 600); 0 omits this family.
    with_rates : bool
        Whether to include plain noise at other sampling rates (default True).
    n : int
        Number of samples of all other inputs.
    """
    short = lengths(quick, longest) if longest else ()
    return cases_of(*VALUES, *FORMS, quick=quick, n=n) + short + (rates(quick, n) if with_rates else ())


def lengths(quick: bool, longest: int = 600) -> tuple[Case, ...]:
    """Return the first n samples of plain noise for every n from 0 to `longest` (quick run: for some n)."""
    quick_sizes = (0, 1, 2, 3, 8, 11, 32, 64, 129, 543, 544, 600)
    sizes = quick_sizes if quick else range(longest + 1)
    return tuple(Case(f"{n} samples", "length", plain()[:n]) for n in sizes if n <= longest)


def rates(quick: bool, n: int = N) -> tuple[Case, ...]:
    """Return plain noise with sampling rates from 500 Hz to 50 kHz."""
    return tuple(Case(f"fs {fs:g} Hz", "rate", plain(n), fs=fs) for fs in RATES_HZ[:: 4 if quick else 1])


def short_signals(quick: bool) -> tuple[Case, ...]:
    """Return signals of n samples for models of orders n - 1, n, n + 1 and 2 n."""
    return tuple(
        Case(f"{n} samples", "order", noise()[:n]).at_order(p)
        for p in ((2, 18) if quick else ORDERS)
        for n in sorted({p + 1, p, p - 1, (p + 1) // 2} - {0})
    )


def with_orders(cases: Iterable[Case], quick: bool, largest: int = 1000) -> tuple[Case, ...]:
    """Return each case at each order up to `largest`.

    Inputs of the families "dtype", "layout", "length" and "broken" are used at order 10 only. A quick run
    uses orders 2 and 18, and also 400 for plain signals.
    """
    default = (2, 18) if quick else ORDERS
    orders = dict.fromkeys((*FORMS, "length"), (10,)) | {"plain": (2, 18, 400) if quick else ORDERS}
    return tuple(c.at_order(p) for c in cases for p in orders.get(c.family, default) if p <= largest)


def to_float64(x: Any) -> NDArray[np.float64]:
    """Return a signal of any dtype and layout as contiguous float64 samples."""
    return np.ascontiguousarray(x, dtype=np.float64)


def battery_hash() -> str:
    """Return a hex digest of all inputs: names, rates, dtypes and samples."""
    digest = hashlib.sha256()
    for case in (*inputs(), *inputs(LONG), *lengths(False), *rates(False), *short_signals(False)):
        digest.update(f"{case.name} {case.family} {case.fs} {case.order} {case.x.dtype}".encode())
        digest.update(case.x.tobytes())
    return digest.hexdigest()[:16]
