"""Sources of blocks by name: standard input, a recording, a bag or a ROS 2 topic."""

import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import chain
from typing import Any, BinaryIO, Literal

import numpy as np

from texclass import shipped
from texclass.features.phase_view import TURN_CHANNELS
from texclass.loaders import find_recording
from texclass.loaders.plausibility import resolve_unit
from texclass.loaders.readers import ReaderSettings, as_column_names, reader_error
from texclass.recognition.model import Model
from texclass.recognition.sources.blocks import Block, BlockSource, resampled
from texclass.recognition.sources.training_input import ACCELERATION_ONLY
from texclass.recording import Recording, RecordingError, Samples

ROS2 = "ros2:"
BLOCK_S = 0.025
"""Default length of a block in seconds."""
MAX_CHANNELS = 1024
"""Largest number of channels; a larger number indicates a wrong file format."""
FILE_OPTIONS = (
    "column",
    "topic",
    "delimiter",
    "time_column",
    "time_unit",
    "skip_rows",
    "comment",
    "drop_incomplete",
)
STDIN = "standard input"


def is_live(source: str | Recording) -> bool:
    """Return whether a source sends samples as measured, without the conditioning of training files.

    Examples
    --------
    >>> is_live("-"), is_live("ros2:/imu"), is_live("oak.txt")
    (True, True, False)
    """
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
    column: str | Sequence[str] | None = None,
    topic: str | None = None,
    delimiter: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    skip_rows: int | None = None,
    comment: str | None = None,
    drop_incomplete: bool = False,
    domain: int | None = None,
    reliability: Literal["reliable", "best effort"] | None = None,
    depth: int | None = None,
    wait_s: float | None = None,
    end_s: float | None = None,
) -> BlockSource:
    r"""Open a source of blocks by its name.

    Parameters
    ----------
    source : str or Recording
        Name of a source: "-" (standard input), "FILE", "DATASET:RECORDING", "bag:FILE?topic=/name" or
        "ros2:/topic". Alternatively, a recording, which is played like a live source.
    fs : float, optional
        Sampling rate in Hz. It is required for standard input, measured by default for a topic, and compared
        with the rate stated in a file.
    unit : str, optional
        Unit of the acceleration; required if neither the source nor the model states it.
    rate : float, optional
        New sampling rate in Hz, for band-limited resampling.
    block_s : float
        Length of a block in seconds, for files and standard input (default 0.025).
    paced : bool
        Whether to play a file in real time (default False).
    raw_channels : int, optional
        Number of interleaved channels, if standard input is little-endian float32. By default, standard input
        is text with one sample per line, and channels separated by commas, blanks or semicolons.
    file : BinaryIO, optional
        Stream that replaces standard input; the caller closes it.
    model : Model, optional
        Trained model, which determines the columns: acceleration, then turn rate and friction if it needs
        them. Files and bags are read and conditioned like its training files; live sources are not
        conditioned.
    column, topic, delimiter, time_column, time_unit, skip_rows, comment, drop_incomplete : optional
        How files are read, see `load_recording`. Standard input accepts column (by number) and delimiter.
    domain, reliability, depth, wait_s, end_s : optional
        Options of ROS 2 topics, see `topic_blocks`.

    Returns
    -------
    blocks : BlockSource
        Generator of blocks.

    Raises
    ------
    RecordingError
        If the rate or unit is missing or contradicts the source, the file is invalid, or the source lacks a
        signal that the model needs. The generator raises it if the first lines of a text are not numbers.
    ValueError
        If an option is invalid, or belongs to another kind of source.

    Examples
    --------
    >>> import io
    >>> text = io.BytesIO(b"0.1\n0.2\n0.3\n")
    >>> blocks = open_source("-", fs=1000, unit="m/s^2", block_s=0.002, file=text)
    >>> [block.samples.ravel().tolist() for block in blocks]
    [[0.1, 0.2], [0.3]]
    """
    options = {
        "column": column,
        "topic": topic,
        "delimiter": delimiter,
        "time_column": time_column,
        "time_unit": time_unit,
        "skip_rows": skip_rows,
        "comment": comment,
        "drop_incomplete": drop_incomplete,
        "domain": domain,
        "reliability": reliability,
        "depth": depth,
        "wait_s": wait_s,
        "end_s": end_s,
    }
    reading: dict[str, Any] = {
        name: value for name, value in options.items() if value is not None and value is not False
    }
    _check_options(source, reading, raw_channels)
    columns = ACCELERATION_ONLY if model is None else model.input_columns
    if not block_s > 0:
        raise ValueError(f"block_s must be positive, got {block_s} s")
    if source == "-":
        blocks = _read_stdin(file or sys.stdin.buffer, fs, unit, block_s, raw_channels, model, **reading)
    elif isinstance(source, str) and source.startswith(ROS2):
        try:
            topic_blocks = shipped.module_of("sources", "ros2").topic_blocks
        except ImportError as error:
            raise RecordingError(
                f"{source}: ROS 2 topics require the extra `robot` ({error}). Install it with "
                "pip install 'texclass[robot]'"
            ) from error
        blocks = topic_blocks(source.removeprefix(ROS2), fs=fs, unit=unit, columns=columns, **reading)
    else:
        find = find_recording if model is None else model.manifest.input.find
        recording = source if isinstance(source, Recording) else find(source, fs=fs, unit=unit, **reading)
        n = max(1, round(block_s * recording.fs))
        blocks = _play(recording, columns.extract(recording), n, paced)
    return blocks if rate is None else resampled(blocks, rate)


