import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")

from texclass.loaders.ros_messages import MULTI_ARRAY
from texclass.recognition.robot.messages import (
    SIGNALS,
    Float64MultiArray,
    Header,
    Imu,
    MultiArrayDimension,
    MultiArrayLayout,
    Time,
    Vector3,
)
from texclass.recognition.robot.subscriber import _decoded

AXES = ("ax", "ay", "az")


def _imu(x):
    return Imu(Header(Time(1, x), "imu"), linear_acceleration=Vector3(x, 0, 0)).serialize(use_version_2=False)


def test_damaged_messages_are_left_out_and_counted():
    raws = [_imu(1), b"", _imu(2)[:50], _imu(3), b"\x00\x09" + _imu(4)[2:]]
    received = _decoded(raws, [10, 20, 30, 40, 50], "sensor_msgs/msg/Imu", AXES)
    assert received.n_bad == 3
    np.testing.assert_array_equal(received.samples[:, 0, 0], [1, 3])
    np.testing.assert_array_equal(received.stamps_ns, [1_000_000_001, 1_000_000_003])
    np.testing.assert_array_equal(received.sent_ns, [10, 40])
    assert _decoded([b"", b"\0"], [1, 2], "sensor_msgs/msg/Imu", AXES) is None


def test_blocks_of_another_size_than_the_first_are_left_out():
    def block(n):
        dims = [MultiArrayDimension("samples", n, 2 * n), MultiArrayDimension("channels", 2, 2)]
        return Float64MultiArray(MultiArrayLayout(dims, 0), [float(n)] * 2 * n).serialize(use_version_2=False)

    received = _decoded([block(3), block(4), block(3)], [1, 2, 3], MULTI_ARRAY, ())
    assert received.samples.shape == (2, 3, 2)
    assert received.n_bad == 1
    np.testing.assert_array_equal(received.stamps_ns, [1, 3])


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=340), min_size=1, max_size=4), st.sampled_from(sorted(SIGNALS)))
def test_any_bytes_are_messages_or_left_out(raws, name):
    sent = list(range(len(raws)))
    received = _decoded(raws, sent, name, AXES if name != MULTI_ARRAY else ())
    assert received is None or len(received.samples) + received.n_bad == len(raws)


@settings(max_examples=200, deadline=None)
@given(st.binary(min_size=1, max_size=12), st.integers(0, 330))
def test_changed_bytes_are_messages_or_left_out(piece, at):
    raw = bytearray(_imu(7))
    raw[at : at + len(piece)] = piece
    received = _decoded([_imu(1), bytes(raw)], [1, 2], "sensor_msgs/msg/Imu", AXES)
    assert len(received.samples) + received.n_bad == 2
