"""Read text files (.txt, CSV, TSV, LabVIEW) with one value per line or columns.

`text_layout` finds the first row, the delimiter and the names of the columns. Numbers may have decimal
commas, and a column of time stamps may contain dates.
"""

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from texclass.loaders.columns import is_time
from texclass.loaders.dates import is_date, parse_dates
from texclass.loaders.readers import (
    ReaderSettings,
    ReadSignals,
    check_size,
    reader_error,
    require_columns,
)
from texclass.loaders.text_layout import (
    DATE,
    MISSING,
    TextLayout,
    find_layout,
    is_number,
    open_text,
    split_cells,
)
from texclass.recording import RecordingError
from texclass.reporting.wording import counted

NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
"""Number with a decimal point or comma."""
NOT_A_NUMBER = ("nan", "NaN", "NAN", "-nan", "-NaN", "-NAN", "+nan", "+NaN", "+NAN")
"""Notations of NaN; other texts in a column of numbers are errors."""
_IS_ROUNDED = tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1)
"""Whether pandas, by default, reads some numbers with an error in the last digit."""


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the names of the columns, from the lines above the rows.

    Raises
    ------
    RecordingError
        If the file is not text, or has no rows of numbers.
    """
    return find_layout(_content(path), str(path), settings).names


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read columns; blank lines and comments are skipped.

    Raises
    ------
    RecordingError
        If a column is missing, a cell or line is not a number, or lines differ in the number of cells.
    """
    return read_text(_content(path), str(path), wanted, settings)


