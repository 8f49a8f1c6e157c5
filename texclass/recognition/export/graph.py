"""A trained model as an ONNX graph: features in; label, probabilities, p-value and verdict out.

Steps and classifiers are built from what `texclass.recognition.deployed` says that they do; skl2onnx converts
those of scikit-learn that have no such form.
"""

import warnings
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from sklearn.impute import SimpleImputer

from texclass.recognition.deployed import Part
from texclass.recognition.model import Model
from texclass.recognition.probabilities import LEAST_PROBABILITY
from texclass.recording import Samples

OPSETS: Mapping[str, int] = {"": 18, "ai.onnx.ml": 3}
"""Versions of the operators, old enough for onnxruntime 1.15 (2023): robots rarely have the latest."""
IR_VERSION = 8
"""Of the file format; belongs to opset 18."""
FEATURES = "features"
OUTPUTS: tuple[str, ...] = ("label", "probabilities", "p_known", "unknown")
LARGE = 64
"""Elements from which on equal constants are kept once."""
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

Made = TypeVar("Made")
Operand = str | float | NDArray[Any]
"""The name of a tensor, or a constant; numbers in double precision."""


class OnnxExportError(ValueError):
    """A model cannot be exported; the message says what of it, and the rule."""


class Graph:
    """Nodes in the order of their computation; tensors are known by name.

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

    def add(self, operator: str, *operands: Operand, name: str | None = None, **attributes: Any) -> str:
        """Add a node and return the name of its output.

        Parameters
        ----------
        operator : str
            Of the standard operators.
        *operands : str, float or ndarray
            Names of tensors, or constants.
        name : str, optional
            Of the output; a new one by default.
        **attributes
            Of the operator.
        """
        from onnx import helper

        names = [one if isinstance(one, str) else self.constant(one) for one in operands]
        output = name or self._new(operator)
        self.nodes.append(helper.make_node(operator, names, [output], **attributes))
        return output

    def constant(self, value: float | NDArray[Any]) -> str:
        """Add a constant and return its name; a number in double precision."""
        values = value if isinstance(value, np.ndarray) else np.array(value, dtype=np.float64)
        if values.size < LARGE:
            return self._kept(values)
        return self.once((values.dtype, values.shape, values.tobytes()), lambda: self._kept(values))

    def _kept(self, values: NDArray[Any]) -> str:
        from onnx import numpy_helper

        self.constants.append(numpy_helper.from_array(values, self._new("constant")))
        return str(self.constants[-1].name)

    def once(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what `make` adds, which is added the first time a key is asked for."""
        if key not in self._made:
            self._made[key] = make()
        made: Made = self._made[key]
        return made

    def cast(self, operand: str, dtype: type[np.generic]) -> str:
        """Add a conversion to another type of numbers."""
        from onnx import helper

        return self.add("Cast", operand, to=helper.np_dtype_to_tensor_dtype(np.dtype(dtype)))

    def short(self, values: NDArray[np.float64]) -> str:
        """Add a constant in the fewest bits that lose nothing of it, converted to double precision."""
        for dtype in (np.float16, np.float32):
            with np.errstate(over="ignore"):
                kept = values.astype(dtype)
            if np.array_equal(kept, values):
                return self.cast(self.constant(kept), np.float64)
        return self.constant(values)

    def cut(self, operand: str, start: int, stop: int, axis: int = -1) -> str:
        """Add the elements [start, stop) along an axis."""
        return self.add("Slice", operand, along(start), along(stop), along(axis))

    def reshape(self, operand: str, *shape: int) -> str:
        """Add a reshape; 0 keeps the length of an axis, -1 is what is left."""
        return self.add("Reshape", operand, along(*shape))

    def largest(self, operand: str, n: int) -> str:
        """Add where the n largest of each row are, and return the name of the indices, shape (n_rows, n)."""
        from onnx import helper

        names = [self._new("largest"), self._new("indices")]
        self.nodes.append(
            helper.make_node("TopK", [operand, self.constant(along(n))], names, axis=1, largest=1, sorted=1)
        )
        return names[1]

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
        model = helper.make_model(graph, opset_imports=opsets, ir_version=IR_VERSION, doc_string=doc)
        try:
            checker.check_model(model, full_check=True)
        except Exception as error:  # its exceptions have no class in common
            raise OnnxExportError(
                f"the graph is not valid ({error}); the rule is opset {OPSETS['']}"
            ) from error
        return model

    def _new(self, kind: str) -> str:
        self._n_names += 1
        return f"{kind}_{self._n_names}"


