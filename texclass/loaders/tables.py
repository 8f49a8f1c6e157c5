"""Read numbers from text: one value per line, or columns (.txt, CSV, TSV; and Parquet).

The first line of a text names the columns, unless each of its cells is a number: then they are c1, c2, ....
"""

import csv
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as arrow_csv
from pyarrow import parquet

from texclass.loaders.columns import (
    UNNAMED,
    ReadOptions,
    ReadSignals,
    as_samples,
    check_held,
    check_size,
    refused,
    require,
)
from texclass.recording import RecordingError


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
        require(wanted, names(path, options), path)
        return _read_parquet(path, wanted)
    present, delimiter, n_before = _layout(path, options)
    is_one = len(present) == 1
    hint = f" (is {delimiter!r} the delimiter? --delimiter, `delimiter` in a card)" if is_one else ""
    require(wanted, present, path, hint=hint)
    if is_one and (other := next((mark for mark in ";\t|" if mark in present[0]), "")):
        raise refused(path, f"its one column is {present[0]!r}", f"one that is parted: --delimiter '{other}'")
    check_size(path.stat().st_size // 2, path)
    try:
        text: Path | pa.BufferReader = path
        if delimiter == " ":  # any number of blanks, as they align numbers
            lines = re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", path.read_bytes())
            text = pa.BufferReader(re.sub(rb"[ \t]+", b" ", lines))
        table = arrow_csv.read_csv(
            text,
            read_options=arrow_csv.ReadOptions(column_names=present, skip_rows=n_before, use_threads=False),
            parse_options=arrow_csv.ParseOptions(delimiter=delimiter),
            convert_options=arrow_csv.ConvertOptions(
                include_columns=wanted, column_types=dict.fromkeys(wanted, pa.float64()), null_values=[]
            ),
        )
    except (pa.ArrowException, ValueError, TypeError, KeyError) as error:
        said = _first_bad_line(path) if path.suffix.lower() == ".txt" and is_one else ""
        raise RecordingError(f"{path}: {said or f'{error}; the rule is a number in every cell'}") from error
    return ReadSignals({name: table[name].to_numpy() for name in wanted})


def _first_bad_line(path: Path) -> str:
    for number, line in enumerate(path.read_text("utf-8-sig", errors="replace").splitlines(), start=1):
        try:
            float(line.replace("_", "x") or 0)  # Python alone takes 1_000 for a number
        except ValueError:
            return f"line {number} is {line[:40]!r}; the rule is one number per line"
    return ""


def _read_parquet(path: Path, wanted: tuple[str, ...]) -> ReadSignals:
    file, _ = _parquet(path)
    check_held(file.metadata.num_rows * len(wanted), path)
    try:
        table = file.read(columns=list(wanted), use_threads=False)
        lacking = {name: n for name in wanted if (n := table[name].null_count)}
        stored = {name: table[name].to_numpy() for name in wanted if not lacking}
    except Exception as error:  # damaged bytes make pyarrow raise almost anything
        raise _unreadable(path, error) from error
    for name, n in lacking.items():
        raise refused(path, f"{name} lacks {n} values", "a number in every cell")
    return ReadSignals({name: as_samples(stored[name], name, path) for name in wanted})


def _parquet(path: Path) -> tuple[parquet.ParquetFile, tuple[str, ...]]:
    """Return a file and the names of its columns."""
    try:
        file = parquet.ParquetFile(path)
        return file, tuple(file.schema_arrow.names)
    except Exception as error:  # damaged bytes make pyarrow raise almost anything
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> RecordingError:
    return RecordingError(f"{path}: not a readable Parquet file ({error})")


def _layout(path: Path, options: ReadOptions) -> tuple[tuple[str, ...], str, int]:
    """Return the columns of a text, what divides them, and how many lines there are up to their names."""
    suffix = path.suffix.lower()
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            delimiter = options.delimiter or {".tsv": "\t", ".csv": ","}.get(suffix, "")
            if not delimiter:
                begin = next((line.strip() for line in file if line.strip()), "")
                delimiter = next((mark for mark in "\t;, " if mark in begin), "")
                file.seek(0)
            lines = (line.strip(" ") for line in file) if delimiter == " " else file
            rows = csv.reader(lines, delimiter=delimiter or ",", skipinitialspace=delimiter == " ")
            first = next((row for row in rows if row), [])
    except (ValueError, TypeError, csv.Error) as error:
        told = f"{path}: line 1 is not a header of column names, nor of numbers ({error}); the rule is UTF-8"
        raise RecordingError(told) from error
    if not delimiter:
        return (UNNAMED,), ",", 0
    header = tuple(name.strip() for name in first)
    if not header or not all(map(_is_number, header)):
        return header, delimiter, rows.line_num
    return (UNNAMED,) if len(header) == 1 else tuple(f"c{i + 1}" for i in range(len(header))), delimiter, 0


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace("_", "x"))
    except ValueError:
        return False
    return True
