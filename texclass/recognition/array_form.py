"""Array form of fitted estimators: what a trained model computes after the features, without scikit-learn.

Each transformer or classifier of the shipped pipelines becomes a mapping with the name of an operation
(`does`) and its arrays. Models predict with these mappings and store them in their files, and ONNX graphs are
built from them. An estimator without an array form is stored itself ("ask").
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.classifiers.kernel import View, kernel_scores
from texclass.recognition.probabilities import class_scores, log_of, softmax
from texclass.recording import Samples

Part = Mapping[str, Any]
Columns = NDArray[np.intp]
TrainingSet = tuple[Samples, NDArray[Any]]
"""Prepared rows (n, n_columns) and their labels (n,)."""


def apply(part: Part, X: Samples) -> Samples:
    """Apply a part to rows (n, n_columns): return prepared rows, or decisions (n, n_classes).

    Raises
    ------
    KeyError, TypeError, ValueError
        If the mapping is no valid part.
    """
    arguments = {name: value for name, value in part.items() if name != "does"}
    return OPERATIONS[part["does"]](X, **arguments)


def apply_all(parts: Sequence[Part], X: Samples) -> Samples:
    """Apply several parts to rows, one after the other."""
    for part in parts:
        X = apply(part, X)
    return X


def decide(steps: Sequence[Part], classifier: Part, X: Samples) -> tuple[Samples, Samples]:
    """Return prepared rows (n, n_prepared) and decisions (n, n_classes) for rows of features (n, n_columns).

    Raises
    ------
    ValueError
        If a prepared value is not finite.
    """
    prepared = apply_all(steps, X)
    if not np.isfinite(prepared).all():
        raise ValueError("features are undefined. Expected a pipeline with a step that fills them")
    return prepared, apply(classifier, prepared)


def estimators_in(parts: Any) -> list[Any]:
    """Return the estimators that have no array form, however deep in mappings and sequences."""
    if isinstance(parts, Mapping):
        if "estimator" in parts:
            return [parts["estimator"]]
        parts = list(parts.values())
    return [one for part in parts for one in estimators_in(part)] if isinstance(parts, list | tuple) else []


def steps_of(step: Any) -> list[Part]:  # noqa: PLR0911  (one for each kind)
    """Return the array form of a fitted transformer: steps, one after the other.

    "take" columns; "fill" undefined values; "standardise", (X - center) / scale; "affine", X scale + shift;
    "clip" to low ... high; "ask" an estimator.
    """
    from sklearn.feature_selection import SelectorMixin
    from sklearn.impute import SimpleImputer
    from sklearn.pipeline import Pipeline
    from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, StandardScaler

    match step:
        case None | "passthrough":
            return []
        case Pipeline():
            return [part for _, inner in step.steps for part in steps_of(inner)]
        case SelectorMixin():
            return [{"does": "take", "columns": np.flatnonzero(step.get_support())}]
        case SimpleImputer(add_indicator=False, missing_values=gap) if np.isnan(gap):
            values = np.asarray(step.statistics_, dtype=np.float64)
            if step.keep_empty_features or not np.isnan(values).any():
                return [{"does": "fill", "values": values}]
            kept = np.flatnonzero(~np.isnan(values))
            return [{"does": "take", "columns": kept}, {"does": "fill", "values": values[kept]}]
        case MinMaxScaler():
            low, high = step.feature_range
            clipped = [{"does": "clip", "low": low, "high": high}] * step.clip
            return [{"does": "affine", "scale": step.scale_, "shift": step.min_}, *clipped]
        case StandardScaler():
            return [_standardise(step.mean_ if step.with_mean else None, step.scale_)]
        case RobustScaler():
            return [_standardise(step.center_, step.scale_)]
        case MaxAbsScaler() if not getattr(step, "clip", False):
            return [_standardise(None, step.scale_)]
    return [{"does": "ask", "estimator": step}]


def _standardise(center: Samples | None, scale: Samples | None) -> Part:
    return {
        "does": "standardise",
        "center": 0.0 if center is None else center,
        "scale": 1.0 if scale is None else scale,
    }


def classifier_of(  # noqa: PLR0911
    classifier: Any, training_set: TrainingSet | None = None, *, votes: bool = False
) -> Part:
    """Return the array form of a fitted classifier, whose decisions are those of `class_scores`.

    "linear", X weights + intercept; "kernel", the mean of Matern kernels between rows and prototypes in each
    view, times dual; "gauss", log posteriors; "centroids", and "neighbours", the shares of the nearest;
    "vote" of pieces of the columns; "chain" of steps and what decides after them; "ask" an estimator.

    Parameters
    ----------
    classifier : classifier
        Fitted.
    training_set : tuple of (X, y), optional
        Nearest neighbours need it; without it they have no array form.
    votes : bool
        Whether it is one of several voters: probabilities then are no logarithms, of two classes about 0.
    """
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.linear_model import LogisticRegression, RidgeClassifier
    from sklearn.naive_bayes import GaussianNB
    from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
    from sklearn.pipeline import Pipeline

    from texclass.classifiers.kernel_discriminant import KernelDiscriminant
    from texclass.classifiers.segment_voting import SegmentVoting

    n_classes = len(classifier.classes_)
    match classifier:
        case Pipeline():
            steps = [part for _, step in classifier.steps[:-1] for part in steps_of(step)]
            return {"does": "chain", "steps": steps, "decide": classifier_of(classifier[-1], votes=votes)}
        case LinearDiscriminantAnalysis() | LogisticRegression() | RidgeClassifier():
            weights = np.ascontiguousarray(np.atleast_2d(classifier.coef_).T)
            return {
                "does": "linear",
                "weights": _of_both(weights, n_classes),
                "intercept": _of_both(classifier.intercept_, n_classes),
            }
        case KernelDiscriminant():
            kernel = {
                "does": "kernel",
                "views": [dict(vars(view)) for view in classifier.views_],
                "prototypes": list(classifier.prototypes_),
                "dual": _of_both(classifier.dual_, n_classes),
                "length": float(classifier.length),
            }
            if classifier.limit is None:
                return kernel
            limits = {"does": "clip", "low": classifier.low_, "high": classifier.high_}
            return {"does": "chain", "steps": [limits], "decide": kernel}
        case GaussianNB():
            return {
                "does": "gauss",
                "mean": classifier.theta_,
                "variance": classifier.var_,
                "prior": classifier.class_prior_,
                "votes": votes,
            }
        case NearestCentroid(metric="euclidean"):
            deviation = classifier.within_class_std_dev_
            return {
                "does": "centroids",
                "points": classifier.centroids_,
                "scale": np.where(deviation != 0, deviation, 1.0),
                "prior": classifier.class_prior_,
            }
        case KNeighborsClassifier(weights="uniform", effective_metric_="euclidean") if training_set:
            points, labels = training_set
            return {
                "does": "neighbours",
                "points": points,
                "classes": np.searchsorted(classifier.classes_, labels),
                "n": classifier.n_neighbors,
                "n_classes": n_classes,
                "votes": votes,
            }
        case SegmentVoting():
            whole = classifier.whole_
            return {
                "does": "vote",
                "columns": classifier.columns_,
                "piece": classifier_of(classifier.estimator_, votes=True),
                "whole": None if whole is None else classifier_of(whole, votes=True),
                "whole_weight": classifier.weight_,
            }
    return {"does": "ask", "estimator": classifier, "votes": votes}


def _of_both(values: Samples, n_classes: int) -> Samples:
    """Return the last axis as it is; of two classes, what the second has, minus and plus."""
    values = np.asarray(values, dtype=np.float64)
    return np.concatenate([-values[..., -1:], values[..., -1:]], axis=-1) if n_classes == 2 else values


def _fill(X: Samples, values: Samples) -> Samples:
    return np.where(np.isnan(X), values, X)


def _chain(X: Samples, steps: Sequence[Part], decide: Part) -> Samples:
    return apply_all([*steps, decide], X)


def _kernel(
    X: Samples,
    views: Sequence[Mapping[str, Samples]],
    prototypes: Sequence[Samples],
    dual: Samples,
    length: float,
) -> Samples:
    return kernel_scores(X, [View(**view) for view in views], prototypes, dual, length)


def squared_distances(X: Samples, points: Samples, weight: Samples | float = 1.0) -> Samples:
    """Return the sums of (x - point)^2 weight for rows (n, p) and points (m, p), shape (n, m)."""
    size = max(1, 2**20 // max(1, points.size))  # of differences held at a time
    blocks = (X[k : k + size, None] - points for k in range(0, max(1, len(X)), size))
    return np.concatenate([(d * d * weight).sum(axis=2) for d in blocks])


def _as_decisions(p: Samples, votes: bool) -> Samples:
    """Return probabilities (n, n_classes) as decisions; a voter's as they are, of two classes about 0."""
    if not votes:
        return log_of(p)
    return _of_both(p - 0.5, p.shape[1]) if p.shape[1] == 2 else p


