"""Read numbers from text: one value per line, or columns (.txt, CSV, TSV; and Parquet).

The first line of a text names the columns, unless each of its cells is a number: then they are c1, c2, ....
Decimal points may be commas, and a column of times may hold dates (ISO 8601).
"""

import csv
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
from numpy.typing import NDArray
from pyarrow import parquet

from texclass.loaders.columns import (
    UNNAMED,
    ReadOptions,
    ReadSignals,
    as_samples,
    check_held,
    check_size,
    readable,
    refused,
    require,
)
from texclass.loaders.dates import is_date, parse_dates
from texclass.recording import RecordingError

DIVIDING = "\t;|,"
"""What may divide columns; the first of these that is in the first line does."""
LONGEST_LINE = 1 << 20
"""Characters of the longest first line: names of 10,000 columns take a tenth."""
MOST_COLUMNS = 10_000
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d(?::?\d\d){0,2}(?:\.\d+)?(Z|[+-]\d\d:?\d*)?")


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the columns: the first line of a text, the schema of a Parquet file.

    Raises
    ------
    RecordingError
        If the first line is not text.
    """
    return _parquet(path)[1] if path.suffix.lower() == ".parquet" else _layout(path, options)[0]


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> ReadSignals:
    """Read the wanted columns; blank lines of a text are skipped.

    Raises
    ------
    RecordingError
        If a column is not there, a cell or line is not a number, or a line has other cells than the header.
    """
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path, wanted)
    present, delimiter, n_before, first = _layout(path, options)
    is_one = len(present) == 1
    hint = f" (is {delimiter!r} the delimiter? --delimiter, `delimiter` in a card)" if is_one else ""
    require(wanted, present, path, hint=hint)
    check_size(path.stat().st_size // 2, path)
    # A first cell that is a date, with or without a zone, makes a column of dates.
    dates = {name: _DATE.fullmatch(cell.strip()) for name, cell in zip(present, first, strict=False)}
    types = {name: pa.timestamp("ns", "UTC" if date[1] else None) for name, date in dates.items() if date}
    others = {name for name, cell in zip(present, first, strict=False) if name not in types and is_date(cell)}
    types |= dict.fromkeys(others, pa.string())
    text: Path | bytes = path
    if delimiter == " ":  # any number of blanks, as they align numbers
        lines = path.read_bytes().replace(b"\r\n", b"\n").replace(b"\t", b" ")
        while b"  " in lines:  # a regular expression takes longer than reading the numbers
            lines = lines.replace(b"  ", b" ")
        text = lines.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")
    problem: Exception | None = None
    for decimal in ".,":
        try:
            table = arrow_csv.read_csv(
                pa.BufferReader(text) if isinstance(text, bytes) else text,
                read_options=arrow_csv.ReadOptions(
                    column_names=present, skip_rows=n_before, use_threads=False
                ),
                parse_options=arrow_csv.ParseOptions(delimiter=delimiter),
                convert_options=arrow_csv.ConvertOptions(
                    include_columns=wanted,
                    column_types={name: types.get(name, pa.float64()) for name in wanted},
                    null_values=[],
                    decimal_point=decimal,
                ),
            )
            named: dict[str, NDArray[Any]] = {
                name: parse_dates(table[name]) if name in others else _array(table[name]) for name in wanted
            }
        except (pa.ArrowException, ValueError, TypeError, KeyError) as error:
            problem = problem or error
            continue
        said = ("decimals: commas are read as decimal points",) if decimal == "," else ()
        return ReadSignals(named, flags=said)
    bad = _first_bad_line(path) if path.suffix.lower() == ".txt" and is_one else ""
    raise RecordingError(f"{path}: {bad or f'{problem}; the rule is a number in every cell'}") from problem


def _array(column: pa.ChunkedArray) -> NDArray[Any]:
    """Return numbers or dates as an array; pyarrow's own way loads pandas: longer than reading a file."""
    kind: str = "f8"
    if pa.types.is_timestamp(column.type):
        kind, column = "M8[ns]", column.cast(pa.int64())
    return np.concatenate([np.empty(0, kind), *(np.from_dlpack(c).view(kind) for c in column.chunks)])


def _first_bad_line(path: Path) -> str:
    for number, line in enumerate(path.read_text("utf-8-sig", errors="replace").splitlines(), start=1):
        try:
            float(line.replace("_", "x") or 0)  # Python alone takes 1_000 for a number
        except ValueError:
            return f"line {number} is {line[:40]!r}; the rule is one number per line"
    return ""


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


def _layout(path: Path, options: ReadOptions) -> tuple[tuple[str, ...], str, int, list[str]]:
    """Return the columns of a text, what divides them, how many lines name them, and the first line of cells.

    Of a name that stands twice, the column's number is a part.
    """
    is_txt = path.suffix.lower() == ".txt"
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            if len(file.readline(LONGEST_LINE)) == LONGEST_LINE:
                raise refused(path, "its first line is too long", f"at most {LONGEST_LINE} characters")
            file.seek(0)
            begin = next((line.strip() for line in file if line.strip()), "")
            found = next((mark for mark in DIVIDING + " " * is_txt if mark in begin), "")
            delimiter = options.delimiter or found
            file.seek(0)
            lines = (line.strip(" ") for line in file) if delimiter == " " else file
            rows = csv.reader(lines, delimiter=delimiter or ",", skipinitialspace=delimiter == " ")
            filled = (row for row in rows if row)
            header, n_before = tuple(name.strip() for name in next(filled, [])), rows.line_num
            first = next(filled, [])
    except RecordingError:
        raise
    except (ValueError, TypeError, csv.Error) as error:
        told = f"{path}: line 1 is not a header of column names, nor of numbers ({error}); the rule is UTF-8"
        raise RecordingError(told) from error
    if len(header) > MOST_COLUMNS:
        raise refused(path, f"its first line has {len(header)} columns", f"at most {MOST_COLUMNS}")
    if is_txt and not delimiter:
        return (UNNAMED,), ",", 0, []
    if header and all(map(_is_number, header)):
        names = tuple(f"c{i}" for i in range(1, len(header) + 1)) if len(header) > 1 else (UNNAMED,)
        return names, delimiter or ",", 0, list(header)
    times = Counter(header)
    names = tuple(name if times[name] == 1 else f"{name}#{i}" for i, name in enumerate(header, 1))
    return names, delimiter or ",", n_before, first


def _is_number(cell: str) -> bool:
    """Whether a cell of the first line is none of a header."""
    try:
        float(cell.replace("_", "x").replace(",", "."))
    except ValueError:
        return bool(_DATE.fullmatch(cell)) or is_date(cell)
    return True
