"""How strongly the tool vibrates, bin by bin, as it happens."""

from typing import NamedTuple

import numpy as np
from scipy import signal

from texclass.phases import LEAST_SAMPLES
from texclass.recognition.online._kernels import filter_sections
from texclass.recognition.online.ring import Ring
from texclass.recording import Samples
from texclass.signals import butterworth

HAND_HZ = 60.0
"""Motion below belongs to hand, tremor and gravity, as in `texclass.phases`; 0.2 fs for slow sensors."""
BIN_S = 0.005


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
        self._sos = np.ascontiguousarray(butterworth("highpass", min(HAND_HZ, 0.2 * fs), fs))
        self._at_rest = signal.sosfilt_zi(self._sos)[:, :, None]
        self._state: Samples | None = None

    def push(self, rows: Samples) -> list[Bin]:
        """Filter finite samples (n, n_axes), n a multiple of `bin_size`, and return their bins."""
        if not len(rows):
            return []
        if self._state is None:  # at rest on the first sample, a constant (gravity) causes no transient
            self._state = self._at_rest * rows[0]
        filtered = np.array(rows, order="C")
        filter_sections(self._sos, filtered, self._state)
        start = self.vibration.stop
        self.vibration.push(filtered)
        starts = range(0, len(rows), self.bin_size)
        # Each segment is summed by itself: the order does not depend on how many there are.
        sums = np.add.reduceat(self.power(start, self.vibration.stop), starts).tolist()
        size = self.bin_size
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
