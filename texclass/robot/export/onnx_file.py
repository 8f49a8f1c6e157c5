"""A trained model in, an ONNX file out: checked before it is written, and by what it holds at any time."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from texclass import __version__
from texclass.atomic_write import check_suffix, write_atomic
from texclass.recognition.model import Model
from texclass.robot.export import sample_parity
from texclass.robot.export.answers_graph import build
from texclass.robot.export.graph import OnnxExportError
from texclass.robot.export.parity import TOLERANCE, Parity, check_parity, listed, run, self_checks
from texclass.robot.export.sample_graph import (
    SAMPLES,
    build_of_samples,
    channels_of,
    check_graphs,
    window_of_model,
)

NEEDED = ("onnx", "onnxruntime", "skl2onnx")
PREFIX = "texclass."
"""Of the names of all facts."""
Start = Literal["features", "samples"]


class Exported(NamedTuple):
    """What was written.

    Attributes
    ----------
    path
        The file.
    parity
        How it was compared with the model.
    single_precision
        Operators that compute in single precision; none of what shipped pipelines name.
    facts
        What the metadata say, by name without "texclass.".
    of_samples
        How the whole path was compared with texclass, where samples are the input.
    """

    path: Path
    parity: Parity
    single_precision: tuple[str, ...]
    facts: Mapping[str, Any]
    of_samples: sample_parity.SampleParity | None = None


def export_onnx(
    model: Model, path: str | Path, *, start: Start = "features", window_s: float | None = None
) -> Exported:
    """Write a model as an ONNX file, from the features on or from the samples on: complete, or not at all.

    From "features" on, the graph takes float64 features (n, n_columns). From "samples" on it is the whole
    path of a model of windows: it takes float32 samples (n, n_channels, n_samples), and computes only what
    the model needs. Both give labels, calibrated probabilities, p-values of "known" and verdicts;
    documentation and metadata say the rest. They compute in double precision.

    Parameters
    ----------
    model : Model
        Trained; from samples on with features that have a graph, see `texclass train --exportable`.
    path : str or Path
        File to write (.onnx).
    start : {"features", "samples"}
        Where the graph begins.
    window_s : float, optional
        Seconds of a window of samples; those of the touches the model was trained on by default.

    Raises
    ------
    ModuleNotFoundError
        If the extra `onnx` is not installed.
    OnnxExportError
        If a feature, a step or the classifier has no export, or a window no length.
    ParityError
        If the graph gives other answers than texclass.
    ValueError
        If the suffix is another one.
    """
    check_suffix(path, ".onnx")
    check_installed("exporting to ONNX")
    of_samples, n_samples = None, 0
    try:
        if start == "samples":  # what is refused should be so before anything is computed
            n_samples = window_of_model(model, window_s)
            check_graphs(model)
        graph = build(model)
        parity, single = check_parity(model, graph.SerializeToString()), single_precision(graph)
        facts = facts_of(model, parity, single)
        if start == "samples":
            of_samples, more = _checked_samples(model, n_samples)
            graph, facts = build_of_samples(model, n_samples), facts | more
    except OnnxExportError as error:
        raise type(error)(f"{path}: not written: {error}") from error
    for name, fact in facts.items():
        value = fact if isinstance(fact, str) else json.dumps(fact)
        graph.metadata_props.add(key=f"{PREFIX}{name}", value=value)
    graph.producer_name, graph.producer_version = "texclass", model.manifest.versions.get("texclass", "")
    write_atomic(Path(path), graph.SerializeToString())
    return Exported(Path(path), parity, single, facts, of_samples)


def check_installed(what: str, needed: Sequence[str] = NEEDED) -> None:
    """Check that what an export needs is installed.

    Parameters
    ----------
    what : str
        What needs it, for the message.
    needed : sequence of str
        Modules of the extra `onnx`.

    Raises
    ------
    ModuleNotFoundError
        If the extra `onnx` is not installed.
    """
    for name in needed:
        try:
            import_module(name)
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"{what} needs {error.name}, which is not installed: pip install 'texclass[onnx]'",
                name=error.name,
            ) from error


def _checked_samples(model: Model, n_samples: int) -> tuple[sample_parity.SampleParity, dict[str, Any]]:
    """Compare a graph of windows of samples with texclass; return how, and what the metadata say besides."""
    from texclass.recognition.live.online_recogniser import OnlineRecogniser, OnlineSettings

    channels, some = channels_of(model), sample_parity.recipes(model)
    windows = np.stack([sample_parity.made(recipe, len(channels), n_samples) for recipe in some])
    X = sample_parity.features_of_windows(model, windows)
    whole = build_of_samples(model, n_samples, with_features=True).SerializeToString()
    parity = sample_parity.check_sample_parity(model, whole, windows, X)
    settings = OnlineSettings(window_s=n_samples / model.manifest.fs)
    window = {"n_samples": n_samples, "fs_hz": model.manifest.fs, "unit": model.manifest.unit}
    return parity, {
        "window": {**window, "channels": channels},
        "sample_parity": asdict(parity),
        "stream": OnlineRecogniser(model, settings=settings).constants(len(channels)),
        "formula": sample_parity.FORMULA,
        "self_check": sample_parity.self_checks(model, some, X),
    }


def check_onnx(path: str | Path) -> str:
    """Ask an ONNX file what it holds itself the answers to, and return in words what was compared.

    Parameters
    ----------
    path : str or Path
        A file that `export_onnx` wrote.

    Raises
    ------
    ModuleNotFoundError
        If the extra `onnx` is not installed.
    OnnxExportError
        If it is no such file, or gives other answers than texclass gave when it was written.
    """
    check_installed("checking ONNX files", ("onnx", "onnxruntime"))
    import onnx

    graph = Path(path).read_bytes()
    try:
        file = onnx.ModelProto.FromString(graph)
        facts = {one.key.removeprefix(PREFIX): one.value for one in file.metadata_props}
        checks, entry = json.loads(facts["self_check"]), file.graph.input[0].name
        surfaces = json.loads(facts["surfaces"])
    except Exception as error:  # whatever reading another file runs into
        raise OnnxExportError(
            f"{path}: not a model of texclass ({type(error).__name__}: {error}). Expected a file that "
            "`texclass export` wrote"
        ) from error
    if entry == SAMPLES:
        shape = json.loads(facts["window"])
        X = np.stack(
            [sample_parity.made(check, len(shape["channels"]), shape["n_samples"]) for check in checks]
        )
    else:
        X = np.array([[np.nan if v is None else v for v in check["features"]] for check in checks])
    found, largest = run(graph, X, entry), 0.0
    for i, check in enumerate(checks):
        p, tolerance = np.array(check["probabilities"]), check.get("tolerance", TOLERANCE)
        gap = float(np.abs(found["probabilities"][i] - p).max())
        largest = max(largest, gap)
        said = (str(found["label"][i]), bool(found["unknown"][i]))
        if said != (check["label"], check["unknown"]) or not gap <= tolerance:
            raise OnnxExportError(
                f"{path}: check {i} gives {said} and probabilities that differ by {gap:.2g}. Expected "
                f"({check['label']!r}, {check['unknown']}) within {tolerance:.2g}"
            )
    answered = len({check["label"] for check in checks})
    return (
        f"{len(checks)} of {len(checks)} checks answered as when it was written, probabilities within "
        f"{largest:.1e}; {answered} of {len(surfaces)} surfaces, from {entry} on"
    )


def facts_of(model: Model, parity: Parity, single: tuple[str, ...]) -> dict[str, Any]:
    """Return the metadata of an ONNX file; in it, lists and tables are JSON.

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
    told: dict[str, Any] = model.manifest.model_dump(mode="json", exclude=told_otherwise)
    return told | {
        "version": __version__,
        "columns": model.columns,
        "surfaces": model.surfaces,
        "fs_hz": model.manifest.fs,
        "channels": model.plan.channels,
        "false_alarms": model.novelty.false_alarms,
        "ranges": {edge: listed(values) for edge, values in vars(model.ranges).items()},
        "calibration": asdict(model.calibration),
        "prediction_sets": model.manifest.calibration.get("prediction_sets", {}),
        "single_precision": single,
        "parity": asdict(parity),
        "self_check": self_checks(model),
    }


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
