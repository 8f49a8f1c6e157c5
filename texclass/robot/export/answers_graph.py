"""A trained model as an ONNX graph: features in; label, probabilities, p-value and verdict out.

Steps and classifiers are built from their array form (`texclass.recognition.array_form`); skl2onnx converts
estimators of scikit-learn that have none.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.impute import SimpleImputer

from texclass.recognition.array_form import ArrayStep
from texclass.recognition.model import Model
from texclass.recognition.probabilities import MIN_PROBABILITY
from texclass.recording import Samples
from texclass.robot.export.graph import OPSETS, Graph, OnnxExportError, Tensor, along, tensor_of

FEATURES = "features"
OUTPUTS: tuple[str, ...] = ("label", "probabilities", "p_known", "unknown")
UNDEFINED = ""
"""Label of a row that has an infinite feature, or an undefined one that no step fills."""
DOC = """\
Which surface is this: the part of a texclass model that follows the features.

Input: features, float64 (n, n_columns), a row a touch or recording; texclass.columns names the columns in
order; NaN where a feature is undefined.
Outputs: label, string (n,), the likeliest surface; probabilities, float64 (n, n_surfaces), calibrated, in
the order of texclass.surfaces; p_known, float64 (n,), conformal p-value of "this surface is one of them";
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
    graph = Graph()
    outputs = add_answers(model, Tensor(graph, FEATURES))
    entry = tensor_of(FEATURES, np.float64, "n", len(model.columns))
    return graph.model([entry], outputs, "surfaces", DOC)


def add_answers(model: Model, features: Tensor, silent: Tensor | None = None) -> list[Any]:
    """Add what a model says of rows of features, and return the descriptions of `OUTPUTS`.

    Parameters
    ----------
    model : Model
        What is exported.
    features : Tensor
        Of shape (n, n_columns), double, in the order of the model's columns.
    silent : Tensor, optional
        Of shape (n,), bool: rows of which nothing is said, whatever their features are.

    Raises
    ------
    OnnxExportError
        If a step or the classifier has no export.
    """
    graph, prepared = features.graph, features
    for part in model.steps:
        prepared = add_part(part, prepared)
    decisions = add_part(model.classifier, prepared)
    # (1 - lapse) softmax(beta s) + lapse / K; a scalar beta would lose digits as single columns do
    n, calibration = len(model.surfaces), model.calibration
    p = graph.add("Softmax", decisions * np.full(n, calibration.beta), axis=1)
    p = p * (1 - calibration.lapse) + calibration.lapse / n
    undefined = _of_rows("ReduceMax", graph.add("IsNaN", prepared) | graph.add("IsInf", prepared))
    if silent is not None:
        undefined = undefined | silent
    best = graph.add("ArgMax", p, axis=1, keepdims=0)
    names = graph.add("Gather", np.array(model.surfaces, dtype=object), best)
    graph.add("Where", undefined, np.array(UNDEFINED, dtype=object), names, name="label")
    graph.add("Where", undefined.unsqueeze(), np.nan, p, name="probabilities")
    # p = (1 + #{held-out scores >= score}) / (n + 1), and whether false alarms may have it as small
    novelty, distance = model.novelty, model.novelty.class_distance
    if novelty.kind == "decision" or distance is None:
        strange = -decisions.reduced("ReduceMax", 1, keepdims=False)
    else:
        squares = _squares((prepared - distance.mean) @ distance.projection, distance.class_means)
        strange = squares.reduced("ReduceMin", 1, keepdims=False)
    at_least = (strange.unsqueeze() <= novelty.held_out[None]).cast(np.float64)
    p_known = (at_least.reduced("ReduceSum", 1, keepdims=False) + 1.0) / float(len(novelty.held_out) + 1)
    small = p_known <= novelty.false_alarms
    empty = _of_rows("ReduceMin", graph.add("IsNaN", features))
    graph.add("Where", undefined, np.nan, p_known, name="p_known")
    graph.add("Or", small | empty, undefined, name="unknown")
    return [
        tensor_of("label", object, "n"),
        tensor_of("probabilities", np.float64, "n", len(model.surfaces)),
        tensor_of("p_known", np.float64, "n"),
        tensor_of("unknown", np.bool_, "n"),
    ]


def _of_rows(reduction: str, truths: Tensor) -> Tensor:
    """Add whether any ("ReduceMax") or all ("ReduceMin") of each row is true, shape (n,)."""
    return truths.cast(np.float64).reduced(reduction, 1, keepdims=False).cast(np.bool_)


