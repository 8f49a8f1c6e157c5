"""A trained model as an ONNX graph: features in; label, probabilities, p-value and verdict out.

skl2onnx converts the steps and classifiers of scikit-learn, but for the nearest centroid. It knows nothing of
our classifiers and selectors, and onnxruntime has no imputer for double precision: these are built here.
"""

import warnings
from collections.abc import Callable, Hashable, Mapping
from functools import singledispatch
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from sklearn.feature_selection import SelectorMixin
from sklearn.impute import SimpleImputer
from sklearn.neighbors import NearestCentroid
from sklearn.pipeline import Pipeline

from texclass.experiment.kernel_discriminant import KernelDiscriminant
from texclass.experiment.vote_of_pieces import VoteOfPieces
from texclass.recognition.model import Model
from texclass.recognition.probabilities import LEAST_PROBABILITY
from texclass.recording import Samples

OPSETS: Mapping[str, int] = {"": 18, "ai.onnx.ml": 3}
"""Versions of the operators, old enough for onnxruntime 1.15 (2023): robots rarely have the latest."""
IR_VERSION = 8
"""Of the file format; belongs to opset 18."""
FEATURES = "features"
OUTPUTS = ("label", "probabilities", "p_known", "unknown")
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

    def cut(self, operand: str, start: int, stop: int, axis: int = -1) -> str:
        """Add the elements [start, stop) along an axis."""
        return self.add("Slice", operand, along(start), along(stop), along(axis))

    def reshape(self, operand: str, *shape: int) -> str:
        """Add a reshape; 0 keeps the length of an axis, -1 is what is left."""
        return self.add("Reshape", operand, along(*shape))

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
    for _, step in model.recogniser.steps[1:-1]:
        prepared = add_step(step, graph, prepared)
    decisions = add_class_scores(model.recogniser[-1], graph, prepared)
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
        squares = _squared_distances(seen, near.means, graph)
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
    return _converted(step, graph, rows)


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
            f"{_class_name(step)} has add_indicator = {step.add_indicator}, missing_values = "
            f"{step.missing_values}; the rule is False and NaN"
        )
    filling = np.asarray(step.statistics_, dtype=np.float64)
    if not step.keep_empty_features:
        kept = np.flatnonzero(~np.isnan(filling))
        rows, filling = graph.add("Gather", rows, kept, axis=1), filling[kept]
    return graph.add("Where", graph.add("IsNaN", rows), filling, rows)


def add_class_scores(classifier: Any, graph: Graph, rows: str) -> str:
    """Add what `class_scores` gives, shape (n, n_classes), double.

    Parameters
    ----------
    classifier : classifier
        Fitted.
    graph : Graph
        Grows.
    rows : str
        Tensor of prepared features, (n, n_features), double.

    Raises
    ------
    OnnxExportError
        If it has no export, or neither decisions nor probabilities.
    """
    if hasattr(classifier, "decision_function"):
        return add_decision(classifier, graph, rows)
    p = _probabilities(classifier, graph, rows)
    return graph.add("Log", graph.add("Max", p, LEAST_PROBABILITY))


@singledispatch
def add_decision(classifier: Any, graph: Graph, rows: str) -> str:
    """Add a `decision_function`, one column a class: of two classes minus the decision, and the decision."""
    decision = {"raw_scores": True}
    scores = _converted(classifier, graph, rows, {"zipmap": False, **decision}, decision)
    return _both(scores, len(classifier.classes_), graph)


@add_decision.register
def _(classifier: Pipeline, graph: Graph, rows: str) -> str:
    return add_decision(classifier[-1], graph, add_step(classifier[:-1], graph, rows))


@add_decision.register
def _(classifier: NearestCentroid, graph: Graph, rows: str) -> str:
    """Add -|x/s - c/s|^2 + 2 log prior, s the deviation within classes where it is not 0."""
    scale = np.where(classifier.within_class_std_dev_ != 0, classifier.within_class_std_dev_, 1.0)
    squares = _squared_distances(graph.add("Div", rows, scale), classifier.centroids_ / scale, graph)
    scores = graph.add("Sub", 2 * np.log(classifier.class_prior_), squares)
    if len(classifier.classes_) > 2:
        return scores
    first, second = (graph.add("Gather", scores, along(k), axis=1) for k in (0, 1))
    return _both(graph.add("Sub", second, first), 2, graph)


