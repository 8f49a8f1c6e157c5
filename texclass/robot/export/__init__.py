"""Export of trained models as ONNX files, for programs without Python."""
