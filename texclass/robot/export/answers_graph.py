"""ONNX graph of a trained model, from features to label, probabilities, p-value and verdict.

The graphs of steps and classifiers are built from their array form (`texclass.recognition.array_form`).
Estimators of scikit-learn without an array form are converted by skl2onnx.
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
"""Label of a row with an infinite feature, or with an undefined feature that no step imputes."""
DOC = """\
Surface classification of features with a texclass model.

Input: features, float64 (n, n_columns), one row per window or recording. texclass.columns contains the names
of the columns in order; NaN marks undefined features. Outputs: label, string (n,), the most probable surface;
probabilities, float64 (n, n_surfaces), calibrated, in the order of texclass.surfaces; p_known, float64 (n,),
conformal p-value of "the surface is one of these"; unknown, bool (n,), p_known <= texclass.false_alarms, or
all features are undefined. A row with infinite features, or with undefined features that are not imputed, has
the label "", NaN as probabilities and p_known, and is unknown. The program must compute the features;
texclass.self_check contains rows with their answers.
"""


def build(model: Model) -> Any:
    """Convert a trained model to an ONNX model, without metadata.

    Parameters
    ----------
    model : Model
        Trained model.

    Returns
    -------
    onnx.ModelProto
        Model with the input "features" and the outputs named in `OUTPUTS`.

    Raises
    ------
    OnnxExportError
        If a step or the classifier cannot be exported.
    """
    graph = Graph()
    outputs = add_answers(model, Tensor(graph, FEATURES))
    entry = tensor_of(FEATURES, np.float64, "n", len(model.columns))
    return graph.model([entry], outputs, "surfaces", DOC)


def add_answers(model: Model, features: Tensor, is_invalid: Tensor | None = None) -> list[Any]:
    """Add nodes for the answers of a model to a graph, and return the descriptions of its outputs.

    Parameters
    ----------
    model : Model
        Trained model.
    features : Tensor
        Features (n, n_columns) in double precision, in the order of the model's columns.
    is_invalid : Tensor, optional
        Mask (n,) of rows without a defined answer, in addition to rows with undefined features.

    Raises
    ------
    OnnxExportError
        If a step or the classifier cannot be exported.
    """
    graph, prepared = features.graph, features
    for part in model.steps:
        prepared = add_part(part, prepared)
    decisions = add_part(model.classifier, prepared)
    # (1 - lapse) softmax(beta s) + lapse / K. Beta is an array, because onnxruntime stores a scalar factor
    # next to a matrix product in single precision: see Graph.model.
    n, calibration = len(model.surfaces), model.calibration
    p = graph.add("Softmax", decisions * np.full(n, calibration.beta), axis=1)
    p = p * (1 - calibration.lapse) + calibration.lapse / n
    undefined = _reduce_rows("ReduceMax", graph.add("IsNaN", prepared) | graph.add("IsInf", prepared))
    if is_invalid is not None:
        undefined = undefined | is_invalid
    best = graph.add("ArgMax", p, axis=1, keepdims=0)
    names = graph.add("Gather", np.array(model.surfaces, dtype=object), best)
    graph.add("Where", undefined, np.array(UNDEFINED, dtype=object), names, name="label")
    graph.add("Where", undefined.unsqueeze(), np.nan, p, name="probabilities")
    # p = (1 + #{held-out scores >= score}) / (n + 1); the surface is unknown if p <= false_alarms
    novelty, distance = model.novelty, model.novelty.class_distance
    if novelty.kind == "decision" or distance is None:
        score = -decisions.reduced("ReduceMax", 1, keepdims=False)
    else:
        squares = _squares((prepared - distance.mean) @ distance.projection, distance.class_means)
        score = squares.reduced("ReduceMin", 1, keepdims=False)
    is_higher = (score.unsqueeze() <= novelty.held_out[None]).cast(np.float64)
    p_known = (is_higher.reduced("ReduceSum", 1, keepdims=False) + 1.0) / float(len(novelty.held_out) + 1)
    is_small = p_known <= novelty.false_alarms
    has_no_feature = _reduce_rows("ReduceMin", graph.add("IsNaN", features))
    graph.add("Where", undefined, np.nan, p_known, name="p_known")
    graph.add("Or", is_small | has_no_feature, undefined, name="unknown")
    return [
        tensor_of("label", object, "n"),
        tensor_of("probabilities", np.float64, "n", len(model.surfaces)),
        tensor_of("p_known", np.float64, "n"),
        tensor_of("unknown", np.bool_, "n"),
    ]


def _reduce_rows(reduction: str, condition: Tensor) -> Tensor:
    """Add a test whether any ("ReduceMax") or all ("ReduceMin") elements of each row are true, shape (n,)."""
    return condition.cast(np.float64).reduced(reduction, 1, keepdims=False).cast(np.bool_)


def add_part(part: ArrayStep, rows: Tensor) -> Tensor:
    """Add a step or classifier to a graph.

    Parameters
    ----------
    part : mapping
        Array form of the step or classifier; see `texclass.recognition.array_form`.
    rows : Tensor
        Rows (n, n_features_in) in double precision.

    Returns
    -------
    Tensor
        Transformed rows, or decisions of shape (n, n_classes), in double precision.

    Raises
    ------
    OnnxExportError
        If the step or classifier cannot be exported.
    """
    parameters = {name: value for name, value in part.items() if name != "operation"}
    return BUILDERS[part["operation"]](rows, **parameters)


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
    """Add nodes that compute K alpha, where alpha are the dual coefficients.

    K is the kernel between rows and prototypes, averaged over the views. The prototypes are stored only once:
    with a = z W and b = Z W in each view, a b' is (z W W') Z'.
    """
    graph = rows.graph
    # Standardised prototypes of the first view, exactly if they were stored with 16 bits.
    standardised = prototypes[0] / views[0]["weights"]
    rounded = standardised.astype(np.float16).astype(np.float64)
    standardised = rounded if np.array_equal(rounded * views[0]["weights"], prototypes[0]) else standardised
    samples, kernels = graph.short(np.ascontiguousarray(standardised.T)), []
    product = "MatMul" if standardised.shape[1] > 1 else "Mul"  # see Graph.model
    for view, b in zip(views, prototypes, strict=True):
        z = (rows - view["mean"]) / view["scale"]
        if view["weights"].ndim == 1:
            a = z * view["weights"]
            minus_2_a_W = a * (-2 * view["weights"])
        else:
            weights = graph.short(view["weights"])
            a = graph.add(product, z, weights)
            minus_2_a_W = graph.add(product, a, graph.add("Transpose", weights * -2.0))
        # (1 + s) exp(-s), s = sqrt(3) |a - b| / length, with |a - b|^2 = |a|^2 - 2 a b + |b|^2
        squares = graph.add(product, minus_2_a_W, samples) + a.reduced("ReduceSumSquare", 1)
        squares = squares + np.einsum("ij,ij->i", b, b)
        s = (graph.add("Max", squares, 0.0) * (3 / length**2)).sqrt()
        kernels.append((s + 1.0) * graph.add("Exp", -s))
    return graph.add("Sum", *kernels) @ graph.short(dual / len(kernels))


def _gauss(rows: Tensor, mean: Samples, variance: Samples, prior: Samples, is_averaged: bool) -> Tensor:
    """Add decisions from the posteriors of Gaussian classes, via the sum of (x - mean)^2 / variance."""
    level = np.log(prior) - 0.5 * np.log(2 * np.pi * variance).sum(axis=1)
    joint = level - _squares(rows, mean, np.sqrt(0.5 / variance))
    return _as_decisions(rows.graph.add("Softmax", joint, axis=1), len(prior), is_averaged)


def _centroids(rows: Tensor, points: Samples, scale: Samples, prior: Samples) -> Tensor:
    """Add the decisions of a nearest-centroid classifier, -|x/s - c/s|^2 + 2 log prior."""
    scores: Tensor = 2 * np.log(prior) - _squares(rows / scale, points / scale)
    if len(points) > 2:
        return scores
    first, second = (scores.take(along(k)) for k in (0, 1))
    return _both(second - first)


def _neighbours(
    rows: Tensor, points: Samples, classes: NDArray[Any], n: int, n_classes: int, is_averaged: bool
) -> Tensor:
    """Add the fractions of the classes among the nearest points, which have the smallest |b|^2 - 2 a b."""
    products = rows @ np.ascontiguousarray(-2 * points.T)
    nearness = -(products + np.einsum("ij,ij->i", points, points))
    nearest = rows.graph.largest(nearness, n, axis=1, largest=1, sorted=1)[1]
    one_hot = rows.graph.add("Gather", np.eye(n_classes)[classes], nearest, axis=0)
    return _as_decisions(one_hot.reduced("ReduceMean", 1, keepdims=False), n_classes, is_averaged)


def _vote(
    rows: Tensor, columns: NDArray[Any], segment: ArrayStep, whole: ArrayStep | None, whole_weight: float
) -> Tensor:
    """Add the mean decision over the segments, combined with the decision for the whole movement.

    If all segments have equal features, only one of them is evaluated.
    """
    n_segments = 1 if rows.graph.has_equal_segments else columns.shape[1]
    votes = [add_part(segment, rows.take(columns[:, i])) for i in range(n_segments)]
    mean = rows.graph.add("Sum", *votes) / len(votes)
    if whole is None:
        return mean
    # (mean + w whole) / (1 + w), without a scalar factor next to the matrix product in `whole`: see
    # Graph.model
    return (mean / whole_weight + add_part(whole, rows)) / (1 / whole_weight + 1)


def _chain(rows: Tensor, steps: Sequence[ArrayStep], classifier: ArrayStep) -> Tensor:
    for part in (*steps, classifier):
        rows = add_part(part, rows)
    return rows


def _estimator(rows: Tensor, estimator: Any, is_averaged: bool | None = None) -> Tensor:
    """Add an estimator that has no array form, converted by skl2onnx."""
    if is_averaged is None:
        if isinstance(estimator, SimpleImputer):
            raise OnnxExportError(
                f"cannot export {_class_name(estimator)}: add_indicator must be False and missing_values "
                f"NaN, got {estimator.add_indicator} and {estimator.missing_values}"
            )
        return _convert(estimator, rows)
    n_classes = len(estimator.classes_)
    if hasattr(estimator, "decision_function"):
        decision = {"raw_scores": True}
        scores = _convert(estimator, rows, {"zipmap": False, **decision}, decision)
        return scores if n_classes > 2 else _both(scores)
    if not hasattr(estimator, "predict_proba"):
        raise OnnxExportError(
            f"cannot export {_class_name(estimator)}: it predicts labels only. Expected a classifier with "
            "decision_function or predict_proba"
        )
    return _as_decisions(_convert(estimator, rows, {"zipmap": False}), n_classes, is_averaged)


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
    "estimator": _estimator,
}
"""Operation of an array form -> function that adds it to a graph; see `texclass.recognition.array_form`."""


def _as_decisions(p: Tensor, n_classes: int, is_averaged: bool) -> Tensor:
    """Add decisions derived from probabilities: their logarithms, or themselves if a vote averages them."""
    if not is_averaged:
        return p.graph.add("Log", p.graph.add("Max", p, MIN_PROBABILITY))
    return _both(p - 0.5) if n_classes == 2 else p


def _squares(rows: Tensor, points: Samples, weight: Samples | None = None) -> Tensor:
    """Add the squared distances between rows (n, p) and points (m, p), shape (n, m)."""
    differences = rows.unsqueeze() - points[None]
    if weight is not None:
        differences = differences * weight[None]
    return differences.reduced("ReduceSumSquare", 2, keepdims=False)


def _both(decision: Tensor) -> Tensor:
    """Add the decisions for both of two classes: the negated last column, and the last column."""
    second = decision.take(along(-1))
    return decision.graph.concatenate(-second, second)


def _convert(part: Any, rows: Tensor, *choices: dict[str, bool]) -> Tensor:
    """Convert an estimator with skl2onnx, with the first accepted options, and add it to the graph.

    Returns the last output of the estimator.
    """
    from onnx.utils import Extractor
    from skl2onnx import to_onnx
    from skl2onnx.common.data_types import DoubleTensorType

    entry = [("rows", DoubleTensorType([None, part.n_features_in_]))]
    problem: Exception | None = None
    for options in choices or ({},):
        part_options = {id(part): options} if options else None
        try:
            with warnings.catch_warnings():  # skl2onnx reads deprecated attributes
                warnings.filterwarnings("ignore", "Attribute `.+` was deprecated", FutureWarning)
                model = to_onnx(part, initial_types=entry, options=part_options, target_opset=dict(OPSETS))
        except Exception as error:  # converters for other versions of scikit-learn raise many kinds of errors
            problem = problem or error
        else:
            last = model.graph.output[-1].name
            return rows.graph.embed(Extractor(model).extract_model(["rows"], [last]), rows)
    reason = str(problem).strip().partition("\n")[0]
    raise OnnxExportError(
        f"cannot export {_class_name(part)} to ONNX ({reason}). Expected an estimator of a shipped "
        "pipeline, or one that skl2onnx converts"
    ) from problem


def _class_name(part: Any) -> str:
    return f"{type(part).__module__}.{type(part).__qualname__}"
