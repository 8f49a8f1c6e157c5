"""The ROS 2 example, run with substitutes for the modules of ROS."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest
import ros_stand_in
from turning_surfaces import FS, N, recording, values

from texclass.robot.dds import message_class

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "ros2_node.py"
START_S = 1_700_000_000


@pytest.fixture
def example(monkeypatch):
    for name, module in ros_stand_in.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("ros2_node", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def node(example, turning, monkeypatch, tmp_path):
    turning.save(tmp_path / "m.skops")
    parameters = {"model": str(tmp_path / "m.skops"), "topic": "/drive/imu", "fs": FS}
    monkeypatch.setattr(ros_stand_in.Node, "parameters", parameters)
    return example.SurfaceNode()


def _play(node, rows, callback):
    vector = message_class("geometry_msgs/msg/Vector3")
    for i, row in enumerate(rows.tolist()):
        node.now_ns = START_S * 10**9 + round(i * 1e9 / FS)
        message = message_class("sensor_msgs/msg/Imu")()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(node.now_ns, 10**9)
        message.linear_acceleration, message.angular_velocity = vector(*row[:3]), vector(*row[3:])
        callback(message)


def test_the_docstring_states_that_the_example_was_not_run_with_ros(example):
    assert "NOT run with ROS" in example.__doc__


def test_the_node_subscribes_with_the_quality_of_service_of_sensors(node):
    ((kind, topic, _, quality),) = node.subscriptions
    assert (kind, topic) == (message_class("sensor_msgs/msg/Imu"), "/drive/imu")
    assert quality == ros_stand_in.modules()["rclpy.qos"].qos_profile_sensor_data
    assert set(node.publishers) == {"~/surface", "/diagnostics"}


@pytest.mark.parametrize("terrain", ["gravel", "sand"])
def test_the_node_publishes_the_answer_of_the_model(node, turning, terrain):
    ((_, _, callback, _),) = node.subscriptions
    _play(node, values(terrain, 90), callback)
    (answer,) = [json.loads(message.data) for message in node.publishers["~/surface"].sent]
    expected = turning.answer(recording(terrain, 90))
    assert answer["surface"] == expected.surface == terrain
    assert answer["contact_s"] == pytest.approx(N / FS)
    (array,) = node.publishers["/diagnostics"].sent
    (status,) = array.status
    unknown = answer["unknown"]
    assert (status.level, status.message) == ((b"\1", "unknown surface") if unknown else (b"\0", terrain))
    assert array.header.stamp.sec == START_S + 1
    assert not node.warnings


def test_the_node_warns_about_faults_of_the_stream(node):
    ((_, _, callback, _),) = node.subscriptions
    rows = values("sand", 90)
    rows[100] = float("nan")
    _play(node, rows, callback)
    assert any("not finite" in warning for warning in node.warnings)