def _gauss(X: Samples, mean: Samples, variance: Samples, prior: Samples, votes: bool) -> Samples:
    level = np.log(prior) - 0.5 * np.log(2 * np.pi * variance).sum(axis=1)
    return _as_decisions(softmax(level - 0.5 * squared_distances(X, mean, 1 / variance)), votes)


def _centroids(X: Samples, points: Samples, scale: Samples, prior: Samples) -> Samples:
    """Return -|x/s - c/s|^2 + 2 log prior; of two classes, minus the difference and the difference."""
    scores = 2 * np.log(prior) - squared_distances(X / scale, points / scale)
    return scores if len(points) > 2 else _of_both(scores[:, 1:] - scores[:, :1], 2)


def _neighbours(
    X: Samples, points: Samples, classes: Columns, n: int, n_classes: int, votes: bool
) -> Samples:
    nearest = np.argsort(squared_distances(X, points), axis=1, kind="stable")[:, :n]
    return _as_decisions(np.eye(n_classes)[classes][nearest].mean(axis=1), votes)


def _vote(X: Samples, columns: Columns, piece: Part, whole: Part | None, whole_weight: float) -> Samples:
    """Average over the pieces, then over that and the whole; equal pieces need no rule of their own."""
    n_features, n_segments = columns.shape
    decisions = apply(piece, X[:, columns.T].reshape(-1, n_features))
    mean = decisions.reshape(len(X), n_segments, decisions.shape[1]).mean(axis=1)
    if whole is None:
        return np.asarray(mean)
    return np.asarray((mean + whole_weight * apply(whole, X)) / (1 + whole_weight))


