"""Accuracy against cost, honestly: features are chosen inside each training fold, for every budget."""

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
from texclass.evaluation.folds import Fold, over_folds
from texclass.evaluation.protocols import Protocol
from texclass.evaluation.result import measured_on
from texclass.evaluation.splits import Split
from texclass.evaluation.workers import Progress, each
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset
from texclass.recording import Recording, Samples
from texclass.tradeoff.cost_selection import CostAwareSelector, best_within
from texclass.validation import check_positive

Labels = NDArray[Any]
Facts = Mapping[str, Any]
"""Plain JSON values: an accuracy as `mean`, `low`, `high`; a point of the front, see `nested_front`."""
INNER_FOLDS = 5
Found = TypeVar("Found")
KNEE_LOSS = 0.01
"""The knee is the cheapest point that loses at most this much accuracy to the best one: 1 point."""


@dataclass(frozen=True)
class Limits:
    """What a user can afford.

    Attributes
    ----------
    max_ms
        Of one recording, from its samples to its features (see `CostModel`); None takes the knee.
    max_seconds
        Of movement that is felt; None takes whole recordings.
    max_features
        Columns that reach the classifier.
    surfaces
        The scene's surfaces; all by default. With them, the fewest columns that separate just these.

    Raises
    ------
    ValueError
        If a limit is not above 0.
    """

    max_ms: float | None = None
    max_seconds: float | None = None
    max_features: int | None = None
    surfaces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_positive(max_ms=self.max_ms, max_features=self.max_features)


class Labelled(NamedTuple):
    """What is learnt from: X (n, n_columns) with NaN where undefined, labels y (n,).

    `groups` (n,) are never divided; intervals are over what is `independent` (n,), as its protocol says.
    """

    X: Samples
    y: Labels
    groups: Labels
    independent: Labels


def labelled(X: Samples, frame: pd.DataFrame, protocol: Protocol) -> Labelled:
    """Return columns X (n, n_columns) with what a table says of their rows."""
    y = frame["surface"].to_numpy(dtype=str)
    return Labelled(X, y, protocol.clusters(frame), protocol.independent(frame)[1])


def study_facts(
    dataset: Dataset,
    features: FeatureSet,
    frame: pd.DataFrame,
    like: Recording,
    protocol: Protocol,
    splits: Sequence[Split],
    seed: int,
) -> dict[str, Any]:
    """Return what a trade-off was measured on, and over what its intervals are, as plain JSON values.

    Parameters
    ----------
    dataset : Dataset
        Whose recordings, one of them `like`, the rows of `frame` are (or windows of them).
    features : FeatureSet
        What may be bought.
    frame : DataFrame
        Feature table.
    like : Recording
        States rate and unit.
    protocol, splits, seed
        How its rows were held out.
    """
    over, of = protocol.independent(frame)
    return {
        "dataset": measured_on(dataset, frame, like),
        "features": features.name,
        "features_hash": features.hash,
        "movement": features.movement,
        "clusters": over,
        "n_clusters": len(np.unique(of[np.concatenate([test for _, test in splits])])),
        "seed": seed,
        "input_hash": dataset.input_hash,
    }


def preparation() -> Pipeline:
    """Return what stands before selection: medians for undefined values, then unit deviation."""
    return make_pipeline(SimpleImputer(strategy="median", keep_empty_features=True), StandardScaler())


def discriminant() -> LinearDiscriminantAnalysis:
    """Return the classifier of the trade: linear discriminants with a slight, fixed shrinkage."""
    return LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.01)


def cost_aware(costs: CostModel | None, **limits: Any) -> CostAwareSelector:
    """Return the selector of the trade; whole features, or columns where their number is limited.

    Without costs all columns cost the same.
    """
    limits.setdefault("unit", "feature" if limits.get("max_features") is None else "column")
    return CostAwareSelector(discriminant(), costs=costs, scoring="log_likelihood", cv=INNER_FOLDS, **limits)


def criterion(fold: Fold, groups: Labels) -> SubsetScore:
    """Return what judges subsets of columns inside the training part of a fold, as `cost_aware` does."""
    labels = np.unique(fold.labels, return_inverse=True)[1]
    inner = inner_splits(fold.labels, groups[fold.train], INNER_FOLDS)
    return SubsetScore(discriminant(), fold.learnt, labels, inner, "log_likelihood")


def accuracy_of(hits: ArrayLike, splits: Sequence[Split], data: Labelled) -> dict[str, float]:
    """Return accuracy (`mean`) and its 95 % interval (`low`, `high`) over what is independent.

    Parameters
    ----------
    hits : array_like of bool, shape (n_tested,)
        Whether each test of each fold (of all repeats) was right, fold after fold.
    splits : sequence of (train, test)
        Of the folds.
    data : Labelled
        What was tested.
    """
    over = data.independent[np.concatenate([test for _, test in splits])]
    low, high = cluster_interval(hits, over)
    return {"mean": float(np.asarray(hits).mean()), "low": low, "high": high}


