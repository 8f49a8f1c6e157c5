"""Selection that buys accuracy per millisecond: columns cost what their feature and its transforms cost."""

from collections.abc import Iterable
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MetaEstimatorMixin, is_classifier
from sklearn.feature_selection import SelectorMixin
from sklearn.model_selection import StratifiedGroupKFold, StratifiedKFold
from sklearn.naive_bayes import GaussianNB
from sklearn.utils import Tags
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.experiment.cost import CostModel
from texclass.experiment.protocols import Split
from texclass.recording import Samples
from texclass.tradeoff.cost_search import Choice, Search, Unit, best_within
from texclass.tradeoff.criterion import Criterion, Scoring


def inner_splits(y: NDArray[Any], groups: NDArray[Any] | None, cv: int) -> list[Split]:
    """Return up to `cv` stratified inner folds, not shuffled; samples of one group are never divided.

    Raises
    ------
    ValueError
        If a class has one sample (or one group) only.
    """
    classes, counts = np.unique(y, return_counts=True)
    if groups is not None:
        counts = np.array([np.unique(np.asarray(groups)[y == label]).size for label in classes])
    n_folds = min(cv, int(counts.min()))
    if n_folds < 2:
        lonely, what = classes[counts.argmin()], "sample" if groups is None else "group"
        raise ValueError(f"class {lonely} has 1 {what} to train on; selection needs at least 2 of each")
    folds = StratifiedKFold(n_folds) if groups is None else StratifiedGroupKFold(n_folds)
    return list(folds.split(np.zeros(len(y)), y, groups))


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
        See `Criterion`.
    cv : int
        Inner stratified folds, not shuffled; reduced to the size of the smallest class.

    Attributes
    ----------
    support_ : ndarray of bool, shape (n_columns,)
        Which columns are selected.
    path_ : tuple of Choice
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
            raise ValueError(f"estimator is {judge!r}; the rule is a classifier")
        model = self._cost_model(X.shape[1])
        splits = inner_splits(y, groups, self.cv)
        self.path_ = self.explore(model, Criterion(judge, X, labels, splits, self.scoring))
        chosen = self.within(np.inf)
        if chosen is None:
            least = min(model.of([i]) for i in range(X.shape[1]))
            raise ValueError(f"max_cost is {self.max_cost}; the rule is at least {least:.3g}")
        self.support_ = np.isin(np.arange(X.shape[1]), chosen.columns)
        self.cost_, self.score_ = chosen.cost, chosen.score
        return self

    def explore(self, model: CostModel, criterion: Criterion) -> tuple[Choice, ...]:
        """Return every subset on the way, judged by a criterion that several searches may share."""
        budget = np.inf if self.max_cost is None else self.max_cost
        most = len(model.columns) if self.max_features is None else self.max_features
        search = Search(
            model, criterion, budget, most, floating=self.floating, unit=self.unit, tolerance=self.tolerance
        )
        ways: list[Iterable[Choice]] = []
        if self.direction != "backward":
            # Each alone can be far from the best subset, the better of both cannot (Leskovec et al., 2007).
            ways += [search.forward(thrift) for thrift in dict.fromkeys((0.0, self.thrift))]
        if self.direction != "forward":
            ways.append(search.backward(self.thrift))
        return tuple(choice for way in ways for choice in way)

    def within(self, max_cost: float) -> Choice | None:
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
                f"costs are of {len(model.columns)} columns, X has {n_columns}; "
                "the rule is a finite cost of at least 0 for each"
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
