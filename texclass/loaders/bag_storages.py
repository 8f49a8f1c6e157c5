"""The three ways in which bags store messages: rosbag1, rosbag2 in MCAP, rosbag2 in SQLite.

Each is read from the first byte to the last. What an index says is not followed: one that lies could lead in
circles.
"""

import contextlib
import io
import sqlite3
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag1.reader import Header, RecordType, read_bytes, read_uint32

from texclass.loaders.bag_expansion import MOST_BYTES, Budget

MOST_TOPICS = 10_000
_MAGIC1 = b"#ROSBAG V2.0\n"
_ZSTD = b"\x28\xb5\x2f\xfd"


class Connection(NamedTuple):
    """A topic and what is sent there ("package/msg/Type"), and whether in the layout of ROS 1."""

    topic: str
    type_name: str
    ros1: bool


BagMessage = tuple[Connection, int, bytes]
"""Connection, time of receipt in nanoseconds, serialised message."""


def _bag1_topics(path: Path) -> list[Connection]:
    with path.open("rb") as file:
        index_at, n = _bag1_start(file)
        file.seek(index_at)
        return [_bag1_connection(Header.read(file, RecordType.CONNECTION), file)[1] for _ in range(n)]


def _bag1_messages(path: Path, topic: str, budget: Budget) -> Iterator[BagMessage]:
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
            if len(chunk) != header.get_uint32("size"):
                raise ValueError(f"a chunk holds {len(chunk)} bytes, not {header.get_uint32('size')}")
            yield from _bag1_chunk(chunk, connections, topic)


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
    name = told.get_string("type")
    type_name = name if "/msg/" in name else name.replace("/", "/msg/")
    return header.get_uint32("conn"), Connection(header.get_string("topic"), type_name, ros1=True)


def _bag1_chunk(chunk: bytes, connections: dict[int, Connection], topic: str) -> Iterator[BagMessage]:
    file = io.BytesIO(chunk)
    while file.tell() < len(chunk):
        header = Header.read(file)
        kind = header.get_uint8("op")
        if kind == RecordType.CONNECTION:
            number, connection = _bag1_connection(header, file)
            connections[number] = connection
            continue
        data = read_bytes(file, read_uint32(file))
        if kind == RecordType.MSGDATA:
            connection = connections[header.get_uint32("conn")]
            if connection.topic == topic:
                yield connection, header.get_time("time"), data


def _mcap_topics(path: Path) -> list[Connection]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        if summary is None or not summary.channels:
            return list(_mcap_scan(path))
        return [_mcap_connection(channel, summary.schemas) for channel in summary.channels.values()]


def _mcap_scan(path: Path) -> dict[Connection, None]:
    """Return the connections of a file without a summary."""
    found: dict[Connection, None] = {}
    for connection, _, _ in _mcap_messages(path, None, Budget(path.stat().st_size)):
        found[connection] = None
        if len(found) > MOST_TOPICS:
            break
    return found


def _mcap_messages(path: Path, topic: str | None, budget: Budget) -> Iterator[BagMessage]:
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


def _mcap_chunk(chunk: Chunk, budget: Budget) -> Iterator[Schema | Channel | Message]:
    data = budget.expand(chunk.data, chunk.compression, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"a chunk holds {len(data)} bytes, not {chunk.uncompressed_size}")
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
    name = schemas[channel.schema_id].name if channel.schema_id in schemas else ""
    return Connection(channel.topic, name if "/msg/" in name else name.replace("/", "/msg/"), ros1)


def _db3_topics(path: Path) -> list[Connection]:
    with _database(path) as database:
        rows = database.execute("SELECT name, type FROM topics").fetchmany(MOST_TOPICS + 1)
        return [Connection(str(name), str(type_name), ros1=False) for name, type_name in rows]


def _db3_messages(path: Path, topic: str, budget: Budget) -> Iterator[BagMessage]:
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
        tables = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('messages', 'topics')"
        if database.execute(tables).fetchone() != (2,):
            raise ValueError("it has no tables of messages and topics")
        yield database


READERS = {
    ".bag": (_bag1_topics, _bag1_messages),
    ".mcap": (_mcap_topics, _mcap_messages),
    ".db3": (_db3_topics, _db3_messages),
}
"""Suffix -> what gives the connections of a file, and what gives the messages of one of its topics."""