def budgets_of(costs: CostModel, max_ms: float | None = None) -> tuple[float, ...]:
    """Return the budgets of a front in ms, rising: fractions of the cost of all features, and `max_ms`.

    Each pays for finding the phases before it buys.

    Raises
    ------
    ValueError
        If `max_ms` buys nothing.
    """
    if max_ms is not None and max_ms < costs.cheapest:
        raise ValueError(
            f"max_ms is {max_ms:g}. Expected at least {costs.cheapest:.3g}: the cheapest feature, and "
            f"{costs.segmentation_ms:.3g} for finding the phases"
        )
    given = set() if max_ms is None else {min(max_ms, costs.total)}
    fractions = (0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)
    every = {costs.segmentation_ms + f * costs.features_ms for f in fractions}
    return tuple(sorted({ms for ms in every if ms >= costs.cheapest} | given))


def nested_front(
    data: Labelled,
    splits: Sequence[Split],
    costs: CostModel,
    budgets: Sequence[float],
    *,
    max_features: int | None = None,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[list[Facts], Facts]:
    """Return what every budget buys, and the accuracy of the full set, on the same splits.

    Parameters
    ----------
    data : Labelled
        Features and labels.
    splits : sequence of (train, test)
        All folds of all repeats.
    costs : CostModel
        Of the columns of X.
    budgets : sequence of float
        In ms.
    max_features : int, optional
        Largest number of columns.
    n_jobs : int
        Processes.
    progress : callable, optional
        Called with (done, total, "selections").

    Returns
    -------
    list of dict
        For each `budget_ms`: the `accuracy` of recordings that had no part in the choice; that of `plain`
        sequential selection, which does not look at costs and ends at the budget; and means over folds of
        what the choices cost (`ms`), of their `n_features` and `n_columns`.
    dict
        The accuracy of all columns.
    """
    at_budgets = partial(_at_budgets, data.groups, costs, tuple(budgets), max_features)
    found = _of_each_fold(at_budgets, data, splits, n_jobs=n_jobs, progress=progress)
    hits, bought = zip(*found, strict=True)
    full, *accuracies = (accuracy_of(right, splits, data) for right in np.concatenate(hits, axis=1))
    means = np.mean(bought, axis=0)  # (n_budgets, 3)
    points: list[Facts] = [
        {
            "budget_ms": budget,
            "ms": float(ms),
            "accuracy": aware,
            "plain": plain,
            "n_features": float(n_features),
            "n_columns": float(n_columns),
        }
        for budget, (ms, n_features, n_columns), aware, plain in zip(
            budgets, means, accuracies[::2], accuracies[1::2], strict=True
        )
    ]
    return points, full


def knee(front: Sequence[Facts]) -> Facts:
    """Return the cheapest point that loses at most `KNEE_LOSS` to the best one."""
    best = max(point["accuracy"]["mean"] for point in front)
    return next(point for point in front if point["accuracy"]["mean"] >= best - KNEE_LOSS)


def nested_fewest(
    data: Labelled, splits: Sequence[Split], most: int, *, n_jobs: int = 1
) -> list[tuple[int, Facts]]:
    """Return the accuracy of the best 1, 2, ... `most` columns, chosen inside each training fold."""

    def few(fold: Fold) -> list[NDArray[np.bool_]]:
        path = fewest_path(fold.learnt, fold.labels, data.groups[fold.train], most)
        return [fold.hits(discriminant(), columns) for columns in path]

    hits = np.concatenate(_of_each_fold(few, data, splits, n_jobs=n_jobs), axis=1)
    return [(n, accuracy_of(right, splits, data)) for n, right in enumerate(hits, 1)]


def _of_each_fold(
    choose: Callable[[Fold], Found], data: Labelled, splits: Sequence[Split], **work: Any
) -> list[Found]:
    """Return what is found on each fold, prepared on its training part, by as many processes as are given."""
    calls = [partial(over_folds, choose, data.X, data.y, [split], preparation()) for split in splits]
    return [found for (found,) in each(calls, what="selections", total=len(calls), **work)]


def fewest_path(X: Samples, y: Labels, groups: Labels, most: int) -> list[list[int]]:
    """Return the best 1, 2, ... `most` columns, whatever they cost; fewer where more do not help."""
    selector = cost_aware(None, direction="forward", max_features=most).fit(X, y, groups)
    best = [
        max((c for c in selector.path_ if len(c.columns) <= n), key=lambda c: c.score)
        for n in range(1, most + 1)
    ]
    return [list(choice.columns) for choice in best]


def _at_budgets(
    groups: Labels, costs: CostModel, budgets: tuple[float, ...], max_features: int | None, fold: Fold
) -> tuple[list[NDArray[np.bool_]], list[tuple[float, int, int]]]:
    """Return the hits of the full set, then of the choice and of plain selection at each budget, in turns.

    Then ms, features and columns that the choice at each budget takes.
    """
    score = criterion(fold, groups)
    blind = cost_aware(costs, max_features=max_features, thrift=0.0, floating=False, direction="forward")
    plain = blind.explore(costs, score)
    hits, bought = [fold.hits(discriminant())], []
    for budget in budgets:
        columns: tuple[int, ...] = tuple(range(len(costs.columns)))
        if max_features is not None or budget < costs.total:  # something has to be given up
            aware = cost_aware(costs, max_cost=budget, max_features=max_features)
            choice = best_within(aware.explore(costs, score), budget)
            columns = choice.columns if choice else ()
        few = best_within(plain, budget)
        hits += [fold.hits(discriminant(), list(c)) for c in (columns, few.columns if few else ())]
        bought.append((costs.of(columns), len({costs.features[i] for i in columns}), len(columns)))
    return hits, bought
