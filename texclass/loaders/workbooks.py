"""Read Excel workbooks (.xlsx); each sheet is converted to a text table."""

import csv
import io
import warnings
import zipfile
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import date, datetime, time, timedelta
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, NamedTuple
from xml.parsers import expat

import openpyxl

from texclass.loaders import tables
from texclass.loaders.columns import is_time
from texclass.loaders.readers import (
    ReaderSettings,
    ReadSignals,
    quote_names,
    reader_error,
    require_columns,
    wrap_library_errors,
)
from texclass.loaders.text_layout import find_layout, is_number
from texclass.reporting.wording import counted

MAX_EXPANSION = 100
"""Largest ratio of the expanded size of a workbook to the size of the file, above 64 MB."""
MAX_ROWS = 1 << 20
"""Largest number of rows of a sheet, as in Excel."""
MAX_CELLS = 1 << 24
"""Largest number of cells of a sheet, including blank cells: 8 columns of 3.5 minutes at 10 kHz. A file of a
few kilobytes can announce 1000 times as many."""
MIN_ROWS = 2
"""Smallest number of rows with a number in a sheet that counts as a table."""


class Sheet(NamedTuple):
    """A sheet as comma-separated text."""

    title: str
    where: str
    """File and sheet, for messages."""
    prefix: str
    """Prefix of the column names."""
    data: bytes

    def names(self, settings: ReaderSettings) -> tuple[str, ...]:
        """Return the names of the columns."""
        return tuple(self.prefix + name for name in find_layout(self.data, self.where, settings).names)


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the columns of the first sheet with rows of numbers, then of other sheets as "sheet/column".

    Raises
    ------
    RecordingError
        If the file is not a workbook, or no sheet has rows of numbers.
    """
    return tuple(name for sheet in _sheets(path) for name in sheet.names(settings))


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read columns of one sheet; for formulas, the stored results are read.

    Raises
    ------
    RecordingError
        If a column is missing, a cell is not a number, or the columns are in several sheets.
    """
    sheets = [(sheet, sheet.names(settings)) for sheet in _sheets(path)]
    require_columns(wanted, [name for _, names in sheets for name in names], path)
    match = next(((sheet, names) for sheet, names in sheets if set(wanted) <= set(names)), None)
    if match is None:
        raise reader_error(path, f"{quote_names(wanted)} are in several sheets", "columns of one sheet")
    sheet, columns = match
    inner_names = {name: name.removeprefix(sheet.prefix) for name in wanted}
    signals = tables.read_text(sheet.data, sheet.where, tuple(inner_names.values()), settings)
    flags: tuple[str, ...] = ()
    if len(sheets) > 1:
        n_others = counted(len(sheets) - 1, "other sheet")
        other = next(names for _, names in sheets if names != columns)
        example = next((name for name in other if not is_time(name)), other[0])
        hint = f"to select another, pass --column, e.g. {example!r:.60}"
        flags = (f"sheet: {sheet.title!r:.40} is read, {n_others} ignored; {hint}",)
    selected = {name: signals.signals[column] for name, column in inner_names.items()}
    return replace(signals, signals=selected, flags=(*flags, *signals.flags))


def _sheets(path: Path) -> tuple[Sheet, ...]:
    state = path.stat()
    return _read_sheets(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=1)  # `names` and `read` are called one after the other
def _read_sheets(path: Path, modified: int, size: int) -> tuple[Sheet, ...]:
    """Return the sheets that contain a table."""
    max_size = max(1 << 26, MAX_EXPANSION * size)
    sheets = list[Sheet]()
    with wrap_library_errors(path, "Excel"):
        _check_archive(path, max_size)
        with warnings.catch_warnings(), path.open("rb") as file:
            warnings.simplefilter("ignore")  # about unsupported styles and extensions
            book = openpyxl.load_workbook(file, read_only=True, data_only=True, keep_links=False)
            for sheet in book.worksheets:
                sheet.reset_dimensions()  # stored dimensions may be wrong
                where = f"{path} (sheet {sheet.title!r:.40})"
                if text := _text(sheet.iter_rows(values_only=True), where, max_size):
                    prefix = f"{sheet.title}/" if sheets else ""
                    data = text.encode("utf-8", "replace")
                    sheets.append(Sheet(sheet.title, where, prefix, data))
    if not sheets:
        hint = "to store the results of formulas, save the file in Excel"
        expected = f"a sheet with at least {MIN_ROWS} rows; {hint}"
        raise reader_error(path, "no sheet has rows of numbers", expected)
    return tuple(sheets)


