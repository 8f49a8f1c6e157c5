"""What a small computer needs for a graph, counted, and what graphs with tables of few bits make of windows.

Nothing is guessed: shapes are those that ONNX infers for one window, and where a transform is exported as a
product of matrices the product is counted, not the fast transform that a library of signals would have.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from sklearn.pipeline import make_pipeline

from texclass.experiment.cost import CostModel
from texclass.experiment.feature_table import metadata
from texclass.experiment.windows import touches
from texclass.features.phase_view import TURN
from texclass.loaders.dataset import Dataset, Entry
from texclass.recognition.deployed import described_classifier
from texclass.recognition.export.answers_graph import add_part
from texclass.recognition.export.graph import LARGE, tensor_of
from texclass.recognition.export.parity import run
from texclass.recognition.export.sample_graph import (
    SAMPLES,
    Windows,
    add_features,
    feature_tensors,
    windows_in,
)
from texclass.recognition.holding_out import HoldingOut
from texclass.recording import Recording, RecordingError, Samples
from texclass.tradeoff.curves import degraded, quantised
from texclass.tradeoff.front import Labelled, labelled

SAME_MEMORY = {"Reshape", "Identity", "Unsqueeze", "Squeeze", "Flatten"}
"""Operators that compute and move nothing."""
IN_PLACE = {
    "Abs",
    "Add",
    "Cast",
    "Clip",
    "Div",
    "Exp",
    "Log",
    "Max",
    "Min",
    "Mul",
    "Neg",
    "Relu",
    "Sqrt",
    "Sub",
}
"""Operators whose output may take the place of an operand of its size that is not needed later."""
FLOAT_BYTES = 4
"""Of what is computed: single precision, whatever constants and samples are kept in."""


class Work(NamedTuple):
    """The nodes that run for every window, in order, and what each of them costs.

    Attributes
    ----------
    nodes : list of NodeProto
        All others are computed once, from constants.
    operations : list of int
        Of each node: multiply-adds of matrix products, elements of what else is computed, moved, or summed.
    sizes : mapping
        Tensor -> elements.
    kinds : mapping
        Tensor -> kind of its numbers, as `numpy.dtype.kind` says it: "f" of real ones, "b" of truths.
    inputs, outputs : list of str
        Of the graph.
    """

    nodes: list[Any]
    operations: list[int]
    sizes: dict[str, int]
    kinds: dict[str, str]
    inputs: list[str]
    outputs: list[str]

    def constant_bytes(self, bits: int = 32) -> int:
        """Return the bytes of constants, and of what follows from constants alone and is made once.

        Real ones of `LARGE` elements or more have so many bits, see `shortened`, others 32. Integers, which
        say where to read, have the fewest bytes that hold them.
        """
        made = {name for node in self.nodes for name in node.output} | set(self.inputs)
        # What an index points into is no longer than the longest tensor.
        index = np.min_scalar_type(max(self.sizes.values())).itemsize
        total = 0
        for name in {name for node in self.nodes for name in node.input if name} - made:
            if self.kinds[name] == "f":
                total += self.sizes[name] * (bits if self.sizes[name] >= LARGE else 32) // 8
            else:
                total += self.sizes[name] * index
        return total

    def intermediate_bytes(self, sample_bits: int = 32) -> int:
        """Return the bytes of what is in memory at the same time while a window is computed, at most.

        The window itself is apart; samples of fewer than 32 bits become numbers first, others are read where
        they lie.
        """
        place: dict[str, str] = {}  # tensor -> the one in whose memory it lies
        last: dict[str, int] = {}
        for at, node in enumerate(self.nodes):
            of_reals = {self.kinds[name] for name in (*node.input, *node.output) if name} == {"f"}
            # Doubles are computed in single precision, so that nothing is converted.
            if node.op_type in SAME_MEMORY or (node.op_type == "Cast" and of_reals):
                place[node.output[0]] = place.get(node.input[0], node.input[0])
            last |= {place.get(name, name): at for name in node.input}
        last |= {place.get(name, name): len(self.nodes) for name in self.outputs}

        def size(name: str) -> int:
            return self.sizes[name] * (1 if self.kinds[name] == "b" else FLOAT_BYTES)

        alive = {name: size(name) for name in self.inputs if sample_bits < 32}
        most = sum(alive.values())
        for at, node in enumerate(self.nodes):
            made = {name: size(name) for name in node.output if name and name not in place}
            ended = [name for name in alive if last.get(name, -1) <= at]
            if node.op_type in IN_PLACE and (same := [n for n in ended if alive[n] in made.values()]):
                del alive[same[0]]
            alive |= made
            most = max(most, sum(alive.values()))
            alive = {name: n_bytes for name, n_bytes in alive.items() if last.get(name, -1) > at}
        return most


def work_of(model: Any) -> Work:
    """Return the nodes of an ONNX model that run for every window; all shapes follow from its inputs."""
    from onnx import helper, shape_inference

    graph = shape_inference.infer_shapes(model, data_prop=True).graph
    told = [*graph.input, *graph.value_info, *graph.output]
    shapes = {v.name: [d.dim_value for d in v.type.tensor_type.shape.dim] for v in told}
    types = {v.name: v.type.tensor_type.elem_type for v in told}
    shapes |= {c.name: list(c.dims) for c in graph.initializer}
    types |= {c.name: c.data_type for c in graph.initializer}
    kinds: dict[str, str] = {
        name: helper.tensor_dtype_to_np_dtype(type_).kind for name, type_ in types.items()
    }
    sizes = {name: math.prod(shape) for name, shape in shapes.items()}
    known = {c.name for c in graph.initializer}
    nodes = []
    for node in graph.node:
        if known.issuperset(node.input):
            known |= set(node.output)
        else:
            nodes.append(node)
    operations = [_operations(node, shapes, sizes) for node in nodes]
    names = ([one.name for one in many] for many in (graph.input, graph.output))
    return Work(nodes, operations, sizes, kinds, *names)


def _operations(node: Any, shapes: dict[str, list[int]], sizes: dict[str, int]) -> int:
    output = sizes[node.output[0]]
    if node.op_type in SAME_MEMORY:
        return 0
    if node.op_type in ("MatMul", "Gemm"):
        return output * shapes[node.input[0]][-1]
    if node.op_type.startswith(("Reduce", "Arg")):
        return sizes[node.input[0]]
    if node.op_type == "TopK":  # a sort
        return sizes[node.input[0]] * math.ceil(math.log2(max(2, shapes[node.input[0]][-1])))
    return output


def shortened(model: Any, bits: int = 32) -> Any:
    """Return a model of the standard operators that computes in single precision, its tables in fewer bits.

    Parameters
    ----------
    model : onnx.ModelProto
        In double precision; it is not changed.
    bits : int
        Of each real constant that has `LARGE` elements or more; 32 leaves these in single precision.
    """
    from onnx import ModelProto, TensorProto, numpy_helper

    changed = ModelProto.FromString(model.SerializeToString())
    for constant in changed.graph.initializer:
        if constant.data_type == TensorProto.DOUBLE:
            values = rounded(numpy_helper.to_array(constant), bits)
            constant.CopyFrom(numpy_helper.from_array(values.astype(np.float32), constant.name))
    for node in changed.graph.node:
        for attribute in node.attribute:
            if node.op_type == "Cast" and attribute.i == TensorProto.DOUBLE:
                attribute.i = TensorProto.FLOAT
    for one in (*changed.graph.input, *changed.graph.output):
        if one.type.tensor_type.elem_type == TensorProto.DOUBLE:
            one.type.tensor_type.elem_type = TensorProto.FLOAT
    return changed


def rounded(values: Samples, bits: int) -> Samples:
    """Return values on the levels of so many bits, q round(x / q), q = max |x| / (2^(bits-1) - 1).

    With 32 bits, and where there are fewer than `LARGE` of them, they stay as they are.
    """
    if bits >= 32 or values.size < LARGE or not values.any():
        return values
    step = float(np.abs(values).max()) / (2 ** (bits - 1) - 1)
    return np.asarray(step * np.round(values / step))


Word = tuple[int, int]
WORDS = ((32, 32), (16, 16), (16, 8), (8, 8))
"""Bits of samples, and of tables and weights; 32 are single precision."""


class Cut(NamedTuple):
    """The windows of a dataset at one rate and length.

    Attributes
    ----------
    seconds
        Of a window.
    windows
        What their graph has to know of them.
    tests
        How they are held out.
    X
        Bits of samples and of tables -> their features, as graphs compute them.
    costs
        What columns cost in operations a window.
    """

    seconds: float
    windows: Windows
    tests: HoldingOut
    X: Mapping[Word, Samples]
    costs: CostModel

    @property
    def data(self) -> Labelled:
        """What is learnt from: features of exact samples and tables, with the labels of windows."""
        return labelled(self.X[WORDS[0]], self.tests.table, self.tests.protocol)


def at_rate(dataset: Dataset, fs: float) -> Dataset:
    """Return a dataset at a lower rate (Hz), the same for all recordings, to a sample of their length."""
    lower = degraded(dataset, fs=fs)
    return replace(lower, load=partial(_at_rate, lower.load, fs))


def _at_rate(load: Callable[[Entry], Recording], fs: float, entry: Entry) -> Recording:
    return load(entry).with_(fs=fs)


def cut_of(
    dataset: Dataset, windows: Windows, seconds: float, step: float, full_scale: float, tests: HoldingOut
) -> Cut:
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
    tests : HoldingOut
        How recordings are held out.
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
    x, entry = windows_in(windows, "n")
    x.graph.add("Identity", add_features(windows, x), name="features")
    output = tensor_of("features", np.float64, "n", len(windows.plan.columns))
    graph, X = x.graph.model([entry], [output], "features", ""), {}
    for of_samples, bits in WORDS:
        felt_with = samples if of_samples == 32 else quantised(samples, of_samples, full_scale)
        graph_of_bits = shortened(graph, bits).SerializeToString()
        found = run(graph_of_bits, felt_with.astype(np.float32), SAMPLES, ("features",))["features"]
        X[of_samples, bits] = np.where(np.isfinite(found), found, np.nan).astype(np.float64)
    return Cut(seconds, windows, replace(tests, table=metadata(kept)), X, operations_of(windows))


def operations_of(windows: Windows) -> CostModel:
    """Return what columns cost in operations a window: a part is what the same features need of the graph."""
    x, entry = windows_in(windows, 1)
    found, places = feature_tensors(windows, x)
    tensors = [tensor.name for tensor in found]
    outputs = [tensor_of(name, np.float64, 1, "k") for name in tensors]
    work = work_of(x.graph.model([entry], outputs, "parts", ""))
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
    x, entry = windows_in(windows, 1)
    rows = add_features(windows._replace(plan=windows.plan.restricted_to(columns)), x)
    decisions = add_part(described_classifier(make_pipeline(*steps)), rows)
    x.graph.add("Identity", decisions, name="decisions")
    output = tensor_of("decisions", np.float64, 1, len(steps[-1].classes_))
    return work_of(x.graph.model([entry], [output], "decisions", ""))


def in_bits(classifier: Any, bits: int) -> Any:
    """Return a fitted linear classifier or network with weights of so many bits."""
    found = copy(classifier)
    if (weights := getattr(classifier, "coef_", None)) is not None:
        found.coef_ = rounded(weights, bits)
    if (layers := getattr(classifier, "coefs_", None)) is not None:
        found.coefs_ = [rounded(weights, bits) for weights in layers]
    return found
