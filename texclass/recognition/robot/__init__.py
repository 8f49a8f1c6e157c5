"""ROS 2 topics in and out without ROS, over DDS (extra `robot`)."""

from texclass.recognition.robot.publisher import AnswerPublisher, ImuPublisher
from texclass.recognition.robot.subscriber import Offered, Received, Subscriber, discover

__all__ = ["AnswerPublisher", "ImuPublisher", "Offered", "Received", "Subscriber", "discover"]
