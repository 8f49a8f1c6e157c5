"""What readers of every format share: what they are asked for, what they return, what they refuse."""

import math
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from texclass.recording import RecordingError, Samples

MAX_VALUES = 1_000_000_000
"""A file that announces more values than this in one recording is refused before they are read (8 GB): three
axes of 3 hours at 10 kHz are a third of it."""
MOST_EXPANSION = 1000
"""A file that announces more than so many times its bytes (and more than 64 MB) is refused, too."""
BAG_FOLDER = "metadata.yaml"
"""The file that stands for a bag that is a folder."""
STORAGE = (".mcap", ".db3")
"""Kinds of the files that hold its messages."""
BAGS = (".bag", *STORAGE)
"""Suffixes of bags."""
TURN_RATE = ("wx", "wy", "wz")
"""Columns of a turn rate in a bag, rad/s."""
UNNAMED = "acceleration"
"""Name of the only column of a format that does not name its columns."""
CONVENTIONAL = (
    (UNNAMED,),
    *(tuple(f"{stem}{axis}" for axis in "xyz") for stem in ("", "a", "a ", "acc ", "accel ")),
    *(tuple(f"{stem} {axis}" for axis in "xyz") for stem in ("accelerometer", UNNAMED)),
    tuple(f"linear {UNNAMED} {axis}" for axis in "xyz"),
)
"""Columns that are the acceleration when nobody says which ones are, see `plain`."""
TIMES = (
    *("time", "t", "timestamp", "datetime", "date time", "epoch", "seconds elapsed", "elapsed", "zeit"),
    *("seconds", "milliseconds", "microseconds", "millis", "micros"),
)
"""Columns that say when samples were taken, see `plain`."""
TIME_UNITS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0, "min": 60e9, "h": 3600e9, "days": 86400e9}
"""Nanoseconds in each unit that --time-unit and `time_unit` of a card accept."""
_TIME_SUFFIXES = {
    **{unit: unit for unit in TIME_UNITS},
    **dict.fromkeys(("sec", "second", "seconds"), "s"),
    **dict.fromkeys(("millis", "milliseconds"), "ms"),
    **dict.fromkeys(("µs", "micros", "microseconds"), "us"),
}
"""End of a column's name -> its unit."""
MOST_UNNAMED = 8
"""Columns without names from which they are rather samples of a recording per row than axes."""
COMMENT = r"""[^\s\d"']{1,8}"""
"""Pattern of the beginning of comment lines."""
NO_TIME_COLUMN = "none"
"""Name of a time column that means that there is none."""
ROW_NUMBER = "index"
"""Name of the column that numbers the rows of a table, if it has none."""
ROW_NUMBERS = (ROW_NUMBER, "unnamed: 0", "index level 0", "#", "no", "nr", "row")
"""Columns that number the rows, see `plain`."""
_BRACKETED = {
    **dict.fromkeys(("m/s^2", "m/s2", "m/s²", "m/s/s", "m s-2", "ms-2", "m/(s^2)", "m/sec^2"), "m/s^2"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **{unit.lower(): unit for unit in ("g", "mg", "counts", "V")},
}
"""Unit as it stands in brackets behind a column's name -> unit of an acceleration."""
_OTHER_UNITS = (
    *(
        "mm/s^2",
        "mm/s2",
        "mm/s²",
        "cm/s^2",
        "cm/s2",
        "cm/s²",
        "mv",
        "uv",
        "µv",
        "n",
        "mn",
        "m",
        "mm",
        "m/s",
        "mm/s",
    ),
    *(
        "rad/s",
        "deg/s",
        "°/s",
        "dps",
        "rad",
        "deg",
        "°",
        "ut",
        "µt",
        "°c",
        "c",
        "k",
        "hz",
        "pa",
        "hpa",
        "%",
        "lsb",
    ),
)
"""Units of other signals, or of other sizes."""
_UNIT = re.compile(
    rf"[(\[]\s*({'|'.join(map(re.escape, (*_BRACKETED, *_TIME_SUFFIXES)))})\s*[)\]]", re.IGNORECASE
)


_OTHER_UNIT = re.compile(
    rf"[(\[]\s*({'|'.join(re.escape(unit) for unit in _OTHER_UNITS if unit not in {'n', 'c'})})\s*[)\]]$",
    re.IGNORECASE,
)
"""A unit of something else behind a column's name; "n" and "c" can also be the names of axes."""


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
class ReadOptions:
    """How to read what a format leaves open.

    Attributes
    ----------
    delimiter : str, optional
        Of a text; by default what most of its first rows have.
    codes : bool
        Keep the integer codes of integer audio; else full scale is 1.
    topic : str, optional
        Of a bag; by default the only one that carries an acceleration.
    fs : float, optional
        Rate in Hz that time stamps must agree with; by default the one that they imply.
    time_column : str, optional
        Column or array of the time stamps, or `NO_TIME_COLUMN`; by default one with a conventional name that
        increases.
    time_unit : str, optional
        Unit of the time stamps, of `TIME_UNITS`; by default the one in the name of the column, or inferred.
    rate_of : str
        File that states `fs`; by default user or card do.
    skip_rows : int, optional
        Lines at the beginning of a text that are not read (default 0).
    comment : str, optional
        Beginning of comment lines of a text; by default #, % or //.
    drop_incomplete : bool
        Leave out lines of a text without a number in each column; else they are an error.
    """

    delimiter: str | None = None
    codes: bool = False
    topic: str | None = None
    fs: float | None = None
    time_column: str | None = None
    time_unit: str | None = None
    rate_of: str = ""
    skip_rows: int | None = None
    comment: str | None = None
    drop_incomplete: bool = False


def without_unit(name: str) -> str:
    """Return a column's name without the unit in brackets behind it."""
    return _UNIT.sub("", name).strip()


def with_unit(name: str, unit: str) -> str:
    """Return a column's name with a unit behind it, unless it has this one or the unit is ""."""
    has_it = unit in map(plain_unit, re.findall(r"[(\[][^)\]]*[)\]]", name))
    return f"{name} [{unit}]" if unit and not has_it else name


def group_of(name: str) -> list[str]:
    """Return the groups, structs or sheet that a column is in, as its name states: "log/imu/x" is in two."""
    return re.split(r"[./]", without_unit(name))[:-1]


def plain(name: str) -> str:
    """Return a column's name as conventions are told: "ACCELEROMETER_X (m/s^2)" is "accelerometer x"."""
    return re.sub(r"[\s_]+", " ", without_unit(name).lower()).strip()


def plain_unit(text: str) -> str:
    """Return a unit without brackets around it, "" if it is not known."""
    unit = re.sub(r"^\s*[(\[](.*)[)\]]\s*$", r"\1", text).strip()
    is_other = unit.lower() in {*_TIME_SUFFIXES, *_OTHER_UNITS}
    return _BRACKETED.get(unit.lower(), unit if is_other else "")


def unit_of(names: Sequence[str], path: Path) -> str | None:
    """Return the unit that stands in brackets behind the names of an acceleration's columns, if one does.

    Raises
    ------
    RecordingError
        If there are two, or one is a unit of something else or of another scale.
    """
    if other := next(filter(_OTHER_UNIT.search, names), None):
        raise refused(
            path,
            f"the column {other!r} is in another unit than an acceleration",
            f"{', '.join(dict.fromkeys(_BRACKETED.values()))}: convert its values, or rename it",
        )
    found = {_BRACKETED.get(unit.lower()) for name in names for unit in _UNIT.findall(name)} - {None}
    if len(found) > 1:
        raise refused(path, f"its columns are in {' and '.join(sorted(map(str, found)))}", "one unit")
    return next(iter(found), None)


def time_unit(name: str) -> str | None:
    """Return the unit, of `TIME_UNITS`, in the name of a column, if there is one: "t (ms)", "time_us"."""
    match = re.search(rf"(?:\b|_)({'|'.join(_TIME_SUFFIXES)})\b", name.lower())
    return _TIME_SUFFIXES[match[1]] if match else None


def is_time(name: str) -> bool:
    """Whether the name of a column is that of time stamps: "time", "t_us", "data.t", "clock (ms)"."""
    unit = _UNIT.search(name)
    if unit and unit[1].lower() in _TIME_SUFFIXES:
        return True
    member = re.split(r"[./]", plain(name))[-1]
    stem = re.sub(rf" ({'|'.join(_TIME_SUFFIXES)})$", "", member)
    return stem in TIMES or stem.endswith(" timestamp")


def choose_acceleration(
    names: Sequence[str],
    path: Path,
    varying: Callable[[Sequence[str]], Sequence[str]] = lambda names: names,
) -> tuple[str, ...]:
    """Return the column(s) of the acceleration by convention; ask when there is none.

    Parameters
    ----------
    names : sequence of str
        Of all columns.
    path : Path
        File, for messages.
    varying : callable, optional
        Returns those of some columns that can be an acceleration; the message suggests them.

    Raises
    ------
    RecordingError
        If neither a conventional name nor a single column settles it.
    """
    for convention in CONVENTIONAL:
        if found := columns_of_kind(convention, names):
            return found
    others = [name for name in names if not is_time(name) and plain(name) not in ROW_NUMBERS]
    if len(others) == 1:
        return tuple(others)
    if not others:
        raise refused(
            path, f"its columns are {listed(names)}", "at least one, of numbers, beside time and index"
        )
    is_decimal = tuple(names) == ("c1", "c2")
    rule = "--delimiter ';' if 0,98 is one number; else " * is_decimal
    rule += "to say which hold the acceleration, by name or number: --column"
    rule += f" {_suggested(names, varying(others)) or 'NAMES'}"
    rule += " (`acceleration` under [channels] in a card)"
    raise refused(path, f"its columns are {listed(names)}", rule)


def signal_columns(names: Sequence[str], path: Path) -> tuple[str, ...]:
    """Return the columns of the only signal in a file: three axes, or one column, beside time and index.

    Raises
    ------
    RecordingError
        If there are others.
    """
    others = [name for name in names if not is_time(name) and plain(name) not in ROW_NUMBERS]
    found = _axes(others) or (tuple(others) if len(others) == 1 else ())
    if not found:
        raise refused(path, f"its columns are {listed(names)}", "one signal: a column, or axes x, y and z")
    return found


def turn_rate_factor(names: Sequence[str], path: Path) -> float:
    """Return the factor to rad/s by the unit in brackets behind the names of columns; 1 without any.

    Raises
    ------
    RecordingError
        If it is a unit of something else.
    """
    units = {match[1].lower() for name in names if (match := _OTHER_UNIT.search(name))}
    if units <= {"rad/s"}:
        return 1.0
    if units <= {"deg/s", "°/s", "dps"}:
        return math.pi / 180
    raise refused(path, f"its columns are in {', '.join(sorted(units))}", "a turn rate in rad/s or deg/s")


def _axes(names: Sequence[str]) -> tuple[str, ...]:
    """Return columns whose names differ in x, y and z at their end only; none if there are none."""
    plains = {re.sub(r"\s*[(\[][^)\]]*[)\]]", "", plain(name)): name for name in names}
    for one in plains:
        if (
            one.endswith("x")
            and (found := [plains.get(one[:-1] + axis, "") for axis in "xyz"])
            and all(found)
        ):
            return tuple(found)
    return ()


def _suggested(names: Sequence[str], candidates: Sequence[str]) -> str:
    """Return three axes, or the first three of the candidates, as --column takes them in a shell."""
    candidates = [name for name in candidates if not _OTHER_UNIT.search(name)]
    unnamed = len(names) > MOST_UNNAMED and all(re.fullmatch(r"c\d+", name) for name in names)
    triple = _axes(candidates) or ([] if unnamed else candidates[:3])
    typed = []
    for name in triple:
        by_number = str(list(names).index(name) + 1)
        is_typed = name.isprintable() and not name.startswith("-") and split_columns(name) == (name,)
        if is_typed or numbered((by_number,), names) == (name,):
            typed.append(name if is_typed else by_number)
    return shlex.quote(",".join(typed)) if typed else ""


def split_columns(text: str) -> tuple[str, ...]:
    """Return columns as people write them on a command line: "ax, ay, az"."""
    return tuple(name.strip() for name in text.split(","))


def columns_of_kind(convention: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns with the `plain` names of a convention, if each occurs once; else none."""
    meant = [plain(name) for name in names]
    is_met = all(meant.count(name) == 1 for name in convention)
    return tuple(names[meant.index(name)] for name in convention) if is_met else ()


def numbered(wanted: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return columns by name, with or without a unit behind it, or by number, counted from 1.

    Numbers are names where all of them are.
    """
    by_number = not set(wanted) <= set(names) and all(map(str.isdecimal, wanted))
    bare = [re.sub(r"\s*[(\[][^)\]]*[)\]]$", "", name) for name in names]

    def named(name: str) -> str:
        if name in names and not by_number:
            return name
        if name.isdecimal() and 1 <= int(name) <= len(names):
            return names[int(name) - 1]
        return names[bare.index(name)] if bare.count(name) == 1 else name

    return tuple(map(named, wanted))


def doubtful_numbers(wanted: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return how numbers of columns were read, if they are names of other columns too; else nothing."""
    places = {name: place for place, name in enumerate(names, 1)}
    numbers = {name: int(name) for name in wanted if name.isdecimal()}
    are_places = all(1 <= number <= len(names) for number in numbers.values())
    if not are_places or all(places.get(name, number) == number for name, number in numbers.items()):
        return ()
    chosen = numbered(wanted, names)
    how = "names" if chosen == tuple(wanted) else "numbers from 1"
    return (f"columns: {listed(wanted)} are read as {how}, the columns {listed(chosen)} of {listed(names)}",)


def require(wanted: Sequence[str], names: Sequence[str], path: Path, *, hint: str = "") -> None:
    """Check that every wanted column exists exactly once.

    Raises
    ------
    RecordingError
        Naming the first that does not.
    """
    for name in wanted:
        if (count := list(names).count(name)) != 1:
            raise RecordingError(
                f"{path}: column {name!r} occurs {count} times; its columns are {listed(names)}; "
                f"the rule is once, by name or by number from 1 to {len(names)}{hint}"
            )


def check_size(n_values: int, path: Path) -> None:
    """Refuse a file that announces more than `MAX_VALUES` values, before they are read."""
    if n_values > MAX_VALUES:
        raise refused(path, f"announces {n_values} values", f"at most {MAX_VALUES} a recording, split it")


def check_held(n_values: int, path: Path) -> None:
    """Refuse a file that announces more values than `MAX_VALUES`, or than its bytes can hold."""
    check_size(n_values, path)
    if 8 * n_values > max(1 << 26, MOST_EXPANSION * (size := path.stat().st_size)):
        raise refused(path, f"announces {n_values} values in {size} bytes", f"at most {MOST_EXPANSION} times")


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
        raise refused(path, f"{name} holds {array.dtype}", "real numbers")
    check_size(array.size, path)
    with np.errstate(over="ignore", invalid="ignore"):  # of wider floats: infinite, and refused as such
        samples = np.atleast_1d(np.squeeze(array)).astype(np.float64, copy=False)
    if samples.ndim > 2:
        raise refused(path, f"{name} has shape {array.shape}", "(n,) or (n, channels)")
    return samples.T if samples.ndim == 2 and samples.shape[0] < samples.shape[1] else samples


@contextmanager
def readable(path: Path, kind: str) -> Iterator[None]:
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


def refused(where: object, found: str, rule: str) -> RecordingError:
    """Return the error of a file: what was found there, and the rule that it breaks."""
    return RecordingError(f"{where}: {found}; the rule is {rule}")


def contradicting_rates(where: object, stated: str, given: float, rate_of: str) -> RecordingError:
    """Return the error of a file whose rate is not the given one, which may be that of the file `rate_of`."""
    if rate_of:
        other, remedy = f"{given:g} Hz in {rate_of}", "resample all files"
    else:
        other, remedy = f"{given:g} Hz was given", "omit --fs, or resample"
    return RecordingError(
        f"{where}: fs is {stated}, but {other}. Expected one rate: {remedy} with --resample HZ "
        "(`resample_hz` in a card)"
    )


def listed(names: Sequence[str], most: int = 8) -> str:
    """Return names for a message, cut short when there are many."""
    shown = ", ".join(repr(name) for name in list(names)[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown or "none"
