"""Read numbers from text: one value per line, or columns (.txt, CSV, TSV, LabVIEW; and Parquet).

`text_layout` finds where the rows begin, what divides them and the names of the columns. Decimal points may
be commas, and a column of times may contain dates.
"""

import mmap
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray
from pyarrow import parquet

from texclass.loaders.columns import (
    ReadOptions,
    ReadSignals,
    as_samples,
    check_held,
    check_size,
    is_time,
    readable,
    refused,
    require,
)
from texclass.loaders.dates import is_date, parse_dates
from texclass.loaders.text_layout import DATE, MISSING, TextLayout, find_layout, is_number, split_cells
from texclass.recording import RecordingError
from texclass.reporting.wording import counted

FEW_ROWS = 3
"""Rows above a line of text that rather belong to the lines above the table."""
_NUMBER = r"^\s*[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?\s*$"


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the columns: those above the rows of a text, the schema of a Parquet file.

    Raises
    ------
    RecordingError
        If it is no text, or has no rows of numbers.
    """
    return _parquet(path)[1] if path.suffix.lower() == ".parquet" else find_layout(path, options).names


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> ReadSignals:
    """Read the wanted columns; blank lines and comments of a text are skipped.

    Raises
    ------
    RecordingError
        If a column is not there, a cell or line is not a number, or a line has other cells than the others.
    """
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path, wanted)
    layout = find_layout(path, options)
    is_one = len(layout.names) == 1
    hint = f" (is {layout.delimiter!r} the delimiter? --delimiter, `delimiter` in a card)" if is_one else ""
    require(wanted, layout.names, path, hint=hint)
    check_size(path.stat().st_size // 2, path)
    # A first cell that is a date, with or without a zone, makes a column of dates.
    first = dict(zip(layout.names, layout.first, strict=False))
    dates = {name: DATE.fullmatch(cell) for name, cell in first.items()}
    types = {name: pa.timestamp("ns", "UTC" if date[1] else None) for name, date in dates.items() if date}
    others = {name for name, cell in first.items() if name not in types and is_date(cell)}
    types = {name: types.get(name, pa.string() if name in others else pa.float64()) for name in wanted}
    in_memory = not isinstance(path, Path)  # of a workbook
    rows, n_comments = _rows(path, layout, is_whole=options.drop_incomplete or in_memory)
    flags = [*layout.flags, f"comments: {counted(n_comments, 'line')} between the rows left out"][
        : None if n_comments else -1
    ]
    problem: Exception | None = None
    for decimal in ".,":
        try:
            if options.drop_incomplete:
                table, n_dropped = _complete(rows, layout, types, decimal)
                if n_dropped:
                    flags.append(f"incomplete: {counted(n_dropped, 'line')} without all numbers left out")
            else:
                table = _cells(rows, layout, types, decimal)
            named: dict[str, NDArray[Any]] = {
                name: parse_dates(table[name]) if name in others else _array(table[name]) for name in wanted
            }
        except (pa.ArrowException, ValueError, TypeError, KeyError) as error:
            problem = problem or error
            continue
        if decimal == ",":
            flags.append("decimals: commas are read as decimal points")
        is_stamped = any(map(is_time, wanted))
        return ReadSignals(named, None if is_stamped else layout.fs, flags=tuple(flags))
    raise _bad_line(path, layout, wanted, str(problem)) from problem


def _rows(path: Path, layout: TextLayout, *, is_whole: bool) -> tuple[Path | bytes, int]:
    """Return a text as pyarrow reads it, and how many comments between the rows were left out.

    A file that pyarrow can read as it is stays on the disk, unless `is_whole`: pyarrow cannot leave out a
    line that is not UTF-8.
    """
    marks = [mark.encode() for mark in layout.comments]
    any_mark = b"|".join(map(re.escape, marks))
    if not is_whole and layout.encoding != "utf-16" and layout.is_plain and layout.delimiter != " ":
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            begin = 0
            for _ in range(layout.n_above):
                begin = data.find(b"\n", begin) + 1
            if not marks or not re.compile(rb"\n(?:" + any_mark + rb")").search(data, max(begin - 1, 0)):
                return path, 0
    lines = path.read_text(layout.encoding, errors="replace").split("\n", layout.n_above)
    text = lines[-1].encode("utf-8", "replace") if len(lines) > layout.n_above else b""
    n_comments = 0
    if marks:
        text, n_comments = re.subn(rb"(?m)^[ \t]*(?:" + any_mark + rb").*\n?", b"", text)
    if layout.delimiter == " ":  # any number of blanks, as they align numbers
        text = text.replace(b"\t", b" ")
        while b"  " in text:  # a regular expression takes longer than reading the numbers
            text = text.replace(b"  ", b" ")
        text = text.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")
    return text, n_comments


def _cells(
    rows: Path | bytes,
    layout: TextLayout,
    types: dict[str, pa.DataType],
    decimal: str,
    *,
    is_strict: bool = True,
) -> pa.Table:
    """Return columns of some types; lines with other cells are an error, or left out."""
    hidden = tuple(f"empty {i}" for i in range(len(layout.names), layout.width))
    return arrow_csv.read_csv(
        pa.BufferReader(rows) if isinstance(rows, bytes) else rows,
        read_options=arrow_csv.ReadOptions(
            column_names=(*layout.names, *hidden),
            skip_rows=0 if isinstance(rows, bytes) else layout.n_above,
            use_threads=False,
        ),
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
    rows: Path | bytes, layout: TextLayout, types: dict[str, pa.DataType], decimal: str
) -> tuple[pa.Table, int]:
    """Return the rows that have a number or date in each column, and how many lines have not."""
    texts = _cells(rows, layout, dict.fromkeys(types, pa.string()), decimal, is_strict=False)
    is_whole = np.ones(len(texts), bool)
    for name, kind in types.items():
        pattern = _NUMBER if pa.types.is_floating(kind) else r"\d:\d"
        is_whole &= pc.match_substring_regex(texts[name], pattern).to_numpy()
    kept = texts.filter(pa.array(is_whole))
    content = rows if isinstance(rows, bytes) else rows.read_bytes().split(b"\n", layout.n_above)[-1]
    n_lines = sum(map(bool, map(bytes.strip, content.splitlines())))
    columns = {}
    for name, kind in types.items():
        column = kept[name]
        if pa.types.is_floating(kind):
            column = pc.utf8_trim_whitespace(column)
            column = pc.replace_substring(column, ",", ".") if decimal == "," else column
        columns[name] = pc.cast(column, kind)
    return pa.table(columns), n_lines - len(kept)


def _bad_line(path: Path, layout: TextLayout, wanted: tuple[str, ...], problem: str) -> RecordingError:
    """Return the error of the first line that is no row, with the options that leave it out."""
    is_one = layout.width == 1
    rule = "one number per line" if is_one else "a number in every cell"
    with path.open(encoding=layout.encoding, errors="replace") as file:
        for number, line in enumerate(file, start=1):
            beginning = line.lstrip()
            is_row = (
                number > layout.n_above
                and beginning
                and not (layout.comments and beginning.startswith(layout.comments))
            )
            if not is_row:
                continue
            cells = split_cells(line.rstrip("\r\n"), layout.delimiter)
            bad = next(
                (
                    name
                    for name, cell in zip(layout.names, cells, strict=False)
                    if name in wanted and not is_number(cell)
                ),
                None,
            )
            if len(cells) == layout.width and bad is None:
                continue
            reason = f"column {bad!r} is no number" if bad and not is_one else ""
            if len(cells) != layout.width and not is_one:
                reason = f"it has {counted(len(cells), 'cell')}, others have {layout.width}"
            options = ["--drop-incomplete leaves such lines out (`drop_incomplete` in a card)"]
            if not any(map(is_number, cells)) and any(cell.lower() not in MISSING for cell in cells):
                skips = f"--skip-rows {number} skips this line and those above it (`skip_rows` in a card)"
                options.insert(0 if number - layout.n_above <= FEW_ROWS else 1, skips)
            if re.match(r"""[^\w\s"'+.,;-]""", beginning):
                options.append(
                    f"--comment {beginning[0]!r} leaves out lines that begin so (`comment` in a card)"
                )
            where = f"line {number} is {line.strip()[:40]!r}"
            return RecordingError(
                f"{path}: {where}{reason and f', {reason}'}. Expected {rule}. {', '.join(options)}"
            )
    return refused(path, problem, rule)


