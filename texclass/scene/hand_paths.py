"""What a hand does over a scene: position, force and the surface under it, sample by sample."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from texclass.recording import Samples

COLUMNS = ("time", "x", "y", "force", "surface")
SWEEP_S = 2.0
"""What the default sweep spends on each surface."""
_QUANTILES = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class HandPath:
    """A path at any times.

    Attributes
    ----------
    time_s : ndarray of shape (n,)
        Rising.
    position_mm : ndarray of shape (n, 2)
    force_n : ndarray of shape (n,)
    surface : tuple of (str or None), n of them
        Under the finger; None: none.
    """

    time_s: Samples
    position_mm: Samples
    force_n: Samples
    surface: tuple[str | None, ...]

    @property
    def speed_mm_s(self) -> Samples:
        """Magnitude of the velocity, shape (n,)."""
        with np.errstate(all="ignore"):  # of places and times that no hand reaches
            return np.asarray(np.hypot(*np.gradient(self.position_mm, self.time_s, axis=0).T))

    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return what speeds (mm/s) and forces (N) in contact lie between: their 5th and 95th percentiles."""
        speed = self.speed_mm_s
        touching = (self.force_n > 0) & (speed > 0)
        if not np.isfinite(speed).all():
            raise ValueError("the path is faster than numbers; the rule for its ranges is finite speeds")
        if not touching.any():
            raise ValueError("the path never moves under force; the rule for its ranges is that it does")
        (slow, fast), (light, hard) = (np.quantile(x[touching], _QUANTILES) for x in (speed, self.force_n))
        return (float(slow), float(fast)), (float(light), float(hard))

    def at_rate(self, fs: float) -> tuple[Samples, Samples, list[str | None]]:
        """Return velocity (n, 2) in mm/s, force (n,) in N and surface of each sample, at a rate in Hz."""
        t = np.arange(max(1, int((self.time_s[-1] - self.time_s[0]) * fs))) / fs + self.time_s[0]
        velocity = np.gradient(self.position_mm, self.time_s, axis=0)
        moved = np.column_stack([np.interp(t, self.time_s, one) for one in velocity.T])
        before = np.searchsorted(self.time_s, t, side="right") - 1
        return moved, np.interp(t, self.time_s, self.force_n), [self.surface[i] for i in before]


def read_path(file: str | Path) -> HandPath:
    """Return the path of a CSV file with the columns time (s), x, y (mm), force (N) and surface.

    An empty surface is none.

    Raises
    ------
    ValueError
        If it is no such file, a number is NaN or infinite, or the time does not rise; the message says where.
    OSError
        If it cannot be read.
    """
    try:
        table = pd.read_csv(file, dtype={"surface": "string"})
        rest = [name for name in COLUMNS if name not in table.columns]
        if rest or len(table.columns) != len(COLUMNS):
            raise ValueError(
                f"columns are {', '.join(map(str, table.columns))}; the rule is {', '.join(COLUMNS)}"
            )
        t, x, y, force = (table[name].to_numpy(dtype=np.float64) for name in COLUMNS[:4])
    except (ValueError, TypeError, OverflowError) as error:  # pandas has its own kinds of ValueError
        raise ValueError(f"{file}: {error}") from error
    numbers = np.column_stack([t, x, y, force])
    if len(t) < 2 or not np.isfinite(numbers).all() or np.any(np.diff(t) <= 0):
        row = int(np.argmin(np.isfinite(numbers).all(axis=1))) if len(t) else 0
        raise ValueError(
            f"{file}: row {row + 2}; the rule is finite numbers, a time that rises, 2 rows or more"
        )
    surface = tuple(None if pd.isna(name) else str(name) for name in table["surface"])
    return HandPath(t, np.column_stack([x, y]), force, surface)


def sweep(
    surfaces: Sequence[str],
    speeds_mm_s: tuple[float, float],
    forces_n: tuple[float, float],
    *,
    seconds: float = SWEEP_S,
    fs: float = 1000.0,
) -> HandPath:
    """Return the default path: over each surface in turn, from slow to fast, harder and softer meanwhile."""
    n = max(4, round(seconds * fs))
    rising = np.linspace(0, 1, n, endpoint=False)
    speed = speeds_mm_s[0] + (speeds_mm_s[1] - speeds_mm_s[0]) * rising
    force = forces_n[0] + (forces_n[1] - forces_n[0]) * np.sin(np.pi * rising) ** 2
    x = np.cumsum(np.tile(speed, len(surfaces))) / fs
    named = tuple(name for name in surfaces for _ in range(n))
    return HandPath(
        np.arange(x.size) / fs,
        np.column_stack([x, np.zeros(x.size)]),
        np.tile(force, len(surfaces)),
        named,
    )
