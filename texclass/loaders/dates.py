"""Parse dates and times of day as written by data loggers and spreadsheets (pyarrow parses ISO 8601)."""

import re

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
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


def parse_dates(column: pa.ChunkedArray) -> NDArray[np.datetime64]:
    """Parse dates such as "2019-08-06 14:15:18:503", "6.8.2019 14:15:18" or "2:15:18 PM".

    Dates with slashes are read month first, other dates day first. A wrong order does not change time
    differences within one day.

    Parameters
    ----------
    column : pyarrow.ChunkedArray
        Cells as text.

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
    >>> import pyarrow as pa
    >>> parse_dates(pa.chunked_array([["6.8.2019 14:15:18.5"]])).tolist()
    [1565100918500000000]
    """
    parts = pc.extract_regex(column.combine_chunks(), _PATTERN)
    if parts.null_count:
        invalid = column[int(np.flatnonzero(parts.is_null().to_numpy(zero_copy_only=False))[0])]
        raise ValueError(f"{invalid.as_py()!r} is not a date like {column[0].as_py()!r}")
    field = {name: parts.field(i) for i, name in enumerate(_DATE.groupindex)}

    def number(name: str) -> NDArray[np.int64]:
        cells = pc.if_else(pc.equal(field[name], ""), "0", field[name])
        return np.asarray(pc.cast(cells, pa.int64()).to_numpy(zero_copy_only=False))

    is_month_first = pc.equal(field["mark"], "/").to_numpy(zero_copy_only=False)
    month = number("month") + np.where(is_month_first, number("first"), number("second"))
    day = number("day") + np.where(is_month_first, number("second"), number("first"))
    year = number("year") + number("last")
    months = np.where(year > 0, 12 * (year - 1970) + month - 1, 0).astype("M8[M]")
    days = months.astype("M8[D]") + np.maximum(day - 1, 0)
    half = pc.ascii_upper(field["half"])
    is_pm, has_half = (
        pc.equal(half, "PM").to_numpy(zero_copy_only=False),
        pc.not_equal(half, "").to_numpy(zero_copy_only=False),
    )
    hour = np.where(has_half, number("hour") % 12, number("hour")) + 12 * is_pm
    fraction = pc.cast(pc.utf8_rpad(field["fraction"], 9, "0"), pa.int64()).to_numpy(zero_copy_only=False)
    ns = ((hour * 60 + number("minute")) * 60 + number("s")) * 10**9 + fraction
    if not year.any():  # times of day that pass midnight continue on the next day
        ns += 86_400 * 10**9 * np.cumsum(np.diff(ns, prepend=ns[:1]) < -43_200 * 10**9)
    return np.asarray(days.astype("M8[ns]") + ns.astype("m8[ns]"))
