import dataclasses

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")
pytest.importorskip("rosbags", reason="rosbags is not installed (the extra `robot`)")

from rosbags.typesys import Stores, get_typestore

from texclass.recognition.sources.training_input import InputColumns
from texclass.recording import RecordingError
from texclass.robot import topic_blocks
from texclass.robot.dds import dds_topic, dds_type, message_class, ros_type
from texclass.robot.ros_messages import MULTI_ARRAY
from texclass.robot.topic import decode_messages


def message(name, *values):
    return message_class(name)(*values)


HEADER = message("std_msgs/msg/Header", message("builtin_interfaces/msg/Time", 12, 345_678_901), "imu_link")
A, W = (message("geometry_msgs/msg/Vector3", *xyz) for xyz in ((1.5, -2.5, 9.81), (0.1, 0.2, -0.3)))
COVARIANCE = [float(i) for i in range(9)]
EXAMPLES = {
    "sensor_msgs/msg/Imu": (
        HEADER,
        message("geometry_msgs/msg/Quaternion", 0, 0, 1, 0),
        *(COVARIANCE, W, COVARIANCE, A, COVARIANCE),
    ),
    "geometry_msgs/msg/AccelStamped": (HEADER, message("geometry_msgs/msg/Accel", A, W)),
    "std_msgs/msg/Float64MultiArray": (
        message(
            "std_msgs/msg/MultiArrayLayout",
            [
                message("std_msgs/msg/MultiArrayDimension", name, 2, n)
                for name, n in (("samples", 4), ("c", 2))
            ],
            0,
        ),
        [1.0, 2.0, 3.0, 4.0],
    ),
    "std_msgs/msg/String": ('{"surface": "wood"}',),
    "diagnostic_msgs/msg/DiagnosticArray": (
        HEADER,
        [
            message("diagnostic_msgs/msg/DiagnosticStatus", 1, "texclass: surface", "unknown", "", pairs)
            for pairs in ([message("diagnostic_msgs/msg/KeyValue", "a", "b")], [])
        ],
    ),
}
EXAMPLES = {name: message(name, *values) for name, values in EXAMPLES.items()}
STORE = get_typestore(Stores.ROS2_HUMBLE)


@pytest.mark.parametrize("name", EXAMPLES)
def test_our_serialisation_equals_that_of_ros(name):
    raw = EXAMPLES[name].serialize(use_version_2=False)
    read = STORE.deserialize_cdr(raw, name)
    theirs = bytes(STORE.serialize_cdr(read, name))
    assert raw[:2] == theirs[:2] == b"\x00\x01"
    assert raw[4 : len(theirs)] == theirs[4:]
    assert not raw[len(theirs) :].strip(b"\0")
    assert is_same(EXAMPLES[name], read)
    assert type(EXAMPLES[name]).__idl_typename__ == dds_type(name)
    assert ros_type(dds_type(name)) == name


def is_same(ours, read):
    """Return whether our message has the fields and values of a message that ROS has read."""
    if dataclasses.is_dataclass(ours):
        names = [field.name for field in dataclasses.fields(ours)]
        return all(is_same(getattr(ours, name), getattr(read, name)) for name in names)
    if isinstance(ours, list):
        return len(ours) == len(read) and all(map(is_same, ours, read))
    return ours == read


def test_names_of_topics_and_types_follow_ros_2():
    assert dds_topic("/imu/data") == dds_topic("imu/data") == "rt/imu/data"
    assert dds_type("sensor_msgs/msg/Imu") == "sensor_msgs::msg::dds_::Imu_"


IMU = "sensor_msgs/msg/Imu"
AXES = ("ax", "ay", "az")


def _imu(x):
    header = message("std_msgs/msg/Header", message("builtin_interfaces/msg/Time", 1, x), "imu")
    a = message("geometry_msgs/msg/Vector3", x, 0, 0)
    return message_class(IMU)(header, linear_acceleration=a).serialize(use_version_2=False)


def test_damaged_messages_are_left_out_and_counted():
    raws = [_imu(1), b"", _imu(2)[:50], _imu(3), b"\x00\x09" + _imu(4)[2:]]
    batch = decode_messages(raws, [10, 20, 30, 40, 50], IMU, AXES)
    assert batch.n_damaged == 3
    np.testing.assert_array_equal(batch.samples[:, 0, 0], [1, 3])
    np.testing.assert_array_equal(batch.timestamps_ns, [1_000_000_001, 1_000_000_003])
    np.testing.assert_array_equal(batch.sent_ns, [10, 40])
    assert decode_messages([b"", b"\0"], [1, 2], IMU, AXES) is None


def test_messages_of_another_size_than_the_first_are_left_out():
    def block(n):
        sizes = (("samples", n, 2 * n), ("channels", 2, 2))
        dims = [message("std_msgs/msg/MultiArrayDimension", *size) for size in sizes]
        layout = message("std_msgs/msg/MultiArrayLayout", dims, 0)
        return message(MULTI_ARRAY, layout, [float(n)] * 2 * n).serialize(use_version_2=False)

    batch = decode_messages([block(3), block(4), block(3)], [1, 2, 3], MULTI_ARRAY, ())
    assert batch.samples.shape == (2, 3, 2)
    assert batch.n_damaged == 1
    np.testing.assert_array_equal(batch.timestamps_ns, [1, 3])


def test_a_topic_without_friction_raises_an_error_before_the_stream_starts():
    columns = InputColumns(("ax", "ay", "az"), ("friction",), ("friction",))
    error = r"no friction signal, but the model needs it \(friction\). Expected ax, ay, az, friction"
    with pytest.raises(RecordingError, match=f"ros2:/imu: sensor_msgs/msg/Imu has {error}"):
        topic_blocks("/imu", type_name="sensor_msgs/msg/Imu", reliability="reliable", columns=columns)
