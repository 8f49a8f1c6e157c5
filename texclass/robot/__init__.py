"""Interfaces to robots: ROS bags, ROS 2 topics over DDS, and export of models as ONNX files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