def _ask(X: Samples, estimator: Any, votes: bool | None = None) -> Samples:
    """Ask an estimator on one thread: starting more takes longer than the work that they would share."""
    from sklearn import config_context

    from texclass.classifiers.segment_voting import decisions_of
    from texclass.evaluation.workers import one_thread

    with one_thread(), config_context(assume_finite=True, skip_parameter_validation=True):
        if votes is None:
            return np.asarray(estimator.transform(X))
        if not votes:
            return class_scores(estimator, X)
        decisions = decisions_of(estimator, X)
        return decisions if decisions.ndim == 2 else _of_both(decisions[:, None], 2)


OPERATIONS: Mapping[str, Callable[..., Samples]] = {
    "take": lambda X, columns: X[:, columns],
    "fill": _fill,
    "standardise": lambda X, center, scale: (X - center) / scale,
    "affine": lambda X, scale, shift: X * scale + shift,
    "clip": lambda X, low, high: np.minimum(np.maximum(X, low), high),
    "linear": lambda X, weights, intercept: X @ weights + intercept,
    "kernel": _kernel,
    "gauss": _gauss,
    "centroids": _centroids,
    "neighbours": _neighbours,
    "vote": _vote,
    "chain": _chain,
    "ask": _ask,
}
"""What is done -> what does it to rows, with the arrays of a part."""
