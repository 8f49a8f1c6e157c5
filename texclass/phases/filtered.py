"""A causally filtered signal that is never held as a whole: filtered in blocks, anew where one looks."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from texclass.filters import causal
from texclass.recording import Samples

BLOCK = 1 << 19
"""Rows filtered at a time, about (4 MB a channel): from its state on, a filter does the same as at once."""


@dataclass(frozen=True, eq=False)
class Filtered:
    """Channels averaged down and filtered forwards, so that nothing rings before an impact.

    Attributes
    ----------
    axes : ndarray of shape (n_samples, n_channels)
        What is filtered.
    steps : tuple of int
        Factors by which it is averaged down first, one after the other.
    sos : ndarray of shape (n_sections, 6)
        The filter.
    n_rest : int
        The filter is at rest on the mean of so many rows at the start.
    size : int
        Rows of a block.
    """

    axes: Samples
    steps: tuple[int, ...]
    sos: Samples
    n_rest: int
    size: int = BLOCK
    _states: list[Samples] = field(default_factory=list, repr=False)
    _newest: dict[int, Samples] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        n = len(self.axes)
        for step in self.steps:
            n = -(-n // step)
        return n

    def power(self, per: int) -> Samples:
        """Return the mean square of every `per` rows, summed over channels; `per` divides `size`."""
        mean, n = np.empty(-(-len(self) // per)), self.size // per
        for k, rows in enumerate(self._blocks()):
            mean[k * n : (k + 1) * n] = block_mean(np.einsum("ij,ij->i", rows, rows), per)
        return mean

    def between(self, first: int, stop: int) -> Samples:
        """Return the filtered rows [first, stop), as far as there are any."""
        start = max(0, first) // self.size
        found = [self._block(k) for k in range(start, -(-min(stop, len(self)) // self.size))]
        rows = found[0] if len(found) == 1 else np.concatenate([self._rows(0, 0), *found])
        return rows[max(0, first) - start * self.size : max(0, stop - start * self.size)]

    def correlation(self, lag: int) -> float:
        """Return the mean over rows of what a row and the one `lag` (0 or 1) later have in common."""
        total, before = 0.0, self._rows(0, 0)
        for block in self._blocks():
            rows = np.concatenate([before, block])
            total += float(np.einsum("ij,ij->i", rows[lag:], rows[: len(rows) - lag]).sum())
            before = block[len(block) - lag :]
        return total / max(1, len(self) - lag)

    def _blocks(self) -> Iterator[Samples]:
        return (self._block(k) for k in range(-(-len(self) // self.size)))

    def _block(self, k: int) -> Samples:
        """Return block k; the states at the starts of all blocks before it are found first."""
        while k not in self._newest:
            i = min(k, len(self._states))
            state = self._states[i - 1] if i else np.zeros((len(self.sos), 2, self.axes.shape[1]))
            rest = self._rows(0, self.n_rest).mean(axis=0)
            block, after = causal(self.sos, self._rows(i * self.size, (i + 1) * self.size) - rest, state)
            if i == len(self._states) and after is not None:
                self._states.append(after)
            self._newest.clear()
            self._newest[i] = block
        return self._newest[k]

    def _rows(self, first: int, stop: int) -> Samples:
        step = int(np.prod(self.steps))
        rows = self.axes[first * step : stop * step]
        for each in self.steps:
            rows = block_mean(rows, each)
        return rows


def block_mean(x: Samples, size: int) -> Samples:
    """Mean of blocks of `size` rows; an incomplete last block is averaged over what it holds."""
    if size == 1:
        return x
    whole = len(x) // size * size
    blocks = x[:whole].reshape(-1, size, *x.shape[1:]).mean(axis=1)
    rest = x[whole:]
    return np.concatenate([blocks, rest.mean(axis=0)[np.newaxis]]) if len(rest) else blocks
