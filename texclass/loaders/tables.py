"""Read numbers from text: one value per line (.txt), or columns by name (CSV, TSV; and Parquet)."""

import csv
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
    """Return the names of the columns: the first line of a CSV, the schema of a Parquet file.

    Raises
    ------
    RecordingError
        If the first line is not text.
    """
    match path.suffix.lower():
        case ".txt":
            return (UNNAMED,)
        case ".parquet":
            return _parquet(path)[1]
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = next(csv.reader(file, delimiter=_delimiter(path, options)), [])
    except (ValueError, TypeError, csv.Error) as error:
        raise RecordingError(f"{path}: line 1 is not a header of column names ({error})") from error
    return tuple(name.strip() for name in header)


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> ReadSignals:
    """Read the wanted columns; blank lines of a text are skipped.

    Raises
    ------
    RecordingError
        If a column is not there, a cell or line is not a number, or a line has other cells than the header.
    """
    present = names(path, options)
    hint = f" (is {_delimiter(path, options)!r} the delimiter?)" if len(present) == 1 else ""
    require(wanted, present, path, hint=hint)
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path, wanted)
    check_size(path.stat().st_size // 2, path)
    is_text = path.suffix.lower() == ".txt"
    try:
        table = arrow_csv.read_csv(
            path,
            read_options=arrow_csv.ReadOptions(
                column_names=present, skip_rows=not is_text, use_threads=False
            ),
            parse_options=arrow_csv.ParseOptions(delimiter=_delimiter(path, options)),
            convert_options=arrow_csv.ConvertOptions(
                include_columns=wanted, column_types=dict.fromkeys(wanted, pa.float64()), null_values=[]
            ),
        )
    except (pa.ArrowException, ValueError, TypeError, KeyError) as error:
        said = _first_bad_line(path) if is_text else ""
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


def _delimiter(path: Path, options: ReadOptions) -> str:
    return options.delimiter or ("\t" if path.suffix.lower() == ".tsv" else ",")
