"""Sequential forward selection, fast where a classifier's cross-validated scores have a closed form."""

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, MetaEstimatorMixin
from sklearn.feature_selection import SelectorMixin, SequentialFeatureSelector
from sklearn.model_selection import StratifiedKFold
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.experiment.closed_form import ClosedForm, Labels, closed_form
from texclass.recording import Samples


class ForwardSelector(SelectorMixin, MetaEstimatorMixin, BaseEstimator):  # type: ignore[misc]
    """Add columns one by one, each time the one that helps the classifier most in an inner cross-validation.

    The choice is that of `sklearn.feature_selection.SequentialFeatureSelector` with stratified folds.
    The scores of Gaussian naive Bayes, of the nearest class mean and of the nearest neighbour add up over
    columns, and linear discriminants need only the class means and one covariance; so each inner fold is
    fitted once and candidates are compared without fitting again: 40 to 360 times faster than refitting
    (12 of 20 columns, 24 to 69 classes of 9 samples). Any other classifier goes to scikit-learn's selector.

    Parameters
    ----------
    estimator : classifier
        Whose accuracy decides.
    n_features_to_select : int
        Number of columns; all are kept when there are not more.
    cv : int
        Inner stratified folds, not shuffled; reduced to the size of the smallest class.

    Attributes
    ----------
    support_ : ndarray of shape (n_columns,)
        Which columns are selected.
    """

    def __init__(self, estimator: Any, *, n_features_to_select: int, cv: int = 3) -> None:
        self.estimator = estimator
        self.n_features_to_select = n_features_to_select
        self.cv = cv

    def fit(self, X: Samples, y: NDArray[Any]) -> Self:
        """Select columns.

        Raises
        ------
        ValueError
            If a class has one sample only.
        """
        X, y = validate_data(self, X, y)
        classes, labels = np.unique(y, return_inverse=True)
        n_folds = min(self.cv, int(np.bincount(labels).min()))
        if n_folds < 2:
            lonely = classes[np.bincount(labels).argmin()]
            raise ValueError(f"class {lonely} has 1 sample to train on; selection needs at least 2 of each")
        if X.shape[1] <= self.n_features_to_select:
            self.support_ = np.ones(X.shape[1], dtype=bool)
        else:
            self.support_ = self._select(X, labels, n_folds)
        return self

    def _select(self, X: Samples, labels: Labels, n_folds: int) -> NDArray[np.bool_]:
        splits = list(StratifiedKFold(n_folds).split(X, labels))
        found = [closed_form(self.estimator, X[a], labels[a], X[b]) for a, b in splits]
        folds = [fold for fold in found if fold is not None]
        n_select = self.n_features_to_select
        if len(folds) < n_folds:
            search = SequentialFeatureSelector(self.estimator, n_features_to_select=n_select, cv=n_folds)
            support: NDArray[np.bool_] = search.fit(X, labels).get_support()
            return support
        selected = forward_search(folds, [labels[b] for _, b in splits], X.shape[1], n_select)
        return np.isin(np.arange(X.shape[1]), selected)

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_


def forward_search(folds: list[ClosedForm], truths: list[Labels], n_columns: int, n_select: int) -> list[int]:
    """Return the columns in the order in which they were added; of equal candidates the first wins.

    Parameters
    ----------
    folds : list of ClosedForm
        The classifier fitted on each inner fold.
    truths : list of ndarray of shape (n_test,)
        Labels of each inner fold's test samples.
    n_columns, n_select : int
        Size of the pool and of the selection.
    """
    selected: list[int] = []
    while len(selected) < n_select:
        candidates = np.setdiff1d(np.arange(n_columns), selected)
        hits = [
            (fold.predict(selected, candidates) == truth).mean(axis=1)
            for fold, truth in zip(folds, truths, strict=True)
        ]
        # Rounded, so that equal candidates are equal.
        selected.append(int(candidates[np.mean(hits, axis=0).round(12).argmax()]))
    return selected
