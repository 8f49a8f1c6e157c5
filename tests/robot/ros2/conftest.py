"""The node in the folder `ros2`, run with substitutes for the modules of ROS."""

import importlib
import sys
from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (the extra `robot`)")
pytest.importorskip("rosbags", reason="rosbags is not installed (the extra `robot`)")

import rclpy_stand_in

PACKAGES = Path(__file__).resolve().parents[3] / "ros2"


@pytest.fixture
def node_module(monkeypatch):
    for name, module in rclpy_stand_in.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(PACKAGES / "texclass_ros")
    yield importlib.import_module("texclass_ros.node")
    for name in [name for name in sys.modules if name.startswith("texclass_ros")]:
        del sys.modules[name]


@pytest.fixture
def start_node(node_module, monkeypatch):
    """Return a function that creates the node with the given values of parameters."""

    def start(**parameters):
        monkeypatch.setattr(rclpy_stand_in.LifecycleNode, "overrides", parameters)
        return node_module.SurfaceNode()

    return start
