import dataclasses

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")
pytest.importorskip("rosbags", reason="rosbags is not installed (the extra `robot`)")

from rosbags.typesys import Stores, get_typestore

from texclass.recognition import AnswerPublisher
from texclass.recognition.sources.dds import dds_topic, dds_type, message_class, ros_type


def made(name, *values):
    return message_class(name)(*values)


HEADER = made("std_msgs/msg/Header", made("builtin_interfaces/msg/Time", 12, 345_678_901), "imu_link")
A, W = (made("geometry_msgs/msg/Vector3", *xyz) for xyz in ((1.5, -2.5, 9.81), (0.1, 0.2, -0.3)))
COVARIANCE = [float(i) for i in range(9)]
EXAMPLES = {
    "sensor_msgs/msg/Imu": (
        HEADER,
        made("geometry_msgs/msg/Quaternion", 0, 0, 1, 0),
        *(COVARIANCE, W, COVARIANCE, A, COVARIANCE),
    ),
    "geometry_msgs/msg/AccelStamped": (HEADER, made("geometry_msgs/msg/Accel", A, W)),
    "std_msgs/msg/Float64MultiArray": (
        made(
            "std_msgs/msg/MultiArrayLayout",
            [made("std_msgs/msg/MultiArrayDimension", name, 2, n) for name, n in (("samples", 4), ("c", 2))],
            0,
        ),
        [1.0, 2.0, 3.0, 4.0],
    ),
    "std_msgs/msg/String": ('{"surface": "wood"}',),
    "diagnostic_msgs/msg/DiagnosticArray": (
        HEADER,
        [
            made("diagnostic_msgs/msg/DiagnosticStatus", 1, "texclass: surface", "unknown", "", pairs)
            for pairs in ([made("diagnostic_msgs/msg/KeyValue", "a", "b")], [])
        ],
    ),
}
EXAMPLES = {name: made(name, *values) for name, values in EXAMPLES.items()}
STORE = get_typestore(Stores.ROS2_HUMBLE)


@pytest.mark.parametrize("name", EXAMPLES)
def test_ros_reads_what_we_write_and_writes_the_same(name):
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
    """Whether a message of ours has the members and values of one that ROS read."""
    if dataclasses.is_dataclass(ours):
        names = [field.name for field in dataclasses.fields(ours)]
        return all(is_same(getattr(ours, name), getattr(read, name)) for name in names)
    if isinstance(ours, list):
        return len(ours) == len(read) and all(map(is_same, ours, read))
    return ours == read


def test_topics_are_mangled_as_ros_does():
    assert dds_topic("/imu/data") == dds_topic("imu/data") == "rt/imu/data"
    assert dds_type("sensor_msgs/msg/Imu") == "sensor_msgs::msg::dds_::Imu_"


def test_an_unknown_surface_is_a_warning():
    publisher = AnswerPublisher("/texclass/test/surface", "/texclass/test/diagnostics")
    (known,) = publisher.diagnostics({"surface": "wood", "probability": 0.9}, 7).status
    (unknown,) = publisher.diagnostics({"surface": "wood", "unknown": True, "reasons": ["x"]}, 7).status
    publisher.close()
    assert (known.level, known.message) == (0, "wood")
    assert (unknown.level, unknown.message) == (1, "unknown surface")
    assert {pair.key: pair.value for pair in unknown.values} == {
        "surface": "wood",
        "unknown": "true",
        "reasons": '["x"]',
    }