def add_part(part: ArrayStep, rows: Tensor) -> Tensor:
    """Add a step of a recogniser, or what decides, to a graph.

    Parameters
    ----------
    part : mapping
        As `texclass.recognition.array_form` describes it.
    rows : Tensor
        Of shape (n, n_features_in), double.

    Returns
    -------
    Tensor
        What it makes of them, double: rows, or decisions of shape (n, n_classes).

    Raises
    ------
    OnnxExportError
        If it has no export.
    """
    held = {name: value for name, value in part.items() if name != "operation"}
    return BUILDERS[part["operation"]](rows, **held)


def _standardise(rows: Tensor, center: Samples | float, scale: Samples | float) -> Tensor:
    centered = rows - center if np.ndim(center) else rows
    return centered / scale if np.ndim(scale) else centered


def _clip(rows: Tensor, low: Samples | float, high: Samples | float) -> Tensor:
    if np.ndim(low) == 0:
        return rows.graph.add("Clip", rows, float(low), float(high))
    return rows.graph.add("Min", rows.graph.add("Max", rows, low), high)


def _kernel(
    rows: Tensor,
    views: Sequence[Mapping[str, Samples]],
    prototypes: Sequence[Samples],
    dual: Samples,
    length: float,
) -> Tensor:
    """Add K alpha, K the mean over the views of the kernels between rows and prototypes.

    Prototypes are kept once: with a = z W and b = Z W in each view, a b' is (z W W') Z'.
    """
    graph = rows.graph
    # The standardised samples of the first view; those of 16 bits exactly.
    standardised = prototypes[0] / views[0]["weights"]
    kept = standardised.astype(np.float16).astype(np.float64)
    standardised = kept if np.array_equal(kept * views[0]["weights"], prototypes[0]) else standardised
    samples, kernels = graph.short(np.ascontiguousarray(standardised.T)), []
    product = "MatMul" if standardised.shape[1] > 1 else "Mul"  # see Graph.model
    for view, known in zip(views, prototypes, strict=True):
        z = (rows - view["mean"]) / view["scale"]
        if view["weights"].ndim == 1:
            seen = z * view["weights"]
            back = seen * (-2 * view["weights"])
        else:
            weights = graph.short(view["weights"])
            seen = graph.add(product, z, weights)
            back = graph.add(product, seen, graph.add("Transpose", weights * -2.0))
        # (1 + s) exp(-s), s = sqrt(3) |a - b| / length, with |a - b|^2 = |a|^2 - 2 a b + |b|^2
        squares = graph.add(product, back, samples) + seen.reduced("ReduceSumSquare", 1)
        squares = squares + np.einsum("ij,ij->i", known, known)
        s = (graph.add("Max", squares, 0.0) * (3 / length**2)).sqrt()
        kernels.append((s + 1.0) * graph.add("Exp", -s))
    return graph.add("Sum", *kernels) @ graph.short(dual / len(kernels))


def _gauss(rows: Tensor, mean: Samples, variance: Samples, prior: Samples, is_averaged: bool) -> Tensor:
    """Add log posteriors, from sum (x - mean)^2 / variance."""
    level = np.log(prior) - 0.5 * np.log(2 * np.pi * variance).sum(axis=1)
    joint = level - _squares(rows, mean, np.sqrt(0.5 / variance))
    return _as_decisions(rows.graph.add("Softmax", joint, axis=1), len(prior), is_averaged)


def _centroids(rows: Tensor, points: Samples, scale: Samples, prior: Samples) -> Tensor:
    """Add -|x/s - c/s|^2 + 2 log prior."""
    scores: Tensor = 2 * np.log(prior) - _squares(rows / scale, points / scale)
    if len(points) > 2:
        return scores
    first, second = (scores.take(along(k)) for k in (0, 1))
    return _both(second - first)


def _neighbours(
    rows: Tensor, points: Samples, classes: NDArray[Any], n: int, n_classes: int, is_averaged: bool
) -> Tensor:
    """Add the shares of the nearest points: those with the smallest |b|^2 - 2 a b."""
    products = rows @ np.ascontiguousarray(-2 * points.T)
    nearness = -(products + np.einsum("ij,ij->i", points, points))
    nearest = rows.graph.largest(nearness, n, axis=1, largest=1, sorted=1)[1]
    right = rows.graph.add("Gather", np.eye(n_classes)[classes], nearest, axis=0)
    return _as_decisions(right.reduced("ReduceMean", 1, keepdims=False), n_classes, is_averaged)


