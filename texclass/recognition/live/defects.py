"""Which samples of a stream are no measurements, and what becomes of them: short runs are bridged."""

import numpy as np

from texclass.loaders.stamps import MOST_LOST
from texclass.recognition.model import Model
from texclass.recording import Samples

FAR = 100.0
"""A step of so many times the largest acceleration of training is a loose wire, not a surface."""
STRUCK_M_S2 = 1000.0
"""A step that a tap on a hard surface may make, whatever was trained."""
FAR_UNKNOWN = 1e6
"""The step where a model does not say what it was trained on (files before format 2.1)."""
LARGEST = 1e15
"""No sensor measures more, in any unit."""
LEVEL_S = 0.1
"""Far samples that go on for longer are a new level: the stream goes on there, after a break."""


class Defects:
    """Samples that are no measurements: not finite, or a step from the last good one that no surface makes.

    Up to `MOST_LOST` in a row are replaced by a straight line, as messages that are missing; more are lost.
    Rows come out the same however they come in blocks: bad ones wait for the next good one.

    Parameters
    ----------
    model : Model
        Whose recordings tell how large a step may be.
    n_axes : int
        Columns of acceleration, the first ones.
    fs : float
        Sampling rate in Hz.
    scale : float
        From a number of the stream to the unit of the model's recordings.
    """

    def __init__(self, model: Model, n_axes: int, fs: float, scale: float) -> None:
        loudest = model.manifest.loudest
        far = FAR_UNKNOWN if loudest is None else FAR * loudest
        far = max(far, STRUCK_M_S2) if model.manifest.unit == "m/s^2" else far
        self.n_axes, self.far = n_axes, far / scale
        self._level = max(MOST_LOST + 2, round(LEVEL_S * fs))
        self._last: Samples | None = None
        self._waiting = self._far_for = 0

    def mended(self, rows: Samples) -> tuple[list[tuple[int, Samples]], int, int]:
        """Take in rows (n, n_columns) in the unit of the stream.

        Returns
        -------
        stretches : list of (int, ndarray)
            How many rows are lost before a stretch, and its rows, good or mended.
        n_broken, n_far : int
            How many of the rows are not finite (or no number a sensor sends), and how many are far.
        """
        broken = np.asarray(~(np.abs(rows) <= LARGEST).all(axis=1))  # nor is NaN
        before = rows[:1] if self._last is None else self._last[None]
        with np.errstate(invalid="ignore"):
            steps = np.abs(np.diff(rows[:, : self.n_axes], axis=0, prepend=before[:, : self.n_axes]))
        if not self._waiting and not broken.any() and (steps <= self.far).all():
            self._last = rows[-1].copy()
            return [(0, rows)], 0, 0
        stretches: list[tuple[int, list[Samples]]] = [(0, [])]
        n_far = 0
        for row, is_broken in zip(rows, broken.tolist(), strict=True):
            last = row if self._last is None else self._last
            is_far = not is_broken and bool((np.abs(row - last)[: self.n_axes] > self.far).any())
            self._far_for = self._far_for + 1 if is_far else 0
            if is_broken or 0 < self._far_for < self._level:
                n_far += is_far
                self._waiting += 1
                continue
            if self._last is None or self._waiting > MOST_LOST:
                stretches.append((self._waiting, []))
            else:
                shares = np.arange(1, self._waiting + 1)[:, None] / (self._waiting + 1)
                stretches[-1][1].extend(last + shares * (row - last))
            stretches[-1][1].append(row)
            self._last, self._waiting, self._far_for = row.copy(), 0, 0
        kept = [(lost, np.array(some)) for lost, some in stretches if some]
        return kept, int(np.count_nonzero(broken)), n_far
