"""What bags of ROS store, read from the first byte to the last: topics, and the bytes of their messages.

rosbag1, and rosbag2 in MCAP or SQLite, whole or compressed, a file or a folder whose files follow each other.
The readers of rosbags follow a bag's index, and expand as much as a bag says: one of 1 kB then fills the
memory. Here no index is followed, which could lead in circles, and what expands is bounded.
"""

import bz2
import contextlib
import io
import re
import sqlite3
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag1.reader import Header, RecordType, read_bytes, read_uint32

from texclass.loaders.data_files import is_hidden
from texclass.loaders.readers import BAG_METADATA, STORAGE_SUFFIXES, reader_error, storage_suffix
from texclass.recording import RecordingError

MOST_BYTES = 1 << 27
"""A chunk or message that expands to more (128 MB) is refused."""
MOST_EXPANSION = 100
"""A bag that expands to more than so many times its size (or 64 MB, if that is more) is refused."""
MOST_TOPICS = 10_000
_MAGIC1 = b"#ROSBAG V2.0\n"
_ZSTD = b"\x28\xb5\x2f\xfd"


class Connection(NamedTuple):
    """A topic, what is sent there ("package/msg/Type"), whether in the layout of ROS 1, its definition."""

    topic: str
    type_name: str
    ros1: bool
    definition: str = ""

    @property
    def of_type(self) -> tuple[str, str, bool]:
        """Name, definition and layout of what is sent."""
        return self.type_name, self.definition, self.ros1


BagMessage = tuple[Connection, int, bytes]
"""Connection, time of receipt in nanoseconds, serialised message."""


class Expansion:
    """What a bag may still expand to.

    Parameters
    ----------
    size : int
        Of the file, in bytes.
    """

    def __init__(self, size: int) -> None:
        self.left = max(MOST_EXPANSION * size, 1 << 26)

    def expand(self, data: bytes, how: str, most: int = MOST_BYTES) -> bytes:
        """Return data decompressed ("", "none", "bz2", "lz4", "zstd").

        Raises
        ------
        ValueError
            If that is impossible, or more than `most` bytes or than the bag may have.
        """
        if how in ("", "none"):
            return data
        if how not in _EXPANDERS:
            raise ValueError(f"compression is {how!r}. Expected one of none, bz2, lz4, zstd")
        most = min(most, MOST_BYTES, self.left)
        expanded = _EXPANDERS[how](data, most + 1)
        self.left -= len(expanded)
        if len(expanded) > most:
            raise ValueError(f"it expands to more than {most} bytes or {MOST_EXPANSION} times")
        return expanded


_EXPANDERS: dict[str, Callable[[bytes, int], bytes]] = {
    "bz2": lambda data, most: bz2.BZ2Decompressor().decompress(data, most),
    "lz4": lambda data, most: bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, most)),
    "zstd": lambda data, most: _zstd().stream_reader(data, read_across_frames=True).read(most),
}


def _zstd() -> zstandard.ZstdDecompressor:
    """Return a decompressor that refuses frames which ask for more than 128 MB to look back on."""
    return zstandard.ZstdDecompressor(max_window_size=1 << 27)


def bag_topics(path: Path) -> dict[str, Connection]:
    """Return topic -> connection of a bag: a file, a folder, or the metadata.yaml in one.

    Raises
    ------
    RecordingError
        If it is not a readable bag.
    """
    found: dict[str, Connection] = {}
    for part in _storage_files(path):
        with _storage(part) as (file, suffix):
            for connection in _connections(file, suffix):
                found.setdefault(connection.topic, connection)
                if len(found) > MOST_TOPICS:
                    raise ValueError(f"more than {MOST_TOPICS} topics")
    return found


def bag_messages(path: Path, chosen: Connection) -> Iterator[tuple[int, bytes]]:
    """Yield time of receipt (nanoseconds) and bytes of the messages of a topic, in the order of a bag.

    Raises
    ------
    RecordingError
        If it is not a readable bag, or the topic carries messages of several types.
    """
    for part in _storage_files(path):
        with _storage(part) as (file, suffix):
            budget = Expansion(file.stat().st_size)
            for connection, received, raw in _MESSAGES[suffix](file, chosen.topic, budget):
                if connection[:3] != chosen[:3]:
                    sent = f"{chosen.topic} carries {connection.type_name} and {chosen.type_name}"
                    raise reader_error(path, sent, "one type a topic")
                yield received, raw


