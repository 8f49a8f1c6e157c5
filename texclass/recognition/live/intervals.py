"""Intervals of contact: tables with the true surface of spans of time in recordings."""

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from texclass.loaders.data_files import normalize_name
from texclass.loaders.files import is_bag_name
from texclass.loaders.labels import HEADERS as LABEL_HEADERS
from texclass.loaders.labels import read_rows
from texclass.loaders.readers import BAG_METADATA, formats
from texclass.reporting.wording import counted

if TYPE_CHECKING:
    import pandas as pd

HEADERS: dict[str, tuple[str, ...]] = {
    "recording": ("recording", "file", "filename", "file name", "path"),
    "start_s": ("start s", "start", "onset s", "onset", "begin s", "begin"),
    "end_s": ("end s", "end", "stop s", "stop", "offset s", "offset"),
    "surface": LABEL_HEADERS["surface"],
}
"""Conventional names of each column; case, and underscores instead of blanks, are ignored."""
NO_CONTACT = "no contact"
"""Label of the time outside of the intervals, and of the time in which a stream reports no contact."""
NO_ANSWER = "no answer yet"
"""Label of the time from the detection of a contact to its first answer."""
MAX_PROBLEMS = 10
"""Largest number of invalid rows that a message lists."""


class Interval(NamedTuple):
    """Span of time in which the tool is in contact with one surface.

    Attributes
    ----------
    start_s, end_s
        Start and end in seconds since the first sample of the recording.
    surface
        True surface.
    row
        Line of the interval in its file, or 0.

    Examples
    --------
    >>> Interval(1.0, 3.5, "oak").surface
    'oak'
    """

    start_s: float
    end_s: float
    surface: str
    row: int = 0


class IntervalTable(NamedTuple):
    """Intervals of one or several recordings.

    Attributes
    ----------
    name
        Name of the table in messages.
    intervals
        Intervals by the name of their recording as in the table, in order of time. A recording without
        contact has no intervals. The name is "" if the table has no column for the recording.

    Examples
    --------
    >>> table = IntervalTable("table", {"": [Interval(1.0, 3.5, "oak")]})
    >>> len(table.intervals[""])
    1
    """

    name: str
    intervals: Mapping[str, Sequence[Interval]]


def read_intervals(table: "str | Path | pd.DataFrame") -> IntervalTable:
    """Read intervals of contact.

    Parameters
    ----------
    table : str, Path or DataFrame
        CSV file, or DataFrame, with the columns `start_s`, `end_s` (seconds since the first sample) and
        `surface`, and with `recording` if it describes several recordings. Other columns are ignored. A row
        with a recording and no other values declares a recording without contact.

    Returns
    -------
    IntervalTable

    Raises
    ------
    ValueError
        If the table is unreadable, a column is missing or occurs twice, or rows are invalid or overlap.

    Examples
    --------
    >>> import pandas as pd
    >>> frame = pd.DataFrame({"start": [0.5, 2.0], "end": [1.5, 4.0], "label": ["oak", "cork"]})
    >>> [interval.surface for interval in read_intervals(frame).intervals[""]]
    ['oak', 'cork']
    """
    if isinstance(table, str | Path):
        name, ((_, header), *rows) = str(table), read_rows(Path(table).expanduser(), "table of intervals")
    else:
        name, header = "intervals", [str(column) for column in table.columns]
        frame = table.astype(object).where(table.notna(), "").astype(str)
        rows = list(enumerate(frame.to_numpy().tolist(), start=1))
    places = _columns(name, header)
    problems: list[str] = []
    intervals: dict[str, list[Interval]] = {}
    for row, cells in rows:
        texts = [*cells, *[""] * (len(header) - len(cells))]
        values = {key: texts[place].strip() for key, place in places.items()}
        recording = normalize_name(values.pop("recording", "").replace("\\", "/"))
        if "recording" in places and not recording:
            problems.append(f"row {row} has no recording")
        elif recording and not any(values.values()):
            intervals.setdefault(recording, [])
        elif isinstance(interval := _parse(row, values), str):
            problems.append(interval)
        else:
            intervals.setdefault(recording, []).append(interval)
    for members in intervals.values():
        members.sort()
    problems += [problem for members in intervals.values() for problem in overlaps(members)]
    if problems:
        more = f"; and {len(problems) - MAX_PROBLEMS} more" if len(problems) > MAX_PROBLEMS else ""
        raise ValueError(
            f"{name}: {'; '.join(problems[:MAX_PROBLEMS])}{more}. Expected one row per contact, with "
            "start and end in seconds since the first sample, and a surface"
        )
    if not intervals:
        raise ValueError(
            f"{name}: no intervals. Expected one row per contact. For a recording without contact, add the "
            "column `recording`, and a row with its name and empty cells"
        )
    return IntervalTable(name, intervals)


def _columns(name: str, header: Sequence[str]) -> dict[str, int]:
    """Return the index of each column that is used, by its key in `HEADERS`."""
    places: dict[str, int] = {}
    problems = []
    for key, synonyms in HEADERS.items():
        matches = [i for i, column in enumerate(header) if column.lower().replace("_", " ") in synonyms]
        if len(matches) > 1:
            problems.append(f"several columns for `{key}` ({', '.join(header[i] for i in matches)})")
        elif matches:
            places[key] = matches[0]
        elif key != "recording":
            problems.append(f"no column `{key}`")
    if problems:
        raise ValueError(
            f"{name}: {'; '.join(problems)}. Expected the columns start_s, end_s and surface, and recording "
            f"for several recordings, got {', '.join(map(repr, header))}"
        )
    return places


