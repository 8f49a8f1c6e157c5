"""Read a sheet of an Excel workbook (.xlsx) as a text table."""

import csv
import io
import os
import warnings
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any, cast

import openpyxl

from texclass.document.wording import counted
from texclass.loaders import tables
from texclass.loaders.columns import ReadOptions, ReadSignals, readable, refused
from texclass.loaders.text_layout import is_number

MOST_EXPANSION = 100
"""A workbook that expands to more than so many times its size (and more than 64 MB) is refused."""
LEAST_ROWS = 2
"""Rows with a number from which a sheet has a table."""


@dataclass(frozen=True)
class SheetText:
    """A sheet as comma-separated text, with the methods of `Path` by which text tables are read.

    Attributes
    ----------
    name : str
        File and sheet, for messages.
    data : bytes
        The text (UTF-8).
    flags : tuple of str
        What was assumed.
    """

    name: str
    data: bytes
    flags: tuple[str, ...] = ()
    suffix = ".csv"

    def __str__(self) -> str:
        return self.name

    def open(self, mode: str = "r", **how: Any) -> IO[Any]:
        """Return the text as an open file."""
        file = io.BytesIO(self.data)
        return file if "b" in mode else io.TextIOWrapper(file, **how)

    def read_text(self, encoding: str, errors: str) -> str:
        """Return the text."""
        return self.data.decode(encoding, errors)

    def read_bytes(self) -> bytes:
        """Return the text, encoded."""
        return self.data

    def stat(self) -> SimpleNamespace:
        """Return the size in bytes."""
        return SimpleNamespace(st_size=len(self.data))


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the columns of the sheet that is read.

    Raises
    ------
    RecordingError
        If it is no workbook, or no sheet has rows of numbers.
    """
    return tables.names(cast("Path", _sheet(path)), options)


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> ReadSignals:
    """Read the wanted columns of the first sheet with rows of numbers; formulas have their stored values.

    Raises
    ------
    RecordingError
        If a column is not there, or a cell is not a number.
    """
    sheet = _sheet(path)
    found = tables.read(cast("Path", sheet), wanted, options)
    return replace(found, flags=(*sheet.flags, *found.flags))


def _sheet(path: Path) -> SheetText:
    state = path.stat()
    return _read_sheet(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=1)  # names and columns are read one after another
def _read_sheet(path: Path, modified: int, size: int) -> SheetText:
    with readable(path, "Excel"), zipfile.ZipFile(path) as archive:
        expanded = sum(member.file_size for member in archive.infolist())
        if expanded > max(1 << 26, MOST_EXPANSION * size):
            raise refused(path, f"expands to {expanded} bytes", f"64 MB, or {MOST_EXPANSION} times its size")
    found: list[tuple[str, str]] = []
    with readable(path, "Excel"), warnings.catch_warnings(), path.open("rb") as file:
        warnings.simplefilter("ignore")  # of styles and extensions that are not read
        book = openpyxl.load_workbook(file, read_only=True, data_only=True, keep_links=False)
        for sheet in book.worksheets:
            sheet.reset_dimensions()  # stated ones may be wrong
            if text := _text(sheet.iter_rows(values_only=True)):
                found.append((sheet.title, text))
    if not found:
        raise refused(path, "no sheet has rows of numbers", f"a sheet with at least {LEAST_ROWS}")
    title, text = found[0]
    others = counted(len(found) - 1, "other sheet")
    flags = (f"sheet: {title!r:.40} is read, {others} with numbers not",) if len(found) > 1 else ()
    return SheetText(f"{os.fspath(path)} (sheet {title!r:.40})", text.encode(), flags)


def _text(rows: Iterable[Sequence[Any]]) -> str:
    """Return rows that are not blank as comma-separated text, without blank columns; "" without a table."""
    cells = [[_cell(value) for value in row] for row in rows]
    width = max(map(len, cells), default=0)
    padded = [row + [""] * (width - len(row)) for row in cells if any(row)]
    used = [i for i in range(width) if any(row[i] for row in padded)]
    if sum(any(map(is_number, filter(None, row))) for row in padded) < LEAST_ROWS:
        return ""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([row[i] for i in used] for row in padded)
    return text.getvalue()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    if isinstance(value, datetime):
        return value.isoformat(" ")
    return value.isoformat() if isinstance(value, date) else str(value).strip()
