"""Parse dates and times of day as written by data loggers and spreadsheets (pandas parses ISO 8601)."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_PATTERN = (
    r"^\s*(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)[T, ]+"
    r"|(?P<first>\d\d?)(?P<mark>[-/.])(?P<second>\d\d?)[-/.](?P<last>\d{4})[T, ]+)?"
    r"(?P<hour>\d\d?):(?P<minute>\d\d):(?P<s>\d\d)(?:[:.,](?P<fraction>\d{1,9}))?\s*(?P<half>[AaPp][Mm])?\s*$"
)
_DATE = re.compile(_PATTERN)


def is_date(cell: str) -> bool:
    """Return whether a cell contains a date and time, or a time of day."""
    return _DATE.match(cell) is not None


def parse_dates(cells: Sequence[str]) -> NDArray[np.datetime64]:
    """Parse dates such as "2019-08-06 14:15:18:503", "6.8.2019 14:15:18" or "2:15:18 PM".

    Dates with slashes are read month first, other dates day first. A wrong order does not change time
    differences within one day.

    Parameters
    ----------
    cells : sequence of str
        Cells of a column.

    Returns
    -------
    ndarray of datetime64[ns]
        Times of day without a date are on 1970-01-01, and on the following day after they pass midnight.

    Raises
    ------
    ValueError
        If a cell is not a date.

    Examples
    --------
    >>> parse_dates(["6.8.2019 14:15:18.5"]).tolist()
    [1565100918500000000]
    """
    matches = list(map(_DATE.match, cells))
    rows = [match.groups("") for match in matches if match]
    if len(rows) < len(cells):
        raise ValueError(f"{cells[matches.index(None)]!r} is not a date like {cells[0]!r}")
    field = {
        name: np.array(texts) for name, texts in zip(_DATE.groupindex, zip(*rows, strict=True), strict=True)
    }

    def number(name: str) -> NDArray[np.int64]:
        return np.where(field[name] == "", "0", field[name]).astype(np.int64)

    is_month_first = field["mark"] == "/"
    month = number("month") + np.where(is_month_first, number("first"), number("second"))
    day = number("day") + np.where(is_month_first, number("second"), number("first"))
    year = number("year") + number("last")
    months = np.where(year > 0, 12 * (year - 1970) + month - 1, 0).astype("M8[M]")
    days = months.astype("M8[D]") + np.maximum(day - 1, 0)
    half = np.char.upper(field["half"])
    hour = np.where(half == "", number("hour"), number("hour") % 12 + 12 * (half == "PM"))
    fraction = np.char.ljust(field["fraction"], 9, "0").astype(np.int64)
    ns = ((hour * 60 + number("minute")) * 60 + number("s")) * 10**9 + fraction
    if not year.any():  # times of day that pass midnight continue on the next day
        ns += 86_400 * 10**9 * np.cumsum(np.diff(ns, prepend=ns[:1]) < -43_200 * 10**9)
    return np.asarray(days.astype("M8[ns]") + ns.astype("m8[ns]"))
