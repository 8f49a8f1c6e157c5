"""Robots: bags of ROS, topics of ROS 2 over DDS, and trained models as ONNX files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
