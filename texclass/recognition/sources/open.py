"""Sources of blocks by name: standard input, a recording, a bag, a ROS 2 topic."""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from texclass.loaders import find_recording
from texclass.loaders.files import checked_unit
from texclass.recognition.model import Model
from texclass.recognition.sources.blocks import ACCELERATION_ONLY, Block, BlockSource, Needs
from texclass.recognition.sources.timing import resampled
from texclass.recording import Recording, RecordingError, Samples

ROS2 = "ros2:"
BLOCK_S = 0.025
"""Seconds of a block, by default."""
LONGEST_LINE = 1 << 16
MOST_CHANNELS = 1024
STDIN = "standard input"


def is_live(spec: str) -> bool:
    """Whether the samples of a source are as they come, not yet conditioned as a model's training files."""
    return spec == "-" or spec.startswith(ROS2)


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
    model: Model | None = None,
) -> BlockSource:
    """Return the source of a name.

    Parameters
    ----------
    spec : str
        "-" (standard input), "FILE" or "DATASET:RECORDING", "bag:FILE?topic=/name", "ros2:/topic".
    fs : float, optional
        Sampling rate in Hz; needed for standard input, measured on a topic, else checked against the file.
    unit : str, optional
        Of the acceleration; needed where neither the source nor the model states it.
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
    model : Model, optional
        Whose columns are wanted: with turn rate or friction beside the acceleration if it needs them. Files
        and bags are then read and conditioned as those it was trained on; what `is_live` is as it comes.

    Returns
    -------
    source : BlockSource

    Raises
    ------
    RecordingError
        If a fact is missing or contradicted, the file is bad, or the source has not what the model needs.
    """
    needs = ACCELERATION_ONLY if model is None else model.needs
    if spec == "-":
        unit = checked_unit(Path(STDIN), fs, unit or (None if model is None else model.manifest.input.unit))
        if fs is None:
            raise RecordingError(
                f"{STDIN}: fs is missing; the rule is a rate in Hz, never guessed: give --fs"
            )
        if raw_channels is not None:
            needs.n_axes(raw_channels)
        source = standard_input(file or sys.stdin.buffer, fs, unit, raw_channels, block_s)
    elif spec.startswith(ROS2):
        source = _topic(spec.removeprefix(ROS2), fs, unit, needs)
    else:
        find = find_recording if model is None else model.manifest.input.find
        source = played(find(spec, fs=fs, unit=unit), block_s=block_s, paced=paced, needs=needs)
    return source if rate is None else resampled(source, rate)


def played(
    recording: Recording,
    *,
    block_s: float = BLOCK_S,
    paced: bool = False,
    needs: Needs = ACCELERATION_ONLY,
) -> BlockSource:
    """Return a recording as if it were live.

    Parameters
    ----------
    recording : Recording
        Its acceleration is what is yielded, its flags come with the first block.
    block_s : float
        Seconds a block.
    paced : bool
        Wait until each block would have been recorded; else as fast as they are taken.
    needs : Needs
        Signals beside the acceleration that are yielded, too.

    Raises
    ------
    RecordingError
        If the recording lacks one of these.
    """
    return _played(recording, needs.columns_of(recording), _block_size(block_s, recording.fs), paced)


def standard_input(
    file: BinaryIO,
    fs: float,
    unit: str,
    n_channels: int | None = None,
    block_s: float = BLOCK_S,
) -> BlockSource:
    """Return samples that another program writes: text, or binary.

    Text has one sample a line, channels divided by commas or blanks; binary samples are little-endian
    float32, the channels of a sample side by side, and what is there is passed on.

    Parameters
    ----------
    file : BinaryIO
        Where they are read from; it is left to who opened it.
    fs : float
        Sampling rate in Hz.
    unit : str
        Of the numbers.
    n_channels : int, optional
        Of binary samples; text without.
    block_s : float
        Seconds a block, of binary samples at most.

    Raises
    ------
    ValueError
        If a block has no length, or there is no such number of channels.
    RecordingError
        While blocks are taken: if a sample is not what it should be; the message names line or sample.
    """
    n = _block_size(block_s, fs)
    if n_channels is None:
        return _text(file, fs, unit, n)
    if not 1 <= n_channels <= MOST_CHANNELS:
        raise ValueError(f"n_channels is {n_channels}; the rule is 1 to {MOST_CHANNELS}")
    return _binary(file, fs, unit, n_channels, n)


