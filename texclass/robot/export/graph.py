"""ONNX graphs: tensors that are computed with as arrays are, and the nodes that this adds."""

import math
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

OPSETS: Mapping[str, int] = {"": 18, "ai.onnx.ml": 3}
"""Versions of the operators, old enough for onnxruntime 1.15 (2023): robots rarely have the latest."""

Made = TypeVar("Made")


class OnnxExportError(ValueError):
    """A model cannot be exported; the message says what of it, and the rule."""


class Tensor:
    """A tensor of a graph: whatever is computed of it adds a node, whose output is the result.

    Operators are those of arrays, with other tensors, numbers and arrays, which become constants.

    Parameters
    ----------
    graph : Graph
        Grows.
    name : str
        Of the tensor in it.
    """

    __slots__ = ("graph", "name")
    __array_ufunc__ = None  # of an array and a tensor, the tensor computes

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
        """Return the mean over an axis, which is kept."""
        return self.reduced("ReduceMean", axis)

    def sum(self, axis: int = -1) -> "Tensor":
        """Return the sum over an axis, which is kept."""
        return self.reduced("ReduceSum", axis)

    def reduced(self, operator: str, *axes: int, keepdims: bool = True) -> "Tensor":
        """Return a reduction ("ReduceMax") over axes."""
        return self.graph.add(operator, self, along(*axes), keepdims=int(keepdims))

    def cast(self, dtype: type[np.generic]) -> "Tensor":
        """Return it in another type of numbers."""
        from onnx import helper

        return self.graph.add("Cast", self, to=helper.np_dtype_to_tensor_dtype(np.dtype(dtype)))

    def take(self, at: NDArray[Any], axis: int = 1) -> "Tensor":
        """Return the elements at some indices along an axis."""
        return self.graph.add("Gather", self, at, axis=axis)

    def cut(self, start: int, stop: int, axis: int = -1) -> "Tensor":
        """Return the elements [start, stop) along an axis."""
        return self.graph.add("Slice", self, along(start), along(stop), along(axis))

    def reshape(self, *shape: int) -> "Tensor":
        """Return it in another shape; 0 keeps the length of an axis, -1 is what is left."""
        return self.graph.add("Reshape", self, along(*shape))

    def unsqueeze(self, axis: int = 1) -> "Tensor":
        """Return it with a new axis of length 1."""
        return self.graph.add("Unsqueeze", self, along(axis))

    def where(self, condition: "Tensor", otherwise: "Operand" = np.nan) -> "Tensor":
        """Return it where a condition holds, NaN or something else elsewhere."""
        return self.graph.add("Where", condition, self, otherwise)


Operand = Tensor | float | NDArray[Any]
"""A tensor, or a constant; numbers in double precision."""


