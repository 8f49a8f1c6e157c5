"""What an ONNX file says of itself, so that a program can check that it feeds it what it was trained on."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from texclass import __version__
from texclass.recognition.model import Model
from texclass.recognition.onnx_export.parity import Parity
from texclass.recognition.onnx_export.reference import judge
from texclass.recognition.onnx_export.remembered import remembered
from texclass.recording import Samples

PREFIX = "texclass."
"""Of the names of all facts."""
N_REMEMBERED = 3
"""Rows like those of training, from all over them, with which a program can check itself."""


def facts_of(model: Model, parity: Parity, single: tuple[str, ...]) -> Mapping[str, str]:
    """Return the metadata of an ONNX file; lists and tables as JSON.

    Parameters
    ----------
    model : Model
        What was exported.
    parity : Parity
        How it was checked.
    single : tuple of str
        Operators that compute in single precision.
    """
    manifest = model.manifest
    said: dict[str, Any] = {
        "version": __version__,
        "columns": model.columns,
        "materials": model.materials,
        "fs_hz": manifest.fs,
        "unit": manifest.unit,
        "channels": model.plan.channels,
        "phases": manifest.phases,
        "features": manifest.features,
        "touch_s": manifest.touch_s,
        "shortest_s": manifest.shortest_s,
        "input": manifest.input,
        "pipeline": manifest.pipeline,
        "trained_on": manifest.trained_on,
        "accuracy": manifest.accuracy,
        "false_alarms": model.novelty.false_alarms,
        "ranges": {edge: _listed(values) for edge, values in vars(model.ranges).items()},
        "calibration": asdict(model.calibration),
        "versions": manifest.versions,
        "single_precision": single,
        "parity": asdict(parity),
        "self_check": self_checks(model),
    }
    return {f"{PREFIX}{name}": v if isinstance(v, str) else json.dumps(v) for name, v in said.items()}


def self_checks(model: Model) -> list[dict[str, Any]]:
    """Return rows of features with the answers they have: medians, with gaps, and what training was like.

    null stands for NaN.
    """
    median = model.ranges.median
    gaps = np.where(np.arange(len(median)) % 2, median, np.nan)
    known = remembered(model)
    some = np.linspace(0, len(known) - 1, min(N_REMEMBERED, len(known)), dtype=int)
    X = np.concatenate([[median, gaps], known[some]])
    told = judge(model, X)
    return [
        {
            "features": _listed(X[i]),
            "label": str(told.labels[i]),
            "probabilities": told.probabilities[i].tolist(),
            "p_known": float(told.p_known[i]),
            "unknown": bool(told.unknown[i]),
        }
        for i in np.flatnonzero(told.defined)
    ]


def _listed(values: Samples) -> list[float | None]:
    """Return values as JSON has them: null for NaN."""
    return [None if np.isnan(value) else value for value in values.tolist()]


def single_precision(graph: Any) -> tuple[str, ...]:
    """Return the operators of an ONNX model whose parameters or outputs are in single precision, sorted."""
    from onnx import AttributeProto, TensorProto, shape_inference

    inferred = shape_inference.infer_shapes(graph).graph
    single = {v.name for v in inferred.value_info if v.type.tensor_type.elem_type == TensorProto.FLOAT}
    numbers = (AttributeProto.FLOAT, AttributeProto.FLOATS)
    found = {
        node.op_type
        for node in inferred.node
        if single.intersection(node.output) or any(a.type in numbers for a in node.attribute)
    }
    return tuple(sorted(found))
