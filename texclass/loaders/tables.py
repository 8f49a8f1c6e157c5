"""Read text files (.txt, CSV, TSV, LabVIEW) with one value per line or columns, and Parquet files.

`text_layout` finds the first row, the delimiter and the names of the columns. Numbers may have decimal
commas, and a column of time stamps may contain dates.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray
from pyarrow import parquet

from texclass.loaders.columns import is_time
from texclass.loaders.dates import is_date, parse_dates
from texclass.loaders.readers import (
    ReaderSettings,
    ReadSignals,
    as_samples,
    check_announced_size,
    check_size,
    reader_error,
    require_columns,
    wrap_library_errors,
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


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the names of the columns, from the lines above the rows or the schema of a Parquet file.

    Raises
    ------
    RecordingError
        If the file is not text, or has no rows of numbers.
    """
    if path.suffix.lower() == ".parquet":
        return _parquet(path)[1]
    return find_layout(_map_file(path), str(path), settings).names


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read columns; blank lines and comments of a text file are skipped.

    Raises
    ------
    RecordingError
        If a column is missing, a cell or line is not a number, or lines differ in the number of cells.
    """
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path, wanted)
    return read_text(_map_file(path), str(path), wanted, settings)


def _map_file(path: Path) -> pa.Buffer:
    """Return the content of a file as a memory map."""
    with pa.memory_map(str(path)) as file:
        return file.read_buffer()


def read_text(data: pa.Buffer, where: str, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read columns from the content of a text file; `where` is its name, see `find_layout`."""
    layout = find_layout(data, where, settings)
    is_one = len(layout.names) == 1
    hint = f" (is {layout.delimiter!r} the delimiter? --delimiter, `delimiter` in a card)" if is_one else ""
    require_columns(wanted, layout.names, where, hint=hint)
    check_size(data.size // 2, where)
    # A column contains dates if its first cell is a date, with or without a time zone.
    first = dict(zip(layout.names, layout.first, strict=False))
    dates = {name: DATE.fullmatch(cell) for name, cell in first.items()}
    types = {name: pa.timestamp("ns", "UTC" if date[1] else None) for name, date in dates.items() if date}
    other_dates = {name for name, cell in first.items() if name not in types and is_date(cell)}
    types = {name: types.get(name, pa.string() if name in other_dates else pa.float64()) for name in wanted}
    rows, n_comments = _rows(data, layout, is_decoded=bool(settings.drop_incomplete))
    flags = [*layout.flags]
    if n_comments:
        flags.append(f"comments: {counted(n_comments, 'comment line')} between the rows skipped")
    problem: Exception | None = None
    for decimal in ".,":
        try:
            n_dropped = 0
            if settings.drop_incomplete:
                table, n_dropped = _complete(rows, layout, types, decimal)
            else:
                table = _cells(rows, layout, types, decimal)
            signals: dict[str, NDArray[Any]] = {
                name: parse_dates(table[name]) if name in other_dates else _array(table[name])
                for name in wanted
            }
        except (pa.ArrowException, ValueError, TypeError, KeyError) as error:
            problem = problem or error
            continue
        if n_dropped:
            flags.append(f"incomplete: {counted(n_dropped, 'line')} without a number in each column dropped")
        if decimal == ",":
            flags.append("decimals: commas are read as decimal points")
        has_time_stamps = any(map(is_time, wanted))
        return ReadSignals(signals, None if has_time_stamps else layout.fs, flags=tuple(flags))
    raise _bad_line(data, where, layout, wanted, str(problem)) from problem


def _rows(data: pa.Buffer, layout: TextLayout, *, is_decoded: bool) -> tuple[pa.Buffer, int]:
    """Return the rows of a text in a form that pyarrow can read, and the number of removed comment lines.

    If pyarrow can read the file as it is, the file is not copied to memory. With `is_decoded`, it is always
    decoded, because pyarrow cannot skip lines that are not UTF-8.
    """
    any_mark = b"|".join(re.escape(mark.encode()) for mark in layout.comments)
    if not is_decoded and layout.encoding != "utf-16" and layout.is_plain and layout.delimiter != " ":
        ends = re.compile(rb"\n").finditer(data)
        begin = 0
        for _, end in zip(range(layout.n_above), ends, strict=False):
            begin = end.end()
        if not any_mark or not re.compile(rb"\n(?:" + any_mark + rb")").search(data, max(begin - 1, 0)):
            # pyarrow raises an error for an empty text, but reads no rows from a blank line.
            return data[begin:] if begin < data.size else pa.py_buffer(b"\n"), 0
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
    return pa.py_buffer(text), n_comments


def _cells(
    rows: pa.Buffer,
    layout: TextLayout,
    types: dict[str, pa.DataType],
    decimal: str,
    *,
    is_strict: bool = True,
) -> pa.Table:
    """Read columns of given types; lines with a different number of cells are errors or are skipped."""
    empty_names = tuple(f"empty {i}" for i in range(len(layout.names), layout.width))
    return arrow_csv.read_csv(
        pa.BufferReader(rows),
        read_options=arrow_csv.ReadOptions(column_names=(*layout.names, *empty_names), use_threads=False),
        parse_options=arrow_csv.ParseOptions(
            delimiter=layout.delimiter, invalid_row_handler=None if is_strict else lambda row: "skip"
        ),
        convert_options=arrow_csv.ConvertOptions(
            include_columns=types,
            column_types=types,
            null_values=[],
            decimal_point=decimal,
            check_utf8=is_strict,
        ),
    )


def _complete(
    rows: pa.Buffer, layout: TextLayout, types: dict[str, pa.DataType], decimal: str
) -> tuple[pa.Table, int]:
    """Return the rows with a number or date in each column, and the number of dropped lines."""
    texts = _cells(rows, layout, dict.fromkeys(types, pa.string()), decimal, is_strict=False)
    number = r"^\s*[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?\s*$"
    is_complete = np.ones(len(texts), bool)
    for name, kind in types.items():
        pattern = number if pa.types.is_floating(kind) else r"\d:\d"
        is_complete &= pc.match_substring_regex(texts[name], pattern).to_numpy()
    rows_as_text = texts.filter(pa.array(is_complete))
    n_lines = sum(map(bool, map(bytes.strip, rows.to_pybytes().splitlines())))
    columns = {}
    for name, kind in types.items():
        column = rows_as_text[name]
        if pa.types.is_floating(kind):
            column = pc.utf8_trim_whitespace(column)
            column = pc.replace_substring(column, ",", ".") if decimal == "," else column
        columns[name] = pc.cast(column, kind)
    return pa.table(columns), n_lines - len(rows_as_text)


def _bad_line(
    data: pa.Buffer, where: str, layout: TextLayout, wanted: tuple[str, ...], problem: str
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
        column = next((name for name, cell in present if name in wanted and not is_number(cell)), None)
        if len(cells) == layout.width and column is None:
            continue
        reason = f", column {column!r} is not a number" if column and not is_one else ""
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


def _array(column: pa.ChunkedArray) -> NDArray[Any]:
    """Convert numbers or dates to an array without `to_numpy` of pyarrow, which would import pandas."""
    kind: str = "f8"
    if pa.types.is_timestamp(column.type):
        kind, column = "M8[ns]", column.cast(pa.int64())
    return np.concatenate([np.empty(0, kind), *(np.from_dlpack(c).view(kind) for c in column.chunks)])


def _read_parquet(path: Path, wanted: tuple[str, ...]) -> ReadSignals:
    file, columns = _parquet(path)
    require_columns(wanted, columns, path)
    check_announced_size(file.metadata.num_rows * len(wanted), path)
    with wrap_library_errors(path, "Parquet"):
        table = file.read(columns=list(wanted), use_threads=False)
        for name in wanted:
            if n := table[name].null_count:
                raise reader_error(path, f"{name} has {n} missing values", "a number in every cell")
        stored = {name: table[name].to_numpy() for name in wanted}
    is_date = {name for name, values in stored.items() if values.dtype.kind == "M"}
    numbers = {name: as_samples(stored[name], name, path) for name in wanted if name not in is_date}
    return ReadSignals({**numbers, **{name: stored[name].astype("M8[ns]") for name in is_date}})


def _parquet(path: Path) -> tuple[parquet.ParquetFile, tuple[str, ...]]:
    """Open a Parquet file; return it and the names of its columns."""
    with wrap_library_errors(path, "Parquet"):
        file = parquet.ParquetFile(path)
        return file, tuple(file.schema_arrow.names)