class Graph:
    """Nodes in the order of their computation.

    Parameters
    ----------
    same_pieces : bool
        Whether the pieces of a recording are all the same to classifiers that let them vote: one vote is all.

    Attributes
    ----------
    nodes, constants : list
        What was added so far.
    """

    def __init__(self, *, same_pieces: bool = False) -> None:
        self.same_pieces = same_pieces
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self._n_names = 0
        self._made: dict[Hashable, Any] = {}

    def add(self, operator: str, *operands: Operand, name: str | None = None, **attributes: Any) -> Tensor:
        """Add a node and return its output.

        Parameters
        ----------
        operator : str
            Of the standard operators.
        *operands : Tensor, float or ndarray
            What it computes with.
        name : str, optional
            Of the output; a new one by default.
        **attributes
            Of the operator.
        """
        from onnx import helper

        names = [one.name if isinstance(one, Tensor) else self.constant(one).name for one in operands]
        output = name or self._new(operator)
        self.nodes.append(helper.make_node(operator, names, [output], **attributes))
        return Tensor(self, output)

    def constant(self, value: float | NDArray[Any]) -> Tensor:
        """Add a constant; a number in double precision."""
        values = value if isinstance(value, np.ndarray) else np.array(value, dtype=np.float64)
        if values.size < 64:  # equal constants are kept once from here on
            return self._kept(values)
        return self.once((values.dtype, values.shape, values.tobytes()), lambda: self._kept(values))

    def _kept(self, values: NDArray[Any]) -> Tensor:
        from onnx import numpy_helper

        self.constants.append(numpy_helper.from_array(values, self._new("constant")))
        return Tensor(self, self.constants[-1].name)

    def once(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what `make` adds, which is added the first time a key is asked for."""
        if key not in self._made:
            self._made[key] = make()
        made: Made = self._made[key]
        return made

    def short(self, values: NDArray[np.float64]) -> Tensor:
        """Add a constant in the fewest bits that lose nothing of it, converted to double precision."""
        for dtype in (np.float16, np.float32):
            with np.errstate(over="ignore"):
                kept = values.astype(dtype)
            if np.array_equal(kept, values):
                return self.constant(kept).cast(np.float64)
        return self.constant(values)

    def beside(self, *columns: Tensor, axis: int = 1) -> Tensor:
        """Add tensors side by side."""
        return self.add("Concat", *columns, axis=axis)

    def largest(self, operand: Tensor, n: int, **attributes: Any) -> tuple[Tensor, Tensor]:
        """Add the n largest elements along an axis, and where they are."""
        from onnx import helper

        names = [self._new("largest"), self._new("indices")]
        inputs = [operand.name, self.constant(along(n)).name]
        self.nodes.append(helper.make_node("TopK", inputs, names, **attributes))
        return Tensor(self, names[0]), Tensor(self, names[1])

    def embed(self, part: Any, operand: Tensor) -> Tensor:
        """Add a model of one input and one output, and return its output, in double precision."""
        from onnx import TensorProto, compose

        apart = compose.add_prefix(part, f"{self._new('part')}/")
        (entry,), (output,) = apart.graph.input, apart.graph.output
        self.add("Identity", operand, name=entry.name)
        self.nodes += apart.graph.node
        self.constants += apart.graph.initializer
        last = Tensor(self, output.name)
        return last if output.type.tensor_type.elem_type == TensorProto.DOUBLE else last.cast(np.float64)

    def model(self, inputs: list[Any], outputs: list[Any], name: str, doc: str) -> Any:
        """Return the finished model.

        Raises
        ------
        OnnxExportError
            If it is not valid.
        """
        from onnx import checker, helper

        # Products with matrices of one row are products of elements. onnxruntime moves a scalar factor into
        # the matrix product beside it, and keeps it there in single precision: a scale, where there is one
        # column.
        single = {one.name for one in self.constants if len(one.dims) == 2 and one.dims[0] == 1}
        for node in self.nodes:
            if node.op_type == "MatMul" and node.input[1] in single:
                node.op_type = "Mul"
        used = {node.domain for node in self.nodes} | {""}
        graph = helper.make_graph(self.nodes, name, inputs, outputs, self.constants, doc)
        opsets = [helper.make_opsetid(domain, OPSETS[domain]) for domain in OPSETS if domain in used]
        # Version 8 of the file format belongs to opset 18.
        model = helper.make_model(graph, opset_imports=opsets, ir_version=8, doc_string=doc)
        try:
            checker.check_model(model, full_check=True)
        except Exception as error:  # its exceptions have no class in common
            raise OnnxExportError(f"the graph is not valid ({error}). Expected opset {OPSETS['']}") from error
        return model

    def _new(self, kind: str) -> str:
        self._n_names += 1
        return f"{kind}_{self._n_names}"


def along(*axes: int) -> NDArray[np.int64]:
    """Return axes as reductions take them."""
    return np.array(axes, dtype=np.int64)


def tensor_of(name: str, dtype: type, *shape: int | str) -> Any:
    """Return the description of an input or output of a graph; of text, the type is `object`."""
    from onnx import helper

    kind = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
    return helper.make_tensor_value_info(name, kind, list(shape))