def along(*axes: int) -> NDArray[np.int64]:
    """Return axes as reductions take them."""
    return np.array(axes, dtype=np.int64)


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
    from onnx import TensorProto

    graph = Graph()
    outputs = add_answers(model, graph, FEATURES)
    entry = tensor_of(FEATURES, TensorProto.DOUBLE, "n", len(model.columns))
    return graph.model([entry], outputs, "surfaces", DOC)


def tensor_of(name: str, kind: int, *shape: int | str) -> Any:
    """Return the description of an input or output of a graph."""
    from onnx import helper

    return helper.make_tensor_value_info(name, kind, list(shape))


def add_answers(model: Model, graph: Graph, features: str, silent: str | None = None) -> list[Any]:
    """Add what a model says of rows of features, and return the descriptions of `OUTPUTS`.

    Parameters
    ----------
    model : Model
        What is exported.
    graph : Graph
        Grows.
    features : str
        Tensor of shape (n, n_columns), double, in the order of the model's columns.
    silent : str, optional
        Tensor of shape (n,), bool: rows of which nothing is said, whatever their features are.

    Raises
    ------
    OnnxExportError
        If a step or the classifier has no export.
    """
    from onnx import TensorProto

    prepared = features
    for part in model.deployed.steps:
        prepared = add_part(part, graph, prepared)
    decisions = add_part(model.deployed.decide, graph, prepared)
    # (1 - lapse) softmax(beta s) + lapse / K; a scalar beta would lose digits as single columns do
    n, calibration = len(model.materials), model.calibration
    p = graph.add("Softmax", graph.add("Mul", decisions, np.full(n, calibration.beta)), axis=1)
    p = graph.add("Add", graph.add("Mul", p, 1 - calibration.lapse), calibration.lapse / n)
    bad = graph.add("Or", graph.add("IsNaN", prepared), graph.add("IsInf", prepared))
    undefined = of_rows("ReduceMax", bad, graph)
    if silent is not None:
        undefined = graph.add("Or", undefined, silent)
    best = graph.add("ArgMax", p, axis=1, keepdims=0)
    names = graph.add("Gather", np.array(model.materials, dtype=object), best)
    graph.add("Where", undefined, np.array(UNDEFINED, dtype=object), names, name="label")
    graph.add("Where", graph.add("Unsqueeze", undefined, along(1)), np.nan, p, name="probabilities")
    # p = (1 + #{held-out scores >= score}) / (n + 1), and whether false alarms may have it as small
    novelty, near = model.novelty, model.novelty.nearness
    if novelty.kind == "decision" or near is None:
        strange = graph.add("Neg", graph.add("ReduceMax", decisions, along(1), keepdims=0))
    else:
        seen = graph.add("MatMul", graph.add("Sub", prepared, near.mean), near.view)
        squares = _squares(seen, near.means, graph)
        strange = graph.add("ReduceMin", squares, along(1), keepdims=0)
    at_least = graph.add("LessOrEqual", graph.add("Unsqueeze", strange, along(1)), novelty.held_out[None])
    count = graph.add("ReduceSum", graph.cast(at_least, np.float64), along(1), keepdims=0)
    p_known = graph.add("Div", graph.add("Add", count, 1.0), float(len(novelty.held_out) + 1))
    small = graph.add("LessOrEqual", p_known, novelty.false_alarms)
    empty = of_rows("ReduceMin", graph.add("IsNaN", features), graph)
    graph.add("Where", undefined, np.nan, p_known, name="p_known")
    graph.add("Or", graph.add("Or", small, empty), undefined, name="unknown")

    double, boolean, string = TensorProto.DOUBLE, TensorProto.BOOL, TensorProto.STRING
    return [
        tensor_of("label", string, "n"),
        tensor_of("probabilities", double, "n", len(model.materials)),
        tensor_of("p_known", double, "n"),
        tensor_of("unknown", boolean, "n"),
    ]


