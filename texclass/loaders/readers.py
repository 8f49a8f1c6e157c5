"""What the readers of all formats share: the registry of formats, settings, results, limits and errors.

A reader is a module with `names(path, settings)`, the columns or arrays of a file, and
`read(path, wanted, settings)`, which returns them as `ReadSignals`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from texclass import shipped
from texclass.recording import UNITS, RecordingError, Samples

MAX_VALUES = 1_000_000_000
"""A file that announces more values than this in one recording is refused before they are read (8 GB): three
axes of 3 hours at 10 kHz are a third of it."""
MAX_EXPANSION = 1000
"""A file that announces more than so many times its bytes (and more than 64 MB) is refused, too."""
RATES_HZ = (1e-3, 1e8)
"""Lowest and highest sampling rate: slower sampling is no vibration, no hand-held sensor is faster."""
TIME_UNITS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0, "min": 60e9, "h": 3600e9, "days": 86400e9}
"""Nanoseconds in each unit that --time-unit and `time_unit` of a card accept."""
COMMENT_PATTERN = r"""[^\s\d"']{1,8}"""
"""Pattern of the beginning of comment lines."""
NO_TIME_COLUMN = "none"
"""Name of a time column that means that there is none."""
BAG_METADATA = "metadata.yaml"
"""The file that stands for a bag that is a folder."""
STORAGE_SUFFIXES = (".mcap", ".db3")
"""Kinds of the files that hold its messages."""
BAG_SUFFIXES = (".bag", *STORAGE_SUFFIXES)
"""Suffixes of bags."""


@dataclass(frozen=True)
class Format:
    """A kind of file that can be a recording.

    Attributes
    ----------
    name : str
        For messages and documentation.
    module : str
        The reader.
    settings : tuple of str
        Fields of `ReaderSettings` for this format alone.
    rate : str
        What states the sampling rate, if anything does.
    extra : str
        Extra of texclass with its libraries.
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
    ".parquet": Format("Parquet", _TEXT.module),
    **dict.fromkeys((".wav", ".flac"), _AUDIO),
    ".mat": Format("MATLAB", _HDF5.module, rate="scalar `fs`"),
    ".npy": Format("NPY", _HDF5.module),
    ".npz": Format("NPZ", _HDF5.module, rate="scalar `fs`"),
    **dict.fromkeys((".h5", ".hdf5"), _HDF5),
    ".xlsx": Format("Excel", "texclass.loaders.workbooks", _TEXT.settings[1:], extra="formats"),
    ".tdms": Format("TDMS", "texclass.loaders.tdms", rate="`wf_increment`", extra="formats"),
}
"""Suffix of a file that can be a recording (case does not matter) -> its format."""


def formats() -> dict[str, Format]:
    """Return suffix -> format of the files that can be read, those of other packages last."""
    added = {
        f".{name}": Format(name, module) for name, module in shipped.entry_point_modules("readers").items()
    }
    bags = {
        suffix: Format("bag", kind.module, ("topic",), "time stamps", "robot")
        for suffix, kind in added.items()
        if suffix in BAG_SUFFIXES
    }
    return {**FORMATS, **added, **bags}


@dataclass(frozen=True)
class ReadSignals:
    """Signals read from files.

    Attributes
    ----------
    named : mapping of str to ndarray of shape (n,) or (n, c)
        As stored: by the names of a file's columns, or once it is known what they are by the fields of a
        `Recording`. A column of dates is of kind `datetime64[ns]`.
    fs : float or None
        Sampling rate in Hz if the files state it.
    flags : tuple of str
        What a user should know of how they were read.
    channels : tuple of str
        Names of the axes of an acceleration.
    unit : str or None
        Of the acceleration, if the type of messages or the names of columns state it.
    """

    named: Mapping[str, Samples]
    fs: float | None = None
    flags: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    unit: str | None = None


@dataclass(frozen=True)
class ReaderSettings:
    """How files are read; None stands for what is not given.

    Attributes
    ----------
    fs : float, optional
        Sampling rate in Hz, which time stamps must agree with.
    unit : str, optional
        Unit of the acceleration. "counts" keeps the codes of integer audio; else full scale is 1.
    column : str or sequence of str, optional
        Column(s) of the acceleration, by name or number from 1 (default: the conventional ones).
    delimiter : str, optional
        Of a text (default: what most of its first rows have).
    time_column : str, optional
        Column or array of the time stamps, or `NO_TIME_COLUMN` (default: one with a conventional name that
        increases).
    time_unit : str, optional
        Unit of the time stamps, of `TIME_UNITS` (default: the one in the name of the column, or inferred).
    resample : float, optional
        Rate in Hz to which recordings are brought.
    topic : str, optional
        Of a bag (default: the only one that carries an acceleration).
    skip_rows : int, optional
        Lines at the beginning of a text that are not read (default 0).
    comment : str, optional
        Beginning of comment lines of a text (default: #, % or //).
    drop_incomplete : bool
        Leave out lines of a text without a number in each column; else they are an error.
    rate_of : str
        File that states `fs`; by default user or card do.
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
    rate_of: str = ""

    @property
    def of_a_card(self) -> dict[str, Any]:
        """Settings that are given, of those with the same name in a dataset card."""
        beside = ("fs", "unit", "column", "resample", "rate_of")
        stated = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in beside}
        return {name: value for name, value in stated.items() if value not in {None, False}}

    def check(self, where: object) -> None:
        """Check the settings before any file is read.

        Raises
        ------
        RecordingError
            If a unit is unknown, a rate out of range, the delimiter not one character, a number of lines
            negative, or the beginning of comments blank.
        """
        low, high = RATES_HZ
        if self.unit not in (None, *UNITS):
            raise reader_error(where, f"unit is {self.unit!r}", f"one of {', '.join(UNITS)}")
        for name, rate in {"fs": self.fs, "resample": self.resample}.items():
            if rate is not None and not low <= rate <= high:
                raise reader_error(
                    where, f"{name} is {rate:g} Hz", f"a sampling rate in Hz from {low:g} to {high:g}"
                )
        if self.delimiter is not None and (len(self.delimiter) != 1 or self.delimiter in '"\r\n'):
            raise reader_error(where, f"delimiter is {self.delimiter!r}", "one character, no quote")
        if self.time_unit not in (None, *TIME_UNITS):
            raise reader_error(where, f"time unit is {self.time_unit!r}", f"one of {', '.join(TIME_UNITS)}")
        if self.skip_rows is not None and self.skip_rows < 0:
            raise reader_error(where, f"skip_rows is {self.skip_rows}", "a number of lines, at least 0")
        if self.comment is not None and not re.fullmatch(COMMENT_PATTERN, self.comment):
            raise reader_error(
                where, f"comment is {self.comment!r}", "1 to 8 characters, no blank, digit or quote"
            )


def require_columns(wanted: Sequence[str], names: Sequence[str], where: object, *, hint: str = "") -> None:
    """Check that every wanted column exists exactly once.

    Raises
    ------
    RecordingError
        Naming the first that does not.
    """
    for name in wanted:
        if (count := list(names).count(name)) != 1:
            raise RecordingError(
                f"{where}: column {name!r} occurs {count} times; its columns are {quote_names(names)}. "
                f"Expected once, by name or by number from 1 to {len(names)}{hint}"
            )


def check_size(n_values: int, where: object) -> None:
    """Refuse a file that announces more than `MAX_VALUES` values, before they are read."""
    if n_values > MAX_VALUES:
        raise reader_error(
            where, f"announces {n_values} values", f"at most {MAX_VALUES} a recording, split it"
        )


def check_announced_size(n_values: int, path: Path) -> None:
    """Refuse a file that announces more values than `MAX_VALUES`, or than its bytes can hold."""
    check_size(n_values, path)
    if 8 * n_values > max(1 << 26, MAX_EXPANSION * (size := path.stat().st_size)):
        raise reader_error(
            path, f"announces {n_values} values in {size} bytes", f"at most {MAX_EXPANSION} times"
        )


def as_samples(array: Any, name: str, path: Path) -> Samples:
    """Return a stored array as samples of shape (n,) or (n, c): real numbers, time along the first axis.

    Axes of length 1 are dropped; of two axes the longer one is time.

    Raises
    ------
    RecordingError
        If it does not hold real numbers or has more than two axes.
    """
    array = np.asarray(array)
    if array.dtype.kind not in "iuf":
        raise reader_error(path, f"{name} holds {array.dtype}", "real numbers")
    check_size(array.size, path)
    with np.errstate(over="ignore", invalid="ignore"):  # of wider floats: infinite, and refused as such
        samples = np.atleast_1d(np.squeeze(array)).astype(np.float64, copy=False)
    if samples.ndim > 2:
        raise reader_error(path, f"{name} has shape {array.shape}", "(n,) or (n, channels)")
    return samples.T if samples.ndim == 2 and samples.shape[0] < samples.shape[1] else samples


@contextmanager
def wrap_library_errors(path: Path, kind: str) -> Iterator[None]:
    """Turn what damaged files make the libraries raise, which is almost anything, into one error."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:
        raise RecordingError(f"{path}: not a readable {kind} file ({error})") from error


def storage_suffix(name: str) -> str:
    """Return the kind of a bag's storage file, compressed or not: ".bag", ".mcap", ".db3"."""
    return PurePosixPath(name.lower().removesuffix(".zstd")).suffix


def reader_error(where: object, found: str, rule: str) -> RecordingError:
    """Return the error of a file: what was found there, and the rule that it breaks."""
    return RecordingError(f"{where}: {found}. Expected {rule}")


def rate_conflict_error(where: object, stated: str, given: float, rate_of: str) -> RecordingError:
    """Return the error of a file whose rate is not the given one, which may be that of the file `rate_of`."""
    if rate_of:
        other, remedy = f"{given:g} Hz in {rate_of}", "resample all files"
    else:
        other, remedy = f"{given:g} Hz was given", "omit --fs, or resample"
    return RecordingError(
        f"{where}: fs is {stated}, but {other}. Expected one rate: {remedy} with --resample HZ "
        "(`resample_hz` in a card)"
    )


def quote_names(names: Sequence[str], most: int = 8) -> str:
    """Return names for a message, cut short when there are many."""
    shown = ", ".join(repr(name) for name in list(names)[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown or "none"


def as_column_names(names: str | Sequence[str] | None) -> tuple[str, ...]:
    """Return columns that are given as one, several, or not at all."""
    return (names,) if isinstance(names, str) else tuple(names or ())


def is_bag(path: Path) -> bool:
    """Whether a file is, by its name, a bag."""
    return path.suffix.lower() in BAG_SUFFIXES or path.name == BAG_METADATA
