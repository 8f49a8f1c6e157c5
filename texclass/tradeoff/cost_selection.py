"""Selection that buys accuracy per millisecond: columns cost what their feature and its transforms cost."""

from collections.abc import Iterable, Iterator
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MetaEstimatorMixin, is_classifier
from sklearn.feature_selection import SelectorMixin
from sklearn.naive_bayes import GaussianNB
from sklearn.utils import Tags
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.classifiers.forward_selection import Scoring, SubsetScore, inner_splits
from texclass.evaluation.cost import CostModel
from texclass.recording import Samples

Unit = Literal["column", "feature"]


class Subset(NamedTuple):
    """Columns on the way of a selection: sorted, with their cost (ms) and inner cross-validated score."""

    columns: tuple[int, ...]
    cost: float
    score: float


class CostAwareSelector(SelectorMixin, MetaEstimatorMixin, BaseEstimator):  # type: ignore[misc]
    """Sequential floating selection that buys score per cost.

    Each step adds a column, or all that is left of a feature, whose gain / cost^thrift is largest; then
    columns and features go whose loss does not lower the score. It ends when no step gains more
    than `tolerance`, or none is affordable.

    Parameters
    ----------
    estimator : classifier, optional
        Whose inner cross-validated score decides; Gaussian naive Bayes by default.
    costs : CostModel or array_like of shape (n_columns,), optional
        What columns cost: with features and shared transforms, or each by itself; all the same by default.
    max_cost : float, optional
        Budget, in the unit of the costs.
    max_features : int, optional
        Largest number of columns.
    thrift : float
        0 looks at the gain only (plain sequential selection under a budget), 1 at the gain per cost.
    floating : bool
        Whether columns that no longer earn their cost are dropped.
    tolerance : float
        Smallest gain of the score that is worth a step.
    scoring : {"accuracy", "log_likelihood"}
        See `SubsetScore`.
    cv : int
        Inner stratified folds, not shuffled; reduced to the size of the smallest class.

    Attributes
    ----------
    support_ : ndarray of bool, shape (n_columns,)
        Which columns are selected.
    path_ : tuple of Subset
        Every subset on the way, in order; the last is `support_`.
    cost_, score_ : float
        Of the selection.
    """

    def __init__(
        self,
        estimator: Any = None,
        *,
        costs: CostModel | ArrayLike | None = None,
        max_cost: float | None = None,
        max_features: int | None = None,
        thrift: float = 1.0,
        floating: bool = True,
        unit: Unit = "feature",
        direction: Literal["forward", "backward", "both"] = "both",
        tolerance: float = 0.0,
        scoring: Scoring = "accuracy",
        cv: int = 5,
    ) -> None:
        self.estimator = estimator
        self.costs = costs
        self.max_cost = max_cost
        self.max_features = max_features
        self.thrift = thrift
        self.floating = floating
        self.unit = unit
        self.direction = direction
        self.tolerance = tolerance
        self.scoring = scoring
        self.cv = cv

    def fit(self, X: Samples, y: NDArray[Any], groups: NDArray[Any] | None = None) -> Self:
        """Select columns.

        Parameters
        ----------
        X : ndarray of shape (n_samples, n_columns)
            Finite.
        y : ndarray of shape (n_samples,)
            Classes.
        groups : ndarray of shape (n_samples,), optional
            Samples of one group are never divided between the parts of an inner fold.

        Raises
        ------
        ValueError
            If a class has one sample only, the costs do not fit the columns, or nothing is affordable.
        """
        X, y = validate_data(self, X, y)
        check_classification_targets(y)
        labels = np.unique(y, return_inverse=True)[1]
        judge = GaussianNB() if self.estimator is None else self.estimator
        if not is_classifier(judge):
            raise ValueError(f"estimator is {judge!r}. Expected a classifier")
        model = self._cost_model(X.shape[1])
        splits = inner_splits(y, groups, self.cv)
        self.path_ = self.explore(model, SubsetScore(judge, X, labels, splits, self.scoring))
        chosen = self.within(np.inf)
        if chosen is None:
            raise ValueError(f"max_cost is {self.max_cost}. Expected at least {model.cheapest:.3g}")
        self.support_ = np.isin(np.arange(X.shape[1]), chosen.columns)
        self.cost_, self.score_ = chosen.cost, chosen.score
        return self

    def explore(self, model: CostModel, criterion: SubsetScore) -> tuple[Subset, ...]:
        """Return every subset on the way, judged by a criterion that several searches may share."""
        search = _Search(self, model, criterion)
        ways: list[Iterable[Subset]] = []
        if self.direction != "backward":
            # Each alone can be far from the best subset, the better of both cannot (Leskovec et al., 2007).
            ways += [search.forward(thrift) for thrift in dict.fromkeys((0.0, self.thrift))]
        if self.direction != "forward":
            ways.append(search.backward(self.thrift))
        return tuple(choice for way in ways for choice in way)

    def within(self, max_cost: float) -> Subset | None:
        """Return the best choice on the way that a smaller budget affords, the cheapest of equals."""
        return best_within(self.path_, max_cost)

    def _cost_model(self, n_columns: int) -> CostModel:
        if isinstance(self.costs, CostModel):
            model = self.costs
        else:
            each = np.ones(n_columns) if self.costs is None else np.asarray(self.costs, dtype=np.float64)
            names = tuple(map(str, range(each.size)))
            model = CostModel(names, names, names, each, np.eye(each.size, dtype=bool))
        if len(model.columns) != n_columns or not (np.isfinite(model.ms) & (model.ms >= 0)).all():
            raise ValueError(
                f"costs are of {len(model.columns)} columns, X has {n_columns}. "
                "Expected a finite cost of at least 0 for each"
            )
        return model

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_

    def _transform(self, X: Samples) -> Samples:
        # In rows, as a pruned pipeline's columns lie: sums then come out the same to the last bit.
        return np.ascontiguousarray(super()._transform(X))

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags


