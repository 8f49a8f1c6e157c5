import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")

from texclass.loaders.ros_messages import MULTI_ARRAY
from texclass.recognition.sources.dds import message_class
from texclass.recognition.sources.topic import SIGNALS, decoded_messages

AXES = ("ax", "ay", "az")


def _imu(x):
    header = message_class("std_msgs/msg/Header")(message_class("builtin_interfaces/msg/Time")(1, x), "imu")
    a = message_class("geometry_msgs/msg/Vector3")(x, 0, 0)
    made = message_class("sensor_msgs/msg/Imu")(header, linear_acceleration=a)
    return made.serialize(use_version_2=False)


def test_damaged_messages_are_left_out_and_counted():
    raws = [_imu(1), b"", _imu(2)[:50], _imu(3), b"\x00\x09" + _imu(4)[2:]]
    received = decoded_messages(raws, [10, 20, 30, 40, 50], "sensor_msgs/msg/Imu", AXES)
    assert received.n_bad == 3
    np.testing.assert_array_equal(received.samples[:, 0, 0], [1, 3])
    np.testing.assert_array_equal(received.stamps_ns, [1_000_000_001, 1_000_000_003])
    np.testing.assert_array_equal(received.sent_ns, [10, 40])
    assert decoded_messages([b"", b"\0"], [1, 2], "sensor_msgs/msg/Imu", AXES) is None


def test_blocks_of_another_size_than_the_first_are_left_out():
    def block(n):
        dimension, layout = (message_class(f"std_msgs/msg/MultiArray{k}") for k in ("Dimension", "Layout"))
        dims = [dimension("samples", n, 2 * n), dimension("channels", 2, 2)]
        made = message_class(MULTI_ARRAY)(layout(dims, 0), [float(n)] * 2 * n)
        return made.serialize(use_version_2=False)

    received = decoded_messages([block(3), block(4), block(3)], [1, 2, 3], MULTI_ARRAY, ())
    assert received.samples.shape == (2, 3, 2)
    assert received.n_bad == 1
    np.testing.assert_array_equal(received.stamps_ns, [1, 3])


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=340), min_size=1, max_size=4), st.sampled_from(sorted(SIGNALS)))
def test_any_bytes_are_messages_or_left_out(raws, name):
    sent = list(range(len(raws)))
    received = decoded_messages(raws, sent, name, AXES if name != MULTI_ARRAY else ())
    assert received is None or len(received.samples) + received.n_bad == len(raws)


@settings(max_examples=200, deadline=None)
@given(st.binary(min_size=1, max_size=12), st.integers(0, 330))
def test_changed_bytes_are_messages_or_left_out(piece, at):
    raw = bytearray(_imu(7))
    raw[at : at + len(piece)] = piece
    received = decoded_messages([_imu(1), bytes(raw)], [1, 2], "sensor_msgs/msg/Imu", AXES)
    assert len(received.samples) + received.n_bad == 2
