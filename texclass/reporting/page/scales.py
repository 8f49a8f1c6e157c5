"""From values to places on an axis, and where its ticks stand."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Scale:
    """An axis from low to high.

    Attributes
    ----------
    low, high
        Its ends, low < high; both above 0 where it is logarithmic.
    log
        Whether equal ratios are equally long.
    """

    low: float
    high: float
    log: bool = False

    def __call__(self, x: float) -> float:
        """Return the place of x: 0 at the low end, 1 at the high end; what lies outside stays at the end."""
        low, high = (np.log(self.low), np.log(self.high)) if self.log else (self.low, self.high)
        at = np.log(max(x, self.low)) if self.log else x
        return float(np.clip((at - low) / (high - low), 0.0, 1.0))

    @property
    def ticks(self) -> tuple[float, ...]:
        """Round values between the ends, about five."""
        if self.log:
            return _log_ticks(self.low, self.high)
        step = _round_step((self.high - self.low) / 5)
        first = np.ceil(self.low / step - 1e-9)
        last = np.floor(self.high / step + 1e-9)
        return tuple(float(step * k) + 0.0 for k in np.arange(first, last + 1))


def per_cent_scale(values: Iterable[float]) -> Scale:
    """Return an axis of per cents that ends at 100 and begins at the ten below the least value."""
    least = min(values, default=0.0)
    return Scale(min(90.0, 10 * np.floor(least / 10)), 100.0)


def around(values: Iterable[float], *, log: bool = False, zero: bool = False) -> Scale:
    """Return an axis that holds the values with a little room, and zero where asked."""
    known = list(values) or [1.0]
    low, high = min(known), max(known)
    if log:
        low = max(low, 1e-6)
        return Scale(low / 1.25, max(high, low) * 1.25, log=True)
    low, high = (min(low, 0.0), max(high, 0.0)) if zero else (low, high)
    room = 0.05 * (high - low) or 1.0
    return Scale(low - room * (low != 0 or not zero), high + room * (high != 0 or low == 0 or not zero))


def _round_step(step: float) -> float:
    """Return the next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= step * (1 - 1e-9)))


def _log_ticks(low: float, high: float) -> tuple[float, ...]:
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for steps in ((1,), (1, 3), (1, 2, 5)):
        found = tuple(m * 10.0**d for d in decades for m in steps if low <= m * 10.0**d <= high)
        if len(found) >= 4:
            break
    return found
