"""ONNX graphs, and tensors whose operators add nodes to a graph."""

import math
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

OPSETS: Mapping[str, int] = {"": 18, "ai.onnx.ml": 3}
"""Operator sets supported since onnxruntime 1.15 (2023), because robots seldom have the latest version."""

Cached = TypeVar("Cached")


class OnnxExportError(ValueError):
    """Error for a model that cannot be exported; the message gives the reason.

    Examples
    --------
    >>> issubclass(OnnxExportError, ValueError)
    True
    """


class Tensor:
    """Tensor of a graph, with array operators that add nodes to the graph and return their outputs.

    Operands are tensors, numbers or arrays; numbers and arrays become constants of the graph.

    Parameters
    ----------
    graph : Graph
        Graph to which nodes are added.
    name : str
        Name of the tensor in the graph.
    """

    __slots__ = ("graph", "name")
    __array_ufunc__ = None  # numpy then leaves the operators of an array and a tensor to the tensor

    def __init__(self, graph: "Graph", name: str) -> None:
        self.graph, self.name = graph, name

    def __add__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Add", self, other)

    def __radd__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Add", other, self)

    def __sub__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Sub", self, other)

    def __rsub__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Sub", other, self)

    def __mul__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Mul", self, other)

    def __rmul__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Mul", other, self)

    def __truediv__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Div", self, other)

    def __matmul__(self, other: "Operand") -> "Tensor":
        return self.graph.add("MatMul", self, other)

    def __rmatmul__(self, other: "Operand") -> "Tensor":
        return self.graph.add("MatMul", other, self)

    def __gt__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Greater", self, other)

    def __le__(self, other: "Operand") -> "Tensor":
        return self.graph.add("LessOrEqual", self, other)

    def __or__(self, other: "Operand") -> "Tensor":
        return self.graph.add("Or", self, other)

    def __neg__(self) -> "Tensor":
        return self.graph.add("Neg", self)

    def __abs__(self) -> "Tensor":
        return self.graph.add("Abs", self)

    def sqrt(self) -> "Tensor":
        """Return the square root."""
        return self.graph.add("Sqrt", self)

    def log10(self) -> "Tensor":
        """Return the logarithm to base 10."""
        return self.graph.add("Log", self) * (1 / math.log(10))

    def mean(self, axis: int = -1) -> "Tensor":
        """Return the mean over an axis, which is kept with length 1."""
        return self.reduced("ReduceMean", axis)

    def sum(self, axis: int = -1) -> "Tensor":
        """Return the sum over an axis, which is kept with length 1."""
        return self.reduced("ReduceSum", axis)

    def reduced(self, operator: str, *axes: int, keepdims: bool = True) -> "Tensor":
        """Return the tensor reduced over axes by an operator such as "ReduceMax"."""
        return self.graph.add(operator, self, along(*axes), keepdims=int(keepdims))

    def cast(self, dtype: type[np.generic]) -> "Tensor":
        """Return the tensor with another data type."""
        from onnx import helper

        return self.graph.add("Cast", self, to=helper.np_dtype_to_tensor_dtype(np.dtype(dtype)))

    def take(self, indices: NDArray[Any], axis: int = 1) -> "Tensor":
        """Return the elements at the given indices along an axis."""
        return self.graph.add("Gather", self, indices, axis=axis)

    def cut(self, start: int, stop: int, axis: int = -1) -> "Tensor":
        """Return the elements [start, stop) along an axis."""
        return self.graph.add("Slice", self, along(start), along(stop), along(axis))

    def reshape(self, *shape: int) -> "Tensor":
        """Return the tensor with another shape; 0 keeps the length of an axis, and -1 is inferred."""
        return self.graph.add("Reshape", self, along(*shape))

    def unsqueeze(self, axis: int = 1) -> "Tensor":
        """Return the tensor with a new axis of length 1."""
        return self.graph.add("Unsqueeze", self, along(axis))

    def where(self, condition: "Tensor", otherwise: "Operand" = np.nan) -> "Tensor":
        """Return the tensor where a condition is true, and NaN or `otherwise` elsewhere."""
        return self.graph.add("Where", condition, self, otherwise)


Operand = Tensor | float | NDArray[Any]
"""Tensor or constant; a number becomes a constant in double precision."""


