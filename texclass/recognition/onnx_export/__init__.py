"""Trained models as ONNX files: the same answers where there is no Python."""

from texclass.recognition.onnx_export.export import Exported, export_onnx
from texclass.recognition.onnx_export.graph import OnnxExportError
from texclass.recognition.onnx_export.parity import Parity, ParityError, check_parity

__all__ = ["Exported", "OnnxExportError", "Parity", "ParityError", "check_parity", "export_onnx"]
