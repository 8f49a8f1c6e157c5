"""Fuzzing targets: bags of ROS 1 and 2, and messages."""

import contextlib
import io
import random
import sqlite3
import struct
from pathlib import Path

import zstandard
from mcap.writer import CompressionType, Writer

from fuzz.contract import BAG_IN_FOLDER, Target
from fuzz.mutate import either, of_bytes
from fuzz.recordings import valid, written
from texclass.loaders import load_recording
from texclass.loaders.readers import BAG_METADATA
from texclass.recording import RecordingError
from texclass.robot.ros_messages import MULTI_ARRAY, TYPES, decode_multi_array, decode_stamped
from texclass.robot.topic import decode_messages

IMU, ACCEL = "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped"
N_NUMBERS = dict.fromkeys(TYPES, 6) | {IMU: 37}
"""How many float64 follow the header."""
N = 5
PERIOD_NS = 10_000_000


def stamped(i: int, n_numbers: int, *, ros1: bool = False, order: str = "<") -> bytes:
    """Return message i of a type with a header, numbers 0, 0.1, ... and a frame of 3 letters."""
    stamp = divmod(10**18 + i * PERIOD_NS, 10**9)
    head = struct.pack(f"{order}III", i, *stamp) if ros1 else struct.pack(f"{order}II", *stamp)
    name = b"imu" if ros1 else b"imu\0"
    body = head + struct.pack(f"{order}I", len(name)) + name
    body += b"" if ros1 else bytes(-len(body) % 8)
    numbers = struct.pack(f"{order}{n_numbers}d", *(0.1 * k * (i + 1) for k in range(n_numbers)))
    return (b"" if ros1 else b"\0\1\0\0" if order == "<" else b"\0\0\0\0") + body + numbers


def array(i: int, *, ros1: bool = False) -> bytes:
    """Return a Float64MultiArray of (2, 3)."""
    body = struct.pack("<I", 2)
    for size in (2, 3):
        body += struct.pack("<I", 2) + b"n\0" + (b"" if ros1 else b"\0\0") + struct.pack("<II", size, 6)
    body += struct.pack("<II", 0, 6)
    body += b"" if ros1 else bytes(-len(body) % 8)
    return (b"" if ros1 else b"\0\1\0\0") + body + struct.pack("<6d", *(k + i for k in range(6)))


def mcap(
    compression: CompressionType = CompressionType.NONE, *, chunks: bool = True, kind: str = ACCEL
) -> bytes:
    """Return an MCAP of 5 messages without checksums."""
    buffer = io.BytesIO()
    writer = Writer(buffer, compression=compression, use_chunking=chunks, enable_crcs=False)
    writer.start(profile="ros2", library="")
    schema = writer.register_schema(name=kind, encoding="ros2msg", data=b"")
    channel = writer.register_channel(topic="/imu", message_encoding="cdr", schema_id=schema)
    for i in range(N):
        data = array(i) if kind == MULTI_ARRAY else stamped(i, N_NUMBERS[kind])
        writer.add_message(channel, log_time=i * PERIOD_NS, publish_time=0, data=data)
    writer.finish()
    return buffer.getvalue()


def db3(kind: str = ACCEL) -> bytes:
    """Return a database of 5 messages."""

    def write(path: Path) -> None:
        with contextlib.closing(sqlite3.connect(path)) as database, database:
            database.execute("PRAGMA page_size = 512")
            database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
            database.execute(
                "CREATE TABLE messages"
                "(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
            )
            database.execute("INSERT INTO topics VALUES (1, '/imu', ?)", (kind,))
            rows = [(i, 1, i * PERIOD_NS, stamped(i, N_NUMBERS[kind])) for i in range(N)]
            database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)

    return written("a.db3", write)


def _fields(**values: bytes) -> bytes:
    parts = [name.encode() + b"=" + value for name, value in values.items()]
    joined = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(joined)) + joined


