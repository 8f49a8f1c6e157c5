"""What graphs make of a dataset's windows, with tables of so many bits, and what the same graphs take."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from texclass.experiment.cost import CostModel
from texclass.experiment.feature_table import metadata
from texclass.experiment.windows import touches
from texclass.features.phase_view import TURN
from texclass.loaders.dataset import Dataset, Entry
from texclass.recognition.deployed import described_classifier, described_steps
from texclass.recognition.export.graph import LARGE, Graph, add_part, tensor_of
from texclass.recognition.export.graph_cost import Work, rounded, shortened, work_of
from texclass.recognition.export.parity import run
from texclass.recognition.export.sample_graph import SAMPLES, Windows, add_features, features_of
from texclass.recording import Recording, RecordingError, Samples
from texclass.tradeoff.curves import degraded, quantised

Word = tuple[int, int]
WORDS = ((32, 32), (16, 16), (16, 8), (8, 8))
"""Bits of samples, and of tables and weights; 32 are single precision."""


class Cut(NamedTuple):
    """The windows of a dataset at one rate and length, and what graphs make of them: (bits, bits) -> X."""

    seconds: float
    windows: Windows
    frame: pd.DataFrame
    X: Mapping[Word, Samples]
    costs: CostModel


def at_rate(dataset: Dataset, fs: float) -> Dataset:
    """Return a dataset at a lower rate (Hz), the same for all recordings, to a sample of their length."""
    lower = degraded(dataset, fs=fs)
    return replace(lower, load=partial(_at_rate, lower.load, fs))


def _at_rate(load: Callable[[Entry], Recording], fs: float, entry: Entry) -> Recording:
    return load(entry).with_(fs=fs)


def cut_of(dataset: Dataset, windows: Windows, seconds: float, step: float, full_scale: float) -> Cut:
    """Cut a dataset at one rate, and compute its features with graphs of fewer and fewer bits.

    Parameters
    ----------
    dataset : Dataset
        At that rate.
    windows : Windows
        But for their length.
    seconds, step : float
        Of a window, and from one to the next.
    full_scale : float
        Of the converter.
    """
    felt, rows, kept = touches(dataset, seconds, step=step), [], []
    for entry in felt.entries:
        try:
            recording = felt.load(entry)
        except RecordingError:
            continue
        signals = [recording.acceleration]
        if recording.turn_rate is not None and set(TURN) & set(windows.channels):
            signals.append(recording.turn_rate)
        rows.append(np.column_stack(signals).T)
        kept.append(entry)
    if not rows:
        raise RecordingError(f"{dataset.name}: no recording moves for {seconds:g} s")
    samples, windows = np.stack(rows), windows._replace(n_samples=rows[0].shape[1])
    graph = _features_model(windows)
    X = {}
    for of_samples, bits in WORDS:
        felt_with = samples if of_samples == 32 else quantised(samples, of_samples, full_scale)
        graph_of_bits = shortened(graph, bits).SerializeToString()
        found = run(graph_of_bits, felt_with.astype(np.float32), SAMPLES, ("features",))["features"]
        X[of_samples, bits] = np.where(np.isfinite(found), found, np.nan).astype(np.float64)
    return Cut(seconds, windows, metadata(kept), X, operations_of(windows))


def _features_model(windows: Windows) -> Any:
    """Return the graph of all features, of any number of windows, in double precision."""
    from onnx import TensorProto

    graph = Graph()
    entry = tensor_of(SAMPLES, TensorProto.FLOAT, "n", len(windows.channels), windows.n_samples)
    graph.add("Identity", add_features(windows, graph, graph.cast(SAMPLES, np.float64)), name="features")
    output = tensor_of("features", TensorProto.DOUBLE, "n", len(windows.plan.columns))
    return graph.model([entry], [output], "features", "")


def operations_of(windows: Windows) -> CostModel:
    """Return what columns cost in operations a window: a part is what the same features need of the graph."""
    from onnx import TensorProto

    graph = Graph()
    tensors, places = features_of(windows, graph, graph.cast(SAMPLES, np.float64))
    entry = tensor_of(SAMPLES, TensorProto.FLOAT, 1, len(windows.channels), windows.n_samples)
    work = work_of(
        graph.model([entry], [tensor_of(t, TensorProto.DOUBLE, 1, "k") for t in tensors], "parts", "")
    )
    users = {tensor: {i} for i, tensor in enumerate(tensors)}
    operations: dict[frozenset[int], float] = {}
    for node, n in reversed(list(zip(work.nodes, work.operations, strict=True))):
        by = frozenset[int]().union(*(users.get(name, ()) for name in node.output))
        operations[by] = operations.get(by, 0.0) + n
        for name in node.input:
            users[name] = users.get(name, set()) | by
    feature_of = dict(
        zip(places, np.repeat(range(len(tensors)), [work.sizes[t] for t in tensors]), strict=True)
    )
    own = [int(feature_of[column]) for column in windows.plan.columns]
    return CostModel(
        columns=windows.plan.columns,
        features=tuple(tensors[i] for i in own),
        parts=tuple(str(sorted(by)) for by in operations),
        ms=np.array(list(operations.values())),
        needs=np.array([[i in by for by in operations] for i in own]),
    )


def decisions_of(windows: Windows, columns: Sequence[str], steps: Sequence[Any]) -> Work:
    """Return the work of the graph from samples to decisions.

    Parameters
    ----------
    windows : Windows
        With a plan of these columns or more.
    columns : sequence of str
        What is computed.
    steps : sequence of estimator
        Fitted on these columns; a classifier last.
    """
    from onnx import TensorProto

    graph, plan = Graph(), windows.plan.restricted_to(columns)
    rows = add_features(windows._replace(plan=plan), graph, graph.cast(SAMPLES, np.float64))
    described = [part for step in steps[:-1] for part in described_steps(step)]
    for part in (*described, described_classifier(steps[-1])):
        rows = add_part(part, graph, rows)
    graph.add("Identity", rows, name="decisions")
    entry = tensor_of(SAMPLES, TensorProto.FLOAT, 1, len(windows.channels), windows.n_samples)
    output = tensor_of("decisions", TensorProto.DOUBLE, 1, len(steps[-1].classes_))
    return work_of(graph.model([entry], [output], "decisions", ""))


def in_bits(classifier: Any, bits: int) -> Any:
    """Return a fitted linear classifier or network with weights of so many bits."""
    found = copy(classifier)
    if (weights := getattr(classifier, "coef_", None)) is not None:
        found.coef_ = _kept(weights, bits)
    if (layers := getattr(classifier, "coefs_", None)) is not None:
        found.coefs_ = [_kept(weights, bits) for weights in layers]
    return found


def _kept(weights: Samples, bits: int) -> Samples:
    return rounded(weights, bits) if weights.size >= LARGE else weights