def _played(recording: Recording, signal: Samples, n: int, paced: bool) -> BlockSource:
    fs, start, flags = recording.fs, time.monotonic(), recording.flags
    for first in range(0, len(signal), n):
        samples = signal[first : first + n]
        if paced:
            time.sleep(max(0.0, start + (first + len(samples)) / fs - time.monotonic()))
        yield Block(first / fs, samples, fs, recording.unit, 0, flags)
        flags = ()


def _text(file: BinaryIO, fs: float, unit: str, n: int) -> BlockSource:
    rows: list[list[float]] = []
    done = 0
    for row in _lines(file):
        rows.append(row)
        if len(rows) == n:
            yield Block(done / fs, np.array(rows), fs, unit)
            done, rows = done + n, []
    if rows:
        yield Block(done / fs, np.array(rows), fs, unit)


def _lines(file: BinaryIO) -> Iterator[list[float]]:
    """Yield the numbers of every line that is not blank."""
    width, number = 0, 0
    while line := file.readline(LONGEST_LINE):
        number += 1
        if not line.strip():
            continue
        try:
            row = [float(word) for word in line.replace(b",", b" ").split()]
        except ValueError:
            row = [float("nan")]
        if not np.isfinite(row).all():
            shown = line[:40].decode("utf-8", "replace").strip()
            raise RecordingError(f"{STDIN}: line {number} is {shown!r}; the rule is finite numbers")
        width = width or len(row)
        if len(row) != width or width > MOST_CHANNELS:
            rule = min(width, MOST_CHANNELS)
            raise RecordingError(f"{STDIN}: line {number} holds {len(row)} numbers; the rule is {rule}")
        yield row


def _binary(file: BinaryIO, fs: float, unit: str, n_channels: int, n: int) -> BlockSource:
    read: Callable[[int], bytes] = getattr(file, "read1", file.read)
    size = 4 * n_channels
    done, left = 0, b""
    while piece := read(n * size - len(left)):
        left += piece
        whole = len(left) // size * size
        with np.errstate(invalid="ignore"):  # a signalling NaN warns; it is refused below
            samples = np.frombuffer(left[:whole], "<f4").astype(np.float64).reshape(-1, n_channels)
        if not (good := np.isfinite(samples).all(axis=1)).all():
            bad = int(np.argmin(good))
            raise RecordingError(
                f"{STDIN}: sample {done + bad} is {samples[bad]}; the rule is finite numbers"
            )
        left = left[whole:]
        if whole:
            yield Block(done / fs, samples, fs, unit)
        done += len(samples)
    if left:
        cut = f"{STDIN}: ends within a sample, {len(left)} bytes left out"
        yield Block(done / fs, np.empty((0, n_channels)), fs, unit, 0, (cut,))


def _topic(topic: str, fs: float | None, unit: str | None, needs: Needs) -> BlockSource:
    try:
        from texclass.recognition.sources.topic import topic_blocks
    except ImportError as error:
        raise RecordingError(
            f"{ROS2}{topic}: needs the extra `robot` ({error}): pip install texclass[robot]"
        ) from error
    return topic_blocks(topic, fs=fs, unit=unit, needs=needs)


def _block_size(block_s: float, fs: float) -> int:
    """Return the samples of a block of so many seconds at fs Hz, at least one."""
    if not block_s > 0:
        raise ValueError(f"block_s is {block_s}; the rule is above 0")
    return max(1, round(block_s * fs))
