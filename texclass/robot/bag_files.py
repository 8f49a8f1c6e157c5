"""Low-level access to ROS bags: their topics, and the bytes of their messages.

The module supports rosbag1, and rosbag2 in MCAP or SQLite. Bags may be compressed, and may be a single file
or a folder of consecutive files.

Bags may also be damaged or malicious. The readers of the package rosbags follow the index of a bag and trust
the sizes in it, so a bag of 1 kB can exhaust the memory. This module therefore reads messages from the first
byte to the last, and limits decompression.
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

MAX_BYTES = 1 << 27
"""Largest size of a decompressed chunk or message (128 MB)."""
MAX_EXPANSION = 100
"""Largest ratio of the decompressed size of a bag to its file size; 64 MB are always allowed."""
MAX_TOPICS = 10_000
"""Largest number of topics of a bag; a larger number indicates a damaged file."""
_MAGIC1 = b"#ROSBAG V2.0\n"
_ZSTD = b"\x28\xb5\x2f\xfd"


class Connection(NamedTuple):
    """Topic of a bag, with its message type, serialisation (ROS 1 or CDR) and message definition."""

    topic: str
    type_name: str
    ros1: bool
    definition: str = ""

    @property
    def type_key(self) -> tuple[str, str, bool]:
        """Arguments for `type_of`: name and definition of the message type, and `ros1`."""
        return self.type_name, self.definition, self.ros1


BagMessage = tuple[Connection, int, bytes]
"""Connection, time of receipt in nanoseconds, serialised message."""


class Decompressor:
    """Decompressor with a limit on the total size, which protects against decompression bombs.

    Parameters
    ----------
    file_size : int
        Size of the file in bytes.

    Attributes
    ----------
    n_remaining : int
        Number of bytes that may still be decompressed.

    Examples
    --------
    >>> Decompressor(file_size=1000).decompress(bz2.compress(b"texture"), "bz2")
    b'texture'
    """

    def __init__(self, file_size: int) -> None:
        self.n_remaining = max(MAX_EXPANSION * file_size, 1 << 26)

    def decompress(self, data: bytes, compression: str, max_bytes: int = MAX_BYTES) -> bytes:
        """Return decompressed data.

        Parameters
        ----------
        data : bytes
            Compressed data.
        compression : str
            "" or "none", "bz2", "lz4" or "zstd".
        max_bytes : int
            Largest size of the result in bytes.

        Raises
        ------
        ValueError
            If the compression is unknown, or the result would exceed a limit.
        """
        if compression in ("", "none"):
            return data
        if compression not in _DECOMPRESS:
            raise ValueError(f"compression must be none, bz2, lz4 or zstd, got {compression!r}")
        limit = min(max_bytes, MAX_BYTES, self.n_remaining)
        result = _DECOMPRESS[compression](data, limit + 1)
        self.n_remaining -= len(result)
        if len(result) > limit:
            raise ValueError(
                f"decompressed data must have at most {limit} bytes, and at most {MAX_EXPANSION} times "
                "the size of the file"
            )
        return result


_DECOMPRESS: dict[str, Callable[[bytes, int], bytes]] = {
    "bz2": lambda data, limit: bz2.BZ2Decompressor().decompress(data, limit),
    "lz4": lambda data, limit: bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, limit)),
    "zstd": lambda data, limit: _zstd().stream_reader(data, read_across_frames=True).read(limit),
}


def _zstd() -> zstandard.ZstdDecompressor:
    """Return a decompressor that rejects frames with a window of more than 128 MB."""
    return zstandard.ZstdDecompressor(max_window_size=1 << 27)


def bag_topics(path: Path) -> dict[str, Connection]:
    """Return the connections of a bag by topic.

    Parameters
    ----------
    path : Path
        File, folder, or `metadata.yaml` of a folder.

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    connections: dict[str, Connection] = {}
    for storage_file in _storage_files(path):
        with _open_storage(storage_file) as (file, suffix):
            for connection in _connections(file, suffix):
                connections.setdefault(connection.topic, connection)
                if len(connections) > MAX_TOPICS:
                    raise ValueError(f"more than {MAX_TOPICS} topics")
    return connections


