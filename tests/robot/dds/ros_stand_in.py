"""Substitutes for the modules of ROS 2 that the example uses: rclpy and messages."""

import types

from texclass.robot.dds import message_class

DiagnosticStatus = message_class("diagnostic_msgs/msg/DiagnosticStatus")


class Publisher:
    def __init__(self, kind):
        self.kind, self.sent = kind, []

    def publish(self, message):
        assert type(message) is self.kind  # as rclpy does
        self.sent.append(message)


class Node:
    """Node that stores its publishers, subscriptions and warnings; `parameters` are the values of a test."""

    parameters: dict = {}  # noqa: RUF012  (a test replaces it)

    def __init__(self, name):
        self.name, self.publishers, self.subscriptions, self.warnings = name, {}, [], []

    def declare_parameter(self, name, default):
        value = self.parameters.get(name, default)
        assert type(value) is type(default)  # a ROS parameter keeps the type of its default
        return types.SimpleNamespace(value=value)

    def create_publisher(self, kind, topic, depth):
        return self.publishers.setdefault(topic, Publisher(kind))

    def create_subscription(self, kind, topic, callback, quality):
        self.subscriptions.append((kind, topic, callback, quality))

    def get_clock(self):
        return types.SimpleNamespace(now=lambda: types.SimpleNamespace(nanoseconds=self.now_ns))

    def get_logger(self):
        return types.SimpleNamespace(warning=self.warnings.append)


def modules():
    """Return name -> module, for `sys.modules`."""
    DiagnosticStatus.OK, DiagnosticStatus.WARN = b"\0", b"\1"  # `byte` is bytes in Python
    contents = {
        "rclpy": {"init": lambda: None, "spin": lambda node: None},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": "best effort, the last 5"},
        "sensor_msgs.msg": {"Imu": message_class("sensor_msgs/msg/Imu")},
        "std_msgs.msg": {"String": message_class("std_msgs/msg/String")},
        "diagnostic_msgs.msg": {
            name: message_class(f"diagnostic_msgs/msg/{name}")
            for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
        },
    }
    modules = {}
    for name, members in contents.items():
        modules.setdefault(name.partition(".")[0], types.ModuleType(name.partition(".")[0]))
        modules[name] = modules.get(name) or types.ModuleType(name)
        vars(modules[name]).update(members)
    return modules
