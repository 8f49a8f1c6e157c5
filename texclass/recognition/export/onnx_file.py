"""A trained model in, an ONNX file out: checked against scikit-learn before it is written."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from texclass import __version__
from texclass.recognition.export.graph import UNDEFINED, OnnxExportError, build
from texclass.recognition.export.parity import Parity, check_parity, reference, remembered
from texclass.recognition.model import Model
from texclass.recording import Samples
from texclass.whole_files import write_whole

NEEDED = ("onnx", "onnxruntime", "skl2onnx")
PREFIX = "texclass."
"""Of the names of all facts."""
N_REMEMBERED = 3
"""Rows like those of training, from all over them, with which a program can check itself."""


class Exported(NamedTuple):
    """What was written.

    Attributes
    ----------
    path
        The file.
    parity
        How it was compared with scikit-learn.
    single_precision
        Operators that compute in single precision; none of what shipped pipelines name.
    """

    path: Path
    parity: Parity
    single_precision: tuple[str, ...]


def export_onnx(model: Model, path: str | Path) -> Exported:
    """Write the part of a model that follows the features as an ONNX file: complete, or not at all.

    The graph takes float64 features (n, n_columns), and gives labels, calibrated probabilities, p-values of
    "known" and verdicts; its documentation and metadata say the rest. It computes in double precision.

    Parameters
    ----------
    model : Model
        Trained.
    path : str or Path
        File to write (.onnx).

    Raises
    ------
    ModuleNotFoundError
        If the extra `onnx` is not installed.
    OnnxExportError
        If a step or the classifier has no export.
    ParityError
        If the graph gives other answers than scikit-learn.
    """
    for name in NEEDED:
        try:
            import_module(name)
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"exporting to ONNX needs {error.name}, which is not installed: pip install 'texclass[onnx]'",
                name=error.name,
            ) from error
    try:
        graph = build(model)
        parity = check_parity(model, graph.SerializeToString())
    except OnnxExportError as error:
        raise type(error)(f"{path}: not written: {error}") from error
    single = single_precision(graph)
    for name, value in facts_of(model, parity, single).items():
        graph.metadata_props.add(key=name, value=value)
    graph.producer_name, graph.producer_version = "texclass", model.manifest.versions.get("texclass", "")
    write_whole(Path(path), graph.SerializeToString())
    return Exported(Path(path), parity, single)


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
    told_otherwise = {"fs", "calibration", "unknown", "cost", "format_version"}
    said = model.manifest.model_dump(mode="json", exclude=told_otherwise) | {
        "version": __version__,
        "columns": model.columns,
        "materials": model.materials,
        "fs_hz": model.manifest.fs,
        "channels": model.plan.channels,
        "false_alarms": model.novelty.false_alarms,
        "ranges": {edge: _listed(values) for edge, values in vars(model.ranges).items()},
        "calibration": asdict(model.calibration),
        "single_precision": single,
        "parity": asdict(parity),
        "self_check": _self_checks(model),
    }
    return {f"{PREFIX}{name}": v if isinstance(v, str) else json.dumps(v) for name, v in said.items()}


def _self_checks(model: Model) -> list[dict[str, Any]]:
    """Return rows of features with the answers they have: medians, with gaps, and what training was like.

    null stands for NaN.
    """
    median = model.ranges.median
    gaps = np.where(np.arange(len(median)) % 2, median, np.nan)
    known = remembered(model)
    some = np.linspace(0, len(known) - 1, min(N_REMEMBERED, len(known)), dtype=int)
    X = np.concatenate([[median, gaps], known[some]])
    said = reference(model, X)
    return [
        {
            "features": _listed(X[i]),
            "label": str(said["label"][i]),
            "probabilities": said["probabilities"][i].tolist(),
            "p_known": float(said["p_known"][i]),
            "unknown": bool(said["unknown"][i]),
        }
        for i in np.flatnonzero(said["label"] != UNDEFINED)
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