def bag_messages(path: Path, connection: Connection) -> Iterator[tuple[int, bytes]]:
    """Yield the time of receipt (ns) and the bytes of each message of a topic, in the order of the bag.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or the topic has messages of several types.
    """
    for storage_file in _storage_files(path):
        with _open_storage(storage_file) as (file, suffix):
            decompressor = Decompressor(file.stat().st_size)
            for sender, receipt_ns, raw in _MESSAGES[suffix](file, connection.topic, decompressor):
                if sender[:3] != connection[:3]:
                    types = f"{sender.type_name} and {connection.type_name}"
                    raise reader_error(
                        path, f"{connection.topic} has messages of types {types}", "one type per topic"
                    )
                yield receipt_ns, raw


def _storage_files(path: Path) -> tuple[Path, ...]:
    """Return the files that contain the messages of a bag, sorted by the numbers in their names."""
    folder = path if path.is_dir() else path.parent if path.name == BAG_METADATA else None
    if folder is None:
        return (path,)
    files = [
        file
        for file in folder.iterdir()
        if storage_suffix(file.name) in STORAGE_SUFFIXES and not is_hidden(file.name)
    ]
    if not files:
        raise reader_error(folder, "contains no .mcap or .db3 file", "a folder of rosbag2")
    return tuple(sorted(files, key=lambda file: [int(n) for n in re.findall(r"\d+", file.name)]))


@contextlib.contextmanager
def _open_storage(path: Path) -> Iterator[tuple[Path, str]]:
    """Provide a storage file, decompressed if necessary, and its suffix.

    Any error that the libraries raise for a damaged file becomes a RecordingError.
    """
    try:
        suffix = storage_suffix(path.name)
        if suffix == path.suffix.lower():
            yield path, suffix
            return
        with tempfile.TemporaryDirectory() as folder, path.open("rb") as compressed:
            target, max_bytes = Path(folder) / f"bag{suffix}", Decompressor(path.stat().st_size).n_remaining
            with (
                target.open("wb") as file,
                _zstd().stream_reader(compressed, read_across_frames=True) as stream,
            ):
                while data := stream.read(1 << 20):
                    file.write(data)
                    if file.tell() > max_bytes:
                        raise ValueError(f"the bag is more than {MAX_EXPANSION} times larger than the file")
            yield target, suffix
    except RecordingError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: cannot read the bag ({reason}). It may be incomplete") from error


def _connections(path: Path, suffix: str) -> Iterator[Connection]:
    """Yield the connections in the index of a storage file, or of all messages of an MCAP without one."""
    match suffix:
        case ".bag":
            with path.open("rb") as file:
                index_offset, n = _bag1_start(file)
                file.seek(index_offset)
                for _ in range(n):
                    yield _bag1_connection(Header.read(file, RecordType.CONNECTION), file)[1]
        case ".mcap":
            with path.open("rb") as file:
                summary = make_reader(file).get_summary()
            if summary is not None and summary.channels:
                for channel in summary.channels.values():
                    yield _mcap_connection(channel, summary.schemas)
            else:
                messages = _mcap_messages(path, None, Decompressor(path.stat().st_size))
                yield from (connection for connection, _, _ in messages)
        case ".db3":
            with _database(path) as database:
                rows = database.execute("SELECT name, type FROM topics").fetchmany(MAX_TOPICS + 1)
            yield from (Connection(str(name), str(type_name), ros1=False) for name, type_name in rows)


def _bag1_messages(path: Path, topic: str, decompressor: Decompressor) -> Iterator[BagMessage]:
    with path.open("rb") as file:
        index_offset, _ = _bag1_start(file)
        connections: dict[int, Connection] = {}
        while file.tell() < index_offset:
            header = Header.read(file)
            size = read_uint32(file)
            if header.get_uint8("op") != RecordType.CHUNK:
                file.seek(size, 1)
                continue
            chunk = decompressor.decompress(read_bytes(file, size), header.get_string("compression"))
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


def _check_size(chunk: bytes, n_bytes: int) -> None:
    if len(chunk) != n_bytes:
        raise ValueError(f"a chunk must have {n_bytes} bytes, got {len(chunk)}")


