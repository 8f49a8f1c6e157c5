"""Array form of fitted estimators, with which trained models predict without scikit-learn.

Each transformer and classifier of the shipped pipelines becomes a mapping with the name of an `operation` and
its arrays. Models predict with these mappings and store them in their files, and ONNX graphs are built from
them. An estimator without an array form is stored as it is (operation "estimator").
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.classifiers.kernel import View, kernel_scores
from texclass.recognition.probabilities import class_scores, log_probabilities, softmax
from texclass.recording import Samples

ArrayStep = Mapping[str, Any]
"""Operation and arrays of a transformer or a classifier."""
Columns = NDArray[np.intp]
TrainingSet = tuple[Samples, NDArray[Any]]
"""Prepared rows (n, n_columns) and their labels (n,)."""
MAX_DIFFERENCES = 2**20
"""Number of differences between rows and points in memory at a time (8 MB)."""


def apply(step: ArrayStep, X: Samples) -> Samples:
    """Apply a step to rows (n, n_columns): return prepared rows, or decisions (n, n_classes).

    Raises
    ------
    KeyError, TypeError, ValueError
        If the mapping is not a valid step.

    Examples
    --------
    >>> import numpy as np
    >>> apply({"operation": "clip", "low": 0.0, "high": 1.0}, np.array([[-2.0, 0.5, 3.0]])).tolist()
    [[0.0, 0.5, 1.0]]
    """
    arguments = {name: value for name, value in step.items() if name != "operation"}
    return OPERATIONS[step["operation"]](X, **arguments)


def apply_all(steps: Sequence[ArrayStep], X: Samples) -> Samples:
    """Apply several steps to rows, one after the other."""
    for step in steps:
        X = apply(step, X)
    return X


def decide(steps: Sequence[ArrayStep], classifier: ArrayStep, X: Samples) -> tuple[Samples, Samples]:
    """Return prepared rows (n, n_prepared) and decisions (n, n_classes) for features (n, n_columns).

    Raises
    ------
    ValueError
        If a prepared value is not finite.
    """
    prepared = apply_all(steps, X)
    if not np.isfinite(prepared).all():
        raise ValueError("features are undefined after all steps. Add an imputation step to the pipeline")
    return prepared, apply(classifier, prepared)


def estimators_in(steps: Any) -> list[Any]:
    """Return the estimators without an array form in nested mappings and sequences."""
    if isinstance(steps, Mapping):
        if "estimator" in steps:
            return [steps["estimator"]]
        steps = list(steps.values())
    if not isinstance(steps, list | tuple):
        return []
    return [estimator for step in steps for estimator in estimators_in(step)]


def steps_of(step: Any) -> list[ArrayStep]:  # noqa: PLR0911  (one return per class)
    """Return the array form of a fitted transformer, a list of consecutive steps.

    Operations are "select" (columns), "fill" (undefined values), "standardise" ((X - center) / scale),
    "affine" (X scale + shift), "clip" (low ... high) and "estimator" (no array form).
    """
    from sklearn.feature_selection import SelectorMixin
    from sklearn.impute import SimpleImputer
    from sklearn.pipeline import Pipeline
    from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, RobustScaler, StandardScaler

    match step:
        case None | "passthrough":
            return []
        case Pipeline():
            return [array_step for _, inner in step.steps for array_step in steps_of(inner)]
        case SelectorMixin():
            return [{"operation": "select", "columns": np.flatnonzero(step.get_support())}]
        case SimpleImputer(add_indicator=False, missing_values=missing) if np.isnan(missing):
            values = np.asarray(step.statistics_, dtype=np.float64)
            if step.keep_empty_features or not np.isnan(values).any():
                return [{"operation": "fill", "values": values}]
            columns = np.flatnonzero(~np.isnan(values))
            return [
                {"operation": "select", "columns": columns},
                {"operation": "fill", "values": values[columns]},
            ]
        case MinMaxScaler():
            low, high = step.feature_range
            clip = [{"operation": "clip", "low": low, "high": high}] * step.clip
            return [{"operation": "affine", "scale": step.scale_, "shift": step.min_}, *clip]
        case StandardScaler():
            return [_standardise(step.mean_ if step.with_mean else None, step.scale_)]
        case RobustScaler():
            return [_standardise(step.center_, step.scale_)]
        case MaxAbsScaler() if not getattr(step, "clip", False):
            return [_standardise(None, step.scale_)]
    return [{"operation": "estimator", "estimator": step}]


def _standardise(center: Samples | None, scale: Samples | None) -> ArrayStep:
    return {
        "operation": "standardise",
        "center": 0.0 if center is None else center,
        "scale": 1.0 if scale is None else scale,
    }


def classifier_of(  # noqa: PLR0911
    classifier: Any, training_set: TrainingSet | None = None, *, is_averaged: bool = False
) -> ArrayStep:
    """Return the array form of a fitted classifier, which gives the same decisions as `class_scores`.

    Operations are "linear" (X weights + intercept), "kernel" (mean Matern kernel between rows and prototypes
    in each view, times dual), "gauss" (log posteriors of naive Bayes), "centroids", "neighbours" (shares of
    the nearest neighbours), "vote" (mean over segments), "chain" (steps, then a classifier) and "estimator"
    (no array form).

    Parameters
    ----------
    classifier : classifier
        Fitted classifier.
    training_set : tuple of (X, y), optional
        Training set; nearest neighbours have no array form without it.
    is_averaged : bool
        Whether decisions are averaged by segment voting (default False). If true, the decisions are
        probabilities instead of their logarithms, and are centred at 0 for two classes.
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
            steps = [array_step for _, step in classifier.steps[:-1] for array_step in steps_of(step)]
            final = classifier_of(classifier[-1], is_averaged=is_averaged)
            return {"operation": "chain", "steps": steps, "classifier": final}
        case LinearDiscriminantAnalysis() | LogisticRegression() | RidgeClassifier():
            weights = np.ascontiguousarray(np.atleast_2d(classifier.coef_).T)
            return {
                "operation": "linear",
                "weights": _both_classes(weights, n_classes),
                "intercept": _both_classes(classifier.intercept_, n_classes),
            }
        case KernelDiscriminant():
            kernel = {
                "operation": "kernel",
                "views": [dict(vars(view)) for view in classifier.views_],
                "prototypes": list(classifier.prototypes_),
                "dual": _both_classes(classifier.dual_, n_classes),
                "length": float(classifier.length),
            }
            if classifier.limit is None:
                return kernel
            limits = {"operation": "clip", "low": classifier.low_, "high": classifier.high_}
            return {"operation": "chain", "steps": [limits], "classifier": kernel}
        case GaussianNB():
            return {
                "operation": "gauss",
                "mean": classifier.theta_,
                "variance": classifier.var_,
                "prior": classifier.class_prior_,
                "is_averaged": is_averaged,
            }
        case NearestCentroid(metric="euclidean"):
            deviation = classifier.within_class_std_dev_
            return {
                "operation": "centroids",
                "points": classifier.centroids_,
                "scale": np.where(deviation != 0, deviation, 1.0),
                "prior": classifier.class_prior_,
            }
        case KNeighborsClassifier(weights="uniform", effective_metric_="euclidean") if training_set:
            points, labels = training_set
            return {
                "operation": "neighbours",
                "points": points,
                "classes": np.searchsorted(classifier.classes_, labels),
                "n": classifier.n_neighbors,
                "n_classes": n_classes,
                "is_averaged": is_averaged,
            }
        case SegmentVoting():
            whole = classifier.whole_classifier_
            return {
                "operation": "vote",
                "columns": classifier.segment_columns_,
                "segment": classifier_of(classifier.segment_classifier_, is_averaged=True),
                "whole": None if whole is None else classifier_of(whole, is_averaged=True),
                "whole_weight": classifier.whole_weight_,
            }
    return {"operation": "estimator", "estimator": classifier, "is_averaged": is_averaged}


