"""Which reader reads which file, by suffix."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from texclass.loaders.columns import Columns, ReadOptions
from texclass.recording import RecordingError

SUFFIXES = (".txt", ".csv", ".tsv", ".parquet", ".wav", ".flac", ".mat", ".npz", ".h5", ".hdf5")
"""Suffixes of files that can be recordings; case does not matter."""
BAG_SUFFIXES = (".bag", ".mcap", ".db3")
"""Suffixes of bags of ROS 1 and 2."""
BAG_FOLDER = "metadata.yaml"
"""The file that stands for a bag that is a folder."""

Names = Callable[[Path, ReadOptions], tuple[str, ...]]
Read = Callable[[Path, tuple[str, ...], ReadOptions], Columns]


def names(path: Path, options: ReadOptions) -> tuple[str, ...]:
    """Return the names of the columns or arrays of a file.

    Raises
    ------
    RecordingError
        If the file does not exist, is empty, unreadable, or of an unknown kind.
    """
    return _format(path)[0](path, options)


def read(path: Path, wanted: tuple[str, ...], options: ReadOptions) -> Columns:
    """Read named columns or arrays of a file.

    Raises
    ------
    RecordingError
        If that is impossible; the message names file, value and rule.
    """
    return _format(path)[1](path, wanted, options)


def stated_unit(path: Path, options: ReadOptions) -> str | None:
    """Return the unit of the acceleration if the file says it: only bags do, by the type of their messages.

    Raises
    ------
    RecordingError
        As `names`.
    """
    if not is_bag(path):
        return None
    _check_there(path)
    unit: str | None = _bags().unit(path, options)
    return unit


def topics(path: Path) -> tuple[str, ...]:
    """Return the topics of a bag that can be recordings.

    Raises
    ------
    RecordingError
        If it is no readable bag.
    """
    _check_there(path)
    return tuple(_bags().readable_topics(path))


def is_bag(path: Path) -> bool:
    """Whether a file is, by its name, a bag."""
    return path.suffix.lower() in BAG_SUFFIXES or path.name == BAG_FOLDER


def _bags() -> ModuleType:
    try:
        from texclass.loaders import bags
    except ImportError as error:
        raise RecordingError(
            f"reading bags needs the extra `robot` ({error}): pip install texclass[robot]"
        ) from error
    return bags


def _format(path: Path) -> tuple[Names, Read]:
    """Return the two functions of a format; its libraries are imported only now."""
    _check_there(path)
    if is_bag(path):
        return _bags().names, _bags().read
    match path.suffix.lower():
        case ".txt":
            from texclass.loaders import text

            return text.names, text.read
        case ".csv" | ".tsv" | ".parquet":
            from texclass.loaders import table

            return table.names, table.read
        case ".wav" | ".flac":
            from texclass.loaders import audio

            return audio.names, audio.read
        case ".mat":
            from texclass.loaders import matlab

            return matlab.names, matlab.read
        case ".npz" | ".h5" | ".hdf5":
            from texclass.loaders import arrays

            return arrays.names, arrays.read
    raise RecordingError(
        f"{path}: suffix is {path.suffix!r}; the rule is one of {', '.join((*SUFFIXES, *BAG_SUFFIXES))}"
    )


def _check_there(path: Path) -> None:
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise RecordingError(f"{path}: is not a file; the rule is one file per recording (or axis)")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be opened ({error.strerror})") from error
    if size == 0:
        raise RecordingError(f"{path}: is empty (0 bytes); the rule is at least two samples")
