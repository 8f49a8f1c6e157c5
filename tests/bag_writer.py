"""Real bags of known content, written with the `rosbags` library."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore
from scipy.signal import lfilter

START_NS = 1_700_000_000_000_000_000
IMU = "sensor_msgs/msg/Imu"
ARRAY = "std_msgs/msg/Float64MultiArray"
KINDS = ("bag", "mcap", "db3")


@dataclass
class Topic:
    """Messages of one topic: stamps (None: no header), values (n, columns) or a list of blocks, receipts."""

    type_name: str
    values: object
    stamps_ns: np.ndarray | None
    received_ns: np.ndarray | None = None
    frame: str = "imu_link"


def regular(n: int, fs: float, start_ns: int = START_NS) -> np.ndarray:
    """Return n stamps in nanoseconds at fs Hz."""
    return start_ns + np.rint(np.arange(n) * 1e9 / fs).astype(np.int64)


def write_bag(folder: Path, kind: str, topics: dict[str, Topic], *, compression: str = "", name: str = "run"):
    """Write a bag and return the path of its file; a rosbag2 stands in a folder with its metadata."""
    folder.mkdir(parents=True, exist_ok=True)
    if kind == "bag":
        path = folder / f"{name}.bag"
        writer = rosbag1.Writer(path)
        if compression:
            writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
        store = get_typestore(Stores.ROS1_NOETIC)
    else:
        path = folder / name / f"{name}.{kind}"
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(folder / name, version=9, storage_plugin=plugin)
        if compression:
            mode = rosbag2.CompressionMode[compression.upper()]
            writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
        store = get_typestore(Stores.ROS2_HUMBLE)
    with writer:
        _write(writer, store, topics, ros1=kind == "bag")
    return path


def write_drives(folder: Path, n: int = 8) -> None:
    """Write bags of n drives of 10 s over each of two floors, with IMUs at front and rear."""
    rng = np.random.default_rng(0)
    stamps = regular(1000, 100.0)
    for floor, pole in (("carpet", 0.9), ("tile", -0.5)):
        for drive in range(1, n + 1):
            topics = {}
            for place in ("front", "rear"):
                values = np.tile([0, 0, 9.81, 0, 0, 0], (1000, 1))
                values[:, :3] += lfilter([1], [1, -pole], rng.standard_normal((1000, 3)), axis=0)
                topics[f"/{place}/imu"] = Topic(IMU, values, stamps)
            write_bag(folder / floor, "mcap", topics, name=f"drive_{drive}")


def write_touches(folder: Path, n: int = 4) -> None:
    """Write bags of n touches of 2 s of each of two floors, with IMU, wrench and contact microphone."""
    rng = np.random.default_rng(0)
    stamps = regular(200, 100.0)
    for floor, pole, friction in (("carpet", 0.9, 0.5), ("tile", -0.5, 0.2)):
        for touch in range(1, n + 1):
            imu, wrench = rng.standard_normal((200, 6)), 0.02 * rng.standard_normal((2000, 6))
            imu[:, 2] += 9.81
            wrench[:, 0] += friction
            sound = lfilter([1], [1, -pole], rng.standard_normal(20_000)).reshape(200, 100, 1)
            topics = {
                "/imu": Topic(IMU, imu, stamps),
                "/wrench": Topic("geometry_msgs/msg/WrenchStamped", wrench, regular(2000, 1000.0)),
                # A block is received with its last sample.
                "/microphone": Topic(ARRAY, sound, None, stamps + 9_900_000),
            }
            write_bag(folder / floor, "mcap", topics, name=f"touch_{touch}")


def _write(writer, store, topics, *, ros1):
    lines = []
    for topic, description in topics.items():
        connection = writer.add_connection(topic, description.type_name, typestore=store)
        received = (
            description.received_ns
            if description.received_ns is not None
            else description.stamps_ns + 200_000
        )
        for i, (at, value) in enumerate(zip(received, description.values, strict=True)):
            stamp = None if description.stamps_ns is None else int(description.stamps_ns[i])
            lines.append((int(at), connection, message(store, description, stamp, value, ros1=ros1)))
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    for at, connection, content in sorted(lines, key=lambda line: line[0]):
        writer.write(connection, at, serialize(content, connection.msgtype))


def message(store, description: Topic, stamp: int | None, value, *, ros1: bool):
    """Return one message of the types that carry signals; an Imu's values are ax, ay, az, wx, wy, wz."""
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"]
    if description.type_name == ARRAY:
        return _array(types, np.asarray(value, float))
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    make_header = types["std_msgs/msg/Header"]
    header = make_header(7, time, description.frame) if ros1 else make_header(time, description.frame)
    if description.type_name == IMU:
        none, rotation = np.zeros(9), types["geometry_msgs/msg/Quaternion"](0, 0, 0, 1)
        a, w = vector(*value[:3]), vector(*value[3:6])
        return types[IMU](header, rotation, none, w, none, a, none)
    inner = description.type_name.rpartition("/")[2].removesuffix("Stamped")
    body = types[f"geometry_msgs/msg/{inner}"](vector(*value[:3]), vector(*value[3:6]))
    return types[description.type_name](header, body)


def _array(types, value):
    dimension = types["std_msgs/msg/MultiArrayDimension"]
    sizes = zip(("samples", "channels"), value.shape, strict=True) if value.ndim == 2 else ()
    dims = [dimension(label, size, value.size) for label, size in sizes]
    layout = types["std_msgs/msg/MultiArrayLayout"](dims, 0)
    return types[ARRAY](layout, value.ravel())
