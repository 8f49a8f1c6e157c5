"""Trained models as ONNX files: the same answers where there is no Python."""