def _check_options(source: str | Recording, reading: Mapping[str, Any], raw_channels: int | None) -> None:
    """Raise a ValueError if an option belongs to another kind of source."""
    is_topic = isinstance(source, str) and source.startswith(ROS2)
    if misplaced := [name for name in reading if (name in FILE_OPTIONS) == is_topic]:
        kind = "files" if is_topic else "ROS 2 topics (ros2:/TOPIC)"
        raise ValueError(f"{', '.join(misplaced)} can only be used with {kind}, got source {source}")
    has_file_options = not {*FILE_OPTIONS}.difference(("column", "delimiter")).isdisjoint(reading)
    if source == "-" and (has_file_options or (raw_channels is not None and "delimiter" in reading)):
        raise ValueError(
            f"{', '.join(reading)} cannot be used with {STDIN}. Use --fs instead of a time column; only "
            "--column and, for text, --delimiter are allowed"
        )
    if raw_channels is not None and source != "-":
        raise ValueError(f"--channels can only be used with {STDIN} (-), got {raw_channels} for {source}")


def _read_stdin(
    file: BinaryIO,
    fs: float | None,
    unit: str | None,
    block_s: float,
    raw_channels: int | None,
    model: Model | None,
    column: Any = None,
    delimiter: str | None = None,
) -> BlockSource:
    """Return the blocks of standard input (text or float32), with turn rates in rad/s."""
    ReaderSettings(fs=fs, unit=unit, delimiter=delimiter).check(STDIN)
    unit = resolve_unit(None, unit or (None if model is None else model.manifest.input.unit), STDIN)
    if fs is None:
        raise RecordingError(f"{STDIN}: the sampling rate is missing. Pass it in Hz with --fs")
    n = max(1, round(block_s * fs))
    if raw_channels is None:
        blocks = _read_text(file, fs, unit, n, delimiter)
    else:
        if not 1 <= raw_channels <= MAX_CHANNELS:
            raise ValueError(f"--channels must be between 1 and {MAX_CHANNELS}, got {raw_channels}")
        if model is not None:
            model.input_columns.n_axes(len(as_column_names(column)) or raw_channels)
        blocks = _read_float32(file, fs, unit, raw_channels, n)
    if column is not None:
        blocks = _select_columns(blocks, as_column_names(column))
    if model is not None and (rad_per_unit := model.manifest.input.turn_rate_scale) != 1.0:
        factors = np.array(
            [rad_per_unit if name in TURN_CHANNELS else 1.0 for name in model.input_columns.names]
        )
        blocks = (replace(block, samples=block.samples * factors) for block in blocks)
    return blocks


