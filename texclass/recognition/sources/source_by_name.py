"""Sources of blocks by name: standard input, a recording, a bag, a ROS 2 topic."""

import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import chain
from typing import Any, BinaryIO

import numpy as np

from texclass import shipped
from texclass.features.phase_view import TURN
from texclass.loaders import find_recording
from texclass.loaders.plausibility import resolve_unit
from texclass.loaders.readers import ReaderSettings, as_column_names, reader_error
from texclass.recognition.model import Model
from texclass.recognition.sources.blocks import Block, BlockSource, resampled
from texclass.recognition.sources.training_input import ACCELERATION_ONLY
from texclass.recording import Recording, RecordingError, Samples

ROS2 = "ros2:"
BLOCK_S = 0.025
"""Seconds of a block, by default."""
MOST_CHANNELS = 1024
OF_FILES = ("column", "delimiter", "time_column", "time_unit", "skip_rows", "comment", "drop_incomplete")
STDIN = "standard input"


def is_live(source: str | Recording) -> bool:
    """Whether the samples of a source are as they come, not yet conditioned as a model's training files."""
    return isinstance(source, str) and (source == "-" or source.startswith(ROS2))


def open_source(
    source: str | Recording,
    *,
    fs: float | None = None,
    unit: str | None = None,
    rate: float | None = None,
    block_s: float = BLOCK_S,
    paced: bool = False,
    raw_channels: int | None = None,
    file: BinaryIO | None = None,
    model: Model | None = None,
    **reading: Any,
) -> BlockSource:
    """Return a source of blocks by its name.

    Parameters
    ----------
    source : str or Recording
        "-" (standard input), "FILE" or "DATASET:RECORDING", "bag:FILE?topic=/name", "ros2:/topic"; or a
        recording, as if it were live.
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
        Standard input is little-endian float32, the channels of a sample side by side. Else it is text, one
        sample a line, channels divided by commas, blanks or semicolons.
    file : BinaryIO, optional
        In place of standard input; it is left to who opened it.
    model : Model, optional
        Whose columns are wanted: with turn rate or friction beside the acceleration if it needs them. Files
        and bags are then read and conditioned as those it was trained on; what `is_live` is as it comes.
    **reading : optional
        Of files, what else `load_recording` takes: column, delimiter, time_column, time_unit, skip_rows,
        comment, drop_incomplete; of standard input, column (by number) and delimiter. Of a ROS 2 topic, what
        else `topic_blocks` takes: domain, reliability, depth, wait_s, end_s.

    Returns
    -------
    blocks : BlockSource

    Raises
    ------
    RecordingError
        If a fact is missing or contradicted, the file is bad, or the source has not what the model needs; on
        the way, if the first lines of a text hold no numbers.
    ValueError
        If a block has no length, there is no such number of channels, or options come with another source
        than theirs.
    """
    reading = {name: value for name, value in reading.items() if value is not None}
    _check_options(source, reading, raw_channels)
    needs = ACCELERATION_ONLY if model is None else model.needs
    if not block_s > 0:
        raise ValueError(f"block_s is {block_s}. Expected a positive number")
    if source == "-":
        blocks = _heard(file or sys.stdin.buffer, fs, unit, block_s, raw_channels, model, **reading)
    elif isinstance(source, str) and source.startswith(ROS2):
        try:
            topic_blocks = shipped.module_of("sources", "ros2").topic_blocks
        except ImportError as error:
            raise RecordingError(
                f"{source}: topics require the extra `robot` ({error}): pip install 'texclass[robot]'"
            ) from error
        blocks = topic_blocks(source.removeprefix(ROS2), fs=fs, unit=unit, needs=needs, **reading)
    else:
        find = find_recording if model is None else model.manifest.input.find
        recording = source if isinstance(source, Recording) else find(source, fs=fs, unit=unit, **reading)
        n = max(1, round(block_s * recording.fs))
        blocks = _played(recording, needs.columns_of(recording), n, paced)
    return blocks if rate is None else resampled(blocks, rate)


def _check_options(source: str | Recording, reading: Mapping[str, Any], raw_channels: int | None) -> None:
    """Refuse options that a source of this kind does not take."""
    is_topic = isinstance(source, str) and source.startswith(ROS2)
    if wrong := [name for name in reading if (name in OF_FILES) == is_topic]:
        rule = "a file" if is_topic else "a source ros2:/TOPIC"
        raise ValueError(f"{', '.join(wrong)} given with {source}. Expected {rule}")
    of_files = not {*OF_FILES}.difference(("column", "delimiter")).isdisjoint(reading)
    if source == "-" and (of_files or (raw_channels is not None and "delimiter" in reading)):
        rule = "a rate (--fs) in place of a time column, and --column and --delimiter (of text) alone"
        raise ValueError(f"{', '.join(reading)} given with {STDIN}. Expected {rule}")
    if raw_channels is not None and source != "-":
        raise ValueError(f"{raw_channels} channels given with {source}. Expected standard input, -")


