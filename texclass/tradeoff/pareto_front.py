"""Pareto front of accuracy against latency. Features are selected in each training set for every budget."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from texclass.classifiers.forward_selection import SubsetScore, inner_splits
from texclass.evaluation.accuracy import cluster_interval
from texclass.evaluation.cost import CostModel
from texclass.evaluation.folds import Fold, map_folds
from texclass.evaluation.protocols import Protocol
from texclass.evaluation.result_facts import describe_dataset
from texclass.evaluation.splits import Split
from texclass.evaluation.workers import Progress, run_parallel
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset
from texclass.recording import Recording, Samples
from texclass.tradeoff.cost_selection import CostAwareSelector, best_within
from texclass.validation import check_positive

Labels = NDArray[Any]
Facts = Mapping[str, Any]
"""Plain JSON values: an accuracy (`mean`, `low`, `high`), or a point of the front (see `nested_front`)."""
INNER_FOLDS = 5
"""Number of inner folds in which subsets of columns are scored."""
T = TypeVar("T")
KNEE_LOSS = 0.01
"""Largest difference of accuracy (as a fraction) between the best point of the front and the knee point."""


@dataclass(frozen=True)
class Limits:
    """Budget of a recogniser.

    Attributes
    ----------
    max_ms
        Largest latency per recording in ms, from samples to features (see `CostModel`). None (default)
        selects the knee point.
    max_seconds
        Length in s of the movement that is used from each recording. None (default) uses whole recordings.
    max_features
        Largest number of columns for the classifier (default: no limit).
    surfaces
        Surfaces of a scene (default: all surfaces). If they are given without `max_ms`, the smallest subset
        of columns is selected that separates them.

    Raises
    ------
    ValueError
        If a limit is not positive.

    Examples
    --------
    >>> Limits(max_ms=5.0, max_features=20)
    Limits(max_ms=5.0, max_seconds=None, max_features=20, surfaces=())
    """

    max_ms: float | None = None
    max_seconds: float | None = None
    max_features: int | None = None
    surfaces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_positive(max_ms=self.max_ms, max_features=self.max_features)


class LabelledData(NamedTuple):
    """Features X (n, n_columns) with NaN where undefined, labels y (n,), groups and independent units.

    Samples of the same group in `groups` (n,) always stay together. Confidence intervals are over the
    independent `units` (n,) of the protocol.
    """

    X: Samples
    y: Labels
    groups: Labels
    units: Labels


def label_data(X: Samples, frame: pd.DataFrame, protocol: Protocol) -> LabelledData:
    """Return the columns X (n, n_columns) with the labels, groups and independent units of a table."""
    y = frame["surface"].to_numpy(dtype=str)
    return LabelledData(X, y, protocol.groups(frame), protocol.independent(frame)[1])


def study_facts(
    dataset: Dataset,
    features: FeatureSet,
    frame: pd.DataFrame,
    like: Recording,
    protocol: Protocol,
    splits: Sequence[Split],
    seed: int,
) -> dict[str, Any]:
    """Return facts about dataset, features and independent units of a trade-off as plain JSON values.

    Parameters
    ----------
    dataset : Dataset
        Recordings of the study.
    features : FeatureSet
        Feature set from which subsets are selected.
    frame : DataFrame
        Feature table whose rows are the recordings of the dataset, or windows of these recordings.
    like : Recording
        Recording from which sampling rate and unit are read.
    protocol : Protocol
        Protocol of the splits.
    splits : sequence of (train, test)
        Folds of all repeats.
    seed : int
        Seed of the folds.
    """
    unit_name, units = protocol.independent(frame)
    return {
        "dataset": describe_dataset(dataset, frame, like),
        "features": features.name,
        "features_hash": features.hash,
        "movement": features.movement,
        "clusters": unit_name,
        "n_clusters": len(np.unique(units[np.concatenate([test for _, test in splits])])),
        "seed": seed,
        "input_hash": dataset.input_hash,
    }


def preprocessing() -> Pipeline:
    """Return the steps before selection: replace undefined values by medians, then standardise."""
    return make_pipeline(SimpleImputer(strategy="median", keep_empty_features=True), StandardScaler())


def discriminant() -> LinearDiscriminantAnalysis:
    """Return the classifier of trade-off studies: linear discriminant analysis with small shrinkage."""
    return LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.01)


def cost_aware_selector(costs: CostModel | None, **limits: Any) -> CostAwareSelector:
    """Return the selector of trade-off studies.

    It selects whole features, or single columns if the number of columns is limited. Without `costs`, all
    columns have the same cost.
    """
    limits.setdefault("unit", "feature" if limits.get("max_features") is None else "column")
    return CostAwareSelector(discriminant(), costs=costs, scoring="log_likelihood", cv=INNER_FOLDS, **limits)


def subset_score(fold: Fold, groups: Labels) -> SubsetScore:
    """Return a score for column subsets on the training set of a fold, as used by `cost_aware_selector`."""
    labels = np.unique(fold.y_train, return_inverse=True)[1]
    inner = inner_splits(fold.y_train, groups[fold.train], INNER_FOLDS)
    return SubsetScore(discriminant(), fold.X_train, labels, inner, "log_likelihood")


def accuracy_with_interval(hits: ArrayLike, splits: Sequence[Split], data: LabelledData) -> dict[str, float]:
    """Return the accuracy (`mean`) and its 95 % confidence interval (`low`, `high`) over independent units.

    Parameters
    ----------
    hits : array_like of bool, shape (n_tested,)
        Whether each test sample was classified correctly, concatenated in fold order over all repeats.
    splits : sequence of (train, test)
        Folds of all repeats.
    data : LabelledData
        Data of the study.
    """
    units = data.units[np.concatenate([test for _, test in splits])]
    low, high = cluster_interval(hits, units)
    return {"mean": float(np.asarray(hits).mean()), "low": low, "high": high}


def latency_budgets(costs: CostModel, max_ms: float | None = None) -> tuple[float, ...]:
    """Return increasing latency budgets in ms: fractions of the cost of all features, and `max_ms`.

    Each budget includes the cost of the segmentation into phases.

    Raises
    ------
    ValueError
        If `max_ms` is below the cost of the cheapest feature.
    """
    if max_ms is not None and max_ms < costs.cheapest:
        raise ValueError(
            f"max_ms must be at least {costs.cheapest:.3g} ms (the cheapest feature, including "
            f"{costs.segmentation_ms:.3g} ms for the segmentation), got {max_ms:g} ms"
        )
    requested = set() if max_ms is None else {min(max_ms, costs.total)}
    fractions = (0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)
    grid = {costs.segmentation_ms + f * costs.features_ms for f in fractions}
    return tuple(sorted({ms for ms in grid if ms >= costs.cheapest} | requested))


def nested_front(
    data: LabelledData,
    splits: Sequence[Split],
    costs: CostModel,
    budgets: Sequence[float],
    *,
    max_features: int | None = None,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[list[Facts], Facts]:
    """Return the accuracy of nested selection at every budget, and the accuracy of the full set.

    Parameters
    ----------
    data : LabelledData
        Features and labels.
    splits : sequence of (train, test)
        Folds of all repeats.
    costs : CostModel
        Costs of the columns of X.
    budgets : sequence of float
        Latency budgets in ms.
    max_features : int, optional
        Largest number of columns (default: no limit).
    n_jobs : int
        Number of processes (default 1).
    progress : callable, optional
        Function called with (done, total, "selections").

    Returns
    -------
    list of dict
        For each `budget_ms`: the `accuracy` on held-out recordings; the accuracy of `plain` sequential
        selection, which ignores costs and stops at the budget; and the cost (`ms`), `n_features` and
        `n_columns` of the selected subsets, averaged over folds.
    dict
        Accuracy with all columns, on the same splits.
    """
    evaluate_fold = partial(_evaluate_budgets, data.groups, costs, tuple(budgets), max_features)
    results = _map_folds(evaluate_fold, data, splits, n_jobs=n_jobs, progress=progress)
    hits, sizes = zip(*results, strict=True)
    full, *accuracies = (accuracy_with_interval(row, splits, data) for row in np.concatenate(hits, axis=1))
    means = np.mean(sizes, axis=0)  # (n_budgets, 3)
    points: list[Facts] = [
        {
            "budget_ms": budget,
            "ms": float(ms),
            "accuracy": accuracy,
            "plain": plain,
            "n_features": float(n_features),
            "n_columns": float(n_columns),
        }
        for budget, (ms, n_features, n_columns), accuracy, plain in zip(
            budgets, means, accuracies[::2], accuracies[1::2], strict=True
        )
    ]
    return points, full


def knee_point(front: Sequence[Facts]) -> Facts:
    """Return the cheapest point whose accuracy is within `KNEE_LOSS` of the best point."""
    best = max(point["accuracy"]["mean"] for point in front)
    return next(point for point in front if point["accuracy"]["mean"] >= best - KNEE_LOSS)


def nested_smallest_subsets(
    data: LabelledData, splits: Sequence[Split], max_columns: int, *, n_jobs: int = 1
) -> list[tuple[int, Facts]]:
    """Return the accuracy of the best 1, 2, ... `max_columns` columns, selected in each training set."""

    def evaluate_fold(fold: Fold) -> list[NDArray[np.bool_]]:
        subsets = smallest_subsets(fold.X_train, fold.y_train, data.groups[fold.train], max_columns)
        return [fold.hits(discriminant(), columns) for columns in subsets]

    hits = np.concatenate(_map_folds(evaluate_fold, data, splits, n_jobs=n_jobs), axis=1)
    return [(n, accuracy_with_interval(row, splits, data)) for n, row in enumerate(hits, 1)]


def _map_folds(
    evaluate_fold: Callable[[Fold], T], data: LabelledData, splits: Sequence[Split], **options: Any
) -> list[T]:
    """Return the result of a function on each fold, with preprocessing fitted on its training set."""
    calls = [partial(map_folds, evaluate_fold, data.X, data.y, [split], preprocessing()) for split in splits]
    return [result for (result,) in run_parallel(calls, stage="selections", total=len(calls), **options)]


def smallest_subsets(X: Samples, y: Labels, groups: Labels, max_columns: int) -> list[list[int]]:
    """Return the best 1, 2, ... `max_columns` columns regardless of cost; stop when more do not help."""
    selector = cost_aware_selector(None, direction="forward", max_features=max_columns).fit(X, y, groups)
    best = [
        max(
            (subset for subset in selector.path_ if len(subset.columns) <= n), key=lambda subset: subset.score
        )
        for n in range(1, max_columns + 1)
    ]
    return [list(subset.columns) for subset in best]


def _evaluate_budgets(
    groups: Labels, costs: CostModel, budgets: tuple[float, ...], max_features: int | None, fold: Fold
) -> tuple[list[NDArray[np.bool_]], list[tuple[float, int, int]]]:
    """Return the hits of the full set and of both selections at each budget, and the sizes of the subsets.

    For each budget, the function returns the hits of cost-aware and of plain sequential selection. The sizes
    are the cost in ms, the number of features and the number of columns of the cost-aware subset.
    """
    score = subset_score(fold, groups)
    plain_selector = cost_aware_selector(
        costs, max_features=max_features, cost_exponent=0.0, floating=False, direction="forward"
    )
    plain_path = plain_selector.explore(costs, score)
    hits, sizes = [fold.hits(discriminant())], []
    for budget in budgets:
        columns: tuple[int, ...] = tuple(range(len(costs.columns)))
        if max_features is not None or budget < costs.total:  # not all columns can be used
            selector = cost_aware_selector(costs, max_cost=budget, max_features=max_features)
            subset = best_within(selector.explore(costs, score), budget)
            columns = subset.columns if subset else ()
        plain = best_within(plain_path, budget)
        hits += [fold.hits(discriminant(), list(c)) for c in (columns, plain.columns if plain else ())]
        sizes.append(
            (costs.cost_of_indices(columns), len({costs.features[i] for i in columns}), len(columns))
        )
    return hits, sizes
