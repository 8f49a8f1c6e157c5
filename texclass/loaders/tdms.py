"""Read channels of LabVIEW files (.tdms)."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from nptdms import TdmsFile

from texclass.loaders.columns import (
    ReadOptions,
    ReadSignals,
    as_samples,
    check_held,
    plain_unit,
    readable,
    refused,
    require,
)


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the channels, with their unit: "acc [g]", with several groups "group/acc [g]".

    Raises
    ------
    RecordingError
        If it is no TDMS file.
    """
    with _channels(path) as channels:
        return tuple(channels)


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> ReadSignals:
    """Read the wanted channels; `wf_increment` states the rate.

    Raises
    ------
    RecordingError
        If a channel is not there or not of real numbers, or channels have different rates.
    """
    with _channels(path) as channels:
        require(wanted, tuple(channels), path)
        check_held(sum(len(channels[name]) for name in wanted), path)
        stored = {name: np.asarray(channels[name][:]) for name in wanted}
        steps = {channels[name].properties.get("wf_increment") for name in wanted} - {None, 0}
    if len(steps) > 1:
        rates = ", ".join(f"{1 / step:g}" for step in sorted(steps))
        raise refused(path, f"its channels have rates {rates} Hz", "one: select channels with --column")
    fs = next((1 / float(step) for step in steps), None)
    named = {
        name: array.astype("M8[ns]") if array.dtype.kind == "M" else as_samples(array, name, path)
        for name, array in stored.items()
    }
    flags = (f"time: fs is {fs:g} Hz, as 'wf_increment' in the file states",) if fs else ()
    return ReadSignals(named, fs, flags=flags)


@contextmanager
def _channels(path: Path) -> Iterator[dict[str, Any]]:
    """Give the channels with samples by their names."""
    with path.open("rb") as stored, readable(path, "TDMS"), TdmsFile.open(stored) as file:
        groups = file.groups()
        found = {}
        for group in groups:
            for channel in group.channels():
                unit = plain_unit(str(channel.properties.get("unit_string", "")))
                name = f"{group.name}/{channel.name}" if len(groups) > 1 else channel.name
                if len(channel):
                    found[f"{name} [{unit}]" if unit else name] = channel
        yield found
