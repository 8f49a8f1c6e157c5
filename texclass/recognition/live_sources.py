"""Sources of blocks by name: standard input, a recording, a bag, a ROS 2 topic."""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from texclass.loaders import find_recording
from texclass.loaders.single import checked_unit
from texclass.recognition.blocks import Block, BlockSource
from texclass.recognition.resampling import Resampled
from texclass.recording import Recording, RecordingError, Samples

ROS2 = "ros2:"
BLOCK_S = 0.025
LONGEST_LINE = 1 << 16
MOST_CHANNELS = 1024


class RecordingSource:
    """A recording as if it were live.

    Parameters
    ----------
    recording : Recording
        Its acceleration is what is yielded, its flags come with the first block.
    block_s : float
        Seconds a block.
    paced : bool
        Wait until each block would have been recorded; else as fast as they are taken.
    """

    def __init__(self, recording: Recording, *, block_s: float = BLOCK_S, paced: bool = False) -> None:
        self.recording, self.paced = recording, paced
        self._n = _block_size(block_s, recording.fs)

    def __iter__(self) -> Iterator[Block]:
        """Yield the blocks of the recording."""
        recording = self.recording
        signal = recording.acceleration.reshape(recording.n_samples, -1)
        start = time.monotonic()
        for first in range(0, len(signal), self._n):
            samples = signal[first : first + self._n]
            if self.paced:
                time.sleep(max(0.0, start + (first + len(samples)) / recording.fs - time.monotonic()))
            flags = recording.flags if first == 0 else ()
            yield Block(first / recording.fs, samples, recording.fs, recording.unit, 0, flags)

    def close(self) -> None:
        """Nothing is open."""


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
        self._n = _block_size(block_s, fs)

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
        self._n_channels, self._n = n_channels, _block_size(block_s, fs)

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


def open_source(
    spec: str,
    *,
    fs: float | None = None,
    unit: str | None = None,
    rate: float | None = None,
    block_s: float = BLOCK_S,
    paced: bool = False,
    raw_channels: int | None = None,
    file: BinaryIO | None = None,
) -> BlockSource:
    """Return the source of a name.

    Parameters
    ----------
    spec : str
        "-" (standard input), "FILE" or "DATASET:RECORDING", "bag:FILE?topic=/name", "ros2:/topic".
    fs : float, optional
        Sampling rate in Hz; needed for standard input, measured on a topic, else checked against the file.
    unit : str, optional
        Of the acceleration; needed where the source does not state it.
    rate : float, optional
        Rate in Hz to resample to, band-limited.
    block_s : float
        Seconds a block, of files and standard input.
    paced : bool
        Play a file at its own speed.
    raw_channels : int, optional
        Standard input is float32 of so many channels, not text.
    file : BinaryIO, optional
        In place of standard input.

    Returns
    -------
    source : BlockSource

    Raises
    ------
    RecordingError
        If a fact is missing or contradicted, or the file is bad.
    """
    source = _opened(spec, fs, unit, block_s, paced, raw_channels, file)
    return source if rate is None else Resampled(source, rate)


def _opened(
    spec: str,
    fs: float | None,
    unit: str | None,
    block_s: float,
    paced: bool,
    raw_channels: int | None,
    file: BinaryIO | None,
) -> BlockSource:
    if spec == "-":
        stated = checked_unit(Path("standard input"), fs, unit)
        if fs is None:
            raise RecordingError(
                "standard input: fs is missing; the rule is a rate in Hz, never guessed: give --fs"
            )
        stream = file or sys.stdin.buffer
        if raw_channels is None:
            return LineSource(stream, fs=fs, unit=stated, block_s=block_s)
        return RawSource(stream, fs=fs, unit=stated, n_channels=raw_channels, block_s=block_s)
    if spec.startswith(ROS2):
        return _topic(spec.removeprefix(ROS2), fs, unit)
    recording = find_recording(spec, fs=fs, unit=unit)
    return RecordingSource(recording, block_s=block_s, paced=paced)


def _topic(topic: str, fs: float | None, unit: str | None) -> BlockSource:
    try:
        from texclass.recognition.robot.live import TopicSource
    except ImportError as error:
        raise RecordingError(
            f"{ROS2}{topic}: needs the extra `robot` ({error}): pip install texclass[robot]"
        ) from error
    return TopicSource(topic, fs=fs, unit=unit)


def _block_size(block_s: float, fs: float) -> int:
    if not block_s > 0:
        raise ValueError(f"block_s is {block_s}; the rule is above 0")
    return max(1, round(block_s * fs))
