"""Cost-aware feature selection: the cost of a column includes its feature and the transforms it needs."""

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
    """Subset of columns (sorted indices), with its cost and its score in inner cross-validation."""

    columns: tuple[int, ...]
    cost: float
    score: float


class CostAwareSelector(SelectorMixin, MetaEstimatorMixin, BaseEstimator):  # type: ignore[misc]
    """Sequential floating selection that maximises the gain of the score per cost.

    Each step adds one column or all remaining columns of one feature, whichever has the largest
    gain / cost^cost_exponent. Columns and features are then removed as long as this does not lower the score.
    The selection ends when no affordable step gains more than `tolerance`.

    Parameters
    ----------
    estimator : classifier, optional
        Classifier whose score in inner cross-validation is maximised (default: Gaussian naive Bayes).
    costs : CostModel or array_like of shape (n_columns,), optional
        Costs of features and shared transforms, or of each column (default: all equal).
    max_cost : float, optional
        Budget in the unit of the costs (default: no limit).
    max_features : int, optional
        Largest number of columns (default: no limit).
    cost_exponent : float
        Exponent of the cost. 0 maximises the gain (plain sequential selection within a budget), 1 (default)
        maximises the gain per cost.
    floating : bool
        Whether to remove columns when this does not lower the score (default True).
    unit : {"feature", "column"}
        "feature" (default): a step adds all columns of a feature. "column": a step can also add one column.
    direction : {"forward", "backward", "both"}
        Direction of the search (default "both").
    tolerance : float
        The search continues only while a step gains more than this (default 0).
    scoring : {"accuracy", "log_likelihood"}
        Score to maximise (default "accuracy"); see `SubsetScore`.
    cv : int
        Number of inner stratified folds without shuffling (default 5), limited to the size of the smallest
        class.

    Attributes
    ----------
    support_ : ndarray of bool, shape (n_columns,)
        Mask of the selected columns.
    path_ : tuple of Subset
        All subsets of the search, in order.
    cost_, score_ : float
        Cost and score of the selected subset.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> y = np.repeat([0, 1], 50)
    >>> X = np.column_stack([y, y, y, y]) + rng.normal(size=(100, 4)) * [0.2, 0.2, 5, 5]
    >>> selector = CostAwareSelector(costs=[9.0, 1.0, 1.0, 1.0]).fit(X, y)
    >>> selector.get_support(indices=True), float(selector.cost_)
    (array([1]), 1.0)
    """

    def __init__(
        self,
        estimator: Any = None,
        *,
        costs: CostModel | ArrayLike | None = None,
        max_cost: float | None = None,
        max_features: int | None = None,
        cost_exponent: float = 1.0,
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
        self.cost_exponent = cost_exponent
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
            Finite features.
        y : ndarray of shape (n_samples,)
            Class labels.
        groups : ndarray of shape (n_samples,), optional
            Groups of samples that stay together in the inner folds.

        Raises
        ------
        ValueError
            If a class has only one sample, the costs do not match the columns, or no column is affordable.
        """
        X, y = validate_data(self, X, y)
        check_classification_targets(y)
        labels = np.unique(y, return_inverse=True)[1]
        estimator = GaussianNB() if self.estimator is None else self.estimator
        if not is_classifier(estimator):
            raise ValueError(f"estimator must be a classifier, got {estimator!r}")
        model = self._cost_model(X.shape[1])
        splits = inner_splits(y, groups, self.cv)
        self.path_ = self.explore(model, SubsetScore(estimator, X, labels, splits, self.scoring))
        best = self.best_within(np.inf)
        if best is None:
            raise ValueError(
                f"max_cost must be at least {model.cheapest:.3g}, the cost of the cheapest column, got "
                f"{self.max_cost}"
            )
        self.support_ = np.isin(np.arange(X.shape[1]), best.columns)
        self.cost_, self.score_ = best.cost, best.score
        return self

    def explore(self, model: CostModel, criterion: SubsetScore) -> tuple[Subset, ...]:
        """Return all subsets of the search, scored by `criterion`, which several searches may share."""
        search = _Search(self, model, criterion)
        paths: list[Iterable[Subset]] = []
        if self.direction != "backward":
            # Either search alone can be far from the best subset, but the better of both never is
            # (Leskovec et al., 2007).
            exponents = dict.fromkeys((0.0, self.cost_exponent))
            paths += [search.forward(exponent) for exponent in exponents]
        if self.direction != "forward":
            paths.append(search.backward(self.cost_exponent))
        return tuple(subset for path in paths for subset in path)

    def best_within(self, max_cost: float) -> Subset | None:
        """Return the best subset of the search within a smaller budget. Ties go to the cheapest subset."""
        return best_within(self.path_, max_cost)

    def _cost_model(self, n_columns: int) -> CostModel:
        if isinstance(self.costs, CostModel):
            model = self.costs
        else:
            costs = np.ones(n_columns) if self.costs is None else np.asarray(self.costs, dtype=np.float64)
            names = tuple(map(str, range(costs.size)))
            model = CostModel(names, names, names, costs, np.eye(costs.size, dtype=bool))
        if len(model.columns) != n_columns or not (np.isfinite(model.ms) & (model.ms >= 0)).all():
            raise ValueError(
                f"costs must contain one finite, non-negative number for each of the {n_columns} columns, "
                f"got {len(model.columns)} costs {model.ms}"
            )
        return model

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_

    def _transform(self, X: Samples) -> Samples:
        # Contiguous like the columns of a pruned pipeline, so that sums are equal to the last bit.
        return np.ascontiguousarray(super()._transform(X))

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags


def best_within(path: Iterable[Subset], max_cost: float) -> Subset | None:
    """Return the best subset of a path within a budget, or None. Ties go to the cheapest subset."""
    affordable = [subset for subset in path if subset.cost <= max_cost]
    return max(affordable, key=lambda subset: (subset.score, -subset.cost), default=None)


class _Search:
    """One search with the settings of a selector, a cost model and a score."""

    def __init__(self, settings: CostAwareSelector, model: CostModel, score: SubsetScore) -> None:
        self.settings, self.model, self.score = settings, model, score
        self.budget = np.inf if settings.max_cost is None else settings.max_cost
        self.max_columns = len(model.columns) if settings.max_features is None else settings.max_features
        names = np.array(model.features)
        # Column indices of each feature.
        self.features = [np.flatnonzero(names == f).tolist() for f in dict.fromkeys(model.features)]
        # Smallest cost of a step: a hundredth of the total, so that a free column has a finite gain per cost.
        self.min_cost = max(0.01 * model.total, np.finfo(np.float64).tiny)

    def forward(self, cost_exponent: float) -> Iterator[Subset]:
        """Add the best columns and then remove columns that do not help; yield each better subset."""
        current = Subset(
            (), self.model.segmentation_ms, self.score.of(())
        )  # the cost of segmentation is fixed
        while (better := self._add(current, cost_exponent)) is not None:
            current = better
            yield current
            while self.settings.floating and (reduced := self._drop(current)) is not None:
                current = reduced
                yield current

    def backward(self, cost_exponent: float) -> Iterator[Subset]:
        """Remove features from the full set, one per step, and yield each subset within the limits.

        Each step removes the feature with the smallest loss of score per saved cost.
        """
        current: Subset | None = self._subset(range(len(self.model.columns)))
        while current is not None:
            if current.cost <= self.budget and len(current.columns) <= self.max_columns:
                yield current
            reduced, losses = self._remove_each(current, columns=False), []
            for subset in reduced:
                loss, saving = current.score - subset.score, max(current.cost - subset.cost, self.min_cost)
                losses.append((loss / saving**cost_exponent if loss > 0 else loss, subset.cost))
            current = reduced[losses.index(min(losses))] if reduced else None

    def _subset(self, columns: Iterable[int]) -> Subset:
        indices = tuple(sorted(columns))
        return Subset(indices, self.model.cost_of_indices(indices), self.score.of(indices))

    def _add(self, current: Subset, cost_exponent: float) -> Subset | None:
        selected = set(current.columns)
        remaining = [[i for i in feature if i not in selected] for feature in self.features]
        if self.settings.unit == "feature":
            additions = [columns for columns in remaining if columns]
        else:  # each single column, and all remaining columns of each feature
            additions = [[i] for i in range(len(self.model.columns)) if i not in selected]
            additions += [columns for columns in remaining if len(columns) > 1]
        subsets = [[*current.columns, *columns] for columns in additions]
        subsets = [
            s for s in subsets if len(s) <= self.max_columns and self.model.cost_of_indices(s) <= self.budget
        ]
        if not subsets:
            return None
        # Scoring all single columns in one call is faster.
        n = len(current.columns)
        single = [s[-1] for s in subsets if len(s) == n + 1]
        single_scores = iter(self.score.adding(current.columns, single) if single else ())
        scores = np.array([next(single_scores) if len(s) == n + 1 else self.score.of(s) for s in subsets])
        gain = scores - current.score
        cost = np.array([max(self.model.cost_of_indices(s) - current.cost, self.min_cost) for s in subsets])
        value = np.where(gain > self.settings.tolerance, gain / cost**cost_exponent, -np.inf)
        if not current.columns and (gain <= self.settings.tolerance).all():
            value = gain  # at least one column must be selected
        best = int(value.argmax())
        if value[best] == -np.inf:
            return None
        return Subset(
            tuple(sorted(subsets[best])), self.model.cost_of_indices(subsets[best]), float(scores[best])
        )

    def _remove_each(self, current: Subset, *, columns: bool) -> list[Subset]:
        """Return the non-empty subsets that remain after removing one feature (or one column)."""
        rest = [tuple(c for c in current.columns if c not in feature) for feature in self.features]
        if columns:
            rest += [current.columns[:i] + current.columns[i + 1 :] for i in range(len(current.columns))]
        return [self._subset(r) for r in dict.fromkeys(rest) if 0 < len(r) < len(current.columns)]

    def _drop(self, current: Subset) -> Subset | None:
        """Return the best subset that is cheaper and not worse, or better at no extra cost, or None."""
        reduced = self._remove_each(current, columns=self.settings.unit == "column")
        improvements = [
            c
            for c in reduced
            if (c.score, current.cost) > (current.score, c.cost)
            or (c.score >= current.score and c.cost < current.cost)
        ]
        return max(improvements, key=lambda c: (current.cost - c.cost, c.score), default=None)