def _heard(
    file: BinaryIO,
    fs: float | None,
    unit: str | None,
    block_s: float,
    raw_channels: int | None,
    model: Model | None,
    column: Any = None,
    delimiter: str | None = None,
) -> BlockSource:
    """Return what standard input says, as text or as numbers of so many channels, in the units of a model."""
    ReaderSettings(fs=fs, unit=unit, delimiter=delimiter).check(STDIN)
    unit = resolve_unit(None, unit or (None if model is None else model.manifest.input.unit), STDIN)
    if fs is None:
        raise RecordingError(f"{STDIN}: fs is missing. Expected a rate in Hz, never guessed: give --fs")
    n = max(1, round(block_s * fs))
    if raw_channels is None:
        blocks = _text(file, fs, unit, n, delimiter)
    else:
        if not 1 <= raw_channels <= MOST_CHANNELS:
            raise ValueError(f"n_channels is {raw_channels}. Expected 1 to {MOST_CHANNELS}")
        if model is not None:
            model.needs.n_axes(len(as_column_names(column)) or raw_channels)
        blocks = _binary(file, fs, unit, raw_channels, n)
    if column is not None:
        blocks = _of_columns(blocks, as_column_names(column))
    if model is not None and (in_rad := model.manifest.input.turn_rate_scale) != 1.0:
        factors = np.array([in_rad if name in TURN else 1.0 for name in model.needs.names])
        blocks = (replace(block, samples=block.samples * factors) for block in blocks)
    return blocks


def _played(recording: Recording, signal: Samples, n: int, paced: bool) -> BlockSource:
    fs, start, flags = recording.fs, time.monotonic(), recording.flags
    for first in range(0, len(signal), n):
        samples = signal[first : first + n]
        if paced:
            time.sleep(max(0.0, start + (first + len(samples)) / fs - time.monotonic()))
        yield Block(first / fs, samples, fs, recording.unit, 0, flags)
        flags = ()


def _of_columns(blocks: BlockSource, columns: Sequence[str]) -> BlockSource:
    """Yield blocks of some of the columns, by number from 1: those of a stream have no names."""
    with closing(blocks):
        for block in blocks:
            n = block.samples.shape[1]
            if wrong := [name for name in columns if not (name.isdecimal() and 1 <= int(name) <= n)]:
                raise reader_error(STDIN, f"column {wrong[0]!r} is not there", f"a number from 1 to {n}")
            yield replace(block, samples=block.samples[:, [int(name) - 1 for name in columns]])


def _text(file: BinaryIO, fs: float, unit: str, n: int, delimiter: str | None) -> BlockSource:
    """Yield the numbers of lines that are not blank, n lines a block; NaN, a lost sample, of a garbled one.

    A line holds as many numbers as most of the first ones do: these may be cut, or name columns.
    """
    lines, first = _lines(file, delimiter), list[tuple[int, list[float], str]]()
    while sum(bool(row) for _, row, _ in first) < 3 and len(first) < 100:
        if (line := next(lines, None)) is None:
            break
        first.append(line)
    if not first:
        return
    widths = Counter(len(row) for _, row, _ in first if row).most_common(1)
    width = widths[0][0] if widths else 0
    if not 1 <= width <= MOST_CHANNELS:
        number, _, shown = first[0]
        raise RecordingError(
            f"{STDIN}: line {number} is {shown!r}, of {width} numbers, like those after it. Expected a "
            f"sample a line, 1 to {MOST_CHANNELS} numbers (float32 takes --channels)"
        )
    said, rows, done = list[str](), list[list[float]](), 0
    for number, row, shown in chain(first, lines):
        if not (is_whole := len(row) == width):
            said.append(f"garbled: line {number} is {shown!r}. Expected {width} numbers")
        if is_whole or rows or done:  # what comes before the first sample is none
            rows.append(row if is_whole else [math.nan] * width)
        if len(rows) == n:
            yield Block(done / fs, np.array(rows), fs, unit, 0, tuple(said))
            done, rows, said = done + n, [], []
    if rows or said:
        yield Block(done / fs, np.array(rows).reshape(-1, width), fs, unit, 0, tuple(said))


def _lines(file: BinaryIO, delimiter: str | None) -> Iterator[tuple[int, list[float], str]]:
    """Yield number, numbers (none if it is garbled) and beginning of every line that is not blank.

    Between other marks than commas, a comma is a decimal point.
    """
    number, given = 0, (delimiter or "").encode()
    while line := file.readline(1 << 16):
        number += 1
        if line.strip():
            mark = given or (b";" if b";" in line else b",")
            words = line.replace(b",", b" ").split() if mark == b"," else line.replace(b",", b".").split(mark)
            try:
                row = [float(word) for word in words]
            except ValueError:
                row = []
            yield number, row, line[:40].decode("utf-8", "replace").strip()


def _binary(file: BinaryIO, fs: float, unit: str, n_channels: int, n: int) -> BlockSource:
    read: Callable[[int], bytes] = getattr(file, "read1", file.read)
    size = 4 * n_channels
    done, left = 0, b""
    while piece := read(n * size - len(left)):
        left += piece
        whole = len(left) // size * size
        with np.errstate(invalid="ignore"):  # a signalling NaN warns
            samples = np.frombuffer(left[:whole], "<f4").astype(np.float64).reshape(-1, n_channels)
        left = left[whole:]
        if whole:
            yield Block(done / fs, samples, fs, unit)
        done += len(samples)
    if left:
        cut = f"{STDIN}: ends within a sample, {len(left)} bytes left out"
        yield Block(done / fs, np.empty((0, n_channels)), fs, unit, 0, (cut,))