def of_rows(reduction: str, truths: str, graph: Graph) -> str:
    """Add whether any ("ReduceMax") or all ("ReduceMin") of each row is true, shape (n,)."""
    found = graph.add(reduction, graph.cast(truths, np.float64), along(1), keepdims=0)
    return graph.cast(found, np.bool_)


def add_part(part: Part, graph: Graph, rows: str) -> str:
    """Add a step of a recogniser, or what decides, to a graph.

    Parameters
    ----------
    part : mapping
        As `texclass.recognition.deployed` describes it.
    graph : Graph
        Grows.
    rows : str
        Tensor of shape (n, n_features_in), double.

    Returns
    -------
    str
        Name of the tensor it makes of them, double: rows, or decisions of shape (n, n_classes).

    Raises
    ------
    OnnxExportError
        If it has no export.
    """
    held = {name: value for name, value in part.items() if name != "does"}
    return BUILDERS[part["does"]](graph, rows, **held)


def _standardise(graph: Graph, rows: str, center: Samples | float, scale: Samples | float) -> str:
    centered = graph.add("Sub", rows, center) if np.ndim(center) else rows
    return graph.add("Div", centered, scale) if np.ndim(scale) else centered


def _clip(graph: Graph, rows: str, low: Samples | float, high: Samples | float) -> str:
    if np.ndim(low) == 0:
        return graph.add("Clip", rows, float(low), float(high))
    return graph.add("Min", graph.add("Max", rows, low), high)


def _kernel(
    graph: Graph,
    rows: str,
    views: Sequence[Mapping[str, Samples]],
    prototypes: Sequence[Samples],
    dual: Samples,
    length: float,
) -> str:
    """Add K alpha, K the mean over the views of the kernels between rows and prototypes.

    Prototypes are kept once: with a = z W and b = Z W in each view, a b' is (z W W') Z'.
    """
    # The standardised samples of the first view; those of 16 bits exactly.
    standardised = prototypes[0] / views[0]["weights"]
    kept = standardised.astype(np.float16).astype(np.float64)
    standardised = kept if np.array_equal(kept * views[0]["weights"], prototypes[0]) else standardised
    samples, kernels = graph.short(np.ascontiguousarray(standardised.T)), []
    product = "MatMul" if standardised.shape[1] > 1 else "Mul"  # see Graph.model
    for view, known in zip(views, prototypes, strict=True):
        z = graph.add("Div", graph.add("Sub", rows, view["mean"]), view["scale"])
        if view["weights"].ndim == 1:
            seen = graph.add("Mul", z, view["weights"])
            back = graph.add("Mul", seen, -2 * view["weights"])
        else:
            weights = graph.short(view["weights"])
            seen = graph.add(product, z, weights)
            back = graph.add(product, seen, graph.add("Transpose", graph.add("Mul", weights, -2.0)))
        # (1 + s) exp(-s), s = sqrt(3) |a - b| / length, with |a - b|^2 = |a|^2 - 2 a b + |b|^2
        products = graph.add(product, back, samples)
        squares = graph.add("Add", products, graph.add("ReduceSumSquare", seen, along(1), keepdims=1))
        squares = graph.add("Add", squares, np.einsum("ij,ij->i", known, known))
        s = graph.add("Sqrt", graph.add("Mul", graph.add("Max", squares, 0.0), 3 / length**2))
        kernels.append(graph.add("Mul", graph.add("Add", s, 1.0), graph.add("Exp", graph.add("Neg", s))))
    return graph.add("MatMul", graph.add("Sum", *kernels), graph.short(dual / len(kernels)))