def _storage_files(path: Path) -> tuple[Path, ...]:
    """Return the files that hold a bag's messages, in order."""
    folder = path if path.is_dir() else path.parent if path.name == BAG_METADATA else None
    if folder is None:
        return (path,)
    files = [
        file
        for file in folder.iterdir()
        if storage_suffix(file.name) in STORAGE_SUFFIXES and not is_hidden(file.name)
    ]
    if not files:
        raise reader_error(folder, "holds no .mcap or .db3 file", "a folder of rosbag2")
    return tuple(sorted(files, key=lambda file: [int(n) for n in re.findall(r"\d+", file.name)]))


@contextlib.contextmanager
def _storage(path: Path) -> Iterator[tuple[Path, str]]:
    """Give a storage file, expanded if it is compressed as a whole, and its kind.

    Whatever damaged bytes make the libraries raise meanwhile becomes one error.
    """
    try:
        suffix = storage_suffix(path.name)
        if suffix == path.suffix.lower():
            yield path, suffix
            return
        with tempfile.TemporaryDirectory() as folder, path.open("rb") as packed:
            target, most = Path(folder) / f"bag{suffix}", Expansion(path.stat().st_size).left
            with target.open("wb") as file, _zstd().stream_reader(packed, read_across_frames=True) as stream:
                while piece := stream.read(1 << 20):
                    file.write(piece)
                    if file.tell() > most:
                        raise ValueError(f"expands to more than {MOST_EXPANSION} times its size")
            yield target, suffix
    except RecordingError:
        raise
    except Exception as error:
        told = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: not a readable bag ({told}); is it cut short?") from error


def _connections(path: Path, suffix: str) -> Iterator[Connection]:
    """Yield the connections that a storage file names, or an MCAP file without a summary uses."""
    match suffix:
        case ".bag":
            with path.open("rb") as file:
                index_at, n = _bag1_start(file)
                file.seek(index_at)
                for _ in range(n):
                    yield _bag1_connection(Header.read(file, RecordType.CONNECTION), file)[1]
        case ".mcap":
            with path.open("rb") as file:
                summary = make_reader(file).get_summary()
            if summary is not None and summary.channels:
                yield from (_mcap_connection(each, summary.schemas) for each in summary.channels.values())
            else:
                messages = _mcap_messages(path, None, Expansion(path.stat().st_size))
                yield from (connection for connection, _, _ in messages)
        case ".db3":
            with _database(path) as database:
                rows = database.execute("SELECT name, type FROM topics").fetchmany(MOST_TOPICS + 1)
            yield from (Connection(str(name), str(type_name), ros1=False) for name, type_name in rows)


def _bag1_messages(path: Path, topic: str, budget: Expansion) -> Iterator[BagMessage]:
    with path.open("rb") as file:
        index_at, _ = _bag1_start(file)
        connections: dict[int, Connection] = {}
        while file.tell() < index_at:
            header = Header.read(file)
            size = read_uint32(file)
            if header.get_uint8("op") != RecordType.CHUNK:
                file.seek(size, 1)
                continue
            chunk = budget.expand(read_bytes(file, size), header.get_string("compression"))
            _check_size(chunk, header.get_uint32("size"))
            inner = io.BytesIO(chunk)
            while inner.tell() < len(chunk):
                header = Header.read(inner)
                kind = header.get_uint8("op")
                if kind == RecordType.CONNECTION:
                    number, connection = _bag1_connection(header, inner)
                    connections[number] = connection
                    continue
                data = read_bytes(inner, read_uint32(inner))
                if kind != RecordType.MSGDATA:
                    continue
                connection = connections[header.get_uint32("conn")]
                if connection.topic == topic:
                    yield connection, header.get_time("time"), data


def _check_size(chunk: bytes, announced: int) -> None:
    if len(chunk) != announced:
        raise ValueError(f"a chunk holds {len(chunk)} bytes, not {announced}")


def _bag1_start(file: BinaryIO) -> tuple[int, int]:
    """Return where the index of a rosbag1 starts, and how many connections it names."""
    if file.read(len(_MAGIC1)) != _MAGIC1:
        raise ValueError("it does not start as a rosbag of version 2.0")
    header = Header.read(file, RecordType.BAGHEADER)
    if not (index_at := header.get_uint64("index_pos")):
        raise ValueError("it was never closed: run `rosbag reindex`")
    file.seek(read_uint32(file), 1)
    return index_at, header.get_uint32("conn_count")


