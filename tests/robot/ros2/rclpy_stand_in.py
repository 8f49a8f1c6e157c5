"""Substitutes for the modules of ROS 2 that the node uses. They check what rclpy checks.

- A message class accepts keywords only, and its fields must have the types of the message.
- A lifecycle publisher sends in the state active only.
- A transition that raises an error calls `on_error`.
- The attributes of a node of rclpy must not be replaced.
"""

import enum
import types

from texclass.robot.dds import message_class

RESERVED = (
    "_publishers",
    "_subscriptions",
    "_clients",
    "_services",
    "_timers",
    "_parameters",
    "_logger",
    "_clock",
)
"""Attributes of a node of rclpy."""


class TransitionCallbackReturn(enum.Enum):
    SUCCESS = 0
    FAILURE = 1
    ERROR = 2


SUCCESS = TransitionCallbackReturn.SUCCESS


class QoSProfile:
    def __init__(self, **settings):
        self.__dict__.update(settings)


class Publisher:
    def __init__(self, kind, topic):
        self.kind, self.topic, self.sent, self.is_activated = kind, topic, [], False

    def publish(self, message):
        assert type(message) is self.kind
        message.serialize(use_version_2=False)  # raises an error for a value of another type
        if self.is_activated:
            self.sent.append(message)


class LifecycleNode:
    """Node whose clock, parameters and messages a test controls; `overrides` are the values of parameters."""

    overrides: dict = {}  # noqa: RUF012  (a test replaces it)

    def __init__(self, name):
        for attribute in RESERVED:
            object.__setattr__(self, attribute, "of rclpy")
        self.node_name, self.state, self.now_ns = name, "unconfigured", 0
        self.values, self.publishers, self.subscriptions, self.timers = {}, [], [], []
        self.errors, self.warnings = [], []

    def __setattr__(self, name, value):
        assert name not in RESERVED, f"rclpy has an attribute {name}"
        object.__setattr__(self, name, value)

    def declare_parameter(self, name, default, descriptor):
        value = self.overrides.get(name, default)
        assert type(value) is type(default)  # a parameter keeps the type of its default
        assert descriptor.description
        self.values[name] = value

    def get_parameter(self, name):
        return types.SimpleNamespace(value=self.values[name])

    def create_lifecycle_publisher(self, kind, topic, depth):
        assert depth > 0
        self.publishers.append(Publisher(kind, topic))
        return self.publishers[-1]

    def destroy_lifecycle_publisher(self, publisher):
        self.publishers.remove(publisher)

    def create_subscription(self, kind, topic, callback, quality):
        subscription = types.SimpleNamespace(kind=kind, topic=topic, callback=callback, quality=quality)
        self.subscriptions.append(subscription)
        return subscription

    def destroy_subscription(self, subscription):
        self.subscriptions.remove(subscription)

    def create_timer(self, period_s, callback):
        self.timers.append(
            types.SimpleNamespace(period_ns=round(1e9 * period_s), callback=callback, due_ns=None)
        )
        return self.timers[-1]

    def destroy_timer(self, timer):
        self.timers.remove(timer)

    def get_clock(self):
        return types.SimpleNamespace(now=lambda: types.SimpleNamespace(nanoseconds=self.now_ns))

    def get_logger(self):
        return types.SimpleNamespace(warning=self.warnings.append, error=self.errors.append)

    def on_activate(self, state):
        for publisher in self.publishers:
            publisher.is_activated = True
        return SUCCESS

    def on_deactivate(self, state):
        for publisher in self.publishers:
            publisher.is_activated = False
        return SUCCESS

    def on_cleanup(self, state):
        return SUCCESS

    on_shutdown = on_error = on_cleanup

    def trigger(self, transition):
        """Make a transition; return the new state."""
        start, goal = {
            "configure": ("unconfigured", "inactive"),
            "activate": ("inactive", "active"),
            "deactivate": ("active", "inactive"),
            "cleanup": ("inactive", "unconfigured"),
            "shutdown": (self.state, "finalized"),
        }[transition]
        assert self.state == start
        try:
            result = getattr(self, f"on_{transition}")(self.state)
        except Exception as error:  # as rclpy does
            self.errors.append(repr(error))
            result = TransitionCallbackReturn.ERROR
        if result is TransitionCallbackReturn.ERROR:
            self.state = "unconfigured" if self.on_error(self.state) is SUCCESS else "finalized"
        elif result is SUCCESS:
            self.state = goal
        return self.state

    def spin_until(self, now_ns):
        """Set the clock, and call the timers that are due."""
        self.now_ns = now_ns
        for timer in list(self.timers):
            if timer.due_ns is None:
                timer.due_ns = now_ns + timer.period_ns
            while timer in self.timers and timer.due_ns <= now_ns:
                timer.due_ns += timer.period_ns
                timer.callback()


def get_message(name):
    """Return the class of a message, which accepts keywords only."""
    kind = message_class(name)

    def make(**fields):
        if name == "diagnostic_msgs/msg/DiagnosticStatus":
            assert isinstance(fields["level"], bytes)  # as in rclpy
            fields["level"] = fields["level"][0]
        return kind(**fields)

    return make


def modules():
    """Return name -> module, for `sys.modules`."""
    names = ("BEST_EFFORT", "VOLATILE", "KEEP_LAST")
    policy = types.SimpleNamespace(**{name: name for name in names})
    contents = {
        "rclpy": {},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.lifecycle": {
            "LifecycleNode": LifecycleNode,
            "TransitionCallbackReturn": TransitionCallbackReturn,
        },
        "rclpy.qos": {
            "QoSProfile": QoSProfile,
            **dict.fromkeys(("DurabilityPolicy", "HistoryPolicy", "ReliabilityPolicy"), policy),
        },
        "rosidl_runtime_py.utilities": {"get_message": get_message},
        "rcl_interfaces.msg": {"ParameterDescriptor": types.SimpleNamespace},
        "diagnostic_msgs.msg": {"DiagnosticArray": message_class("diagnostic_msgs/msg/DiagnosticArray")},
        "texclass_msgs.msg": {
            name: message_class(f"texclass_msgs/msg/{name}") for name in ("ContactEvent", "SurfaceAnswer")
        },
    }
    modules = {}
    for name, members in contents.items():
        package = name.partition(".")[0]
        modules.setdefault(package, types.ModuleType(package))
        modules[name] = modules.get(name) or types.ModuleType(name)
        vars(modules[name]).update(members)
    return modules