def _play(recording: Recording, signal: Samples, n: int, paced: bool) -> BlockSource:
    fs, start, flags = recording.fs, time.monotonic(), recording.flags
    for first in range(0, len(signal), n):
        samples = signal[first : first + n]
        if paced:
            time.sleep(max(0.0, start + (first + len(samples)) / fs - time.monotonic()))
        yield Block(first / fs, samples, fs, recording.unit, 0, flags)
        flags = ()


def _select_columns(blocks: BlockSource, columns: Sequence[str]) -> BlockSource:
    """Yield blocks with only the given columns, which are numbered from 1."""
    with closing(blocks):
        for block in blocks:
            n = block.samples.shape[1]
            if invalid := [name for name in columns if not (name.isdecimal() and 1 <= int(name) <= n)]:
                raise reader_error(STDIN, f"column {invalid[0]!r} does not exist", f"a number from 1 to {n}")
            yield replace(block, samples=block.samples[:, [int(name) - 1 for name in columns]])


def _read_text(file: BinaryIO, fs: float, unit: str, n: int, delimiter: str | None) -> BlockSource:
    """Yield blocks of n lines; blank lines are skipped, and a garbled line becomes a sample of NaN.

    The number of columns is the most common one among the first lines, because the very first line may be
    incomplete or a header.
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
    if not 1 <= width <= MAX_CHANNELS:
        number, _, start = first[0]
        raise RecordingError(
            f"{STDIN}: line {number}, {start!r}, has {width} numbers, like the lines that follow. Expected "
            f"one sample per line, with 1 to {MAX_CHANNELS} numbers (for float32 input, pass --channels)"
        )
    flags, rows, n_sent = list[str](), list[list[float]](), 0
    for number, row, start in chain(first, lines):
        if not (is_complete := len(row) == width):
            flags.append(f"garbled: line {number} is {start!r}. Expected {width} numbers")
        if is_complete or rows or n_sent:  # lines before the first sample are a header
            rows.append(row if is_complete else [math.nan] * width)
        if len(rows) == n:
            yield Block(n_sent / fs, np.array(rows), fs, unit, 0, tuple(flags))
            n_sent, rows, flags = n_sent + n, [], []
    if rows or flags:
        yield Block(n_sent / fs, np.array(rows).reshape(-1, width), fs, unit, 0, tuple(flags))


def _lines(file: BinaryIO, delimiter: str | None) -> Iterator[tuple[int, list[float], str]]:
    """Yield the number of each line that is not blank, its values (none if garbled) and first characters.

    If the delimiter is not a comma, a comma is read as a decimal point.
    """
    number, stated_delimiter = 0, (delimiter or "").encode()
    while line := file.readline(1 << 16):
        number += 1
        if line.strip():
            mark = stated_delimiter or (b";" if b";" in line else b",")
            words = line.replace(b",", b" ").split() if mark == b"," else line.replace(b",", b".").split(mark)
            try:
                row = [float(word) for word in words]
            except ValueError:
                row = []
            yield number, row, line[:40].decode("utf-8", "replace").strip()


def _read_float32(file: BinaryIO, fs: float, unit: str, n_channels: int, n: int) -> BlockSource:
    read: Callable[[int], bytes] = getattr(file, "read1", file.read)
    size = 4 * n_channels
    n_sent, buffer = 0, b""
    while data := read(n * size - len(buffer)):
        buffer += data
        n_bytes = len(buffer) // size * size
        with np.errstate(invalid="ignore"):  # a signalling NaN raises a warning
            samples = np.frombuffer(buffer[:n_bytes], "<f4").astype(np.float64).reshape(-1, n_channels)
        buffer = buffer[n_bytes:]
        if n_bytes:
            yield Block(n_sent / fs, samples, fs, unit)
        n_sent += len(samples)
    if buffer:
        flag = f"{STDIN}: ends within a sample, {len(buffer)} bytes left out"
        yield Block(n_sent / fs, np.empty((0, n_channels)), fs, unit, 0, (flag,))