def _parse(row: int, values: Mapping[str, str]) -> Interval | str:
    """Return the interval of a row, or its problem."""
    seconds = []
    for key in ("start_s", "end_s"):
        try:
            # With another delimiter, a comma is a decimal point, as in `texclass stream`.
            seconds.append(float(values[key].replace(",", ".")))
        except ValueError:
            return f"row {row}: {key} is {values[key]!r}, not a number"
    start_s, end_s = seconds
    if not (math.isfinite(start_s) and math.isfinite(end_s) and start_s >= 0):
        return f"row {row}: start and end must be finite and not negative, got {start_s:g} s and {end_s:g} s"
    if end_s <= start_s:
        return f"row {row}: ends at {end_s:g} s, which is not after its start at {start_s:g} s"
    if not values["surface"] or values["surface"] in (NO_CONTACT, NO_ANSWER):
        return f"row {row}: {values['surface'] or 'an empty cell'} is not a surface"
    return Interval(start_s, end_s, normalize_name(values["surface"]), row)


def overlaps(intervals: Sequence[Interval]) -> Iterator[str]:
    """Yield a description of each pair of consecutive intervals that overlap."""
    for one, other in pairwise(intervals):
        if other.start_s < one.end_s:
            yield (
                f"rows {one.row} and {other.row} overlap ({one.surface} until {one.end_s:g} s, "
                f"{other.surface} from {other.start_s:g} s)"
            )


def assign_intervals(
    table: IntervalTable, recordings: Sequence[str], folders: Sequence[str] = ()
) -> tuple[dict[str, list[Interval]], list[str]]:
    """Assign the intervals of a table to recordings.

    Names in the table are matched with the name of the recording, its path within the folder, its file name,
    or one of these without suffix, in this order. The name of a bag is that of its folder.

    Parameters
    ----------
    table : IntervalTable
        Intervals by name of the recording.
    recordings : sequence of str
        Names of the recordings: files, bags or DATASET:RECORDING.
    folders : sequence of str
        Folders that contain the recordings.

    Returns
    -------
    intervals : dict of str to list of Interval
        Intervals of each recording that the table describes.
    notices : list of str
        Notices about names in the table that match no recording.

    Raises
    ------
    ValueError
        If the table has no column for the recording and there are several recordings, a name matches several
        recordings, or no name matches.

    Examples
    --------
    >>> table = IntervalTable("table", {"oak_1": [Interval(1.0, 3.5, "oak")]})
    >>> assigned, notices = assign_intervals(table, ["new/oak_1.txt", "new/oak_2.txt"])
    >>> list(assigned)
    ['new/oak_1.txt']
    """
    if list(table.intervals) == [""]:
        if len(recordings) == 1:
            return {recordings[0]: list(table.intervals[""])}, []
        raise ValueError(
            f"{table.name}: no column `recording`, but there are {len(recordings)} recordings. Add the "
            "column with the file name of the recording of each interval"
        )
    levels = {recording: list(_names_of(recording, folders)) for recording in recordings}
    assigned: dict[str, list[Interval]] = {}
    unused = []
    for name, intervals in table.intervals.items():
        stem = _without_suffix(name)
        matches: list[str] = []
        for level in zip(*levels.values(), strict=True):
            matches = matches or [
                recording for recording, names in zip(levels, level, strict=True) if names & {name, stem}
            ]
        if len(matches) > 1:
            raise ValueError(
                f"{table.name}: {name!r} matches {' and '.join(matches[:3])}. Expected the full name of "
                "one of them"
            )
        if matches:
            assigned.setdefault(matches[0], []).extend(intervals)
        else:
            unused.append(name)
    if not assigned:
        closest = (
            difflib.get_close_matches(Path(recordings[0]).name, unused, n=1, cutoff=0.0) if recordings else []
        )
        raise ValueError(
            f"{table.name}: no row matches {', '.join(recordings[:3]) or 'a recording'}. Expected the names "
            f"of the recordings in the column `recording`, got {', '.join(map(repr, closest or unused[:3]))}"
        )
    for members in assigned.values():
        members.sort()
        if problems := list(overlaps(members)):
            raise ValueError(f"{table.name}: {'; '.join(problems[:MAX_PROBLEMS])}")
    names = ", ".join(unused[:5]) + (" and others" if len(unused) > 5 else "")
    count = counted(len(unused), "name")
    return assigned, [f"{table.name}: {count} without a recording: {names}"] if unused else []


def _names_of(recording: str, folders: Sequence[str]) -> Iterator[set[str]]:
    """Yield the names under which a table may list a recording, from the most to the least specific."""
    place = recording.removeprefix("bag:") if is_bag_name(recording) else recording
    place = place.partition("?topic=")[0]
    path = Path(place).expanduser()
    path = path.parent if path.name == BAG_METADATA else path  # the folder of a bag
    paths = {path.as_posix()}
    for folder in map(Path, folders):
        if path.is_relative_to(folder):
            relative = path.relative_to(folder)
            paths |= {relative.as_posix(), (folder.resolve().name / relative).as_posix()}
    name = path.name.rpartition(":")[2]
    yield {normalize_name(text) for text in (recording, place, path.resolve().as_posix())}
    yield {normalize_name(text) for text in paths}
    yield {normalize_name(name)}
    yield {normalize_name(_without_suffix(text)) for text in (*paths, name)}


def _without_suffix(name: str) -> str:
    """Return a name without the suffix of a recording file; "run_0.5" has none."""
    path = Path(name)
    return path.with_suffix("").as_posix() if path.suffix.lower() in formats() else name
