"""Accuracy against cost, honestly: features are chosen inside each training fold, for every budget."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from texclass.experiment.cost import CostModel
from texclass.experiment.folds import Fold, over_folds
from texclass.experiment.protocols import Split
from texclass.experiment.workers import each
from texclass.recording import Samples
from texclass.tradeoff.cost_search import best_within
from texclass.tradeoff.cost_selection import CostAwareSelector, inner_splits
from texclass.tradeoff.criterion import Criterion
from texclass.tradeoff.tradeoff_result import Estimate, FrontPoint, estimate

Labels = NDArray[Any]
FRACTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)
"""Budgets of a front, in costs of the full set."""
INNER_FOLDS = 5


def preparation() -> Pipeline:
    """Return what stands before selection: medians for undefined values, then unit deviation."""
    return make_pipeline(SimpleImputer(strategy="median", keep_empty_features=True), StandardScaler())


def discriminant() -> LinearDiscriminantAnalysis:
    """Return the classifier of the trade: linear discriminants with a slight, fixed shrinkage."""
    return LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.01)


def cost_aware(costs: CostModel, **limits: Any) -> CostAwareSelector:
    """Return the selector of the trade; whole features, or columns where their number is limited."""
    limits.setdefault("unit", "feature" if limits.get("max_features") is None else "column")
    return CostAwareSelector(discriminant(), costs=costs, scoring="log_likelihood", cv=INNER_FOLDS, **limits)


@dataclass(frozen=True, eq=False)
class Data:
    """What is learnt from: X (n, n_columns) with NaN where undefined, y (n,), groups (n,) never divided."""

    X: Samples
    y: Labels
    groups: Labels


def budgets_of(costs: CostModel) -> tuple[float, ...]:
    """Return the budgets of a front in ms, rising: what the cheapest column costs, then `FRACTIONS`."""
    cheapest = min(costs.of([i]) for i in range(len(costs.columns)))
    return tuple(sorted({f * costs.total for f in FRACTIONS if f * costs.total >= cheapest}))


def nested_front(
    data: Data,
    splits: Sequence[Split],
    costs: CostModel,
    budgets: Sequence[float],
    *,
    max_features: int | None = None,
    n_jobs: int = 1,
    progress: Callable[[int, int, str], None] | None = None,
) -> tuple[tuple[FrontPoint, ...], Estimate]:
    """Return what every budget buys, and the accuracy of the full set, on the same splits.

    Parameters
    ----------
    data : Data
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
    """
    at_budgets = partial(_at_budgets, data.groups, costs, tuple(budgets), max_features)
    work = [partial(over_folds, at_budgets, data.X, data.y, [split], preparation()) for split in splits]
    done = each(work, n_jobs=n_jobs, progress=progress, what="selections")
    folds = [fold for found in done for fold in found]
    table = np.array([fold for fold, _ in folds])  # (n_splits, n_budgets, 5)
    sizes = [np.mean([len(part) for part in parts]) for parts in zip(*splits, strict=True)]
    n_train, n_test = map(float, sizes)
    points = tuple(
        FrontPoint(
            budget_ms=budget,
            ms=float(rows[:, 1].mean()),
            accuracy=estimate(rows[:, 0], n_test, n_train),
            plain=estimate(rows[:, 4], n_test, n_train),
            n_features=float(rows[:, 2].mean()),
            n_columns=float(rows[:, 3].mean()),
        )
        for budget, rows in zip(budgets, table.swapaxes(0, 1), strict=True)
    )
    return points, estimate([full for _, full in folds], n_test, n_train)


def nested_fewest(
    data: Data, splits: Sequence[Split], most: int, *, n_jobs: int = 1
) -> tuple[tuple[int, Estimate], ...]:
    """Return the accuracy of the best 1, 2, ... `most` columns, chosen inside each training fold."""
    few = partial(_few, data.groups, most)
    work = [partial(over_folds, few, data.X, data.y, [split], preparation()) for split in splits]
    rows = np.concatenate(list(each(work, n_jobs=n_jobs)))
    n_train, n_test = (float(np.mean([len(part) for part in parts])) for parts in zip(*splits, strict=True))
    return tuple((n, estimate(rows[:, n - 1], n_test, n_train)) for n in range(1, most + 1))


def _at_budgets(
    groups: Labels, costs: CostModel, budgets: tuple[float, ...], max_features: int | None, fold: Fold
) -> tuple[list[list[float]], float]:
    """Return (accuracy, ms, features, columns, plain accuracy) of each budget; the full set's accuracy."""
    y = fold.labels
    labels, inner = np.unique(y, return_inverse=True)[1], inner_splits(y, groups[fold.train], INNER_FOLDS)
    criterion = Criterion(discriminant(), fold.learnt, labels, inner, "log_likelihood")
    blind = cost_aware(costs, max_features=max_features, thrift=0.0, floating=False, direction="forward")
    plain = blind.explore(costs, criterion)
    rows = []
    for budget in budgets:
        columns = _bought(costs, criterion, budget, max_features)
        few = best_within(plain, budget)
        accuracies = [fold.accuracy(discriminant(), list(c)) for c in (columns, few.columns if few else ())]
        n_features = len({costs.features[i] for i in columns})
        rows.append([accuracies[0], costs.of(columns), n_features, len(columns), accuracies[1]])
    return rows, fold.accuracy(discriminant())


def _bought(
    costs: CostModel, criterion: Criterion, budget: float, max_features: int | None
) -> tuple[int, ...]:
    """Return the columns that a budget buys; all of them where nothing has to be given up."""
    if max_features is None and budget >= costs.total:
        return tuple(range(len(costs.columns)))
    aware = cost_aware(costs, max_cost=budget, max_features=max_features)
    choice = best_within(aware.explore(costs, criterion), budget)
    return choice.columns if choice else ()


def _few(groups: Labels, most: int, fold: Fold) -> list[float]:
    """Return the accuracy of the best 1 ... `most` columns of one fold."""
    path = fewest_path(fold.learnt, fold.labels, groups[fold.train], most)
    return [fold.accuracy(discriminant(), columns) for columns in path]


def fewest_path(X: Samples, y: Labels, groups: Labels, most: int) -> list[list[int]]:
    """Return the best 1, 2, ... `most` columns, whatever they cost; fewer where more do not help."""
    selector = CostAwareSelector(
        discriminant(), scoring="log_likelihood", cv=INNER_FOLDS, unit="column", direction="forward",
        max_features=most,
    ).fit(X, y, groups)  # fmt: skip
    best = [
        max((c for c in selector.path_ if len(c.columns) <= n), key=lambda c: c.score)
        for n in range(1, most + 1)
    ]
    return [list(choice.columns) for choice in best]