@add_decision.register
def _(classifier: KernelDiscriminant, graph: Graph, rows: str) -> str:
    """Add K alpha, K the mean over the views of the kernels between rows and prototypes."""
    kernels = []
    for view, prototypes in zip(classifier.views_, classifier.prototypes_, strict=True):
        Z = graph.add("Div", graph.add("Sub", rows, view.mean), view.scale)
        seen = graph.add("Mul" if view.weights.ndim == 1 else "MatMul", Z, view.weights)
        # (1 + s) exp(-s), s = sqrt(3) |a - b| / length, with |a - b|^2 = |a|^2 - 2 a b + |b|^2
        products = graph.add("MatMul", seen, np.ascontiguousarray(-2 * prototypes.T))
        squares = graph.add("Add", products, graph.add("ReduceSumSquare", seen, along(1), keepdims=1))
        squares = graph.add("Add", squares, np.einsum("ij,ij->i", prototypes, prototypes))
        s = graph.add("Sqrt", graph.add("Mul", graph.add("Max", squares, 0.0), 3 / classifier.length**2))
        kernels.append(graph.add("Mul", graph.add("Add", s, 1.0), graph.add("Exp", graph.add("Neg", s))))
    scores = graph.add("MatMul", graph.add("Sum", *kernels), classifier.dual_ / len(kernels))
    return _both(scores, len(classifier.classes_), graph)


@add_decision.register
def _(classifier: VoteOfPieces, graph: Graph, rows: str) -> str:
    """Add the mean over the pieces, then that and the whole.

    Pieces that are all the same need no rule of their own: their mean is their decision.
    """
    n = classifier.n_pieces
    n_columns = classifier.n_features_in_
    votes = [
        _vote(classifier.estimator_, graph, graph.add("Gather", rows, np.arange(i, n_columns, n), axis=1))
        for i in range(1 if graph.same_pieces else n)
    ]
    mean = graph.add("Div", graph.add("Sum", *votes), len(votes))
    if classifier.whole_ is None:
        return mean
    weight = np.full(len(classifier.classes_), classifier.whole_weight)
    whole = graph.add("Mul", _vote(classifier.whole_, graph, rows), weight)
    return graph.add("Div", graph.add("Add", mean, whole), 1 + classifier.whole_weight)


def _squared_distances(rows: str, points: Samples, graph: Graph) -> str:
    """Add |x_i - c_j|^2 of rows (n, p) and points (m, p), shape (n, m), from the differences themselves."""
    apart = graph.add("Sub", graph.add("Unsqueeze", rows, along(1)), points[None])
    return graph.add("ReduceSumSquare", apart, along(2), keepdims=0)


def _vote(voter: Any, graph: Graph, rows: str) -> str:
    """Add the decisions of a voter, or its probabilities where it has no other; of two classes, about 0."""
    if hasattr(voter, "decision_function"):
        return add_decision(voter, graph, rows)
    p = _probabilities(voter, graph, rows)
    return _both(graph.add("Sub", p, 0.5), 2, graph) if len(voter.classes_) == 2 else p


def _probabilities(classifier: Any, graph: Graph, rows: str) -> str:
    if not hasattr(classifier, "predict_proba"):
        raise OnnxExportError(
            f"{_class_name(classifier)} as it is set has answers alone; "
            "the rule is a classifier with decisions or probabilities"
        )
    if isinstance(classifier, Pipeline):
        return _probabilities(classifier[-1], graph, add_step(classifier[:-1], graph, rows))
    return _converted(classifier, graph, rows, {"zipmap": False})


def _both(decision: str, n_classes: int, graph: Graph) -> str:
    """Return a decision of more than two classes as it is; of two, minus its last column, and that column."""
    if n_classes > 2:
        return decision
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
