"""Bags by path: one file, or a folder of rosbag2 whose files follow each other."""

import contextlib
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

from texclass.loaders.bag_expansion import MOST_EXPANSION, Budget, most_expanded, zstd_decompressor
from texclass.loaders.bag_storages import MOST_TOPICS, READERS, BagMessage, Connection
from texclass.loaders.formats import BAG_FOLDER
from texclass.recording import RecordingError


def bag_topics(path: Path) -> dict[str, Connection]:
    """Return topic -> connection of a bag: a file, a folder, or the metadata.yaml in one.

    Raises
    ------
    RecordingError
        If it is not a readable bag.
    """
    found: dict[str, Connection] = {}
    for part in storage_files(path):
        with _as_error(part), _expanded(part) as (file, suffix):
            for connection in READERS[suffix][0](file):
                found.setdefault(connection.topic, connection)
                if len(found) > MOST_TOPICS:
                    raise ValueError(f"more than {MOST_TOPICS} topics")
    return found


def bag_messages(path: Path, topic: str) -> Iterator[BagMessage]:
    """Yield the messages of a topic in the order in which they stand in a bag.

    Raises
    ------
    RecordingError
        If it is not a readable bag.
    """
    for part in storage_files(path):
        with _as_error(part), _expanded(part) as (file, suffix):
            yield from READERS[suffix][1](file, topic, Budget(file.stat().st_size))


def storage_files(path: Path) -> tuple[Path, ...]:
    """Return the files that hold a bag's messages, in order.

    Raises
    ------
    RecordingError
        If there is none.
    """
    folder = path if path.is_dir() else path.parent if path.name == BAG_FOLDER else None
    if folder is None:
        return (path,)
    files = [file for file in folder.iterdir() if _storage_suffix(file) in (".mcap", ".db3")]
    if not files:
        raise RecordingError(f"{folder}: holds no .mcap or .db3 file; the rule is a folder of rosbag2")
    return tuple(sorted(files, key=lambda file: [int(n) for n in re.findall(r"\d+", file.name)]))


def _storage_suffix(file: Path) -> str:
    return Path(file.name.lower().removesuffix(".zstd")).suffix


@contextlib.contextmanager
def _as_error(path: Path) -> Iterator[None]:
    """Turn whatever damaged bytes make the libraries raise into one error of ours."""
    try:
        yield
    except (RecordingError, GeneratorExit):
        raise
    except (Exception, MemoryError) as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: not a readable bag ({told}); is it cut short?") from error


@contextlib.contextmanager
def _expanded(path: Path) -> Iterator[tuple[Path, str]]:
    """Give a storage file and its kind; one that is compressed as a whole is first expanded beside."""
    suffix = _storage_suffix(path)
    if suffix == path.suffix.lower():
        yield path, suffix
        return
    with tempfile.TemporaryDirectory() as folder, path.open("rb") as packed:
        target = Path(folder) / f"bag{suffix}"
        most = most_expanded(path.stat().st_size)
        with (
            target.open("wb") as file,
            zstd_decompressor().stream_reader(packed, read_across_frames=True) as stream,
        ):
            while piece := stream.read(1 << 20):
                file.write(piece)
                if file.tell() > most:
                    raise ValueError(f"expands to more than {MOST_EXPANSION} times its size")
        yield target, suffix