def _bag1_connection(header: Header, file: BinaryIO) -> tuple[int, Connection]:
    told = Header.read(file)
    name, definition = told.get_string("type"), told.get_string("message_definition")
    connection = Connection(header.get_string("topic"), _with_msg(name), True, definition)
    return header.get_uint32("conn"), connection


def _mcap_messages(path: Path, topic: str | None, budget: Expansion) -> Iterator[BagMessage]:
    schemas: dict[int, Schema] = {}
    connections: dict[int, Connection] = {}
    with path.open("rb") as file:
        for outer in StreamReader(file, emit_chunks=True, record_size_limit=MOST_BYTES).records:
            for record in _mcap_chunk(outer, budget) if isinstance(outer, Chunk) else (outer,):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    connections[record.id] = _mcap_connection(record, schemas)
                elif isinstance(record, Message) and topic in (None, connections[record.channel_id].topic):
                    yield connections[record.channel_id], record.log_time, record.data


def _mcap_chunk(chunk: Chunk, budget: Expansion) -> Iterator[Schema | Channel | Message]:
    data = budget.expand(chunk.data, chunk.compression, chunk.uncompressed_size)
    _check_size(data, chunk.uncompressed_size)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of a chunk is wrong")
    stream = ReadDataStream(io.BytesIO(data))
    while stream.count < len(data):
        kind, size = stream.read1(), stream.read8()
        if kind == Opcode.MESSAGE:
            yield Message.read(stream, size)
        elif kind == Opcode.CHANNEL:
            yield Channel.read(stream)
        elif kind == Opcode.SCHEMA:
            yield Schema.read(stream)
        else:
            stream.read(size)


def _mcap_connection(channel: Channel, schemas: dict[int, Schema]) -> Connection:
    ros1 = channel.message_encoding == "ros1"
    if (schema := schemas.get(channel.schema_id)) is None:
        return Connection(channel.topic, "", ros1)
    is_message = schema.encoding in ("ros1msg", "ros2msg")
    definition = schema.data.decode("utf-8", "replace") if is_message else ""
    return Connection(channel.topic, _with_msg(schema.name), ros1, definition)


def _with_msg(name: str) -> str:
    return name if "/msg/" in name else name.replace("/", "/msg/")


def _db3_messages(path: Path, topic: str, budget: Expansion) -> Iterator[BagMessage]:
    with _database(path) as database:
        (found,) = database.execute("PRAGMA quick_check(1)").fetchone()
        if found != "ok":
            raise ValueError(f"the database is damaged: {found}")
        rows = database.execute(
            "SELECT topics.type, messages.timestamp, messages.data FROM messages "
            "JOIN topics ON messages.topic_id = topics.id WHERE topics.name = ?",
            (topic,),
        )
        for type_name, received, data in rows:
            if not (isinstance(received, int) and isinstance(data, bytes)):
                raise ValueError(f"a message is {type(data).__name__}, received at {received!r}")
            raw = budget.expand(data, "zstd") if data.startswith(_ZSTD) else data
            yield Connection(topic, str(type_name), ros1=False), received, raw


@contextlib.contextmanager
def _database(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a database to read; one that was not closed keeps its last part in a file of its own."""
    how = "mode=ro" if path.with_name(f"{path.name}-wal").exists() else "immutable=1"
    with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}?{how}", uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
        database.execute("PRAGMA trusted_schema = OFF")
        (page_size,) = database.execute("PRAGMA page_size").fetchone()
        if rest := path.stat().st_size % page_size:  # SQLite would read zeros in place of what is missing
            raise ValueError(f"its last page has {rest} of {page_size} bytes")
        tables = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('messages', 'topics')"
        if database.execute(tables).fetchone() != (2,):
            raise ValueError("it has no tables of messages and topics")
        yield database


_MESSAGES: dict[str, Callable[[Path, str, Expansion], Iterator[BagMessage]]] = {
    ".bag": _bag1_messages,
    ".mcap": _mcap_messages,
    ".db3": _db3_messages,
}
"""Suffix -> what gives the messages of a topic of a file."""
