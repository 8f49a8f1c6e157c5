"""What every model of one vibration checks of its samples, and how it makes them safe from any gain."""

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples


def one_channel(x: ArrayLike, name: str, *, at_least: int = 1) -> Samples:
    """Return `x` as float64 of shape (n_samples,), or say which rule it breaks."""
    samples = np.asarray(x, dtype=np.float64)
    if samples.ndim != 1 or samples.size < at_least:
        raise ValueError(
            f"{name} has shape {samples.shape}; the rule is one channel of at least {at_least} samples"
        )
    bad = np.flatnonzero(~np.isfinite(samples))
    if bad.size:
        raise ValueError(
            f"{name} has {bad.size} values that are NaN or infinite, the first at sample {bad[0]}; "
            "the rule is finite samples"
        )
    return samples


def to_unit_scale(x: Samples) -> tuple[Samples, int]:
    """Return `x` times 2^-e, of largest magnitude in [0.5, 1), and e; exact at 1e-300 as at 1e300."""
    exponent = int(np.frexp(np.max(np.abs(x), initial=0.0))[1])
    with np.errstate(under="ignore"):
        return np.ldexp(x, -exponent), exponent


def positive(value: float, name: str) -> float:
    """Return a value that is finite and above 0; else raise the ValueError that names it."""
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} is {value}; the rule is finite and above 0")
    return value


def angular_frequencies(omega: ArrayLike) -> Samples:
    """Return `omega` (rad per sample) as float64 of shape (n_frequencies,), or say which rule it breaks."""
    w = np.ascontiguousarray(omega, dtype=np.float64)
    if w.ndim != 1 or not np.all(np.isfinite(w)):
        raise ValueError(f"omega has shape {w.shape}; the rule is (n_frequencies,) finite radians per sample")
    return w
