"""Names of columns: units in them, conventions for time and acceleration, how people refer to them."""

import math
import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

from texclass.loaders.readers import TIME_UNITS, quote_names, reader_error

TURN_RATE = ("wx", "wy", "wz")
"""Columns of a turn rate in a bag, rad/s."""
ACCELERATION = "acceleration"
"""Name of the only column of a format that does not name its columns."""
ROW_NUMBER = "index"
"""Name of the column that numbers the rows of a table, if it has none."""
_CONVENTIONAL = (
    (ACCELERATION,),
    *(tuple(f"{stem}{axis}" for axis in "xyz") for stem in ("", "a", "a ", "acc ", "accel ")),
    *(
        tuple(f"{stem} {axis}" for axis in "xyz")
        for stem in ("accelerometer", ACCELERATION, f"linear {ACCELERATION}")
    ),
)
"""Columns that are the acceleration unless others are given, see `plain`."""
_TIME_SUFFIXES = {
    **{unit: unit for unit in TIME_UNITS},
    **dict.fromkeys(("sec", "second", "seconds"), "s"),
    **dict.fromkeys(("millis", "milliseconds"), "ms"),
    **dict.fromkeys(("µs", "micros", "microseconds"), "us"),
}
"""End of a column's name -> its unit."""
_BRACKETED = {
    **dict.fromkeys(("m/s^2", "m/s2", "m/s²", "m/s/s", "m s-2", "ms-2", "m/(s^2)", "m/sec^2"), "m/s^2"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **{unit.lower(): unit for unit in ("g", "mg", "counts", "V")},
}
"""Unit in brackets after the name of a column -> unit of an acceleration."""
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
"""Units of other signals, or of another scale."""
_AXIS_OR_UNIT = ("n", "c")
"""Newton and Celsius, which in brackets can also be the names of axes."""
_UNIT = re.compile(
    rf"[(\[]\s*({'|'.join(map(re.escape, (*_BRACKETED, *_TIME_SUFFIXES)))})\s*[)\]]", re.IGNORECASE
)
_OTHER_UNIT = re.compile(rf"[(\[]\s*({'|'.join(map(re.escape, _OTHER_UNITS))})\s*[)\]]$", re.IGNORECASE)


def strip_unit(name: str) -> str:
    """Return a column's name without the unit in brackets behind it."""
    return _UNIT.sub("", name).strip()


def add_unit(name: str, unit: str) -> str:
    """Return a column's name with a unit behind it, unless it has this one or the unit is ""."""
    has_it = unit in map(parse_unit, re.findall(r"[(\[][^)\]]*[)\]]", name))
    return f"{name} [{unit}]" if unit and not has_it else name


def group_path(name: str) -> list[str]:
    """Return the groups, structs or sheet that a column is in, as its name states: "log/imu/x" is in two."""
    return re.split(r"[./]", strip_unit(name))[:-1]


def normalize_column(name: str) -> str:
    """Return a column's name as conventions are told: "ACCELEROMETER_X (m/s^2)" is "accelerometer x"."""
    return re.sub(r"[\s_]+", " ", strip_unit(name).lower()).strip()


def parse_unit(text: str) -> str:
    """Return a unit without brackets around it, "" if it is not known."""
    unit = re.sub(r"^\s*[(\[](.*)[)\]]\s*$", r"\1", text).strip()
    is_other = unit.lower() in {*_TIME_SUFFIXES, *_OTHER_UNITS, *_AXIS_OR_UNIT}
    return _BRACKETED.get(unit.lower(), unit if is_other else "")


def acceleration_unit(names: Sequence[str], path: Path) -> str | None:
    """Return the unit that stands in brackets behind the names of an acceleration's columns, if one does.

    Raises
    ------
    RecordingError
        If there are two, or one is a unit of something else or of another scale.
    """
    if other := next(filter(_OTHER_UNIT.search, names), None):
        raise reader_error(
            path,
            f"the column {other!r} is in another unit than an acceleration",
            f"{', '.join(dict.fromkeys(_BRACKETED.values()))}: convert its values, or rename it",
        )
    found = {_BRACKETED.get(unit.lower()) for name in names for unit in _UNIT.findall(name)} - {None}
    if len(found) > 1:
        raise reader_error(path, f"its columns are in {' and '.join(sorted(map(str, found)))}", "one unit")
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
    member = re.split(r"[./]", normalize_column(name))[-1]
    stem = re.sub(rf" ({'|'.join(_TIME_SUFFIXES)})$", "", member)
    return stem.endswith(" timestamp") or stem in (
        *("time", "t", "timestamp", "datetime", "date time", "epoch", "seconds elapsed", "elapsed", "zeit"),
        *("seconds", "milliseconds", "microseconds", "millis", "micros"),
    )


def _value_columns(names: Sequence[str]) -> list[str]:
    """Return the columns that neither are time stamps nor number the rows."""
    row_numbers = (ROW_NUMBER, "unnamed: 0", "index level 0", "#", "no", "nr", "row")
    return [name for name in names if not is_time(name) and normalize_column(name) not in row_numbers]


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
    for convention in _CONVENTIONAL:
        if found := match_convention(convention, names):
            return found
    others = _value_columns(names)
    if len(others) == 1:
        return tuple(others)
    if not others:
        raise reader_error(
            path, f"its columns are {quote_names(names)}", "at least one, of numbers, beside time and index"
        )
    is_decimal = tuple(names) == ("c1", "c2")
    rule = "--delimiter ';' if 0,98 is one number; else " * is_decimal
    rule += "to say which hold the acceleration, by name or number: --column"
    rule += f" {_suggest_columns(names, varying(others)) or 'NAMES'}"
    rule += " (`acceleration` under [channels] in a card)"
    raise reader_error(path, f"its columns are {quote_names(names)}", rule)


def signal_columns(names: Sequence[str], path: Path) -> tuple[str, ...]:
    """Return the columns of the only signal in a file: three axes, or one column, beside time and index.

    Raises
    ------
    RecordingError
        If there are others.
    """
    others = _value_columns(names)
    found = _axis_columns(others) or (tuple(others) if len(others) == 1 else ())
    if not found:
        raise reader_error(
            path, f"its columns are {quote_names(names)}", "one signal: a column, or axes x, y and z"
        )
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
    raise reader_error(
        path, f"its columns are in {', '.join(sorted(units))}", "a turn rate in rad/s or deg/s"
    )


def _axis_columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return columns whose names differ in x, y and z at their end only; none if there are none."""
    plains = {re.sub(r"\s*[(\[][^)\]]*[)\]]", "", normalize_column(name)): name for name in names}
    for stem in (name[:-1] for name in plains if name.endswith("x")):
        if all(f"{stem}{axis}" in plains for axis in "xyz"):
            return tuple(plains[f"{stem}{axis}"] for axis in "xyz")
    return ()


def _suggest_columns(names: Sequence[str], candidates: Sequence[str]) -> str:
    """Return three axes, or the first three of the candidates, as --column takes them in a shell."""
    candidates = [name for name in candidates if not _OTHER_UNIT.search(name)]
    # more than 8 columns without names are rather samples of a recording per row than axes
    is_row = len(names) > 8 and all(re.fullmatch(r"c\d+", name) for name in names)
    triple = _axis_columns(candidates) or ([] if is_row else candidates[:3])
    typed = []
    for name in triple:
        by_number = str(list(names).index(name) + 1)
        is_typed = name.isprintable() and not name.startswith("-") and split_columns(name) == (name,)
        if is_typed or resolve_columns((by_number,), names) == (name,):
            typed.append(name if is_typed else by_number)
    return shlex.quote(",".join(typed)) if typed else ""


def split_columns(text: str) -> tuple[str, ...]:
    """Return columns as people write them on a command line: "ax, ay, az"."""
    return tuple(name.strip() for name in text.split(","))


def match_convention(convention: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns with the `plain` names of a convention, if each occurs once; else none."""
    meant = [normalize_column(name) for name in names]
    is_met = all(meant.count(name) == 1 for name in convention)
    return tuple(names[meant.index(name)] for name in convention) if is_met else ()


def resolve_columns(wanted: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
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


def ambiguous_number_flags(wanted: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Return how numbers of columns were read, if they are names of other columns too; else nothing."""
    places = {name: place for place, name in enumerate(names, 1)}
    numbers = {name: int(name) for name in wanted if name.isdecimal()}
    are_places = all(1 <= number <= len(names) for number in numbers.values())
    if not are_places or all(places.get(name, number) == number for name, number in numbers.items()):
        return ()
    chosen = resolve_columns(wanted, names)
    how = "names" if chosen == tuple(wanted) else "numbers from 1"
    return (
        f"columns: {quote_names(wanted)} are read as {how}, the columns {quote_names(chosen)} "
        f"of {quote_names(names)}",
    )
