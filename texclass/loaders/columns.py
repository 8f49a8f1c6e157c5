"""Column names: units, recognition of time and acceleration columns, and selection by name or number."""

import math
import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

from texclass.loaders.readers import TIME_UNITS, quote_names, reader_error

TURN_RATE = ("wx", "wy", "wz")
"""Columns of the turn rate in a bag, in rad/s."""
ACCELERATION = "acceleration"
"""Signal of a recording, and name of the only column in formats without column names."""
ROW_NUMBER = "index"
"""Name of an unnamed column that numbers the rows of a table."""
_CONVENTIONAL = (
    (ACCELERATION,),
    *(tuple(f"{stem}{axis}" for axis in "xyz") for stem in ("", "a", "a ", "acc ", "accel ")),
    *(
        tuple(f"{stem} {axis}" for axis in "xyz")
        for stem in ("accelerometer", ACCELERATION, f"linear {ACCELERATION}")
    ),
)
"""Conventional columns of the acceleration, as `normalize_column` returns their names."""
_TIME_SUFFIXES = {
    **{unit: unit for unit in TIME_UNITS},
    **dict.fromkeys(("sec", "second", "seconds"), "s"),
    **dict.fromkeys(("millis", "milliseconds"), "ms"),
    **dict.fromkeys(("µs", "micros", "microseconds"), "us"),
}
"""Time unit by suffix of a column name."""
_BRACKETED = {
    **dict.fromkeys(("m/s^2", "m/s2", "m/s²", "m/s/s", "m s-2", "ms-2", "m/(s^2)", "m/sec^2"), "m/s^2"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **{unit.lower(): unit for unit in ("g", "mg", "counts", "V")},
}
"""Unit of an acceleration by the text in brackets after a column name."""
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
        "k",
        "hz",
        "pa",
        "hpa",
        "%",
        "lsb",
    ),
)
"""Units of other signals, or of accelerations in an unsupported scale."""
_AXIS_OR_UNIT = ("n", "c")
"""Symbols of newton and degree Celsius; in brackets, they may also be names of axes."""
_UNIT = re.compile(
    rf"[(\[]\s*({'|'.join(map(re.escape, (*_BRACKETED, *_TIME_SUFFIXES)))})\s*[)\]]", re.IGNORECASE
)
_OTHER_UNIT = re.compile(rf"[(\[]\s*({'|'.join(map(re.escape, _OTHER_UNITS))})\s*[)\]]$", re.IGNORECASE)


def strip_unit(name: str) -> str:
    """Return a column name without the unit in brackets."""
    return _UNIT.sub("", name).strip()


def add_unit(name: str, unit: str) -> str:
    """Return a column name with a unit in brackets, unless it has this unit or the unit is ""."""
    has_unit = unit in map(parse_unit, re.findall(r"[(\[][^)\]]*[)\]]", name))
    return f"{name} [{unit}]" if unit and not has_unit else name


def group_path(name: str) -> list[str]:
    """Return the groups, structs or sheet in a column name: ["log", "imu"] for "log/imu/x"."""
    return re.split(r"[./]", strip_unit(name))[:-1]


def normalize_column(name: str) -> str:
    """Return a column name for comparison: "accelerometer x" for "ACCELEROMETER_X (m/s^2)"."""
    return re.sub(r"[\s_]+", " ", strip_unit(name).lower()).strip()


def parse_unit(text: str) -> str:
    """Return a unit without brackets; "" if it is unknown."""
    unit = re.sub(r"^\s*[(\[](.*)[)\]]\s*$", r"\1", text).strip()
    is_other = unit.lower() in {*_TIME_SUFFIXES, *_OTHER_UNITS, *_AXIS_OR_UNIT}
    return _BRACKETED.get(unit.lower(), unit if is_other else "")


