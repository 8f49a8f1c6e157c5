import dataclasses

import numpy as np
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


def _as_rosbags(message, name):
    """Return the same message in the classes of rosbags."""
    values = []
    for (_, (kind, detail)), field in zip(
        STORE.get_msgdef(name).fields, dataclasses.fields(message), strict=True
    ):
        value = getattr(message, field.name)
        if int(kind) == 2:  # another message
            value = _as_rosbags(value, detail)
        elif isinstance(value, list):
            inner = detail[0]
            value = (
                [_as_rosbags(v, inner[1]) for v in value] if int(inner[0]) == 2 else np.array(value, float)
            )
        values.append(value)
    return STORE.types[name](*values)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_bytes_are_those_of_ros(name):
    ours_raw = EXAMPLES[name].serialize(use_version_2=False)
    theirs = bytes(STORE.serialize_cdr(_as_rosbags(EXAMPLES[name], name), name))
    assert ours_raw[:2] == theirs[:2] == b"\x00\x01"
    assert ours_raw[4 : len(theirs)] == theirs[4:]
    assert not ours_raw[len(theirs) :].strip(b"\0")


@pytest.mark.parametrize("name", EXAMPLES)
def test_members_and_type_have_the_names_of_ros(name):
    fields = [field for field, _ in STORE.get_msgdef(name).fields]
    assert [field.name for field in dataclasses.fields(EXAMPLES[name])] == fields
    assert type(EXAMPLES[name]).__idl_typename__ == dds_type(name)
    assert ros_type(dds_type(name)) == name


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
