"""Graphs with changed constants, to test the parity check."""

import onnx
from onnx import numpy_helper


def changed_graphs(graph, condition, change):
    """Return copies of a graph, as bytes, each with one changed constant, for all that meet a condition."""
    graphs = []
    for i, constant in enumerate(graph.graph.initializer):
        values = numpy_helper.to_array(constant).copy()
        if condition(values):
            copy = onnx.ModelProto.FromString(graph.SerializeToString())
            copy.graph.initializer[i].CopyFrom(numpy_helper.from_array(change(values), constant.name))
            graphs.append(copy.SerializeToString())
    return graphs
