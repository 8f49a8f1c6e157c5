"""Read LabVIEW files (.tdms)."""

import logging
import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile
from nptdms.log import log_manager

from texclass.loaders.columns import add_unit, is_time, parse_unit
from texclass.loaders.readers import (
    ReaderSettings,
    ReadSignals,
    as_samples,
    check_announced_size,
    quote_names,
    reader_error,
    require_columns,
    wrap_library_errors,
)

log_manager.set_level(logging.CRITICAL)  # incomplete segments are flagged here instead


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the names of the channels with their unit: "acc [g]", or "group/acc [g]" with several groups.

    Raises
    ------
    RecordingError
        If the file is not a TDMS file, or has no channel of numbers.
    """
    with _channels(path) as (numeric, _):
        return tuple(numeric)


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read channels; the sampling rate is read from the property `wf_increment`.

    If a file ends within a segment, all channels are cut to the shortest one.

    Raises
    ------
    RecordingError
        If a channel is missing, or channels have different rates.
    """
    with _channels(path) as (numeric, others):
        require_columns(wanted, tuple(numeric), path)
        channels = {name: numeric[name] for name in wanted}
        check_announced_size(sum(map(len, channels.values())), path)
        fs = _rate(channels, path)
        units = {name: str(channel.properties.get("unit_string", "")) for name, channel in channels.items()}
        stored = {name: np.asarray(channel[:]) for name, channel in channels.items()}
        signals = {
            name: array.astype("M8[ns]") if array.dtype.kind == "M" else as_samples(array, name, path)
            for name, array in stored.items()
        }
    flags = [f"time: fs is {fs:g} Hz, from 'wf_increment' in the file"] if fs else []
    if unknown := [unit for unit in dict.fromkeys(units.values()) if unit and not parse_unit(unit)]:
        flags.append(f"unit: {quote_names(unknown)[:60]} in the file is unknown")
    if not _is_whole(path):
        n = min(map(len, signals.values()))
        signals = {name: samples[:n] for name, samples in signals.items()}
        flags.append("incomplete: the file ends within a segment")
    if others:
        flags.append(f"ignored: {quote_names([f'{name} ({kind})' for name, kind in others.items()])}")
    return ReadSignals(signals, fs, flags=tuple(flags))


def _rate(channels: dict[str, Any], path: Path) -> float | None:
    """Return the sampling rate in Hz of channels; None if no channel has a time step."""
    steps = set[float]()
    for name, channel in channels.items():
        increment = channel.properties.get("wf_increment", 0)
        step = float(increment) if isinstance(increment, int | float | np.number) else math.nan
        if not 0 <= step < math.inf:
            raise reader_error(path, f"wf_increment of {name!r} is {increment!r:.40}", "a time step in s")
        if step and not is_time(name):
            steps.add(step)
    if len(steps) > 1:
        rates = ", ".join(f"{1 / step:g}" for step in sorted(steps))
        raise reader_error(
            path, f"its channels have the rates {rates} Hz", "one rate: select channels with --column"
        )
    return next((1 / step for step in steps), None)


def _is_whole(path: Path) -> bool:
    """Return whether the last segment of a file is complete; npTDMS does not report truncated segments."""
    at, lead_in = 0, 28  # bytes of the lead-in, which contains the length of the rest of the segment
    with path.open("rb") as file:
        while at < (size := path.stat().st_size):
            file.seek(at)
            (length,) = struct.unpack("<12xQ8x", file.read(lead_in).ljust(lead_in, b"\xff"))
            at += lead_in + length
    return at == size


@contextmanager
def _channels(path: Path) -> Iterator[tuple[dict[str, Any], dict[str, str]]]:
    """Open a file; yield the channels of numbers or dates by name, and the types of other channels."""
    numeric, others = dict[str, Any](), dict[str, str]()
    with path.open("rb") as stored, wrap_library_errors(path, "TDMS"), TdmsFile.open(stored) as file:
        groups = {
            group.name: [channel for channel in group.channels() if len(channel)] for group in file.groups()
        }
        has_one_group = sum(map(bool, groups.values())) == 1
        for group, channels in groups.items():
            for channel in channels:
                name = channel.name if has_one_group else f"{group}/{channel.name}"
                name = add_unit(name, parse_unit(str(channel.properties.get("unit_string", ""))))
                if name in numeric or name in others:
                    raise reader_error(path, f"two channels have the name {name!r:.80}", "unique names")
                if channel.dtype.kind in "iufM":
                    numeric[name] = channel
                else:
                    others[name] = "text" if channel.dtype.kind == "O" else channel.dtype.name
        if not numeric:
            raise reader_error(
                path, f"its channels are {quote_names(list(others))}", "a channel of real numbers"
            )
        yield numeric, others
