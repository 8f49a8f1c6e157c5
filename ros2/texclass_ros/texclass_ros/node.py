"""Lifecycle node that classifies the surface from the acceleration of a sensor.

The node only connects ROS with `texclass.robot.message_classifier`, which contains the recognition, the
conversion of the messages and the diagnostics.
"""

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosidl_runtime_py.utilities import get_message
from texclass_msgs.msg import ContactEvent, SurfaceAnswer

from texclass.recognition import load_model
from texclass.robot.message_classifier import MessageClassifier
from texclass_ros.parameters import PARAMETERS, online_settings

PROCESS_S = 0.025
"""Time between two calls of the recognition in s, because one call for many messages is faster."""
QUEUE = 10
"""Queue length of the published topics, the default of ROS 2."""


def make_message(name, /, **fields):
    """Return a message from the name of its type and its fields."""
    if "level" in fields:
        fields["level"] = bytes([fields["level"]])  # the type `byte` of ROS is bytes in Python
    return get_message(name)(**fields)


class SurfaceNode(LifecycleNode):
    """Node that subscribes to a sensor and publishes answers, contact events and diagnostics."""

    def __init__(self):
        super().__init__("texclass")
        for name, (default, description) in PARAMETERS.items():
            self.declare_parameter(name, default, ParameterDescriptor(description=description))
        # rclpy has attributes such as _timers and _publishers, which must not be replaced.
        self._model = self._classifier = self._sensor = None
        self._periodic = []

    def on_configure(self, state):
        """Load the model, check the parameters, and create the publishers."""
        self._values = {name: self.get_parameter(name).value for name in PARAMETERS}
        try:
            if not self._values["model"]:
                raise ValueError("the parameter model is empty. Expected a file written by 'texclass train'")
            if self._values["queue_depth"] < 1:
                raise ValueError(f"queue_depth must be at least 1 message, got {self._values['queue_depth']}")
            if not self._values["diagnostics_period_s"] > 0:
                raise ValueError(
                    f"diagnostics_period_s must be positive, got {self._values['diagnostics_period_s']} s"
                )
            self._model = load_model(self._values["model"])
            self._create_classifier()  # checks the other parameters
        except (OSError, ValueError) as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._answer_publisher = self.create_lifecycle_publisher(SurfaceAnswer, "~/answer", QUEUE)
        self._event_publisher = self.create_lifecycle_publisher(ContactEvent, "~/contact", QUEUE)
        self._status_publisher = self.create_lifecycle_publisher(DiagnosticArray, "/diagnostics", QUEUE)
        return TransitionCallbackReturn.SUCCESS

    def _create_classifier(self):
        values = self._values
        return MessageClassifier(
            self._model,
            make_message,
            type_name=values["message_type"],
            topic=values["topic"],
            fs=values["fs"] or None,
            unit=values["unit"] or None,
            frame=values["frame_id"],
            settings=online_settings(values),
            adapt=values["adapt"],
        )

    def on_activate(self, state):
        """Start the recognition and subscribe to the sensor, with the quality of service of sensor data."""
        self._classifier = self._create_classifier()
        sensor_data = QoSProfile(
            reliability=ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.VOLATILE,
            history=HistoryPolicy.KEEP_LAST,
            depth=self._values["queue_depth"],
        )
        message_class = get_message(self._values["message_type"])
        self._sensor = self.create_subscription(
            message_class, self._values["topic"], self._receive, sensor_data
        )
        self._periodic = [
            self.create_timer(PROCESS_S, self._process),
            self.create_timer(self._values["diagnostics_period_s"], self._publish_diagnostics),
        ]
        return super().on_activate(state)

    def on_deactivate(self, state):
        """Publish the last answers and end the recognition."""
        self._stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state):
        """Release the model and the publishers."""
        self._release()
        return super().on_cleanup(state)

    def on_shutdown(self, state):
        """End the recognition, and release the model and the publishers."""
        self._stop()
        self._release()
        return super().on_shutdown(state)

    def on_error(self, state):
        """Return to the state unconfigured after an error in a transition."""
        self._stop()
        self._release()
        return super().on_error(state)

    def _stop(self):
        if self._classifier is None:
            return
        self._publish(self._classifier.finish())
        self._classifier = None
        for timer in self._periodic:
            self.destroy_timer(timer)
        self._periodic = []
        if self._sensor is not None:
            self.destroy_subscription(self._sensor)
        self._sensor = None

    def _release(self):
        for name in ("_answer_publisher", "_event_publisher", "_status_publisher"):
            if publisher := vars(self).pop(name, None):
                self.destroy_lifecycle_publisher(publisher)
        self._model = None

    def _receive(self, message):
        self._classifier.push(message, self.get_clock().now().nanoseconds)

    def _process(self):
        self._publish(self._classifier.process())

    def _publish(self, output):
        for message in output.answers:
            self._answer_publisher.publish(message)
        for message in output.events:
            self._event_publisher.publish(message)
        for notice in output.notices:
            self.get_logger().warning(notice)

    def _publish_diagnostics(self):
        self._status_publisher.publish(self._classifier.diagnostics(self.get_clock().now().nanoseconds))


def main():
    """Run the node until it is interrupted."""
    rclpy.init()
    node = SurfaceNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
