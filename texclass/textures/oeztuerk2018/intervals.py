"""How many signals a surface needs: people stroke slowly where friction is high."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples
from texclass.signals import one_channel, positive

BIN_MM_S = 40.0
"""`oeztuerk2018`, figure 4.2: bins of 4 cm/s."""
FRICTION = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
N_INTERVALS = (7, 5, 4, 3, 2, 2)
"""`oeztuerk2018`, section 4.2: intervals at each of these coefficients."""
EXTREME = 1.2
"""From here on 1 interval. The thesis calls its seventh coefficient extreme and does not print it."""
NOTABLE = 0.05
"""Share of the samples that makes a bin notable; the thesis judges by eye."""


@dataclass(frozen=True)
class SpeedIntervals:
    """Speeds for each of which one signal is displayed.

    Attributes
    ----------
    bounds_mm_s : tuple of float
        Rising, from 0 to infinity: n_intervals + 1 of them.
    """

    bounds_mm_s: tuple[float, ...]

    @property
    def n_intervals(self) -> int:
        """How many signals are needed."""
        return len(self.bounds_mm_s) - 1

    @property
    def centres_mm_s(self) -> tuple[float, ...]:
        """A speed for each interval: its middle, for the last that of its first 40 mm/s."""
        lower = self.bounds_mm_s[:-1]
        upper = (*self.bounds_mm_s[1:-1], lower[-1] + BIN_MM_S)
        return tuple((a + b) / 2 for a, b in zip(lower, upper, strict=True))

    def index(self, speed: ArrayLike) -> NDArray[np.intp]:
        """Return which interval each speed (mm/s) belongs to; a bound belongs to the faster one."""
        return np.searchsorted(self.bounds_mm_s[1:-1], np.asarray(speed, dtype=np.float64), side="right")

    def __str__(self) -> str:
        edges = [f"{b / 10:g}" for b in self.bounds_mm_s[:-1]]
        closed = [f"{a}-{b}" for a, b in pairwise(edges)]
        return ", ".join([*closed, f"> {edges[-1]}"]) + " cm/s"


def n_intervals(friction: float) -> int:
    """Return how many intervals a friction coefficient asks for.

    At the coefficients of the thesis its number; between two of them the larger one, so that never a signal
    is lacking; 1 from `EXTREME` on.

    Raises
    ------
    ValueError
        If the coefficient is negative, NaN or infinite.
    """
    if not (np.isfinite(friction) and friction >= 0):
        raise ValueError(f"friction is {friction}; the rule is finite and at least 0")
    if friction >= EXTREME:
        return 1
    return N_INTERVALS[int(np.searchsorted(FRICTION, friction + 1e-9, side="right")) - 1]


def speed_intervals(friction: float) -> SpeedIntervals:
    """Return the intervals for a friction coefficient: 40 mm/s each, the last one open.

    Parameters
    ----------
    friction : float
        Kinetic friction coefficient.

    References
    ----------
    `oeztuerk2018`, chapter 4 and Table 6.1.

    Examples
    --------
    >>> print(speed_intervals(0.4))
    0-4, 4-8, 8-12, > 12 cm/s
    """
    return _of(n_intervals(friction))


def intervals_from_speeds(
    speed: ArrayLike, *, notable: float = NOTABLE, bin_mm_s: float = BIN_MM_S
) -> SpeedIntervals:
    """Return the intervals that speeds of people on a surface ask for.

    The histogram of figure 4.2: intervals up to the last bin that holds a notable share of the samples; what
    is faster belongs to the last interval.

    Parameters
    ----------
    speed : array_like of shape (n_samples,)
        mm/s, at least 0; sampled in equal steps of time.
    notable : float
        Least share, 0 < notable < 1.
    bin_mm_s : float
        Width of the bins.

    Raises
    ------
    ValueError
        For a negative speed, NaN, infinity, no sample, or a share out of its range.
    """
    v = one_channel(speed, "speed")
    if np.any(v < 0) or not 0 < notable < 1:
        raise ValueError(f"smallest speed is {v.min()}, notable {notable}; the rule is >= 0, and 0 to 1")
    share = histogram(v, bin_mm_s=bin_mm_s)
    above = np.flatnonzero(share >= notable)
    return _of(int(above[-1]) + 1 if above.size else 1, bin_mm_s)


def histogram(speed: ArrayLike, *, bin_mm_s: float = BIN_MM_S) -> Samples:
    """Return the share of the speeds (mm/s) in each bin from 0 on."""
    v = one_channel(speed, "speed")
    which = np.floor(v / positive(bin_mm_s, "bin_mm_s")).astype(int)
    return np.asarray(np.bincount(which) / v.size)


def _of(n: int, width: float = BIN_MM_S) -> SpeedIntervals:
    return SpeedIntervals((*(i * width for i in range(n)), np.inf))
