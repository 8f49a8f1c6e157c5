"""Graphs that were tampered with."""

import onnx
from onnx import numpy_helper


def changed_graphs(graph, chosen, change):
    """Return a graph, as bytes, with one of its constants changed: one for each whose values are chosen."""
    found = []
    for i, constant in enumerate(graph.graph.initializer):
        values = numpy_helper.to_array(constant).copy()
        if chosen(values):
            tampered = onnx.ModelProto.FromString(graph.SerializeToString())
            tampered.graph.initializer[i].CopyFrom(numpy_helper.from_array(change(values), constant.name))
            found.append(tampered.SerializeToString())
    return found
