"""Damaged and malicious bags: reading returns a recording or raises one clear error."""

import bz2
import io
import sqlite3
import struct
import tracemalloc

import lz4.frame
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra `robot` is not installed")
pytest.importorskip("mcap", reason="the extra `robot` is not installed")

import zstandard
from bag_writer import IMU, KINDS, Topic, message, regular, write_bag
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from texclass.loaders import load_recording
from texclass.recording import RecordingError
from texclass.robot.bag_files import MAX_EXPANSION, Decompressor
from texclass.robot.ros_messages import (
    TYPES,
    decode_stamped,
)

N = 40


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder for damaged bags, and the bytes of a small valid bag of every kind."""
    folder = tmp_path_factory.mktemp("bags")
    topic = {"/imu": Topic(IMU, np.random.default_rng(0).normal(size=(N, 6)), regular(N, 100))}
    bags = {kind: write_bag(folder, kind, topic, name=kind).read_bytes() for kind in KINDS}
    bags["bz2"] = write_bag(folder, "bag", topic, name="z", compression="bz2").read_bytes()
    return folder, bags


def _attempt(folder, kind, data):
    """Return the recording of a bag, or None after a RecordingError that names the file."""
    path = folder / f"damaged.{'bag' if kind == 'bz2' else kind}"
    path.write_bytes(data)
    try:
        return load_recording(path)
    except RecordingError as error:
        message = str(error)
    assert str(path) in message
    assert "\n" not in message
    return None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_a_truncated_bag_is_an_error(whole, kind, share):
    folder, bags = whole
    assert _attempt(folder, kind, bags[kind][: int(share * len(bags[kind]))]) is None
    assert _attempt(folder, kind, bags[kind]) is not None


@pytest.mark.parametrize("store", [Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def test_every_message_type_is_decoded_as_it_was_serialised(store):
    ros1 = store is Stores.ROS1_NOETIC
    types = get_typestore(store)
    serialize = types.serialize_ros1 if ros1 else types.serialize_cdr
    values = np.random.default_rng(1).normal(size=(5, 6))
    for name, type_ in TYPES.items():
        raws = [
            bytes(
                serialize(
                    message(types, Topic(name, None, None, frame="x" * i), 10**18 + i, v, ros1=ros1), name
                )
            )
            for i, v in enumerate(values)
        ]
        columns = [column for column, where in type_.columns.items() if len(where) == 1]
        stamps, decoded = decode_stamped(type_, raws, columns, ros1=ros1)
        np.testing.assert_array_equal(stamps, 10**18 + np.arange(5))
        np.testing.assert_array_equal(decoded, values[:, : len(columns)])


@pytest.mark.parametrize("compression", ["bz2", "lz4", "zstd"])
def test_a_decompression_bomb_raises_an_error_before_it_fills_the_memory(compression):
    zeros = bytes(1 << 27)
    compress = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstandard.compress}[compression]
    packed = compress(zeros)
    del zeros
    tracemalloc.start()
    with pytest.raises(ValueError, match="decompressed data must have at most"):
        Decompressor(len(packed)).decompress(packed, compression)
    assert tracemalloc.get_traced_memory()[1] < 5 * (1 << 26)
    tracemalloc.stop()


def test_the_total_size_of_decompressed_chunks_is_limited():
    packed = zstandard.compress(bytes(1 << 24))
    decompressor = Decompressor(len(packed))
    for _ in range(4):
        decompressor.decompress(packed, "zstd", 1 << 24)
    with pytest.raises(ValueError, match=f"{MAX_EXPANSION} times"):
        decompressor.decompress(packed, "zstd", 1 << 24)


def _mcap(path, messages, encoding="cdr", name=IMU):
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(name=name, encoding="ros2msg", data=b"")
        channel = writer.register_channel(topic="/imu", message_encoding=encoding, schema_id=schema)
        for i, data in enumerate(messages):
            writer.add_message(channel, log_time=i * 10**7, publish_time=0, data=data)
        writer.finish()
    return path


HEAD = b"\x00\x01\x00\x00" + bytes(8)
WHOLE = HEAD + b"\x01\0\0\0" + bytes(300)


def test_a_damaged_message_raises_an_error_with_topic_and_type(tmp_path):
    for data in (b"", HEAD[:8], HEAD + b"\xff" * 4, b"\x00\x03\x00\x00" + WHOLE[4:], WHOLE[:-8]):
        error = rf"/imu: {IMU}: a message of {len(data)} bytes is damaged.* Expected a complete message"
        with pytest.raises(RecordingError, match=error):
            load_recording(_mcap(tmp_path / "x.mcap", [data] * 3))


@pytest.mark.parametrize("n", [0, 1])
def test_a_bag_of_fewer_than_two_messages_raises_an_error(tmp_path, n):
    with pytest.raises(RecordingError, match=rf"/imu: has {n} messages|has no topic"):
        load_recording(_mcap(tmp_path / "x.mcap", [WHOLE] * n))


def test_a_database_with_other_tables_or_a_view_instead_of_a_table_raises_an_error(tmp_path):
    for i, view in enumerate(("CREATE TABLE messages(x)", "CREATE VIEW messages AS SELECT 1 AS id")):
        path = tmp_path / f"{i}.db3"
        with sqlite3.connect(path) as database:
            database.execute(view)
            database.execute("CREATE TABLE topics(id, name, type)" if i else "CREATE TABLE other(x)")
        database.close()
        with pytest.raises(RecordingError, match="it has no tables 'messages' and 'topics'"):
            load_recording(path)


def test_a_generated_column_cannot_fill_the_memory(tmp_path):
    path = tmp_path / "x.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE topics(id INTEGER, name TEXT, type TEXT)")
        database.execute(
            "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, "
            "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)))"
        )
        database.execute(f"INSERT INTO topics VALUES (1, '/imu', '{IMU}')")
        database.executemany(
            "INSERT INTO messages(id, topic_id, timestamp) VALUES (?, 1, ?)", [(1, 1), (2, 2)]
        )
    database.close()
    with pytest.raises(RecordingError, match="cannot read the bag"):
        load_recording(path)


def test_a_rosbag_with_too_large_sizes_in_its_header_raises_an_error(tmp_path):
    def field(name, value):
        content = name + b"=" + value
        return struct.pack("<I", len(content)) + content

    head = field(b"op", b"\x03") + field(b"index_pos", struct.pack("<Q", 40))
    head += field(b"conn_count", b"\xff" * 4) + field(b"chunk_count", b"\xff" * 4)
    file = io.BytesIO()
    file.write(b"#ROSBAG V2.0\n" + struct.pack("<I", len(head)) + head + b"\xff\xff\xff\x7f")
    path = tmp_path / "x.bag"
    path.write_bytes(file.getvalue())
    with pytest.raises(RecordingError, match="cannot read the bag"):
        load_recording(path)