def acceleration_unit(names: Sequence[str], path: Path) -> str | None:
    """Return the unit in brackets after the column names of an acceleration; None if there is none.

    Raises
    ------
    RecordingError
        If there are several units, or one is not a supported unit of acceleration.
    """
    if other := next(filter(_OTHER_UNIT.search, names), None):
        raise reader_error(
            path,
            f"the unit of the column {other!r} is not supported for an acceleration",
            f"{', '.join(dict.fromkeys(_BRACKETED.values()))}: convert the values, or rename the column",
        )
    units = {_BRACKETED.get(unit.lower()) for name in names for unit in _UNIT.findall(name)} - {None}
    if len(units) > 1:
        problem = f"its columns have the units {' and '.join(sorted(map(str, units)))}"
        raise reader_error(path, problem, "the same unit for all axes")
    return next(iter(units), None)


def time_unit(name: str) -> str | None:
    """Return the time unit in a column name such as "t (ms)" or "time_us"; None if there is none."""
    match = re.search(rf"(?:\b|_)({'|'.join(_TIME_SUFFIXES)})\b", name.lower())
    return _TIME_SUFFIXES[match[1]] if match else None


def is_time(name: str) -> bool:
    """Return whether a column name denotes time stamps, such as "time", "t_us", "data.t" or "clock (ms)"."""
    unit = _UNIT.search(name)
    if unit and unit[1].lower() in _TIME_SUFFIXES:
        return True
    member = re.split(r"[./]", normalize_column(name))[-1]
    stem = re.sub(rf" ({'|'.join(_TIME_SUFFIXES)})$", "", member)
    return stem.endswith(" timestamp") or stem in (
        *("time", "t", "timestamp", "datetime", "date time", "epoch", "seconds elapsed", "elapsed", "zeit"),
        *("seconds", "milliseconds", "microseconds", "millis", "micros"),
    )


def _value_columns(names: Sequence[str]) -> list[str]:
    """Return the columns that contain neither time stamps nor row numbers."""
    row_numbers = (ROW_NUMBER, "unnamed: 0", "index level 0", "#", "no", "nr", "row")
    return [name for name in names if not is_time(name) and normalize_column(name) not in row_numbers]


def choose_acceleration(
    names: Sequence[str],
    path: Path,
    varying: Callable[[Sequence[str]], Sequence[str]] = lambda names: names,
) -> tuple[str, ...]:
    """Return the column(s) of the acceleration by their conventional names, or the only column.

    Parameters
    ----------
    names : sequence of str
        Names of all columns.
    path : Path
        File, for messages.
    varying : callable, optional
        Function that selects the columns that may contain an acceleration, for the suggestion in the message.

    Raises
    ------
    RecordingError
        If several columns remain and none has a conventional name.

    Examples
    --------
    >>> choose_acceleration(["time", "ax", "ay", "az", "force"], Path("oak.csv"))
    ('ax', 'ay', 'az')
    """
    for convention in _CONVENTIONAL:
        if columns := match_convention(convention, names):
            return columns
    others = _value_columns(names)
    if len(others) == 1:
        return tuple(others)
    if not others:
        raise reader_error(
            path,
            f"its columns are {quote_names(names)}",
            "at least one column of numbers other than time and index",
        )
    has_decimal_commas = tuple(names) == ("c1", "c2")
    expected = "--delimiter ';' if 0,98 is one number; otherwise " * has_decimal_commas
    expected += f"--column {_suggest_columns(names, varying(others)) or 'NAMES'}"
    expected += " (by name or number; `acceleration` under [channels] in a card)"
    raise reader_error(
        path, f"cannot identify the acceleration; the columns are {quote_names(names)}", expected
    )


def signal_columns(names: Sequence[str], path: Path) -> tuple[str, ...]:
    """Return the columns of the only signal in a file: three axes or one column, without time and index.

    Raises
    ------
    RecordingError
        If the file contains more than one signal, or none.
    """
    values = _value_columns(names)
    columns = _axis_columns(values) or (tuple(values) if len(values) == 1 else ())
    if not columns:
        raise reader_error(
            path, f"its columns are {quote_names(names)}", "one signal: one column, or the axes x, y and z"
        )
    return columns


