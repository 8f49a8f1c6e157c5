"""Export of a trained model as an ONNX file, and the self-check of such a file."""

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
from texclass.robot.export.answers_graph import build
from texclass.robot.export.graph import OnnxExportError
from texclass.robot.export.parity import TOLERANCE, Parity, check_parity, run, self_checks, to_json
from texclass.robot.export.sample_graph import (
    SAMPLES,
    build_sample_graph,
    channels_of,
    check_graphs,
    window_length,
)
from texclass.robot.export.sample_parity import (
    FORMULA,
    SampleParity,
    check_sample_parity,
    create_window,
    features_of_windows,
    sample_self_checks,
    window_recipes,
)

REQUIRED_MODULES = ("onnx", "onnxruntime", "skl2onnx")
PREFIX = "texclass."
"""Prefix of the keys in the metadata."""
Start = Literal["features", "samples"]


class ExportedModel(NamedTuple):
    """Exported ONNX file, with the results of its checks.

    Attributes
    ----------
    path
        ONNX file.
    parity
        Comparison of the answers for features with the answers of the model.
    single_precision
        Operators that compute in single precision; none for the classifiers of shipped pipelines.
    facts
        Metadata of the file; its keys are without the prefix "texclass.".
    sample_parity
        Comparison of the answers for samples with the answers of texclass; None if features are the input.
    """

    path: Path
    parity: Parity
    single_precision: tuple[str, ...]
    facts: Mapping[str, Any]
    sample_parity: SampleParity | None = None


def export_onnx(
    model: Model, path: str | Path, *, start: Start = "features", window_s: float | None = None
) -> ExportedModel:
    """Write a model as an ONNX file, after checking that the graph gives the same answers.

    If `start` is "features", the input is float64 features (n, n_columns). If it is "samples", the graph also
    computes the features of windows, and the input is float32 samples (n, n_channels, n_samples). The outputs
    are labels, calibrated probabilities, p-values of "the surface is in the training set", and whether the
    surface is unknown. Graphs compute in double precision.

    Parameters
    ----------
    model : Model
        Trained model. For "samples", its features must have a graph (`texclass train --exportable`).
    path : str or Path
        File to write (.onnx).
    start : {"features", "samples"}
        Input of the graph.
    window_s : float, optional
        Length of the windows in seconds, if `start` is "samples" (default: as in training).

    Returns
    -------
    exported : ExportedModel
        Path, metadata and results of the checks.

    Raises
    ------
    ModuleNotFoundError
        If the extra `onnx` is not installed.
    OnnxExportError
        If a feature, a step or the classifier cannot be exported, or the window length is missing.
    ParityError
        If the answers of the graph differ from those of texclass.
    ValueError
        If the suffix is not .onnx.

    Examples
    --------
    >>> exported = export_onnx(load_model("surfaces.skops"), "surfaces.onnx")  # doctest: +SKIP
    >>> print(exported.parity)  # doctest: +SKIP
    """
    check_suffix(path, ".onnx")
    check_installed("exporting to ONNX")
    samples_result, n_samples = None, 0
    try:
        if start == "samples":  # check the window and the features before the expensive steps
            n_samples = window_length(model, window_s)
            check_graphs(model)
        graph = build(model)
        parity, single = check_parity(model, graph.SerializeToString()), single_precision(graph)
        facts = facts_of(model, parity, single)
        if start == "samples":
            samples_result, sample_facts = _check_samples(model, n_samples)
            graph, facts = build_sample_graph(model, n_samples), facts | sample_facts
    except OnnxExportError as error:
        raise type(error)(f"{path} was not written: {error}") from error
    for name, fact in facts.items():
        value = fact if isinstance(fact, str) else json.dumps(fact)
        graph.metadata_props.add(key=f"{PREFIX}{name}", value=value)
    graph.producer_name, graph.producer_version = "texclass", model.manifest.versions.get("texclass", "")
    write_atomic(Path(path), graph.SerializeToString())
    return ExportedModel(Path(path), parity, single, facts, samples_result)


def check_installed(action: str, modules: Sequence[str] = REQUIRED_MODULES) -> None:
    """Check that the modules of the extra `onnx` are installed.

    Parameters
    ----------
    action : str
        Action that requires the modules, for the error message.
    modules : sequence of str
        Names of the modules.

    Raises
    ------
    ModuleNotFoundError
        If a module is not installed.
    """
    for name in modules:
        try:
            import_module(name)
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"{action} requires {error.name}, which is not installed: pip install 'texclass[onnx]'",
                name=error.name,
            ) from error