def _gauss(graph: Graph, rows: str, mean: Samples, variance: Samples, prior: Samples, votes: bool) -> str:
    """Add log posteriors, from sum (x - mean)^2 / variance."""
    level = np.log(prior) - 0.5 * np.log(2 * np.pi * variance).sum(axis=1)
    joint = graph.add("Sub", level, _squares(rows, mean, graph, np.sqrt(0.5 / variance)))
    return _as_decisions(graph.add("Softmax", joint, axis=1), len(prior), votes, graph)


def _centroids(graph: Graph, rows: str, points: Samples, scale: Samples, prior: Samples) -> str:
    """Add -|x/s - c/s|^2 + 2 log prior."""
    squares = _squares(graph.add("Div", rows, scale), points / scale, graph)
    scores = graph.add("Sub", 2 * np.log(prior), squares)
    if len(points) > 2:
        return scores
    first, second = (graph.add("Gather", scores, along(k), axis=1) for k in (0, 1))
    return _both(graph.add("Sub", second, first), graph)


def _neighbours(
    graph: Graph, rows: str, points: Samples, classes: NDArray[Any], n: int, n_classes: int, votes: bool
) -> str:
    """Add the shares of the nearest points: those with the smallest |b|^2 - 2 a b."""
    products = graph.add("MatMul", rows, np.ascontiguousarray(-2 * points.T))
    nearness = graph.add("Neg", graph.add("Add", products, np.einsum("ij,ij->i", points, points)))
    nearest = graph.largest(nearness, n)
    right = graph.add("Gather", np.eye(n_classes)[classes], nearest, axis=0)
    p = graph.add("ReduceMean", right, along(1), keepdims=0)
    return _as_decisions(p, n_classes, votes, graph)


def _vote(
    graph: Graph,
    rows: str,
    n_pieces: int,
    piece: Part,
    whole: Part | None,
    whole_weight: float,
    n_columns: int,
    n_classes: int,
    divided: NDArray[Any] | None = None,
    seen: NDArray[Any] | None = None,
) -> str:
    """Add the mean over the pieces, then that and the whole.

    Pieces that are all the same need no rule of their own: their mean is their decision.
    """
    columns = np.arange(n_columns) if divided is None else divided
    votes = [
        add_part(piece, graph, graph.add("Gather", rows, columns[i::n_pieces], axis=1))
        for i in range(1 if graph.same_pieces else n_pieces)
    ]
    mean = graph.add("Div", graph.add("Sum", *votes), len(votes))
    if whole is None:
        return mean
    looked_at = rows if seen is None else graph.add("Gather", rows, seen, axis=1)
    beside = graph.add("Mul", add_part(whole, graph, looked_at), np.full(n_classes, whole_weight))
    return graph.add("Div", graph.add("Add", mean, beside), 1 + whole_weight)


def _chain(graph: Graph, rows: str, steps: Sequence[Part], decide: Part) -> str:
    for part in (*steps, decide):
        rows = add_part(part, graph, rows)
    return rows


def _ask(graph: Graph, rows: str, estimator: Any, votes: bool | None = None) -> str:
    """Add what skl2onnx makes of an estimator that has no array form."""
    if votes is None:
        if isinstance(estimator, SimpleImputer):
            raise OnnxExportError(
                f"{_class_name(estimator)} has add_indicator = {estimator.add_indicator}, missing_values = "
                f"{estimator.missing_values}; the rule is False and NaN"
            )
        return _converted(estimator, graph, rows)
    n_classes = len(estimator.classes_)
    if hasattr(estimator, "decision_function"):
        decision = {"raw_scores": True}
        scores = _converted(estimator, graph, rows, {"zipmap": False, **decision}, decision)
        return scores if n_classes > 2 else _both(scores, graph)
    if not hasattr(estimator, "predict_proba"):
        raise OnnxExportError(
            f"{_class_name(estimator)} as it is set has answers alone; "
            "the rule is a classifier with decisions or probabilities"
        )
    return _as_decisions(_converted(estimator, graph, rows, {"zipmap": False}), n_classes, votes, graph)