def _bag1_start(file: BinaryIO) -> tuple[int, int]:
    """Return the offset of the index of a rosbag1, and its number of connections."""
    if file.read(len(_MAGIC1)) != _MAGIC1:
        raise ValueError("it does not start with the header of a rosbag of version 2.0")
    header = Header.read(file, RecordType.BAGHEADER)
    if not (index_offset := header.get_uint64("index_pos")):
        raise ValueError("it was not closed: run `rosbag reindex`")
    file.seek(read_uint32(file), 1)
    return index_offset, header.get_uint32("conn_count")


def _bag1_connection(header: Header, file: BinaryIO) -> tuple[int, Connection]:
    type_header = Header.read(file)
    name, definition = type_header.get_string("type"), type_header.get_string("message_definition")
    connection = Connection(header.get_string("topic"), _ros2_type_name(name), True, definition)
    return header.get_uint32("conn"), connection


def _mcap_messages(path: Path, topic: str | None, decompressor: Decompressor) -> Iterator[BagMessage]:
    schemas: dict[int, Schema] = {}
    connections: dict[int, Connection] = {}
    with path.open("rb") as file:
        for outer in StreamReader(file, emit_chunks=True, record_size_limit=MAX_BYTES).records:
            for record in _mcap_chunk(outer, decompressor) if isinstance(outer, Chunk) else (outer,):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    connections[record.id] = _mcap_connection(record, schemas)
                elif isinstance(record, Message) and topic in (None, connections[record.channel_id].topic):
                    yield connections[record.channel_id], record.log_time, record.data


def _mcap_chunk(chunk: Chunk, decompressor: Decompressor) -> Iterator[Schema | Channel | Message]:
    data = decompressor.decompress(chunk.data, chunk.compression, chunk.uncompressed_size)
    _check_size(data, chunk.uncompressed_size)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("a chunk has the wrong checksum")
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
    return Connection(channel.topic, _ros2_type_name(schema.name), ros1, definition)


def _ros2_type_name(name: str) -> str:
    """Return "package/msg/Type" for the ROS 1 name "package/Type"."""
    return name if "/msg/" in name else name.replace("/", "/msg/")


def _db3_messages(path: Path, topic: str, decompressor: Decompressor) -> Iterator[BagMessage]:
    with _database(path) as database:
        (result,) = database.execute("PRAGMA quick_check(1)").fetchone()
        if result != "ok":
            raise ValueError(f"the database is damaged: {result}")
        rows = database.execute(
            "SELECT topics.type, messages.timestamp, messages.data FROM messages "
            "JOIN topics ON messages.topic_id = topics.id WHERE topics.name = ?",
            (topic,),
        )
        for type_name, receipt_ns, data in rows:
            if not (isinstance(receipt_ns, int) and isinstance(data, bytes)):
                raise ValueError(
                    f"a message must be bytes with an integer time of receipt, got {type(data).__name__} and "
                    f"{receipt_ns!r}"
                )
            raw = decompressor.decompress(data, "zstd") if data.startswith(_ZSTD) else data
            yield Connection(topic, str(type_name), ros1=False), receipt_ns, raw


@contextlib.contextmanager
def _database(path: Path) -> Iterator[sqlite3.Connection]:
    """Open the SQLite database of a bag for reading."""
    # A database that was not closed has its last messages in a write-ahead log, which "immutable" ignores.
    mode = "mode=ro" if path.with_name(f"{path.name}-wal").exists() else "immutable=1"
    with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}?{mode}", uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_BYTES)
        database.execute("PRAGMA trusted_schema = OFF")
        (page_size,) = database.execute("PRAGMA page_size").fetchone()
        if (
            n_bytes := path.stat().st_size % page_size
        ):  # SQLite reads zeros for missing bytes, without an error
            raise ValueError(f"its last page has {n_bytes} of {page_size} bytes")
        tables = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('messages', 'topics')"
        if database.execute(tables).fetchone() != (2,):
            raise ValueError("it has no tables 'messages' and 'topics'")
        yield database


_MESSAGES: dict[str, Callable[[Path, str, Decompressor], Iterator[BagMessage]]] = {
    ".bag": _bag1_messages,
    ".mcap": _mcap_messages,
    ".db3": _db3_messages,
}
"""Suffix of a storage file -> reader of the messages of a topic."""
