"""A ROS 2 node that says which surface an Imu feels: for people who have ROS, texclass in its Python.

    ros2 run is not needed: python ros2_node.py --ros-args -p model:=surface.skops -p topic:=/imu/data

It was NOT run with ROS where it was written: there is no ROS there, and a test checks only its syntax and the
names it uses of texclass. What it uses of ROS is a part of rclpy that has been the same since ROS 2 Foxy.
Without ROS, texclass hears and answers ROS 2 topics itself: `texclass.recognition.robot`.
"""

import json

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu
from std_msgs.msg import String

from texclass.recognition import load_model
from texclass.recognition.timing import Timing
from texclass.recording import Recording


class SurfaceNode(Node):
    """Hears an Imu, publishes an answer for every window of so many seconds."""

    def __init__(self):
        super().__init__("surface")
        self.model = load_model(self.declare_parameter("model", "surface.skops").value)
        self.window_s = self.declare_parameter("window_s", 1.0).value
        topic = self.declare_parameter("topic", "/imu/data").value
        fs = self.declare_parameter("fs", 0.0).value
        self.timing = Timing(fs or None, "m/s^2")
        self.window = []
        self.text = self.create_publisher(String, "~/surface", 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_subscription(Imu, topic, self.hear, qos_profile_sensor_data)

    def hear(self, message):
        """Take one message; answer when a window is full."""
        stamp = np.array([message.header.stamp.sec * 10**9 + message.header.stamp.nanosec])
        now = np.array([self.get_clock().now().nanoseconds])
        a = message.linear_acceleration
        for block in self.timing.push(stamp, now, np.array([[[a.x, a.y, a.z]]])):
            for flag in block.flags:
                self.get_logger().warning(flag)
            self.window = [] if block.lost else self.window
            self.window.extend(block.samples)
            if len(self.window) >= self.window_s * block.fs:
                self.answer(np.array(self.window), block.fs, message.header.stamp)
                self.window = []

    def answer(self, samples, fs, stamp):
        """Publish which surface a window is of, as JSON and as diagnostics."""
        answer = self.model.answer(Recording(samples, fs, "m/s^2", "window")).to_dict()
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
