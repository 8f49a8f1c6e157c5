"""Text with one value per line."""

import io
from pathlib import Path

import pyarrow as pa
import pyarrow.csv as arrow_csv

from texclass.loaders.columns import UNNAMED, Columns, ReadOptions, check_size
from texclass.recording import RecordingError


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the one column such a file has."""
    return (UNNAMED,)


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> Columns:
    """Read the values; blank lines are skipped.

    Raises
    ------
    RecordingError
        If a line holds anything but one number; the message names the line.
    """
    check_size(path.stat().st_size // 2, path)
    content = path.read_bytes()
    try:
        table = arrow_csv.read_csv(
            io.BytesIO(content),
            read_options=arrow_csv.ReadOptions(column_names=[UNNAMED], use_threads=False),
            convert_options=arrow_csv.ConvertOptions(column_types={UNNAMED: pa.float64()}, null_values=[]),
        )
    except pa.ArrowInvalid as error:
        raise RecordingError(f"{path}: {_first_bad_line(content) or error}") from error
    return Columns({UNNAMED: table[UNNAMED].to_numpy()})


def _first_bad_line(content: bytes) -> str:
    for number, line in enumerate(content.decode("utf-8", errors="replace").splitlines(), start=1):
        try:
            float(line.replace("_", "x") or 0)  # Python alone takes 1_000 for a number
        except ValueError:
            return f"line {number} is {line[:40]!r}; the rule is one number per line"
    return ""
