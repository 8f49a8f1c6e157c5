"""What stands between features and classifier, as nodes of a graph.

skl2onnx converts scalers, projections and the like. Two kinds it cannot: onnxruntime has no imputer for
double precision, and it does not know our selectors.
"""

from functools import singledispatch
from typing import Any

import numpy as np
from sklearn.feature_selection import SelectorMixin
from sklearn.impute import SimpleImputer
from sklearn.pipeline import Pipeline

from texclass.recognition.onnx_export.converted import class_name, converted_step
from texclass.recognition.onnx_export.graph import Graph, OnnxExportError


@singledispatch
def add_step(step: Any, graph: Graph, rows: str) -> str:
    """Add a fitted transformer to a graph.

    Parameters
    ----------
    step : transformer
        Fitted.
    graph : Graph
        Grows.
    rows : str
        Tensor of shape (n, n_features_in), double.

    Returns
    -------
    str
        Name of the tensor it makes of them, of shape (n, n_features_out), double.

    Raises
    ------
    OnnxExportError
        If it has no export.
    """
    return converted_step(step, graph, rows)


@add_step.register
def _(step: str | None, graph: Graph, rows: str) -> str:
    """Add "passthrough": nothing."""
    return rows


@add_step.register
def _(step: Pipeline, graph: Graph, rows: str) -> str:
    for _, inner in step.steps:
        rows = add_step(inner, graph, rows)
    return rows


@add_step.register
def _(step: SelectorMixin, graph: Graph, rows: str) -> str:
    return graph.add("Gather", rows, np.flatnonzero(step.get_support()), axis=1)


@add_step.register
def _(step: SimpleImputer, graph: Graph, rows: str) -> str:
    if step.add_indicator or not np.isnan(step.missing_values):
        raise OnnxExportError(
            f"{class_name(step)} has add_indicator = {step.add_indicator}, missing_values = "
            f"{step.missing_values}; the rule is False and NaN"
        )
    filling = np.asarray(step.statistics_, dtype=np.float64)
    if not step.keep_empty_features:
        kept = np.flatnonzero(~np.isnan(filling))
        rows, filling = graph.add("Gather", rows, kept, axis=1), filling[kept]
    return graph.add("Where", graph.add("IsNaN", rows), filling, rows)