def _both_classes(values: Samples, n_classes: int) -> Samples:
    """Return values with one entry per class on the last axis; for two classes, (-v, v) of the second."""
    values = np.asarray(values, dtype=np.float64)
    return np.concatenate([-values[..., -1:], values[..., -1:]], axis=-1) if n_classes == 2 else values


def _fill(X: Samples, values: Samples) -> Samples:
    return np.where(np.isnan(X), values, X)


def _chain(X: Samples, steps: Sequence[ArrayStep], classifier: ArrayStep) -> Samples:
    return apply_all([*steps, classifier], X)


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
    n = max(1, MAX_DIFFERENCES // max(1, points.size))
    batches = (X[k : k + n, None] - points for k in range(0, max(1, len(X)), n))
    return np.concatenate([(d * d * weight).sum(axis=2) for d in batches])


def _as_decisions(p: Samples, is_averaged: bool) -> Samples:
    """Return log probabilities, or probabilities for averaging (centred at 0 for two classes)."""
    if not is_averaged:
        return log_probabilities(p)
    return _both_classes(p - 0.5, p.shape[1]) if p.shape[1] == 2 else p


def _gauss(X: Samples, mean: Samples, variance: Samples, prior: Samples, is_averaged: bool) -> Samples:
    level = np.log(prior) - 0.5 * np.log(2 * np.pi * variance).sum(axis=1)
    return _as_decisions(softmax(level - 0.5 * squared_distances(X, mean, 1 / variance)), is_averaged)


def _centroids(X: Samples, points: Samples, scale: Samples, prior: Samples) -> Samples:
    """Return -|x/s - c/s|^2 + 2 log prior; for two classes, (-d, d) with the difference d of both."""
    scores = 2 * np.log(prior) - squared_distances(X / scale, points / scale)
    return scores if len(points) > 2 else _both_classes(scores[:, 1:] - scores[:, :1], 2)


def _neighbours(
    X: Samples, points: Samples, classes: Columns, n: int, n_classes: int, is_averaged: bool
) -> Samples:
    nearest = np.argsort(squared_distances(X, points), axis=1, kind="stable")[:, :n]
    return _as_decisions(np.eye(n_classes)[classes][nearest].mean(axis=1), is_averaged)


def _vote(
    X: Samples, columns: Columns, segment: ArrayStep, whole: ArrayStep | None, whole_weight: float
) -> Samples:
    """Average the decisions over the segments, then combine the mean with the decision on the recording."""
    n_features, n_segments = columns.shape
    decisions = apply(segment, X[:, columns.T].reshape(-1, n_features))
    mean = decisions.reshape(len(X), n_segments, decisions.shape[1]).mean(axis=1)
    if whole is None:
        return np.asarray(mean)
    return np.asarray((mean + whole_weight * apply(whole, X)) / (1 + whole_weight))


def _estimator(X: Samples, estimator: Any, is_averaged: bool | None = None) -> Samples:
    """Apply an estimator on one thread, because starting threads takes longer than classifying a few rows."""
    from sklearn import config_context

    from texclass.classifiers.segment_voting import decisions_of
    from texclass.evaluation.workers import one_thread

    with one_thread(), config_context(assume_finite=True, skip_parameter_validation=True):
        if is_averaged is None:
            return np.asarray(estimator.transform(X))
        if not is_averaged:
            return class_scores(estimator, X)
        decisions = decisions_of(estimator, X)
        return decisions if decisions.ndim == 2 else _both_classes(decisions[:, None], 2)


OPERATIONS: Mapping[str, Callable[..., Samples]] = {
    "select": lambda X, columns: X[:, columns],
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
    "estimator": _estimator,
}
"""Operation -> function of rows and the arrays of a step."""
