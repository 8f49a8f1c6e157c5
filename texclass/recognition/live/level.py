"""How strongly the tool vibrates, bin by bin, as it happens; memory of the last seconds of a stream."""

from typing import NamedTuple

import numpy as np

from texclass.phases import LEAST_SAMPLES
from texclass.recording import Samples
from texclass.signals import butterworth, causal

HAND_HZ = 60.0
"""Motion below belongs to hand, tremor and gravity, as in `texclass.phases`; 0.2 fs for slow sensors."""
BIN_S = 0.005


class Ring:
    """The last rows of a stream, any stretch of them in one piece.

    Rows are numbered from the first one ever pushed. Each is written twice, a capacity apart, so that the
    last `capacity` rows always stand side by side somewhere.

    Parameters
    ----------
    capacity : int
        Rows that are kept.
    n_columns : int
        Numbers a row.
    """

    def __init__(self, capacity: int, n_columns: int) -> None:
        self.capacity = capacity
        self._twice = np.zeros((2 * capacity, n_columns))
        self.start = self.stop = 0
        """The rows [start, stop) are at hand."""

    def push(self, rows: Samples) -> None:
        """Append rows of shape (n, n_columns), n at most the capacity; the oldest ones make place."""
        n, at = len(rows), self.stop % self.capacity
        first = min(n, self.capacity - at)
        for start in (at, at + self.capacity):
            self._twice[start : start + first] = rows[:first]
        if first < n:
            for start in (0, self.capacity):
                self._twice[start : start + n - first] = rows[first:]
        self.stop += n
        self.start = max(self.start, self.stop - self.capacity)

    def skip(self, n: int) -> None:
        """Go on `n` rows later: those between, and all before, are not at hand."""
        self.start = self.stop = self.stop + n

    def view(self, start: int, stop: int) -> Samples:
        """Return rows [start, stop), shape (stop - start, n_columns); valid until the next push.

        Raises
        ------
        ValueError
            If they are not at hand.
        """
        if not self.start <= start <= stop <= self.stop:
            raise ValueError(f"rows {start} to {stop}; the rule is from {self.start} to {self.stop}")
        at = start % self.capacity
        return self._twice[at : at + stop - start]

    @property
    def n_bytes(self) -> int:
        """Memory it takes."""
        return self._twice.nbytes


class Bin(NamedTuple):
    """Samples [start, stop) of the stream, and their mean square vibration."""

    start: int
    stop: int
    power: float


class Level:
    """Mean square of what a causal high-pass leaves, summed over axes, in bins of some milliseconds.

    The filter runs from sample to sample and bins are counted from the first sample after a break, so they
    do not depend on how samples come in blocks.

    Parameters
    ----------
    fs : float
        Sampling rate in Hz.
    n_axes : int
        Columns of what is pushed.
    keep_s : float
        Seconds of the vibration that are remembered.

    Attributes
    ----------
    bin_size : int
        Samples a bin.
    vibration : Ring
        What the high-pass leaves, shape (n, n_axes).
    """

    def __init__(self, fs: float, n_axes: int, keep_s: float) -> None:
        self.bin_size = max(LEAST_SAMPLES, round(BIN_S * fs))
        self.vibration = Ring(round(keep_s * fs) + 4 * self.bin_size, n_axes)
        self._sos = butterworth("highpass", min(HAND_HZ, 0.2 * fs), fs)
        self._state: Samples | None = None

    def push(self, rows: Samples) -> list[Bin]:
        """Filter finite samples (n, n_axes), n a multiple of `bin_size`, and return their bins."""
        if not len(rows):
            return []
        # Without a state the filter is at rest on the first sample: gravity causes no transient.
        filtered, self._state = causal(self._sos, rows, self._state)
        start, size = self.vibration.stop, self.bin_size
        self.vibration.push(filtered)
        starts = range(0, len(rows), size)
        # Each segment is summed by itself: the order does not depend on how many there are.
        sums = np.add.reduceat(self.power(start, self.vibration.stop), starts).tolist()
        return [Bin(start + k, start + k + size, s / size) for k, s in zip(starts, sums, strict=True)]

    def power(self, start: int, stop: int) -> Samples:
        """Return the square of the vibration, summed over axes, of samples [start, stop)."""
        near = self.vibration.view(start, stop)
        return np.asarray(np.einsum("ij,ij->i", near, near))

    def correlation(self, start: int, stop: int) -> float:
        """Return how far samples [start, stop) resemble those before them: about 0 for white noise."""
        v = self.vibration.view(start, stop)
        power = float((v**2).sum())
        return float((v[1:] * v[:-1]).sum()) / power if power > 0 else 0.0

    def skip(self, n: int) -> None:
        """Go on `n` samples later, at rest on what comes then."""
        self.vibration.skip(n)
        self._state = None