def _vote(
    rows: Tensor, columns: NDArray[Any], segment: ArrayStep, whole: ArrayStep | None, whole_weight: float
) -> Tensor:
    """Add the mean over the pieces, then that and the whole.

    Pieces that are all the same need no rule of their own: their mean is their decision.
    """
    n_asked = 1 if rows.graph.same_pieces else columns.shape[1]
    votes = [add_part(segment, rows.take(columns[:, i])) for i in range(n_asked)]
    mean = rows.graph.add("Sum", *votes) / len(votes)
    if whole is None:
        return mean
    # (mean + w whole) / (1 + w); a scalar w beside the product in `whole` would lose digits: see Graph.model
    return (mean / whole_weight + add_part(whole, rows)) / (1 / whole_weight + 1)


def _chain(rows: Tensor, steps: Sequence[ArrayStep], classifier: ArrayStep) -> Tensor:
    for part in (*steps, classifier):
        rows = add_part(part, rows)
    return rows


def _ask(rows: Tensor, estimator: Any, is_averaged: bool | None = None) -> Tensor:
    """Add what skl2onnx makes of an estimator that has no array form."""
    if is_averaged is None:
        if isinstance(estimator, SimpleImputer):
            raise OnnxExportError(
                f"{_class_name(estimator)} has add_indicator = {estimator.add_indicator}, missing_values = "
                f"{estimator.missing_values}. Expected False and NaN"
            )
        return _converted(estimator, rows)
    n_classes = len(estimator.classes_)
    if hasattr(estimator, "decision_function"):
        decision = {"raw_scores": True}
        scores = _converted(estimator, rows, {"zipmap": False, **decision}, decision)
        return scores if n_classes > 2 else _both(scores)
    if not hasattr(estimator, "predict_proba"):
        raise OnnxExportError(
            f"{_class_name(estimator)} has labels only, no decisions or probabilities. "
            "Expected a classifier with decisions or probabilities"
        )
    return _as_decisions(_converted(estimator, rows, {"zipmap": False}), n_classes, is_averaged)


BUILDERS: Mapping[str, Callable[..., Tensor]] = {
    "select": lambda rows, columns: rows.take(columns),
    "fill": lambda rows, values: rows.graph.add("Where", rows.graph.add("IsNaN", rows), values, rows),
    "standardise": _standardise,
    "affine": lambda rows, scale, shift: rows * scale + shift,
    "clip": _clip,
    "linear": lambda rows, weights, intercept: rows @ weights + intercept,
    "kernel": _kernel,
    "gauss": _gauss,
    "centroids": _centroids,
    "neighbours": _neighbours,
    "vote": _vote,
    "chain": _chain,
    "estimator": _ask,
}
"""What is done -> what adds it to a graph; see `texclass.recognition.array_form`."""


def _as_decisions(p: Tensor, n_classes: int, is_averaged: bool) -> Tensor:
    """Add probabilities as decisions: logarithms; a voter's as they are, of two classes about 0."""
    if not is_averaged:
        return p.graph.add("Log", p.graph.add("Max", p, MIN_PROBABILITY))
    return _both(p - 0.5) if n_classes == 2 else p


def _squares(rows: Tensor, points: Samples, weight: Samples | None = None) -> Tensor:
    """Add |x_i - c_j|^2 of rows (n, p) and points (m, p), shape (n, m), from the differences themselves."""
    apart = rows.unsqueeze() - points[None]
    if weight is not None:
        apart = apart * weight[None]
    return apart.reduced("ReduceSumSquare", 2, keepdims=False)


def _both(decision: Tensor) -> Tensor:
    """Return a decision between two classes, its last column, as minus it, and it."""
    second = decision.take(along(-1))
    return decision.graph.beside(-second, second)


def _converted(part: Any, rows: Tensor, *choices: dict[str, bool]) -> Tensor:
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
            return rows.graph.embed(Extractor(whole).extract_model(["rows"], [last]), rows)
    said = str(problem).strip().partition("\n")[0]
    raise OnnxExportError(
        f"{_class_name(part)} has no export to ONNX ({said}). "
        "Expected what shipped pipelines name, or what skl2onnx converts"
    ) from problem


def _class_name(part: Any) -> str:
    return f"{type(part).__module__}.{type(part).__qualname__}"