def _array(column: pa.ChunkedArray) -> NDArray[Any]:
    """Return numbers or dates as an array; pyarrow's own way loads pandas: longer than reading a file."""
    kind: str = "f8"
    if pa.types.is_timestamp(column.type):
        kind, column = "M8[ns]", column.cast(pa.int64())
    return np.concatenate([np.empty(0, kind), *(np.from_dlpack(c).view(kind) for c in column.chunks)])


def _read_parquet(path: Path, wanted: tuple[str, ...]) -> ReadSignals:
    file, present = _parquet(path)
    require(wanted, present, path)
    check_held(file.metadata.num_rows * len(wanted), path)
    with readable(path, "Parquet"):
        table = file.read(columns=list(wanted), use_threads=False)
        for name in wanted:
            if n := table[name].null_count:
                raise refused(path, f"{name} lacks {n} values", "a number in every cell")
        stored = {name: table[name].to_numpy() for name in wanted}
    is_date = {name for name, values in stored.items() if values.dtype.kind == "M"}
    numbers = {name: as_samples(stored[name], name, path) for name in wanted if name not in is_date}
    return ReadSignals({**numbers, **{name: stored[name].astype("M8[ns]") for name in is_date}})


def _parquet(path: Path) -> tuple[parquet.ParquetFile, tuple[str, ...]]:
    """Return a file and the names of its columns."""
    with readable(path, "Parquet"):
        file = parquet.ParquetFile(path)
        return file, tuple(file.schema_arrow.names)