def turn_rate_factor(names: Sequence[str], path: Path) -> float:
    """Return the factor that converts the unit in brackets after the column names to rad/s (default 1).

    Raises
    ------
    RecordingError
        If the unit is not a supported unit of turn rate.
    """
    units = {match[1].lower() for name in names if (match := _OTHER_UNIT.search(name))}
    if units <= {"rad/s"}:
        return 1.0
    if units <= {"deg/s", "°/s", "dps"}:
        return math.pi / 180
    raise reader_error(
        path, f"its columns have the unit {', '.join(sorted(units))}", "a turn rate in rad/s or deg/s"
    )


def _axis_columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return three columns whose names differ only in a final x, y or z; an empty tuple if there are none."""
    by_normal_name = {re.sub(r"\s*[(\[][^)\]]*[)\]]", "", normalize_column(name)): name for name in names}
    for stem in (name[:-1] for name in by_normal_name if name.endswith("x")):
        if all(f"{stem}{axis}" in by_normal_name for axis in "xyz"):
            return tuple(by_normal_name[f"{stem}{axis}"] for axis in "xyz")
    return ()


def _suggest_columns(names: Sequence[str], candidates: Sequence[str]) -> str:
    """Return three axes, or the first three candidates, as a value of --column, quoted for the shell."""
    candidates = [name for name in candidates if not _OTHER_UNIT.search(name)]
    # More than 8 unnamed columns are probably the samples of one recording per row.
    is_row = len(names) > 8 and all(re.fullmatch(r"c\d+", name) for name in names)
    columns = _axis_columns(candidates) or ([] if is_row else candidates[:3])
    arguments = []
    for name in columns:
        number = str(list(names).index(name) + 1)
        is_usable = name.isprintable() and not name.startswith("-") and split_columns(name) == (name,)
        if is_usable or resolve_columns((number,), names) == (name,):
            arguments.append(name if is_usable else number)
    return shlex.quote(",".join(arguments)) if arguments else ""


def split_columns(text: str) -> tuple[str, ...]:
    """Return the columns of a command-line value such as "ax, ay, az"."""
    return tuple(name.strip() for name in text.split(","))


def match_convention(convention: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns with the normalized names of a convention; () unless each occurs once."""
    normal_names = [normalize_column(name) for name in names]
    has_all = all(normal_names.count(name) == 1 for name in convention)
    return tuple(names[normal_names.index(name)] for name in convention) if has_all else ()


def resolve_columns(wanted: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return columns selected by name (with or without unit) or by number, counted from 1.

    If all numbers are also names of columns, they are treated as names.

    Examples
    --------
    >>> resolve_columns(["x", "3"], ["t", "x [g]", "y [g]"])
    ('x [g]', 'y [g]')
    """
    by_number = not set(wanted) <= set(names) and all(map(str.isdecimal, wanted))
    names_without_unit = [re.sub(r"\s*[(\[][^)\]]*[)\]]$", "", name) for name in names]

    def resolve(name: str) -> str:
        if name in names and not by_number:
            return name
        if name.isdecimal() and 1 <= int(name) <= len(names):
            return names[int(name) - 1]
        is_unique = names_without_unit.count(name) == 1
        return names[names_without_unit.index(name)] if is_unique else name

    return tuple(map(resolve, wanted))


def ambiguous_number_flags(wanted: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return a flag if column numbers are also names of other columns."""
    positions = {name: position for position, name in enumerate(names, 1)}
    numbers = {name: int(name) for name in wanted if name.isdecimal()}
    are_valid = all(1 <= number <= len(names) for number in numbers.values())
    if not are_valid or all(positions.get(name, number) == number for name, number in numbers.items()):
        return ()
    chosen = resolve_columns(wanted, names)
    interpretation = "names" if chosen == tuple(wanted) else "numbers from 1"
    return (
        f"columns: {quote_names(wanted)} are read as {interpretation} and select {quote_names(chosen)} "
        f"from {quote_names(names)}",
    )