def _check_samples(model: Model, n_samples: int) -> tuple[SampleParity, dict[str, Any]]:
    """Compare a graph whose input is samples with texclass; return the result, and metadata for the file."""
    from texclass.recognition.live.online_recogniser import OnlineRecogniser, OnlineSettings

    channels, recipes = channels_of(model), window_recipes(model)
    windows = np.stack([create_window(recipe, len(channels), n_samples) for recipe in recipes])
    X = features_of_windows(model, windows)
    graph = build_sample_graph(model, n_samples, with_features=True).SerializeToString()
    parity = check_sample_parity(model, graph, windows, X)
    settings = OnlineSettings(window_s=n_samples / model.manifest.fs)
    window = {"n_samples": n_samples, "fs_hz": model.manifest.fs, "unit": model.manifest.unit}
    return parity, {
        "window": {**window, "channels": channels},
        "sample_parity": asdict(parity),
        "stream": OnlineRecogniser(model, settings=settings).constants(len(channels)),
        "formula": FORMULA,
        "self_check": sample_self_checks(model, recipes, X),
    }


def check_onnx(path: str | Path) -> str:
    """Run the self-check of an ONNX file: classify its stored rows or windows, and compare the answers.

    Parameters
    ----------
    path : str or Path
        File written by `export_onnx`.

    Returns
    -------
    summary : str
        Number of checks and largest difference of a probability, in words.

    Raises
    ------
    ModuleNotFoundError
        If the extra `onnx` is not installed.
    OnnxExportError
        If the file was not written by texclass, or an answer differs from the stored one.

    Examples
    --------
    >>> check_onnx("surfaces.onnx")  # doctest: +SKIP
    """
    check_installed("checking ONNX files", ("onnx", "onnxruntime"))
    import onnx

    graph = Path(path).read_bytes()
    try:
        file = onnx.ModelProto.FromString(graph)
        facts = {item.key.removeprefix(PREFIX): item.value for item in file.metadata_props}
        checks, entry = json.loads(facts["self_check"]), file.graph.input[0].name
        surfaces = json.loads(facts["surfaces"])
    except Exception as error:  # other files cause many kinds of errors
        raise OnnxExportError(
            f"{path} is not a model of texclass ({type(error).__name__}: {error}). Expected a file written "
            "by 'texclass export'"
        ) from error
    if entry == SAMPLES:
        window = json.loads(facts["window"])
        X = np.stack([create_window(c, len(window["channels"]), window["n_samples"]) for c in checks])
    else:
        X = np.array([[np.nan if v is None else v for v in check["features"]] for check in checks])
    outputs, largest = run(graph, X, entry), 0.0
    for i, check in enumerate(checks):
        p, tolerance = np.array(check["probabilities"]), check.get("tolerance", TOLERANCE)
        difference = float(np.abs(outputs["probabilities"][i] - p).max())
        largest = max(largest, difference)
        label, is_unknown = str(outputs["label"][i]), bool(outputs["unknown"][i])
        if (label, is_unknown) != (check["label"], check["unknown"]) or not difference <= tolerance:
            raise OnnxExportError(
                f"{path}: check {i} must give label {check['label']!r}, unknown = {check['unknown']} and "
                f"probabilities within {tolerance:.2g}, got {label!r}, {is_unknown} and a difference of "
                f"{difference:.2g}. Export the model again"
            )
    n_predicted = len({check["label"] for check in checks})
    return (
        f"{len(checks)} of {len(checks)} checks with the stored answers, probabilities within {largest:.1e}; "
        f"{n_predicted} of {len(surfaces)} surfaces, input {entry}"
    )


def facts_of(model: Model, parity: Parity, single: tuple[str, ...]) -> dict[str, Any]:
    """Return the metadata of an ONNX file.

    Parameters
    ----------
    model : Model
        Exported model.
    parity : Parity
        Result of the parity check.
    single : tuple of str
        Operators that compute in single precision.
    """
    # These have another form below, or do not apply to the file.
    excluded = {"fs", "calibration", "unknown", "cost", "format_version"}
    facts: dict[str, Any] = model.manifest.model_dump(mode="json", exclude=excluded)
    return facts | {
        "version": __version__,
        "columns": model.columns,
        "surfaces": model.surfaces,
        "fs_hz": model.manifest.fs,
        "channels": model.plan.channels,
        "false_alarms": model.novelty.false_alarms,
        "ranges": {name: to_json(values) for name, values in vars(model.ranges).items()},
        "calibration": asdict(model.calibration),
        "prediction_sets": model.manifest.calibration.get("prediction_sets", {}),
        "single_precision": single,
        "parity": asdict(parity),
        "self_check": self_checks(model),
    }


def single_precision(graph: Any) -> tuple[str, ...]:
    """Return the sorted operators of an ONNX model whose attributes or outputs are in single precision."""
    from onnx import AttributeProto, TensorProto, shape_inference

    inferred = shape_inference.infer_shapes(graph).graph
    single = {v.name for v in inferred.value_info if v.type.tensor_type.elem_type == TensorProto.FLOAT}
    numbers = (AttributeProto.FLOAT, AttributeProto.FLOATS)
    operators = {
        node.op_type
        for node in inferred.node
        if single.intersection(node.output) or any(a.type in numbers for a in node.attribute)
    }
    return tuple(sorted(operators))
