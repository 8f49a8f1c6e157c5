"""Classifiers as nodes of a graph: their decisions, which calibration makes probabilities of.

skl2onnx converts those of scikit-learn but for the nearest centroid; it knows nothing of ours.
"""

from functools import singledispatch
from typing import Any

import numpy as np
from sklearn.neighbors import NearestCentroid
from sklearn.pipeline import Pipeline

from texclass.experiment.kernel_discriminant import KernelDiscriminant, View
from texclass.experiment.vote_of_pieces import VoteOfPieces
from texclass.recognition.onnx_export.converted import class_name, converted_decision, converted_probabilities
from texclass.recognition.onnx_export.graph import Graph, OnnxExportError, along, number, repeated
from texclass.recognition.onnx_export.steps import add_step
from texclass.recording import Samples

LEAST_PROBABILITY = 1e-12
"""Of which `class_scores` still takes the logarithm."""


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
    return graph.add("Log", graph.add("Max", p, number(LEAST_PROBABILITY)))


@singledispatch
def add_decision(classifier: Any, graph: Graph, rows: str) -> str:
    """Add a `decision_function`, one column a class: of two classes minus the decision, and the decision."""
    return _both(converted_decision(classifier, graph, rows), len(classifier.classes_), graph)


@add_decision.register
def _(classifier: Pipeline, graph: Graph, rows: str) -> str:
    return add_decision(classifier[-1], graph, add_step(classifier[:-1], graph, rows))


@add_decision.register
def _(classifier: NearestCentroid, graph: Graph, rows: str) -> str:
    """Add -|x/s - c/s|^2 + 2 log prior, s the deviation within classes where it is not 0."""
    scale = np.where(classifier.within_class_std_dev_ != 0, classifier.within_class_std_dev_, 1.0)
    squares = squared_distances(graph.add("Div", rows, scale), classifier.centroids_ / scale, graph)
    scores = graph.add("Sub", 2 * np.log(classifier.class_prior_), squares)
    if len(classifier.classes_) > 2:
        return scores
    first, second = (graph.add("Gather", scores, along(k), axis=1) for k in (0, 1))
    return _both(graph.add("Sub", second, first), 2, graph)


@add_decision.register
def _(classifier: KernelDiscriminant, graph: Graph, rows: str) -> str:
    """Add K alpha, K the mean over the views of the kernels between rows and prototypes."""
    kernels = [
        _matern(_view(view, graph, rows), prototypes, classifier.length, graph)
        for view, prototypes in zip(classifier.views_, classifier.prototypes_, strict=True)
    ]
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
        for i in range(n)
    ]
    mean = graph.add("Div", graph.add("Sum", *votes), number(n))
    if classifier.whole_ is None:
        return mean
    weight = repeated(classifier.whole_weight, len(classifier.classes_))
    whole = graph.add("Mul", _vote(classifier.whole_, graph, rows), weight)
    return graph.add("Div", graph.add("Add", mean, whole), number(1 + classifier.whole_weight))


def squared_distances(rows: str, points: Samples, graph: Graph) -> str:
    """Add |x_i - c_j|^2 of rows (n, p) and points (m, p), shape (n, m), from the differences themselves."""
    apart = graph.add("Sub", graph.add("Unsqueeze", rows, along(1)), points[None])
    return graph.add("ReduceSumSquare", apart, along(2), keepdims=0)


def _vote(voter: Any, graph: Graph, rows: str) -> str:
    """Add the decisions of a voter, or its probabilities where it has no other; of two classes, about 0."""
    if hasattr(voter, "decision_function"):
        return add_decision(voter, graph, rows)
    p = _probabilities(voter, graph, rows)
    return _both(graph.add("Sub", p, number(0.5)), 2, graph) if len(voter.classes_) == 2 else p


def _probabilities(classifier: Any, graph: Graph, rows: str) -> str:
    if not hasattr(classifier, "predict_proba"):
        raise OnnxExportError(
            f"{class_name(classifier)} as it is set has answers alone; "
            "the rule is a classifier with decisions or probabilities"
        )
    if isinstance(classifier, Pipeline):
        return _probabilities(classifier[-1], graph, add_step(classifier[:-1], graph, rows))
    return converted_probabilities(classifier, graph, rows)


def _both(decision: str, n_classes: int, graph: Graph) -> str:
    """Return a decision of more than two classes as it is; of two, minus its last column, and that column."""
    if n_classes > 2:
        return decision
    second = graph.add("Gather", decision, along(-1), axis=1)
    return graph.add("Concat", graph.add("Neg", second), second, axis=1)


def _view(view: View, graph: Graph, rows: str) -> str:
    Z = graph.add("Div", graph.add("Sub", rows, view.mean), view.scale)
    return graph.add("Mul" if view.weights.ndim == 1 else "MatMul", Z, view.weights)


def _matern(seen: str, prototypes: Samples, length: float, graph: Graph) -> str:
    """Add (1 + s) exp(-s), s = sqrt(3) |a - b| / length, with |a - b|^2 = |a|^2 - 2 a b + |b|^2."""
    products = graph.add("MatMul", seen, np.ascontiguousarray(-2 * prototypes.T))
    squares = graph.add("Add", products, graph.add("ReduceSumSquare", seen, along(1), keepdims=1))
    squares = graph.add("Add", squares, np.einsum("ij,ij->i", prototypes, prototypes))
    squares = graph.add("Max", squares, number(0.0))
    s = graph.add("Sqrt", graph.add("Mul", squares, number(3 / length**2)))
    decay = graph.add("Exp", graph.add("Neg", s))
    return graph.add("Mul", graph.add("Add", s, number(1.0)), decay)