class Graph:
    """ONNX graph: nodes in the order of their computation, and constants.

    Parameters
    ----------
    has_equal_segments : bool
        Whether all segments of a movement have equal features, so that one segment suffices for segment
        voting.

    Attributes
    ----------
    nodes, constants : list
        Nodes and constants added so far.
    """

    def __init__(self, *, has_equal_segments: bool = False) -> None:
        self.has_equal_segments = has_equal_segments
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self._n_names = 0
        self._cache: dict[Hashable, Any] = {}

    def add(self, operator: str, *operands: Operand, name: str | None = None, **attributes: Any) -> Tensor:
        """Add a node and return its output.

        Parameters
        ----------
        operator : str
            Name of an ONNX operator.
        *operands : Tensor, float or ndarray
            Inputs of the operator.
        name : str, optional
            Name of the output (default: a new one).
        **attributes
            Attributes of the operator.
        """
        from onnx import helper

        names = [x.name if isinstance(x, Tensor) else self.constant(x).name for x in operands]
        output = name or self._new(operator)
        self.nodes.append(helper.make_node(operator, names, [output], **attributes))
        return Tensor(self, output)

    def constant(self, value: float | NDArray[Any]) -> Tensor:
        """Add a constant; a number is stored in double precision."""
        values = value if isinstance(value, np.ndarray) else np.array(value, dtype=np.float64)
        if values.size < 64:  # only large constants are worth sharing
            return self._add_constant(values)
        key = (values.dtype, values.shape, values.tobytes())
        return self.once(key, lambda: self._add_constant(values))

    def _add_constant(self, values: NDArray[Any]) -> Tensor:
        from onnx import numpy_helper

        self.constants.append(numpy_helper.from_array(values, self._new("constant")))
        return Tensor(self, self.constants[-1].name)

    def once(self, key: Hashable, create: Callable[[], Cached]) -> Cached:
        """Return the result of `create`, which is called only when a key is first used."""
        if key not in self._cache:
            self._cache[key] = create()
        cached: Cached = self._cache[key]
        return cached

    def short(self, values: NDArray[np.float64]) -> Tensor:
        """Add a constant with the fewest bits that represent it exactly, and its cast to double precision."""
        for dtype in (np.float16, np.float32):
            with np.errstate(over="ignore"):
                rounded = values.astype(dtype)
            if np.array_equal(rounded, values):
                return self.constant(rounded).cast(np.float64)
        return self.constant(values)

    def concatenate(self, *tensors: Tensor, axis: int = 1) -> Tensor:
        """Add the concatenation of tensors along an axis."""
        return self.add("Concat", *tensors, axis=axis)

    def largest(self, operand: Tensor, n: int, **attributes: Any) -> tuple[Tensor, Tensor]:
        """Add the `n` largest elements along an axis; return their values and indices."""
        from onnx import helper

        names = [self._new("largest"), self._new("indices")]
        inputs = [operand.name, self.constant(along(n)).name]
        self.nodes.append(helper.make_node("TopK", inputs, names, **attributes))
        return Tensor(self, names[0]), Tensor(self, names[1])

    def embed(self, part: Any, operand: Tensor) -> Tensor:
        """Add an ONNX model with one input and one output; return its output in double precision."""
        from onnx import TensorProto, compose

        prefixed = compose.add_prefix(part, f"{self._new('part')}/")
        (entry,), (output,) = prefixed.graph.input, prefixed.graph.output
        self.add("Identity", operand, name=entry.name)
        self.nodes += prefixed.graph.node
        self.constants += prefixed.graph.initializer
        last = Tensor(self, output.name)
        return last if output.type.tensor_type.elem_type == TensorProto.DOUBLE else last.cast(np.float64)

    def model(self, inputs: list[Any], outputs: list[Any], name: str, doc: str) -> Any:
        """Return the complete ONNX model.

        Raises
        ------
        OnnxExportError
            If the model is not valid.
        """
        from onnx import checker, helper

        # onnxruntime fuses a scalar factor with a neighbouring matrix product, and stores it in single
        # precision. A model with one column has such a factor (its scale). Products with matrices of one row
        # are therefore written as element-wise products.
        single = {c.name for c in self.constants if len(c.dims) == 2 and c.dims[0] == 1}
        for node in self.nodes:
            if node.op_type == "MatMul" and node.input[1] in single:
                node.op_type = "Mul"
        domains = {node.domain for node in self.nodes} | {""}
        graph = helper.make_graph(self.nodes, name, inputs, outputs, self.constants, doc)
        opsets = [helper.make_opsetid(domain, OPSETS[domain]) for domain in OPSETS if domain in domains]
        # Version 8 of the file format corresponds to opset 18.
        model = helper.make_model(graph, opset_imports=opsets, ir_version=8, doc_string=doc)
        try:
            checker.check_model(model, full_check=True)
        except Exception as error:  # the exceptions of onnx have no common base class
            raise OnnxExportError(
                f"the graph is not valid in opset {OPSETS['']} ({error}). Train another classifier"
            ) from error
        return model

    def _new(self, kind: str) -> str:
        self._n_names += 1
        return f"{kind}_{self._n_names}"


def along(*axes: int) -> NDArray[np.int64]:
    """Return axes or indices as an integer array, the form that ONNX operators expect."""
    return np.array(axes, dtype=np.int64)


def tensor_of(name: str, dtype: type, *shape: int | str) -> Any:
    """Return the description of an input or output of a graph; the dtype of text is `object`."""
    from onnx import helper

    kind = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
    return helper.make_tensor_value_info(name, kind, list(shape))
