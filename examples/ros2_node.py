"""A ROS 2 node that says which surface an Imu feels: for people who have ROS, texclass in its Python.

    ros2 run is not needed: python ros2_node.py --ros-args -p model:=surface.skops -p topic:=/imu/data

It was NOT run with ROS where it was written: there is no ROS there, and a test runs it with modules that
stand for ROS. What it uses of ROS is a part of rclpy that has been the same since ROS 2 Foxy.
Without ROS, texclass hears and answers ROS 2 topics itself: `texclass.recognition.sources`.
"""

import json

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu
from std_msgs.msg import String

from texclass.recognition import Notice, OnlineSettings, Session, WindowAnswer, load_model
from texclass.recognition.sources.blocks import Timing


class SurfaceNode(Node):
    """Hears an Imu, publishes what every window of a contact adds to what is known of it."""

    def __init__(self):
        super().__init__("surface")
        model = load_model(self.declare_parameter("model", "surface.skops").value)
        window_s = self.declare_parameter("window_s", 0.0).value  # 0: as trained
        topic = self.declare_parameter("topic", "/imu/data").value
        fs = self.declare_parameter("fs", 0.0).value  # 0: measured
        self.needs = model.needs
        if "friction" in self.needs.beside:
            raise ValueError(f"{topic}: an Imu has {self.needs.lacks('friction')}")
        self.timing = Timing(fs or None, "m/s^2")
        self.session = Session(model, settings=OnlineSettings(window_s=window_s or None))
        self.text = self.create_publisher(String, "~/surface", 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_subscription(Imu, topic, self.hear, qos_profile_sensor_data)

    def hear(self, message):
        """Take one message; answer when a window is full."""
        stamp = np.array([message.header.stamp.sec * 10**9 + message.header.stamp.nanosec])
        now = np.array([self.get_clock().now().nanoseconds])
        vectors = [message.linear_acceleration]
        if "turn_rate" in self.needs.beside:
            vectors.append(message.angular_velocity)
        row = [number for v in vectors for number in (v.x, v.y, v.z)]
        for block in self.timing.push(stamp, now, np.array([[row]])):
            for update in self.session.take(block):
                if isinstance(update, Notice):
                    self.get_logger().warning(update.what)
                elif isinstance(update, WindowAnswer):
                    self.answer(update, message.header.stamp)

    def answer(self, update, stamp):
        """Publish which surface a contact is with, as JSON and as diagnostics."""
        answer = {**update.verdict.to_dict(), "reasons": list(update.answer.reasons)}
        self.text.publish(String(data=json.dumps(answer)))
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if answer["unknown"] else DiagnosticStatus.OK,
            name="texclass: surface",
            message="unknown surface" if answer["unknown"] else answer["surface"],
            values=[KeyValue(key=key, value=json.dumps(value)) for key, value in answer.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = stamp
        self.diagnostics.publish(array)


def main():
    """Run the node until it is interrupted."""
    rclpy.init()
    rclpy.spin(SurfaceNode())


if __name__ == "__main__":
    main()