def _content(path: Path) -> bytes:
    check_size(path.stat().st_size // 2, path)
    return path.read_bytes()


def read_text(data: bytes, where: str, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read columns from the content of a text file; `where` is its name, see `find_layout`."""
    layout = find_layout(data, where, settings)
    is_one = len(layout.names) == 1
    hint = f" (is {layout.delimiter!r} the delimiter? --delimiter, `delimiter` in a card)" if is_one else ""
    require_columns(wanted, layout.names, where, hint=hint)
    # A column contains dates if its first cell is a date.
    first = dict(zip(layout.names, layout.first, strict=False))
    dates = {name: cell for name, cell in first.items() if name in wanted and _is_date(cell)}
    rows, n_comments = _rows(data, layout)
    flags = [*layout.flags]
    if n_comments:
        flags.append(f"comments: {counted(n_comments, 'comment line')} between the rows skipped")
    problem: Exception | None = None
    if not settings.drop_incomplete and not _is_rectangular(rows, layout):
        raise _bad_line(data, where, layout, wanted, dates, "lines differ in the number of cells")
    for decimal in ".,":
        try:
            n_dropped = 0
            if settings.drop_incomplete:
                signals, n_dropped = _complete(rows, layout, wanted, dates, decimal)
            else:
                signals = _columns(rows, layout, wanted, dates, decimal)
        except ValueError as error:  # includes the errors of pandas
            problem = problem or error
            continue
        if n_dropped:
            flags.append(f"incomplete: {counted(n_dropped, 'line')} without a number in each column dropped")
        if decimal == ",":
            flags.append("decimals: commas are read as decimal points")
        has_time_stamps = any(map(is_time, wanted))
        return ReadSignals(signals, None if has_time_stamps else layout.fs, flags=tuple(flags))
    raise _bad_line(data, where, layout, wanted, dates, str(problem)) from problem


def _rows(data: bytes, layout: TextLayout) -> tuple[bytes, int]:
    """Return the rows of a text in a form that pandas can read, and the number of removed comment lines.

    If pandas can read the rows as they are, they are not decoded.
    """
    any_mark = b"|".join(re.escape(mark.encode()) for mark in layout.comments)
    if layout.encoding != "utf-16" and layout.is_plain and layout.delimiter != " ":
        begin = 0
        for _, end in zip(range(layout.n_above), re.compile(rb"\n").finditer(data), strict=False):
            begin = end.end()
        if not any_mark or not re.compile(rb"\n(?:" + any_mark + rb")").search(data, max(begin - 1, 0)):
            return data[begin:], 0
    lines = open_text(data, layout.encoding, errors="replace").read().split("\n", layout.n_above)
    text = lines[-1].encode("utf-8", "replace") if len(lines) > layout.n_above else b""
    n_comments = 0
    if any_mark:
        text, n_comments = re.subn(rb"(?m)^[ \t]*(?:" + any_mark + rb").*\n?", b"", text)
    if layout.delimiter == " ":  # any number of blanks between aligned numbers
        text = text.replace(b"\t", b" ")
        while b"  " in text:  # a regular expression would be slower than reading the numbers
            text = text.replace(b"  ", b" ")
        text = text.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")
    return text, n_comments


def _is_rectangular(rows: bytes, layout: TextLayout) -> bool:
    """Return whether all lines that are not blank have the same number of cells. pandas does not check it."""
    codes = np.frombuffer(rows if rows.endswith(b"\n") else rows + b"\n", np.uint8)
    marks = codes[(codes == ord("\n")) | (codes == ord(layout.delimiter))]
    n_delimiters = np.diff(np.flatnonzero(marks == ord("\n")), prepend=-1) - 1
    if (n_delimiters == layout.width - 1).all():
        return True
    # Blank lines, or delimiters in quotes.
    return all(len(_split(line, layout)) == layout.width for line in _lines(rows))


def _lines(rows: bytes) -> list[str]:
    """Return the lines that are not blank."""
    return [line for line in rows.decode("utf-8", "replace").split("\n") if line.strip()]


def _split(line: str, layout: TextLayout) -> list[str]:
    is_quoted = '"' in line
    return split_cells(line, layout.delimiter) if is_quoted else line.split(layout.delimiter)


def _complete(
    rows: bytes, layout: TextLayout, wanted: tuple[str, ...], dates: Mapping[str, str], decimal: str
) -> tuple[dict[str, NDArray[Any]], int]:
    """Read the lines with a number or date in each column. Return the number of other lines, too."""
    columns = [(layout.names.index(name), dates.get(name)) for name in wanted]
    lines, complete = _lines(rows), []
    for line in lines:
        cells = [cell.strip() for cell in _split(line, layout)]
        if len(cells) == layout.width and all(
            _is_date(cells[i], like) if like else NUMBER.fullmatch(cells[i]) for i, like in columns
        ):
            complete.append([cells[i] for i, _ in columns])
    texts = zip(*complete, strict=True) if complete else ([] for _ in wanted)
    signals: dict[str, NDArray[Any]] = {
        name: _parse_dates(list(cells))
        if name in dates
        else np.array([float(cell.replace(decimal, ".")) for cell in cells])
        for name, cells in zip(wanted, texts, strict=True)
    }
    return signals, len(lines) - len(complete)


def _columns(
    rows: bytes, layout: TextLayout, wanted: tuple[str, ...], dates: Mapping[str, str], decimal: str
) -> dict[str, NDArray[Any]]:
    """Read columns of numbers and of dates."""
    at = {name: layout.names.index(name) for name in wanted}
    numeric = [i for name, i in at.items() if name not in dates]
    for i in numeric:
        if layout.first and layout.first[i].lower() in {"true", "false"}:  # pandas would read 1 and 0
            raise ValueError(f"{layout.first[i]!r} is not a number")
    options: dict[str, Any] = {"na_values": dict.fromkeys(numeric, NOT_A_NUMBER)}
    if _IS_ROUNDED:
        options["float_precision"] = "round_trip"
    frame = pd.read_csv(
        io.BytesIO(rows),
        header=None,
        names=range(layout.width),
        index_col=False,
        usecols=sorted(at.values()),
        dtype={i: "float64" if i in numeric else "object" for i in at.values()},
        sep=layout.delimiter,
        decimal=decimal,
        skipinitialspace=True,
        keep_default_na=False,
        encoding_errors="replace",
        engine="c",
        low_memory=False,
        **options,
    )
    return {
        name: _parse_dates([cell.strip() for cell in frame[i]]) if name in dates else frame[i].to_numpy()
        for name, i in at.items()
    }


def _is_date(cell: str, like: str = "") -> bool:
    """Return whether a cell is a date, in ISO 8601 if `like` is."""
    is_iso = DATE.fullmatch(cell) is not None
    return is_iso or (is_date(cell) and not DATE.fullmatch(like))


def _parse_dates(cells: list[str]) -> NDArray[np.datetime64]:
    """Parse dates, as ISO 8601 if the first one is; either all dates have a time zone or none has."""
    if cells and not DATE.fullmatch(cells[0]):
        return parse_dates(cells)
    has_zones = {match and bool(match[1]) for match in map(DATE.fullmatch, cells)}
    if None in has_zones or len(has_zones) > 1:
        raise ValueError(f"a cell is not a date like {cells[0]!r}")
    stamps = pd.to_datetime(cells, format="ISO8601", utc=True).tz_localize(None)
    return stamps.as_unit("ns").to_numpy()


def _bad_line(
    data: bytes,
    where: str,
    layout: TextLayout,
    wanted: tuple[str, ...],
    dates: Mapping[str, str],
    problem: str,
) -> RecordingError:
    """Return the error for the first invalid line. Its message lists options that skip the line."""
    is_one = layout.width == 1
    expected = "one number per line" if is_one else "a number in every cell"
    for number, line in enumerate(open_text(data, layout.encoding, errors="replace"), start=1):
        beginning = line.lstrip()
        is_comment = bool(layout.comments) and beginning.startswith(layout.comments)
        if number <= layout.n_above or not beginning or is_comment:
            continue
        cells = split_cells(line.rstrip("\r\n"), layout.delimiter)
        present = zip(layout.names, cells, strict=False)
        column = next(
            (
                name
                for name, cell in present
                if name in wanted and not (_is_date(cell, dates[name]) if name in dates else is_number(cell))
            ),
            None,
        )
        if len(cells) == layout.width and column is None:
            continue
        kind = "date" if column in dates else "number"
        reason = f", column {column!r} is not a {kind}" if column and not is_one else ""
        if len(cells) != layout.width and not is_one:
            reason = f" with {counted(len(cells), 'cell')}, but the other lines have {layout.width}"
        options = ["--drop-incomplete drops such lines (`drop_incomplete` in a card)"]
        if not any(map(is_number, cells)) and any(cell.lower() not in MISSING for cell in cells):
            skips = f"--skip-rows {number} skips this line and those above it (`skip_rows` in a card)"
            # A text within the first three lines probably belongs above the table.
            options.insert(0 if number - layout.n_above <= 3 else 1, skips)
        if re.match(r"""[^\w\s"'+.,;-]""", beginning):
            options.append(f"--comment {beginning[0]!r} skips lines that start with it (`comment` in a card)")
        text = f"line {number} is {line.strip()[:40]!r}{reason}"
        return RecordingError(f"{where}: {text}. Expected {expected}. {', '.join(options)}")
    return reader_error(where, problem, expected)
