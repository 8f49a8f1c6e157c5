"""Modules that stand for ROS 2: what the example uses of rclpy and of its messages, as rclpy defines it."""

import types
from dataclasses import dataclass, field


@dataclass
class Stamp:
    sec: int = 0
    nanosec: int = 0


@dataclass
class Header:
    stamp: Stamp = field(default_factory=Stamp)
    frame_id: str = ""


@dataclass
class Vector3:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(kw_only=True)
class Imu:
    header: Header = field(default_factory=Header)
    angular_velocity: Vector3 = field(default_factory=Vector3)
    linear_acceleration: Vector3 = field(default_factory=Vector3)


@dataclass(kw_only=True)
class String:
    data: str = ""


@dataclass(kw_only=True)
class KeyValue:
    key: str = ""
    value: str = ""


@dataclass(kw_only=True)
class DiagnosticStatus:
    level: bytes = b"\0"
    name: str = ""
    message: str = ""
    values: list = field(default_factory=list)
    OK = b"\0"  # `byte` is bytes in Python
    WARN = b"\1"


@dataclass(kw_only=True)
class DiagnosticArray:
    header: Header = field(default_factory=Header)
    status: list = field(default_factory=list)


class Publisher:
    def __init__(self, kind):
        self.kind, self.sent = kind, []

    def publish(self, message):
        assert type(message) is self.kind  # as rclpy does
        self.sent.append(message)


class Node:
    """Keeps what a node asks for; parameters are given by the class attribute `given`."""

    given: dict = {}  # noqa: RUF012  (a test replaces it)

    def __init__(self, name):
        self.name, self.publishers, self.subscriptions, self.warned = name, {}, [], []

    def declare_parameter(self, name, default):
        value = self.given.get(name, default)
        assert type(value) is type(default)  # a ROS parameter keeps the type of its default
        return types.SimpleNamespace(value=value)

    def create_publisher(self, kind, topic, depth):
        return self.publishers.setdefault(topic, Publisher(kind))

    def create_subscription(self, kind, topic, callback, quality):
        self.subscriptions.append((kind, topic, callback, quality))

    def get_clock(self):
        return types.SimpleNamespace(now=lambda: types.SimpleNamespace(nanoseconds=self.now_ns))

    def get_logger(self):
        return types.SimpleNamespace(warning=self.warned.append)


def modules():
    """Return name -> module, for `sys.modules`."""
    parts = {
        "rclpy": {"init": lambda: None, "spin": lambda node: None},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": "best effort, the last 5"},
        "sensor_msgs.msg": {"Imu": Imu},
        "std_msgs.msg": {"String": String},
        "diagnostic_msgs.msg": {
            "DiagnosticArray": DiagnosticArray,
            "DiagnosticStatus": DiagnosticStatus,
            "KeyValue": KeyValue,
        },
    }
    made = {}
    for name, members in parts.items():
        made.setdefault(name.partition(".")[0], types.ModuleType(name.partition(".")[0]))
        made[name] = made.get(name) or types.ModuleType(name)
        vars(made[name]).update(members)
    return made