BUILDERS: Mapping[str, Callable[..., str]] = {
    "take": lambda graph, rows, columns: graph.add("Gather", rows, columns, axis=1),
    "fill": lambda graph, rows, values: graph.add("Where", graph.add("IsNaN", rows), values, rows),
    "standardise": _standardise,
    "affine": lambda graph, rows, scale, shift: graph.add("Add", graph.add("Mul", rows, scale), shift),
    "clip": _clip,
    "linear": lambda graph, rows, weights, intercept: graph.add(
        "Add", graph.add("MatMul", rows, weights), intercept
    ),
    "kernel": _kernel,
    "gauss": _gauss,
    "centroids": _centroids,
    "neighbours": _neighbours,
    "vote": _vote,
    "chain": _chain,
    "ask": _ask,
}
"""What is done -> what adds it to a graph; see `texclass.recognition.deployed`."""


def _as_decisions(p: str, n_classes: int, votes: bool, graph: Graph) -> str:
    """Add probabilities as decisions: logarithms; a voter's as they are, of two classes about 0."""
    if not votes:
        return graph.add("Log", graph.add("Max", p, LEAST_PROBABILITY))
    return _both(graph.add("Sub", p, 0.5), graph) if n_classes == 2 else p


def _squares(rows: str, points: Samples, graph: Graph, weight: Samples | None = None) -> str:
    """Add |x_i - c_j|^2 of rows (n, p) and points (m, p), shape (n, m), from the differences themselves."""
    apart = graph.add("Sub", graph.add("Unsqueeze", rows, along(1)), points[None])
    if weight is not None:
        apart = graph.add("Mul", apart, weight[None])
    return graph.add("ReduceSumSquare", apart, along(2), keepdims=0)


def _both(decision: str, graph: Graph) -> str:
    """Return a decision between two classes, its last column, as minus it, and it."""
    second = graph.add("Gather", decision, along(-1), axis=1)
    return graph.add("Concat", graph.add("Neg", second), second, axis=1)


def _converted(part: Any, graph: Graph, rows: str, *choices: dict[str, bool]) -> str:
    """Add what skl2onnx makes of an estimator, under the first options it knows; return its last output."""
    from onnx.utils import Extractor
    from skl2onnx import to_onnx
    from skl2onnx.common.data_types import DoubleTensorType

    entry = [("rows", DoubleTensorType([None, part.n_features_in_]))]
    problem: Exception | None = None
    for options in choices or ({},):
        chosen = {id(part): options} if options else None
        try:
            with warnings.catch_warnings():  # of fitted attributes that skl2onnx still reads
                warnings.filterwarnings("ignore", "Attribute `.+` was deprecated", FutureWarning)
                whole = to_onnx(part, initial_types=entry, options=chosen, target_opset=dict(OPSETS))
        except Exception as error:  # whatever a converter that was made for another version runs into
            problem = problem or error
        else:
            last = whole.graph.output[-1].name
            return graph.embed(Extractor(whole).extract_model(["rows"], [last]), rows)
    said = str(problem).strip().partition("\n")[0]
    raise OnnxExportError(
        f"{_class_name(part)} has no export to ONNX ({said}); "
        "the rule is what shipped pipelines name, or what skl2onnx converts"
    ) from problem


def _class_name(part: Any) -> str:
    return f"{type(part).__module__}.{type(part).__qualname__}"
