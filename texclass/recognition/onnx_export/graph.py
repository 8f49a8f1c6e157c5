"""An ONNX graph that is being built: nodes, constants, parts that another converter made."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

OPSETS: Mapping[str, int] = {"": 18, "ai.onnx.ml": 3}
"""Versions of the operators, old enough for onnxruntime 1.15 (2023): robots rarely have the latest."""
IR_VERSION = 8
"""Of the file format; belongs to opset 18."""

Operand = str | NDArray[Any]
"""The name of a tensor, or a constant."""


class OnnxExportError(ValueError):
    """A model cannot be exported; the message says what of it, and the rule."""


class Graph:
    """Nodes in the order of their computation; tensors are known by name.

    Attributes
    ----------
    nodes, constants : list
        What was added so far.
    """

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self._n_names = 0

    def add(self, operator: str, *operands: Operand, name: str | None = None, **attributes: Any) -> str:
        """Add a node and return the name of its output.

        Parameters
        ----------
        operator : str
            Of the standard operators.
        *operands : str or ndarray
            Names of tensors, or constants.
        name : str, optional
            Of the output; a new one by default.
        **attributes
            Of the operator.
        """
        from onnx import helper

        names = [self._constant(one) if isinstance(one, np.ndarray) else one for one in operands]
        output = name or self._new(operator)
        self.nodes.append(helper.make_node(operator, names, [output], **attributes))
        return output

    def embed(self, part: Any, operand: str) -> str:
        """Add a model of one input and one output, and return the name of its output, in double precision."""
        from onnx import TensorProto, compose

        apart = compose.add_prefix(part, f"{self._new('part')}/")
        (entry,), (output,) = apart.graph.input, apart.graph.output
        self.add("Identity", operand, name=entry.name)
        self.nodes += apart.graph.node
        self.constants += apart.graph.initializer
        if output.type.tensor_type.elem_type == TensorProto.DOUBLE:
            return str(output.name)
        return self.add("Cast", output.name, to=TensorProto.DOUBLE)

    def model(self, inputs: list[Any], outputs: list[Any], name: str, doc: str) -> Any:
        """Return the finished model.

        Raises
        ------
        OnnxExportError
            If it is not valid.
        """
        from onnx import checker, helper

        self._multiply_single_columns()
        used = {node.domain for node in self.nodes} | {""}
        graph = helper.make_graph(self.nodes, name, inputs, outputs, self.constants, doc)
        opsets = [helper.make_opsetid(domain, OPSETS[domain]) for domain in OPSETS if domain in used]
        model = helper.make_model(graph, opset_imports=opsets, ir_version=IR_VERSION, doc_string=doc)
        try:
            checker.check_model(model, full_check=True)
        except Exception as error:  # its exceptions have no class in common
            raise OnnxExportError(
                f"the graph is not valid ({error}); the rule is opset {OPSETS['']}"
            ) from error
        return model

    def _multiply_single_columns(self) -> None:
        """Make products with matrices of one row products of elements, which they are.

        onnxruntime moves a scalar factor into the matrix product beside it, and keeps it there in single
        precision: a scale, where there is one column.
        """
        single = {one.name for one in self.constants if len(one.dims) == 2 and one.dims[0] == 1}
        for node in self.nodes:
            if node.op_type == "MatMul" and node.input[1] in single:
                node.op_type = "Mul"

    def _constant(self, value: NDArray[Any]) -> str:
        from onnx import numpy_helper

        self.constants.append(numpy_helper.from_array(value, self._new("constant")))
        return str(self.constants[-1].name)

    def _new(self, kind: str) -> str:
        self._n_names += 1
        return f"{kind}_{self._n_names}"


def along(*axes: int) -> NDArray[np.int64]:
    """Return axes as reductions take them."""
    return np.array(axes, dtype=np.int64)


def number(value: float) -> NDArray[np.float64]:
    """Return a scalar constant in double precision."""
    return np.array(value, dtype=np.float64)


def repeated(value: float, n: int) -> NDArray[np.float64]:
    """Return a factor as a constant of shape (n,), n > 1; a scalar would lose digits as single columns do."""
    return np.full(n, value)
