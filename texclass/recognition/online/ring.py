"""The last seconds of a stream, in memory that does not grow."""

import numpy as np

from texclass.recording import Samples


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
