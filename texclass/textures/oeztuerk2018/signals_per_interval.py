"""How many signals a surface needs, by its friction, and each of them made endless: what the thesis plays."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recording import Samples
from texclass.signals import one_channel, positive
from texclass.textures.oeztuerk2018.speed_textures import SpeedTexture

BIN_MM_S = 40.0
"""`oeztuerk2018`, figure 4.2: bins of 4 cm/s."""
FRICTION = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
N_INTERVALS = (7, 5, 4, 3, 2, 2)
"""`oeztuerk2018`, section 4.2: intervals at each of these coefficients."""
EXTREME = 1.2
"""From here on 1 interval. The thesis calls its seventh coefficient extreme and does not print it."""
NOTABLE = 0.05
"""Share of the samples that makes a bin notable; the thesis judges by eye."""
DURATION_S = 10.0
N_COPIES = 5
"""Mirrored copies in an endless signal."""


@dataclass(frozen=True)
class SpeedIntervals:
    """Speeds for each of which one signal is displayed.

    Attributes
    ----------
    bounds_mm_s : tuple of float
        Rising, from 0 to infinity: n_intervals + 1 of them.
    """

    bounds_mm_s: tuple[float, ...]

    @classmethod
    def equal(cls, n: int, width_mm_s: float = BIN_MM_S) -> "SpeedIntervals":
        """Return n intervals of one width, the last one open."""
        return cls((*(i * width_mm_s for i in range(n)), np.inf))

    @property
    def n_intervals(self) -> int:
        """How many signals are needed."""
        return len(self.bounds_mm_s) - 1

    @property
    def centres_mm_s(self) -> tuple[float, ...]:
        """A speed for each interval: its middle, for the last that of its first 40 mm/s."""
        bounds = [*self.bounds_mm_s[:-1], self.bounds_mm_s[-2] + BIN_MM_S]
        return tuple((a + b) / 2 for a, b in pairwise(bounds))

    def index(self, speed: ArrayLike) -> NDArray[np.intp]:
        """Return which interval each speed (mm/s) belongs to; a bound belongs to the faster one."""
        return np.searchsorted(self.bounds_mm_s[1:-1], np.asarray(speed, dtype=np.float64), side="right")

    def __str__(self) -> str:
        edges = [f"{b / 10:g}" for b in self.bounds_mm_s[:-1]]
        return ", ".join([*(f"{a}-{b}" for a, b in pairwise(edges)), f"> {edges[-1]}"]) + " cm/s"


def speed_intervals(friction: float) -> SpeedIntervals:
    """Return the intervals for a friction coefficient: 40 mm/s each, the last one open.

    At the coefficients of the thesis their number is its own; between two of them the larger one, so that
    never a signal is lacking; 1 from `EXTREME` on.

    Parameters
    ----------
    friction : float
        Kinetic friction coefficient.

    Raises
    ------
    ValueError
        If the coefficient is negative, NaN or infinite.

    References
    ----------
    `oeztuerk2018`, chapter 4 and Table 6.1.

    Examples
    --------
    >>> print(speed_intervals(0.4))
    0-4, 4-8, 8-12, > 12 cm/s
    """
    if not (np.isfinite(friction) and friction >= 0):
        raise ValueError(f"friction is {friction}; the rule is finite and at least 0")
    known = int(np.searchsorted(FRICTION, friction + 1e-9, side="right")) - 1
    return SpeedIntervals.equal(1 if friction >= EXTREME else N_INTERVALS[known])


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
    share = np.bincount(np.floor(v / positive(bin_mm_s, "bin_mm_s")).astype(int)) / v.size
    last = np.flatnonzero(share >= notable)[-1:]
    return SpeedIntervals.equal(int(last.sum()) + 1, bin_mm_s)


def mirrored(x: ArrayLike) -> Samples:
    """Return the signal with its reflection behind it, shape (2 n_samples,): x_0 ... x_n-1 x_n-1 ... x_0.

    Wherever copies of it meet, one sample stands beside its equal: no join has a jump.
    """
    samples = one_channel(x, "signal")
    return np.concatenate([samples, samples[::-1]])


def seamless(
    x: ArrayLike, fs: float, *, duration_s: float = DURATION_S, peak: float | None = None
) -> Samples:
    """Return a signal of the duration: the mirrored one, as often as needed, scaled.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Any unit. Of 1 s, 5 mirrored copies make 10 s, as printed.
    fs : float
        Sampling rate, Hz.
    duration_s : float
        Of the result; the last copy is cut there.
    peak : float, optional
        Largest magnitude of the result: that of the reference it is compared with, as in the thesis.

    Returns
    -------
    ndarray of shape (round(duration_s * fs),)

    References
    ----------
    `oeztuerk2018`, end of section 3.2.

    Examples
    --------
    >>> seamless([1.0, 2.0, 4.0], 3.0, duration_s=3.0, peak=2.0)
    array([0.5, 1. , 2. , 2. , 1. , 0.5, 0.5, 1. , 2. ])
    """
    n = round(positive(duration_s, "duration_s") * positive(fs, "fs"))
    endless = np.resize(mirrored(x), n)
    largest = np.max(np.abs(endless), initial=0.0)
    return endless if peak is None or largest == 0 else endless * (peak / largest)


def displayed_signals(
    texture: SpeedTexture,
    friction: float,
    *,
    duration_s: float = DURATION_S,
    peaks: tuple[float, ...] | None = None,
    seed: int = 0,
) -> list[Samples]:
    """Return a seamless signal for each of the `speed_intervals` of a friction, from slow to fast.

    Parameters
    ----------
    texture : LpcTexture or FrequencyTexture
        Of the surface; each signal is that at the centre of its interval.
    friction : float
        Kinetic friction coefficient of the surface.
    duration_s : float
        Of each signal: a tenth of it is synthesized, mirrored and repeated 5 times, as printed.
    peaks : tuple of float, optional
        Largest magnitude of the reference of each interval, to scale to; by default the signals stay as the
        texture makes them.
    seed : int
        Of the noise.

    Returns
    -------
    list of ndarray of shape (n_samples,)
        In the unit of the recordings, at the rate of the texture.

    Raises
    ------
    ValueError
        As `speed_intervals`, or if there is not one peak for each interval.

    References
    ----------
    `oeztuerk2018`, sections 3.2 and 6.1, Table 6.1.
    """
    speeds = speed_intervals(friction).centres_mm_s
    if peaks is not None and len(peaks) != len(speeds):
        raise ValueError(f"there are {len(peaks)} peaks; the rule is {len(speeds)}, one an interval")
    n = max(1, round(duration_s * texture.fs / (2 * N_COPIES)))
    return [
        seamless(texture.signal(v, n, seed=seed + i), texture.fs, duration_s=duration_s, peak=peak)
        for i, (v, peak) in enumerate(zip(speeds, peaks or [None] * len(speeds), strict=True))
    ]
