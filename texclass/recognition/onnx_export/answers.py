"""A trained model as a graph: features in; label, probabilities, p-value and verdict out."""

from typing import Any

import numpy as np

from texclass.recognition.calibration import Calibration
from texclass.recognition.model import Model
from texclass.recognition.onnx_export.classifiers import add_class_scores, squared_distances
from texclass.recognition.onnx_export.graph import Graph, along, number, repeated
from texclass.recognition.onnx_export.steps import add_step
from texclass.recognition.unknown import Novelty

FEATURES = "features"
OUTPUTS = ("label", "probabilities", "p_known", "unknown")
UNDEFINED = ""
"""Label of a row that has an infinite feature, or an undefined one that no step fills."""
DOC = """\
Which surface is this: the part of a texclass model that follows the features.

Input: features, float64 (n, n_columns), a row a touch or recording; texclass.columns names the columns in
order; NaN where a feature is undefined.
Outputs: label, string (n,), the likeliest material; probabilities, float64 (n, n_materials), calibrated, in
the order of texclass.materials; p_known, float64 (n,), conformal p-value of "this surface is one of them";
unknown, bool (n,), p_known <= texclass.false_alarms, or no feature has a value.
A row that is infinite somewhere, or undefined where nothing fills it, has the label "", NaN, and is unknown.
Computing the features is left to the program; texclass.self_check holds rows with the answers it has to get.
"""


def build(model: Model) -> Any:
    """Return a trained model as an ONNX model, without metadata.

    Parameters
    ----------
    model : Model
        What is exported.

    Returns
    -------
    onnx.ModelProto
        One input, "features"; the outputs of `OUTPUTS`.

    Raises
    ------
    OnnxExportError
        If a step or the classifier has no export.
    """
    from onnx import TensorProto, helper

    graph = Graph()
    prepared = FEATURES
    for _, step in model.recogniser.steps[1:-1]:
        prepared = add_step(step, graph, prepared)
    decisions = add_class_scores(model.recogniser[-1], graph, prepared)
    p = _probabilities(model.calibration, decisions, len(model.materials), graph)
    undefined = _undefined(prepared, graph)
    best = graph.add("ArgMax", p, axis=1, keepdims=0)
    names = graph.add("Gather", np.array(model.materials, dtype=object), best)
    graph.add("Where", undefined, np.array(UNDEFINED, dtype=object), names, name="label")
    graph.add("Where", graph.add("Unsqueeze", undefined, along(1)), number(np.nan), p, name="probabilities")
    _add_verdict(model.novelty, _strangeness(model.novelty, decisions, prepared, graph), undefined, graph)

    entry = helper.make_tensor_value_info(FEATURES, TensorProto.DOUBLE, ["n", len(model.columns)])
    outputs = [
        helper.make_tensor_value_info("label", TensorProto.STRING, ["n"]),
        helper.make_tensor_value_info("probabilities", TensorProto.DOUBLE, ["n", len(model.materials)]),
        helper.make_tensor_value_info("p_known", TensorProto.DOUBLE, ["n"]),
        helper.make_tensor_value_info("unknown", TensorProto.BOOL, ["n"]),
    ]
    return graph.model([entry], outputs, "surfaces", DOC)


def _probabilities(calibration: Calibration, decisions: str, n_classes: int, graph: Graph) -> str:
    """Add (1 - lapse) softmax(beta s) + lapse / K."""
    p = graph.add("Softmax", graph.add("Mul", decisions, repeated(calibration.beta, n_classes)), axis=1)
    p = graph.add("Mul", p, number(1 - calibration.lapse))
    return graph.add("Add", p, number(calibration.lapse / n_classes))


def _strangeness(novelty: Novelty, decisions: str, prepared: str, graph: Graph) -> str:
    near = novelty.nearness
    if novelty.kind == "decision" or near is None:
        return graph.add("Neg", graph.add("ReduceMax", decisions, along(1), keepdims=0))
    seen = graph.add("MatMul", graph.add("Sub", prepared, near.mean), near.view)
    return graph.add("ReduceMin", squared_distances(seen, near.means, graph), along(1), keepdims=0)


def _add_verdict(novelty: Novelty, strange: str, undefined: str, graph: Graph) -> None:
    """Add p = (1 + #{held-out scores >= score}) / (n + 1), and whether false alarms may have it as small."""
    at_least = graph.add("LessOrEqual", graph.add("Unsqueeze", strange, along(1)), novelty.held_out[None])
    count = graph.add("ReduceSum", _as_number(at_least, graph), along(1), keepdims=0)
    p = graph.add("Div", graph.add("Add", count, number(1.0)), number(len(novelty.held_out) + 1))
    small = graph.add("LessOrEqual", p, number(novelty.false_alarms))
    empty = _each(graph.add("IsNaN", FEATURES), "ReduceMin", graph)
    graph.add("Where", undefined, number(np.nan), p, name="p_known")
    graph.add("Or", graph.add("Or", small, empty), undefined, name="unknown")


def _undefined(prepared: str, graph: Graph) -> str:
    bad = graph.add("Or", graph.add("IsNaN", prepared), graph.add("IsInf", prepared))
    return _each(bad, "ReduceMax", graph)


def _each(truths: str, reduction: str, graph: Graph) -> str:
    """Add whether any ("ReduceMax") or all ("ReduceMin") of each row is true, shape (n,)."""
    from onnx import TensorProto

    found = graph.add(reduction, _as_number(truths, graph), along(1), keepdims=0)
    return graph.add("Cast", found, to=TensorProto.BOOL)


def _as_number(truths: str, graph: Graph) -> str:
    from onnx import TensorProto

    return graph.add("Cast", truths, to=TensorProto.DOUBLE)