def _check_archive(path: Path, max_size: int) -> None:
    """Raise an error if a workbook expands to more than `max_size` bytes, or declares entities."""
    with zipfile.ZipFile(path) as archive:
        expanded = sum(member.file_size for member in archive.infolist())
        if expanded > max_size:
            expected = f"at most 64 MB, or {MAX_EXPANSION} times the size of the file"
            raise reader_error(path, f"expands to {expanded} bytes", expected)
        for member in archive.infolist():
            with archive.open(member) as content:
                _check_prolog(content, f"{path} ({member.filename:.80})")


def _check_prolog(content: IO[bytes], where: str) -> None:
    """Raise an error for XML with a document type, whose entities can expand without limit or read files."""
    elements = list[object]()

    def refuse(*_doctype: object) -> None:
        raise reader_error(where, "declares a document type", "XML without entities")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda *element: elements.append(element)
    with suppress(expat.ExpatError):  # images, and files that openpyxl rejects
        while not elements and (chunk := content.read(1 << 16)):
            parser.Parse(chunk)


def _text(rows: Iterable[Sequence[Any]], where: str, max_characters: int) -> str:
    """Convert rows to comma-separated lines without blank columns; return "" if the sheet has no table.

    Parameters
    ----------
    rows : iterable of sequence
        Values of the cells of each row.
    where : str
        File and sheet, for messages.
    max_characters : int
        Largest number of characters of the text.

    Raises
    ------
    RecordingError
        If there are too many rows, cells or characters.
    """
    text, n_cells, n_numeric, used = io.StringIO(), 0, 0, set[int]()
    writer = csv.writer(text, lineterminator="\n")
    for number, row in enumerate(rows, 1):
        n_cells += len(row)
        if number > MAX_ROWS or n_cells > MAX_CELLS or text.tell() > max_characters:
            limits = f"{MAX_ROWS} rows, {MAX_CELLS} cells and {max_characters} characters"
            expected = f"at most {limits}: split the sheet"
            raise reader_error(where, f"has at least {number} rows and {n_cells} cells", expected)
        cells = [_cell(value) for value in row] if any(value is not None for value in row) else []
        filled = [i for i, cell in enumerate(cells) if cell]
        if not filled:
            text.write("\n")  # line numbers in messages are row numbers of the sheet
            continue
        used.update(filled)
        n_numeric += any(is_number(cells[i]) for i in filled)
        writer.writerow(cells)
    if n_numeric < MIN_ROWS:
        return ""
    return _align_columns(text.getvalue(), sorted(used))


def _align_columns(text: str, columns: Sequence[int]) -> str:
    """Keep only the given columns of a text, and fill missing cells with blanks."""
    aligned = io.StringIO()
    writer = csv.writer(aligned, lineterminator="\n")
    for row in csv.reader(io.StringIO(text)):
        if row:
            writer.writerow([row[i] if i < len(row) else "" for i in columns])
        else:
            aligned.write("\n")
    return aligned.getvalue()


def _cell(value: Any) -> str:
    errors = ("#N/A", "#DIV/0!", "#NAME?", "#NULL!", "#NUM!", "#REF!", "#VALUE!")  # results of formulas
    if value is None or value in errors:
        return ""
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    if isinstance(value, datetime):
        return value.isoformat(" ")
    return value.isoformat() if isinstance(value, date | time) else " ".join(str(value).split())
