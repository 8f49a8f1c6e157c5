"""Resampling of a stream: band-limited, the same numbers for any division into blocks."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from scipy.signal import firwin

from texclass.recognition.blocks import Block, BlockSource
from texclass.recording import Samples

HALF_WIDTH = 10
"""Samples of the slower rate on either side that count for one sample; as in `scipy.signal.resample_poly`."""


class Resampler:
    """y[m] = sum over k of h[mQ - kP] x[k] for a rate P / Q times the old one, as soon as all x[k] are there.

    Parameters
    ----------
    fs, to : float
        Rates in Hz.

    Raises
    ------
    ValueError
        If a rate is not above 0, or they differ by more than a factor of 1000.
    """

    def __init__(self, fs: float, to: float) -> None:
        if not (fs > 0 and to > 0 and 1e-3 <= to / fs <= 1e3):
            raise ValueError(f"from {fs} Hz to {to} Hz; the rule is above 0 and at most a factor 1000 apart")
        ratio = Fraction(to / fs).limit_denominator(1000)
        self._p, self._q = ratio.numerator, ratio.denominator
        slower = max(self._p, self._q)
        self._half = HALF_WIDTH * slower
        self._h = (
            self._p * firwin(2 * self._half + 1, 1 / slower, window=("kaiser", 5.0)) if slower > 1 else None
        )
        self._x: Samples | None = None
        self._first = self._next = 0

    @property
    def n_out(self) -> int:
        """Samples returned so far."""
        return self._next

    def push(self, x: Samples) -> Samples:
        """Take samples of shape (n, n_channels) and return those that are complete, of the same form."""
        if self._h is None:
            self._next += len(x)
            return x
        self._x = x if self._x is None else np.concatenate((self._x, x))
        stop = -((self._half - (self._first + len(self._x)) * self._p) // self._q)
        m = np.arange(self._next, stop, dtype=np.int64)
        self._next += len(m)
        y = self._outputs(m) if len(m) else np.empty((0, x.shape[1]))
        oldest = (self._next * self._q - self._half) // self._p
        drop = min(max(oldest - self._first, 0), len(self._x))
        self._x, self._first = self._x[drop:], self._first + drop
        return y

    def _outputs(self, m: NDArray[np.int64]) -> Samples:
        assert self._x is not None
        assert self._h is not None
        k = (m * self._q + self._half)[:, None] // self._p - np.arange(2 * self._half // self._p + 1)
        tap = self._half + m[:, None] * self._q - k * self._p
        is_inside = (tap >= 0) & (tap <= 2 * self._half) & (k >= self._first)
        h = np.where(is_inside, self._h[np.clip(tap, 0, 2 * self._half)], 0.0)
        x = self._x[np.clip(k - self._first, 0, len(self._x) - 1)]
        return np.asarray(np.einsum("mk,mkc->mc", h, x))


class Resampled:
    """A source at another rate; starts anew after a loss.

    Parameters
    ----------
    source : BlockSource
        What to resample.
    rate : float
        Wanted, in Hz.
    """

    def __init__(self, source: BlockSource, rate: float) -> None:
        self.source, self.rate = source, rate

    def __iter__(self) -> Iterator[Block]:
        """Yield blocks at the wanted rate."""
        resampler, start_s = None, 0.0
        for block in self.source:
            flags = block.flags
            if resampler is None or block.lost:
                if resampler is None and block.fs != self.rate:
                    flags = (*flags, f"resampled (band-limited) from {block.fs:g} Hz to {self.rate:g} Hz")
                resampler, start_s = Resampler(block.fs, self.rate), block.t_s
            at = start_s + resampler.n_out / self.rate
            y = resampler.push(block.samples)
            lost = round(block.lost * self.rate / block.fs)
            if len(y) or flags or lost:
                yield Block(at, y, self.rate, block.unit, lost, flags)

    def close(self) -> None:
        """Close what is resampled."""
        self.source.close()