def _sized(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def bag1(compression: str = "none") -> bytes:
    """Return a bag of ROS 1 of 5 messages, its head not padded to 4096 bytes."""
    import bz2

    link = _fields(op=b"\x07", conn=struct.pack("<I", 0), topic=b"/imu")
    link += _fields(topic=b"/imu", type=b"geometry_msgs/AccelStamped", md5sum=b"*", message_definition=b"")
    chunk = link
    for i in range(N):
        time = struct.pack("<II", *divmod(10**18 + i * PERIOD_NS, 10**9))
        chunk += _fields(op=b"\x02", conn=struct.pack("<I", 0), time=time) + _sized(stamped(i, 6, ros1=True))
    packed = bz2.compress(chunk) if compression == "bz2" else chunk
    body = _fields(op=b"\x05", compression=compression.encode(), size=struct.pack("<I", len(chunk)))
    body += _sized(packed)

    def head(at: int) -> bytes:
        counts = {"conn_count": struct.pack("<I", 1), "chunk_count": struct.pack("<I", 1)}
        return (
            b"#ROSBAG V2.0\n" + _fields(op=b"\x03", index_pos=struct.pack("<Q", at), **counts) + _sized(b" ")
        )

    return head(len(head(0)) + len(body)) + body + link


def _read(path: Path) -> object:
    try:
        return valid(load_recording(path))
    except RecordingError:  # the messages of arrays state no unit
        return valid(load_recording(path, unit="arbitrary", column=("c1", "c2", "c3")))


def _read_folder(path: Path) -> object:
    described = path.with_name(BAG_METADATA)
    described.write_bytes(b"x")
    try:
        return valid(load_recording(described, unit="m/s^2"))
    finally:
        described.unlink()


def _messages() -> list[bytes]:
    """Return a message after one byte that encodes its layout and number of repetitions."""
    seeds = [bytes([0]) + stamped(0, N_NUMBERS[t.name]) for t in TYPES.values()]
    seeds += [bytes([1]) + stamped(0, N_NUMBERS[t.name], ros1=True) for t in TYPES.values()]
    return [
        *seeds,
        bytes([0]) + stamped(0, 6, order=">"),
        bytes([0]) + array(0),
        bytes([1]) + array(0, ros1=True),
    ]


def _decode(data: bytes) -> object:
    """Decode as every type; what one refuses another may take."""
    raw, ros1 = data[1:], bool(data[:1] and data[0] & 1)
    refused = None
    seeds: list[object] = []
    for type_ in TYPES.values():
        try:
            whole = stamped(0, N_NUMBERS[type_.name], ros1=ros1)
            stamps, samples = decode_stamped(type_, [raw, raw, whole], [*type_.columns], ros1=ros1)
            assert stamps.shape == (3,)
            assert samples.shape == (3, len(type_.columns))
            seeds.append(samples)
        except ValueError as error:
            refused = error
    try:
        samples = decode_multi_array(raw, ros1=ros1)
        assert samples.ndim == 2
        assert samples.size
        seeds.append(samples)
    except ValueError as error:
        refused = error
    if not seeds and refused is not None:
        raise refused
    return seeds


def _hear(data: bytes) -> object:
    """Take messages as the subscriber does: damaged ones are left out, nothing is raised."""
    raws = [data[1:], stamped(0, 37), data[1:]]
    for kind, columns in (
        (IMU, TYPES[IMU].acceleration),
        (ACCEL, TYPES[ACCEL].acceleration),
        (MULTI_ARRAY, ()),
    ):
        seeds = decode_messages(raws, [1, 2, 3], kind, columns)
        assert seeds is None or len(seeds.samples) + seeds.n_damaged == len(raws)
    return raws


def _zstd(rng: random.Random, data: bytes) -> bytes:
    """Mutate the contents of a compressed file and compress them again."""
    try:
        inner = zstandard.ZstdDecompressor().decompress(data, max_output_size=1 << 20)
    except (zstandard.ZstdError, MemoryError):
        return of_bytes(rng, data)
    return zstandard.compress(of_bytes(rng, inner))


def _mcaps() -> list[bytes]:
    return [
        mcap(),
        mcap(CompressionType.ZSTD),
        mcap(CompressionType.LZ4),
        mcap(chunks=False),
        mcap(kind=MULTI_ARRAY),
    ]


TARGETS = (
    Target("rosbag1", lambda: [bag1(), bag1("bz2")], _read, of_bytes, "fuzzed.bag"),
    Target("rosbag2 mcap", _mcaps, _read, of_bytes, "fuzzed.mcap"),
    Target("rosbag2 sqlite3", lambda: [db3()], _read, of_bytes, "fuzzed.db3"),
    Target(
        "rosbag2 compressed as a whole",
        lambda: [zstandard.compress(mcap())],
        _read_folder,
        either(_zstd, _zstd, of_bytes),
        BAG_IN_FOLDER,
    ),
    Target("ros messages", _messages, _decode, of_bytes, ""),
    Target("ros messages on the wire", _messages, _hear, of_bytes, ""),
)
