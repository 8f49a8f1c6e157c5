"""ROS 2 node that classifies the surface from an Imu topic (needs ROS 2, and texclass in its Python).

    python ros2_node.py --ros-args -p model:=surface.skops -p topic:=/imu/data

This example was NOT run with ROS. A test runs it with substitutes for the ROS modules; it only uses functions
of rclpy that exist since ROS 2 Foxy. Without ROS, `texclass stream MODEL ros2:/TOPIC` does the same.
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
from texclass.recognition.sources.blocks import BlockAssembler


class SurfaceNode(Node):
    """Node that subscribes to an Imu and publishes the verdict after every window of a contact."""

    def __init__(self):
        super().__init__("surface")
        model = load_model(self.declare_parameter("model", "surface.skops").value)
        window_s = self.declare_parameter("window_s", 0.0).value  # 0: as in training
        topic = self.declare_parameter("topic", "/imu/data").value
        fs = self.declare_parameter("fs", 0.0).value  # 0: measured
        self.columns = model.input_columns
        if "friction" in self.columns.auxiliary:
            raise ValueError(f"{topic}: an Imu has {self.columns.missing_signal('friction')}")
        self.assembler = BlockAssembler(fs or None, "m/s^2")
        self.session = Session(model, settings=OnlineSettings(window_s=window_s or None))
        self.text = self.create_publisher(String, "~/surface", 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_subscription(Imu, topic, self.on_message, qos_profile_sensor_data)

    def on_message(self, message):
        """Process one message, and publish the answer if it completes a window."""
        stamp = np.array([message.header.stamp.sec * 10**9 + message.header.stamp.nanosec])
        now = np.array([self.get_clock().now().nanoseconds])
        vectors = [message.linear_acceleration]
        if "turn_rate" in self.columns.auxiliary:
            vectors.append(message.angular_velocity)
        row = [number for v in vectors for number in (v.x, v.y, v.z)]
        for block in self.assembler.push(stamp, now, np.array([[row]])):
            for update in self.session.push(block):
                if isinstance(update, Notice):
                    self.get_logger().warning(update.message)
                elif isinstance(update, WindowAnswer):
                    self.publish_answer(update, message.header.stamp)

    def publish_answer(self, update, stamp):
        """Publish the verdict for a contact, as JSON and as diagnostics."""
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
