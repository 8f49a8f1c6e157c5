"""Registry of file formats, and the settings, results, limits and errors shared by all readers.

A reader is a module with two functions: `names(path, settings)` returns the names of the columns or arrays of
a file, and `read(path, wanted, settings)` returns the columns named in `wanted` as `ReadSignals`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path, PurePosixPath
from typing import Any, TypedDict

import numpy as np

from texclass import shipped
from texclass.recording import UNITS, RecordingError, Samples

MAX_VALUES = 1_000_000_000
"""Largest number of values in one recording (8 GB), three times as many as 3 hours of three axes at 10 kHz.
The header of a file is checked before its values are read."""
MAX_EXPANSION = 1000
"""Largest ratio of the size after decompression to the size of the file, for data over 64 MB."""
RATES_HZ = (1e-3, 1e8)
"""Lowest and highest valid sampling rate in Hz; real sensors stay well within this range."""
TIME_UNITS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0, "min": 60e9, "h": 3600e9, "days": 86400e9}
"""Duration in nanoseconds of each unit accepted by --time-unit and by the card key `time_unit`."""
COMMENT_PATTERN = r"""[^\s\d"']{1,8}"""
"""Regular expression for the characters that start a comment line."""
NO_TIME_COLUMN = "none"
"""Value of --time-column that ignores all time stamps."""
BAG_METADATA = "metadata.yaml"
"""File that represents a bag stored as a folder (rosbag2)."""
STORAGE_SUFFIXES = (".mcap", ".db3")
"""Suffixes of the files in a bag folder that contain the messages."""
BAG_SUFFIXES = (".bag", *STORAGE_SUFFIXES)
"""Suffixes of bags."""


@dataclass(frozen=True)
class Format:
    """File format of recordings.

    Attributes
    ----------
    name : str
        Name in messages and documentation.
    module : str
        Module of the reader.
    settings : tuple of str
        Fields of `ReaderSettings` that apply only to this format.
    rate : str
        Where the file states the sampling rate; "" if it does not.
    extra : str
        Extra of texclass that installs the required libraries; "" if none is needed.
    """

    name: str
    module: str
    settings: tuple[str, ...] = ()
    rate: str = ""
    extra: str = ""


_TEXT = Format("text", "texclass.loaders.tables", ("delimiter", "skip_rows", "comment", "drop_incomplete"))
_LABVIEW = Format("LabVIEW text", _TEXT.module, _TEXT.settings, rate="`Delta_X`")
_AUDIO = Format("audio", "texclass.loaders.audio", rate="header")
_HDF5 = Format("HDF5", "texclass.loaders.arrays", rate="scalar or attribute `fs`")
FORMATS: Mapping[str, Format] = {
    **dict.fromkeys((".txt", ".csv", ".tsv"), _TEXT),
    ".lvm": _LABVIEW,
    ".parquet": Format("Parquet", "texclass.loaders.parquet", extra="parquet"),
    **dict.fromkeys((".wav", ".flac"), _AUDIO),
    ".mat": Format("MATLAB", _HDF5.module, rate="scalar `fs`"),
    ".npy": Format("NPY", _HDF5.module),
    ".npz": Format("NPZ", _HDF5.module, rate="scalar `fs`"),
    **dict.fromkeys((".h5", ".hdf5"), _HDF5),
    ".xlsx": Format("Excel", "texclass.loaders.workbooks", _TEXT.settings[1:], extra="formats"),
    ".tdms": Format("TDMS", "texclass.loaders.tdms", rate="`wf_increment`", extra="formats"),
}
"""Format by lower-case suffix; the case of the suffix of a file is ignored."""


def formats() -> dict[str, Format]:
    """Return the readable formats by suffix; formats of other installed packages come last."""
    registered = {
        f".{name}": Format(name, module) for name, module in shipped.entry_point_modules("readers").items()
    }
    bags = {
        suffix: Format("bag", kind.module, ("topic",), "time stamps", "robot")
        for suffix, kind in registered.items()
        if suffix in BAG_SUFFIXES
    }
    return {**FORMATS, **registered, **bags}


@dataclass(frozen=True)
class ReadSignals:
    """Signals read from files.

    Attributes
    ----------
    signals : mapping of str to ndarray of shape (n,) or (n, c)
        Stored values, by column name, or by field of `Recording` once the columns are assigned. A column of
        dates has the type `datetime64[ns]`.
    fs : float or None
        Sampling rate in Hz, if the files state it.
    flags : tuple of str
        Notes for the user on how the files were read.
    channels : tuple of str
        Names of the axes of the acceleration.
    unit : str or None
        Unit of the acceleration, if the message type or the column names state it.
    rates : mapping of str to float
        Sampling rates in Hz of all signals whose own rate is stated, by column name; once the columns are
        assigned, of the signals whose rate differs from `fs`, by field of `Recording`.
    """

    signals: Mapping[str, Samples]
    fs: float | None = None
    flags: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    unit: str | None = None
    rates: Mapping[str, float] = field(default_factory=dict)


class LoadingOptions(TypedDict, total=False):
    """Options of `load_recording`; see `ReaderSettings`."""

    fs: float | None
    unit: str | None
    resample: float | None
    column: str | Sequence[str] | None
    topic: str | None
    delimiter: str | None
    time_column: str | None
    time_unit: str | None
    skip_rows: int | None
    comment: str | None
    drop_incomplete: bool


@dataclass(frozen=True)
class ReaderSettings:
    """Options for reading files; None selects the default.

    Attributes
    ----------
    fs : float, optional
        Sampling rate in Hz. Time stamps must agree with it.
    unit : str, optional
        Unit of the acceleration. "counts" keeps the integer values of audio; with other units, full scale
        is 1.
    column : str or sequence of str, optional
        Column(s) of the acceleration, by name or number from 1 (default: conventional names).
    delimiter : str, optional
        Column delimiter of a text file (default: detected from its first rows).
    time_column : str, optional
        Column or array of the time stamps, or `NO_TIME_COLUMN` (default: an increasing column with a
        conventional name).
    time_unit : str, optional
        Unit of the time stamps, one of `TIME_UNITS` (default: from the column name, or inferred).
    resample : float, optional
        Target sampling rate in Hz.
    topic : str, optional
        Topic of a bag (default: the only one with an acceleration). For a dataset, also a pattern; see
        `is_topic_pattern`.
    skip_rows : int, optional
        Number of lines to skip at the start of a text file (default 0).
    comment : str, optional
        Start of comment lines in a text file (default: #, % or //).
    drop_incomplete : bool
        Drop lines of a text file that lack a number in a column (default False: raise an error).
    auxiliary_fs : mapping of str to float
        Sampling rates in Hz of auxiliary signals with another rate that the files do not state, by field of
        `Recording`.
    rate_of : str
        File from which `fs` was read; "" if it is set by the user or the card.
    """

    fs: float | None = None
    unit: str | None = None
    column: Any = None
    delimiter: str | None = None
    time_column: str | None = None
    time_unit: str | None = None
    resample: float | None = None
    topic: str | None = None
    skip_rows: int | None = None
    comment: str | None = None
    drop_incomplete: bool | None = None
    auxiliary_fs: Mapping[str, float] = field(default_factory=dict)
    rate_of: str = ""

    @property
    def card_keys(self) -> dict[str, Any]:
        """Options that are set and have the same name as a key of dataset cards."""
        other_names = ("fs", "unit", "column", "resample", "auxiliary_fs", "rate_of")
        names = (one.name for one in fields(self) if one.name not in other_names)
        values = {name: getattr(self, name) for name in names}
        return {name: value for name, value in values.items() if value not in {None, False}}

    def check(self, where: object) -> None:
        """Check the options before any file is read.

        Parameters
        ----------
        where : str or Path
            File or folder named in the messages.

        Raises
        ------
        RecordingError
            If a unit is unknown, a rate is out of range, the topic is no valid pattern, the delimiter is not
            one character, `skip_rows` is negative, or `comment` is blank.
        """
        low, high = RATES_HZ
        if self.unit not in (None, *UNITS):
            raise reader_error(where, f"unknown unit {self.unit!r}", f"one of {', '.join(UNITS)}")
        for name, rate in {"fs": self.fs, "resample": self.resample}.items():
            if rate is not None and not low <= rate <= high:
                raise reader_error(where, f"{name} is {rate:g} Hz", f"a rate from {low:g} to {high:g} Hz")
        try:
            is_topic_pattern(self.topic)
        except re.error as error:
            problem = f"topic {self.topic!r} is not a valid regular expression ({error})"
            raise reader_error(where, problem, "the name of a topic, or a pattern with groups") from error
        if self.delimiter is not None and (len(self.delimiter) != 1 or self.delimiter in '"\r\n'):
            raise reader_error(where, f"delimiter is {self.delimiter!r}", "one character other than a quote")
        if self.time_unit not in (None, *TIME_UNITS):
            raise reader_error(
                where, f"unknown time unit {self.time_unit!r}", f"one of {', '.join(TIME_UNITS)}"
            )
        if self.skip_rows is not None and self.skip_rows < 0:
            raise reader_error(where, f"skip_rows is {self.skip_rows}", "a number of lines of at least 0")
        if self.comment is not None and not re.fullmatch(COMMENT_PATTERN, self.comment):
            raise reader_error(
                where, f"comment is {self.comment!r}", "1 to 8 characters without blanks, digits and quotes"
            )


def is_topic_pattern(topic: str | None) -> bool:
    """Return whether a topic is a regular expression with named groups: every match is one recording.

    Examples
    --------
    >>> is_topic_pattern("/imu"), is_topic_pattern("/(?P<surface>[a-z]+)/imu")
    (False, True)
    """
    return topic is not None and bool(re.compile(topic).groupindex)


def require_columns(wanted: Sequence[str], names: Sequence[str], where: object, *, hint: str = "") -> None:
    """Check that every wanted column exists exactly once.

    Raises
    ------
    RecordingError
        If a column is missing or occurs several times.
    """
    for name in wanted:
        if (count := list(names).count(name)) != 1:
            problem = f"no column {name!r}" if count == 0 else f"{count} columns are named {name!r}"
            raise RecordingError(
                f"{where}: {problem}; the columns are {quote_names(names)}. "
                f"Expected a name that occurs once, or a column number from 1 to {len(names)}{hint}"
            )


def check_size(n_values: int, where: object) -> None:
    """Raise an error if the header of a file announces more than `MAX_VALUES` values."""
    if n_values > MAX_VALUES:
        raise reader_error(
            where,
            f"its header announces {n_values} values",
            f"at most {MAX_VALUES} per recording: split the file",
        )


def check_announced_size(n_values: int, path: Path) -> None:
    """Raise an error if a file header announces more values than `MAX_VALUES` or than its size allows."""
    check_size(n_values, path)
    if 8 * n_values > max(1 << 26, MAX_EXPANSION * (size := path.stat().st_size)):
        problem = f"its header announces {n_values} values, but the file has {size} bytes"
        expected = f"at most {MAX_EXPANSION} times as many bytes after decompression"
        raise reader_error(path, problem, expected)


def check_coverage(coverage: float, where: object) -> None:
    """Raise an error if a signal covers less than 90 % of the duration of the acceleration."""
    if coverage < 0.9:
        raise reader_error(
            where, f"it covers {coverage:.0%} of the duration of the acceleration", "at least 90%"
        )


def as_samples(array: Any, name: str, path: Path) -> Samples:
    """Convert a stored array to samples of shape (n,) or (n, c): real numbers, time along the first axis.

    Axes of length 1 are dropped. If two axes remain, the longer one is time.

    Raises
    ------
    RecordingError
        If the array does not contain real numbers or has more than two axes.
    """
    array = np.asarray(array)
    if array.dtype.kind not in "iuf":
        raise reader_error(path, f"{name} contains {array.dtype} values", "real numbers")
    check_size(array.size, path)
    # Wider floats may become infinite, which is an error later.
    with np.errstate(over="ignore", invalid="ignore"):
        samples = np.atleast_1d(np.squeeze(array)).astype(np.float64, copy=False)
    if samples.ndim > 2:
        raise reader_error(path, f"{name} has shape {array.shape}", "(n,) or (n, channels)")
    return samples.T if samples.ndim == 2 and samples.shape[0] < samples.shape[1] else samples


@contextmanager
def wrap_library_errors(path: Path, kind: str) -> Iterator[None]:
    """Convert any exception that a library raises for a damaged file to a `RecordingError`."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:
        raise RecordingError(f"{path}: not a readable {kind} file ({error})") from error


def storage_suffix(name: str) -> str:
    """Return the suffix (".bag", ".mcap", ".db3") of a bag's storage file, ignoring ".zstd"."""
    return PurePosixPath(name.lower().removesuffix(".zstd")).suffix


def reader_error(where: object, problem: str, expected: str) -> RecordingError:
    """Return an error whose message contains the file, the problem and what was expected."""
    return RecordingError(f"{where}: {problem}. Expected {expected}")


def rate_conflict_error(where: object, file_rate: str, fs: float, rate_of: str) -> RecordingError:
    """Return the error for a file whose sampling rate contradicts `fs`, which was read from `rate_of`."""
    if rate_of:
        other, hint = f"{fs:g} Hz in {rate_of}", "resample all files"
    else:
        other, hint = f"{fs:g} Hz was given", "omit --fs, or resample"
    return RecordingError(
        f"{where}: fs is {file_rate}, but {other}. Expected the same rate: {hint} with --resample HZ "
        "(`resample_hz` in a card)"
    )


def quote_names(names: Sequence[str], max_names: int = 8) -> str:
    """Return at most `max_names` names in quotes for a message, and the number of other names."""
    text = ", ".join(repr(name) for name in list(names)[:max_names])
    return f"{text} and {len(names) - max_names} more" if len(names) > max_names else text or "none"


def as_column_names(names: str | Sequence[str] | None) -> tuple[str, ...]:
    """Convert one column name, several column names or None to a tuple."""
    return (names,) if isinstance(names, str) else tuple(names or ())


def is_bag(path: Path) -> bool:
    """Return whether a file has the name or suffix of a bag."""
    return path.suffix.lower() in BAG_SUFFIXES or path.name == BAG_METADATA
