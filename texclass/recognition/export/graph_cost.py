"""What a graph costs a small computer: operations and bytes, counted in the graph as it would run.

Nothing is guessed: shapes are those that ONNX infers for one window, and where a transform is exported as a
product of matrices the product is counted, not the fast transform that a library of signals would have.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from texclass.recognition.export.graph import LARGE
from texclass.recording import Samples

SAME_MEMORY = {"Reshape", "Identity", "Unsqueeze", "Squeeze", "Flatten"}
"""Operators that compute and move nothing."""
IN_PLACE = {
    "Abs",
    "Add",
    "Cast",
    "Clip",
    "Div",
    "Exp",
    "Log",
    "Max",
    "Min",
    "Mul",
    "Neg",
    "Relu",
    "Sqrt",
    "Sub",
}
"""Operators whose output may take the place of an operand of its size that is not needed later."""
FLOAT_BYTES = 4
"""Of what is computed: single precision, whatever constants and samples are kept in."""


class GraphCost(NamedTuple):
    """What one window costs.

    Attributes
    ----------
    operations
        Multiply-adds of matrix products, elements of what else is computed, moved, or summed.
    constant_bytes
        Of constants, and of what follows from constants alone and is made once; integers, which say where to
        read, in the fewest bytes that hold them.
    intermediate_bytes
        Of what is in memory at the same time while a window is computed, at most; the window apart.
    """

    operations: int
    constant_bytes: int
    intermediate_bytes: int


class Work(NamedTuple):
    """The nodes that run for every window, in order, and what each of them costs.

    Attributes
    ----------
    nodes : list of NodeProto
        All others are computed once, from constants.
    operations : list of int
        Of each node.
    sizes : mapping
        Tensor -> elements.
    kinds : mapping
        Tensor -> number of its type, see `onnx.TensorProto`.
    inputs, outputs : list of str
        Of the graph.
    """

    nodes: list[Any]
    operations: list[int]
    sizes: dict[str, int]
    kinds: dict[str, int]
    inputs: list[str]
    outputs: list[str]

    def cost(self, sample_bits: int = 32, bits: int = 32) -> GraphCost:
        """Return what a window costs.

        Parameters
        ----------
        sample_bits : int
            Of the samples that come in; of 32, they are read where the window lies.
        bits : int
            Of each real constant that has `LARGE` elements or more, see `shortened`; of others 32.
        """
        return GraphCost(sum(self.operations), self._constants(bits), self._most_alive(sample_bits))

    def _constants(self, bits: int) -> int:
        """Return the bytes of what nodes read and no node of these computes."""
        from onnx import TensorProto

        made = {name for node in self.nodes for name in node.output} | set(self.inputs)
        # What an index points into is no longer than the longest tensor.
        index = np.min_scalar_type(max(self.sizes.values())).itemsize
        total = 0
        for name in {name for node in self.nodes for name in node.input if name} - made:
            if self.kinds[name] in (TensorProto.FLOAT, TensorProto.DOUBLE):
                total += self.sizes[name] * (bits if self.sizes[name] >= LARGE else 32) // 8
            else:
                total += self.sizes[name] * index
        return total

    def _most_alive(self, sample_bits: int) -> int:
        """Return the bytes of the tensors that are in memory at the same time, at most."""
        from onnx import TensorProto

        real = {TensorProto.FLOAT, TensorProto.DOUBLE}
        place: dict[str, str] = {}  # tensor -> the one in whose memory it lies
        last: dict[str, int] = {}
        for at, node in enumerate(self.nodes):
            of_reals = {self.kinds[name] for name in (*node.input, *node.output) if name} <= real
            # Doubles are computed in single precision, so that nothing is converted.
            if node.op_type in SAME_MEMORY or (node.op_type == "Cast" and of_reals):
                place[node.output[0]] = place.get(node.input[0], node.input[0])
            last |= {place.get(name, name): at for name in node.input}
        last |= {place.get(name, name): len(self.nodes) for name in self.outputs}

        def size(name: str) -> int:
            return self.sizes[name] * (1 if self.kinds[name] == TensorProto.BOOL else FLOAT_BYTES)

        alive = {name: size(name) for name in self.inputs if sample_bits < 32}
        most = sum(alive.values())
        for at, node in enumerate(self.nodes):
            made = {name: size(name) for name in node.output if name and name not in place}
            ended = [name for name in alive if last.get(name, -1) <= at]
            if node.op_type in IN_PLACE and (same := [n for n in ended if alive[n] in made.values()]):
                del alive[same[0]]
            alive |= made
            most = max(most, sum(alive.values()))
            alive = {name: n_bytes for name, n_bytes in alive.items() if last.get(name, -1) > at}
        return most


def work_of(model: Any) -> Work:
    """Return the nodes of an ONNX model that run for every window; all shapes follow from its inputs."""
    from onnx import shape_inference

    graph = shape_inference.infer_shapes(model, data_prop=True).graph
    told = [*graph.input, *graph.value_info, *graph.output]
    shapes = {v.name: [d.dim_value for d in v.type.tensor_type.shape.dim] for v in told}
    kinds = {v.name: v.type.tensor_type.elem_type for v in told}
    shapes |= {c.name: list(c.dims) for c in graph.initializer}
    kinds |= {c.name: c.data_type for c in graph.initializer}
    sizes = {name: math.prod(shape) for name, shape in shapes.items()}
    known = {c.name for c in graph.initializer}
    nodes = []
    for node in graph.node:
        if known.issuperset(node.input):
            known |= set(node.output)
        else:
            nodes.append(node)
    operations = [_operations(node, shapes, sizes) for node in nodes]
    names = ([one.name for one in many] for many in (graph.input, graph.output))
    return Work(nodes, operations, sizes, kinds, *names)


def _operations(node: Any, shapes: dict[str, list[int]], sizes: dict[str, int]) -> int:
    output = sizes[node.output[0]]
    if node.op_type in SAME_MEMORY:
        return 0
    if node.op_type in ("MatMul", "Gemm"):
        return output * shapes[node.input[0]][-1]
    if node.op_type.startswith(("Reduce", "Arg")):
        return sizes[node.input[0]]
    if node.op_type == "TopK":  # a sort
        return sizes[node.input[0]] * math.ceil(math.log2(max(2, shapes[node.input[0]][-1])))
    return output


def shortened(model: Any, bits: int = 32) -> Any:
    """Return a model of the standard operators that computes in single precision, its tables in fewer bits.

    Parameters
    ----------
    model : onnx.ModelProto
        In double precision; it is not changed.
    bits : int
        Of each real constant that has `LARGE` elements or more; 32 leaves these in single precision.
    """
    from onnx import ModelProto, TensorProto, numpy_helper

    changed = ModelProto.FromString(model.SerializeToString())
    for constant in changed.graph.initializer:
        if constant.data_type == TensorProto.DOUBLE:
            values = numpy_helper.to_array(constant)
            if values.size >= LARGE:
                values = rounded(values, bits)
            constant.CopyFrom(numpy_helper.from_array(values.astype(np.float32), constant.name))
    for node in changed.graph.node:
        for attribute in node.attribute:
            if node.op_type == "Cast" and attribute.i == TensorProto.DOUBLE:
                attribute.i = TensorProto.FLOAT
    for one in (*changed.graph.input, *changed.graph.output):
        if one.type.tensor_type.elem_type == TensorProto.DOUBLE:
            one.type.tensor_type.elem_type = TensorProto.FLOAT
    return changed


def rounded(values: Samples, bits: int) -> Samples:
    """Return values on the levels of so many bits, q round(x / q), q = max |x| / (2^(bits-1) - 1).

    With 32 bits they stay as they are.
    """
    step = float(np.abs(values).max()) / (2 ** (bits - 1) - 1)
    return values if bits >= 32 or step == 0 else np.asarray(step * np.round(values / step))