def best_within(path: Iterable[Subset], max_cost: float) -> Subset | None:
    """Return the best choice of a path that a budget affords, the cheapest of equals; None without one."""
    affordable = [choice for choice in path if choice.cost <= max_cost]
    return max(affordable, key=lambda choice: (choice.score, -choice.cost), default=None)


class _Search:
    """One search: what columns cost, how good they are, and the settings of the selector."""

    def __init__(self, settings: CostAwareSelector, model: CostModel, score: SubsetScore) -> None:
        self.settings, self.model, self.score = settings, model, score
        self.budget = np.inf if settings.max_cost is None else settings.max_cost
        self.most = len(model.columns) if settings.max_features is None else settings.max_features
        names = np.array(model.features)
        # The columns of each feature, by number; what a move costs at least.
        self.features = [np.flatnonzero(names == f).tolist() for f in dict.fromkeys(model.features)]
        # A hundredth of the total: what is free is not infinitely good.
        self.least = max(0.01 * model.total, np.finfo(np.float64).tiny)

    def forward(self, thrift: float) -> Iterator[Subset]:
        """Yield each better choice: add the move that is worth most, then drop what earns nothing."""
        now = Subset((), self.model.segmentation_ms, self.score.of(()))  # which every choice pays
        while (better := self._add(now, thrift)) is not None:
            now = better
            yield now
            while self.settings.floating and (lighter := self._drop(now)) is not None:
                now = lighter
                yield now

    def backward(self, thrift: float) -> Iterator[Subset]:
        """Yield the full set and what is left of it as features go, to the last.

        The next to go is the feature that loses least for what its going saves.
        """
        now: Subset | None = self._choice(range(len(self.model.columns)))
        while now is not None:
            if now.cost <= self.budget and len(now.columns) <= self.most:
                yield now
            lighter, price = self._without_each(now, columns=False), []
            for choice in lighter:
                loss, saved = now.score - choice.score, max(now.cost - choice.cost, self.least)
                price.append((loss / saved**thrift if loss > 0 else loss, choice.cost))
            now = lighter[price.index(min(price))] if lighter else None

    def _choice(self, columns: Iterable[int]) -> Subset:
        chosen = tuple(sorted(columns))
        return Subset(chosen, self.model.of(chosen), self.score.of(chosen))

    def _add(self, now: Subset, thrift: float) -> Subset | None:
        have = set(now.columns)
        left = [[i for i in feature if i not in have] for feature in self.features]
        if self.settings.unit == "feature":
            added = [rest for rest in left if rest]
        else:  # every single column, then all that is left of every feature
            added = [[i] for i in range(len(self.model.columns)) if i not in have]
            added += [rest for rest in left if len(rest) > 1]
        every = [[*now.columns, *some] for some in added]
        moves = [m for m in every if len(m) <= self.most and self.model.of(m) <= self.budget]
        if not moves:
            return None
        # Single columns are compared at once.
        n = len(now.columns)
        single = [m[-1] for m in moves if len(m) == n + 1]
        found = iter(self.score.adding(now.columns, single) if single else ())
        scores = np.array([next(found) if len(m) == n + 1 else self.score.of(m) for m in moves])
        gain = scores - now.score
        price = np.array([max(self.model.of(m) - now.cost, self.least) for m in moves])
        worth = np.where(gain > self.settings.tolerance, gain / price**thrift, -np.inf)
        if not now.columns and (gain <= self.settings.tolerance).all():
            worth = gain  # something has to be selected
        best = int(worth.argmax())
        if worth[best] == -np.inf:
            return None
        return Subset(tuple(sorted(moves[best])), self.model.of(moves[best]), float(scores[best]))

    def _without_each(self, now: Subset, *, columns: bool) -> list[Subset]:
        """Return what is left when one feature (or one column) goes, unless nothing is."""
        rest = [tuple(c for c in now.columns if c not in feature) for feature in self.features]
        if columns:
            rest += [now.columns[:i] + now.columns[i + 1 :] for i in range(len(now.columns))]
        return [self._choice(r) for r in dict.fromkeys(rest) if 0 < len(r) < len(now.columns)]

    def _drop(self, now: Subset) -> Subset | None:
        """Return the best choice that is cheaper and no worse, or better and no dearer; None without one."""
        lighter = self._without_each(now, columns=self.settings.unit == "column")
        kept = [
            c
            for c in lighter
            if (c.score, now.cost) > (now.score, c.cost) or (c.score >= now.score and c.cost < now.cost)
        ]
        return max(kept, key=lambda c: (now.cost - c.cost, c.score), default=None)
