"""Accuracy against cost, honestly: features are chosen inside each training fold, for every budget."""

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.impute import SimpleImputer
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from texclass.experiment.cost import CostModel
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
EXPECTED = (
    "Only one sample available",
    ".*at least 1 zero standard deviation",
    "invalid value encountered in divide",
)
"""What scikit-learn warns of where a class has one training recording, or a column is the same throughout
each class: linear discriminants of the former, `NearestCentroid` of spreads that only its shrinkage uses.
What becomes of such data shows in the accuracy."""


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

    def prepared(self, split: Split) -> tuple[Samples, Samples]:
        """Return training and test columns, prepared on the training part."""
        train, test = split
        prepare = preparation().fit(self.X[train])
        return prepare.transform(self.X[train]), prepare.transform(self.X[test])


def accuracy_of(classifier: Any, train: Samples, y: Labels, test: Samples, truth: Labels) -> float:
    """Return the accuracy on the test part; of no column, that of always naming the commonest class."""
    if train.shape[1] == 0:
        names, counts = np.unique(y, return_counts=True)
        return float((truth == names[counts.argmax()]).mean())
    with warnings.catch_warnings():
        for message in EXPECTED:
            warnings.filterwarnings("ignore", message)
        return float((clone(classifier).fit(train, y).predict(test) == truth).mean())


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
    work = (partial(_fold, data, split, costs, tuple(budgets), max_features) for split in splits)
    folds = list(_counted(each(work, n_jobs=n_jobs), len(splits), "selections", progress))
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
    rows = np.array(list(each((partial(_few, data, split, most) for split in splits), n_jobs=n_jobs)))
    n_train, n_test = (float(np.mean([len(part) for part in parts])) for parts in zip(*splits, strict=True))
    return tuple((n, estimate(rows[:, n - 1], n_test, n_train)) for n in range(1, most + 1))


def _fold(
    data: Data, split: Split, costs: CostModel, budgets: tuple[float, ...], max_features: int | None
) -> tuple[list[list[float]], float]:
    """Return (accuracy, ms, features, columns, plain accuracy) of each budget; the full set's accuracy."""
    A, B = data.prepared(split)
    y, truth = data.y[split[0]], data.y[split[1]]
    labels, inner = np.unique(y, return_inverse=True)[1], inner_splits(y, data.groups[split[0]], INNER_FOLDS)
    criterion = Criterion(discriminant(), A, labels, inner, "log_likelihood")

    blind = cost_aware(costs, max_features=max_features, thrift=0.0, floating=False, direction="forward")
    plain = blind.explore(costs, criterion)

    def tested(columns: Sequence[int]) -> float:
        chosen = list(columns)
        return accuracy_of(discriminant(), A[:, chosen], y, B[:, chosen], truth)

    rows = []
    for budget in budgets:
        columns = _bought(costs, criterion, budget, max_features)
        few = best_within(plain, budget)
        n_features = len({costs.features[i] for i in columns})
        rows.append(
            [tested(columns), costs.of(columns), n_features, len(columns), tested(few.columns if few else ())]
        )
    return rows, tested(range(A.shape[1]))


def _bought(
    costs: CostModel, criterion: Criterion, budget: float, max_features: int | None
) -> tuple[int, ...]:
    """Return the columns that a budget buys; all of them where nothing has to be given up."""
    if max_features is None and budget >= costs.total:
        return tuple(range(len(costs.columns)))
    aware = cost_aware(costs, max_cost=budget, max_features=max_features)
    choice = best_within(aware.explore(costs, criterion), budget)
    return choice.columns if choice else ()


def _few(data: Data, split: Split, most: int) -> list[float]:
    """Return the accuracy of the best 1 ... `most` columns of one fold."""
    A, B = data.prepared(split)
    y, truth = data.y[split[0]], data.y[split[1]]
    path = fewest_path(A, y, data.groups[split[0]], most)
    return [accuracy_of(discriminant(), A[:, c], y, B[:, c], truth) for c in path]


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


def _counted(
    results: Iterable[Any], total: int, what: str, progress: Callable[[int, int, str], None] | None
) -> Iterable[Any]:
    for done, result in enumerate(results, start=1):
        if progress is not None:
            progress(done, total, what)
        yield result
