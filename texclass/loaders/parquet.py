"""Read Parquet files with one column per signal (extra `parquet`)."""

from pathlib import Path

from pyarrow import parquet

from texclass.loaders.readers import (
    ReaderSettings,
    ReadSignals,
    as_samples,
    check_announced_size,
    reader_error,
    require_columns,
    wrap_library_errors,
)


def names(path: Path, settings: ReaderSettings) -> tuple[str, ...]:
    """Return the names of the columns, from the schema.

    Raises
    ------
    RecordingError
        If the file is not a Parquet file.
    """
    with wrap_library_errors(path, "Parquet"):
        return tuple(parquet.ParquetFile(path).schema_arrow.names)


def read(path: Path, wanted: tuple[str, ...], settings: ReaderSettings) -> ReadSignals:
    """Read columns of numbers or dates.

    Raises
    ------
    RecordingError
        If a column is missing, has missing values, or contains neither numbers nor dates.
    """
    require_columns(wanted, names(path, settings), path)
    with wrap_library_errors(path, "Parquet"):
        file = parquet.ParquetFile(path)
        check_announced_size(file.metadata.num_rows * len(wanted), path)
        table = file.read(columns=list(wanted), use_threads=False)
        for name in wanted:
            if n := table[name].null_count:
                raise reader_error(path, f"{name} has {n} missing values", "a number in every cell")
        stored = {name: table[name].to_numpy() for name in wanted}
    is_date = {name for name, values in stored.items() if values.dtype.kind == "M"}
    numbers = {name: as_samples(stored[name], name, path) for name in wanted if name not in is_date}
    return ReadSignals({**numbers, **{name: stored[name].astype("M8[ns]") for name in is_date}})
