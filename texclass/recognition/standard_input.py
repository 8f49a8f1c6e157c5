"""Samples that another program writes: text, or binary."""

from collections.abc import Callable, Iterator
from typing import BinaryIO

import numpy as np

from texclass.recognition.blocks import BLOCK_S, Block, block_size
from texclass.recording import RecordingError, Samples

LONGEST_LINE = 1 << 16
MOST_CHANNELS = 1024


class LineSource:
    """Text, one sample a line, channels divided by commas or blanks.

    Parameters
    ----------
    file : BinaryIO
        Where it is read from.
    fs : float
        Sampling rate in Hz.
    unit : str
        Of the numbers.
    block_s : float
        Seconds a block.
    name : str
        For messages.
    """

    def __init__(
        self, file: BinaryIO, *, fs: float, unit: str, block_s: float = BLOCK_S, name: str = "standard input"
    ) -> None:
        self._file, self._fs, self._unit, self._name = file, fs, unit, name
        self._n = block_size(block_s, fs)

    def __iter__(self) -> Iterator[Block]:
        """Yield blocks until the input ends.

        Raises
        ------
        RecordingError
            If a line is not what it should be; the message names the line.
        """
        rows: list[list[float]] = []
        done = 0
        for row in self._rows():
            rows.append(row)
            if len(rows) == self._n:
                yield Block(done / self._fs, np.array(rows), self._fs, self._unit)
                done, rows = done + len(rows), []
        if rows:
            yield Block(done / self._fs, np.array(rows), self._fs, self._unit)

    def close(self) -> None:
        """Leave the input to who opened it."""

    def _rows(self) -> Iterator[list[float]]:
        width, number = None, 0
        while line := self._file.readline(LONGEST_LINE):
            number += 1
            if not line.strip():
                continue
            row = self._numbers(line, number)
            width = width or len(row)
            if len(row) != width or width > MOST_CHANNELS:
                rule = min(width, MOST_CHANNELS)
                raise RecordingError(
                    f"{self._name}: line {number} holds {len(row)} numbers; the rule is {rule}"
                )
            yield row

    def _numbers(self, line: bytes, number: int) -> list[float]:
        try:
            row = [float(word) for word in line.replace(b",", b" ").split()]
        except ValueError:
            row = [float("nan")]
        if not np.isfinite(row).all():
            shown = line[:40].decode("utf-8", "replace").strip()
            raise RecordingError(f"{self._name}: line {number} is {shown!r}; the rule is finite numbers")
        return row


class RawSource:
    """Binary samples: little-endian float32, the channels of a sample side by side.

    Parameters
    ----------
    file : BinaryIO
        Where it is read from.
    fs : float
        Sampling rate in Hz.
    unit : str
        Of the numbers.
    n_channels : int
        Channels.
    block_s : float
        Seconds a block, at most: what is there is passed on.
    name : str
        For messages.
    """

    def __init__(
        self,
        file: BinaryIO,
        *,
        fs: float,
        unit: str,
        n_channels: int = 1,
        block_s: float = BLOCK_S,
        name: str = "standard input",
    ) -> None:
        if not 1 <= n_channels <= MOST_CHANNELS:
            raise ValueError(f"n_channels is {n_channels}; the rule is 1 to {MOST_CHANNELS}")
        self._file, self._fs, self._unit, self._name = file, fs, unit, name
        self._n_channels, self._n = n_channels, block_size(block_s, fs)

    def __iter__(self) -> Iterator[Block]:
        """Yield blocks until the input ends.

        Raises
        ------
        RecordingError
            If a sample is not finite.
        """
        read: Callable[[int], bytes] = getattr(self._file, "read1", self._file.read)
        size = 4 * self._n_channels
        done, left = 0, b""
        while piece := read(self._n * size - len(left)):
            left += piece
            n = len(left) // size
            samples = self._samples(left[: n * size], done)
            left = left[n * size :]
            if n:
                yield Block(done / self._fs, samples, self._fs, self._unit)
            done += n
        if left:
            cut = f"{self._name}: ends within a sample, {len(left)} bytes left out"
            yield Block(done / self._fs, np.empty((0, self._n_channels)), self._fs, self._unit, 0, (cut,))

    def close(self) -> None:
        """Leave the input to who opened it."""

    def _samples(self, data: bytes, done: int) -> Samples:
        with np.errstate(invalid="ignore"):  # a signalling NaN warns; it is refused below
            samples = np.frombuffer(data, "<f4").astype(np.float64).reshape(-1, self._n_channels)
        if not (good := np.isfinite(samples).all(axis=1)).all():
            at = done + int(np.argmin(good))
            raise RecordingError(
                f"{self._name}: sample {at} is {samples[at - done]}; the rule is finite numbers"
            )
        return samples
