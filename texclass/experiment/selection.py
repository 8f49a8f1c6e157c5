"""Selection of columns by cross-validation, fast where a classifier's scores have a closed form.

`SubsetScore` says how good a subset of columns is. For the simplest classifiers it fits each fold once, not
once a subset (`closed_form`); all others are fitted again.
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax
from sklearn.base import BaseEstimator, MetaEstimatorMixin
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.feature_selection import SelectorMixin
from sklearn.model_selection import StratifiedGroupKFold, StratifiedKFold
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from texclass.experiment.folds import Fold, without_remarks
from texclass.experiment.kernel_discriminant import class_means
from texclass.experiment.protocols import Split
from texclass.recording import Samples

Labels = NDArray[np.intp]
Scores = Callable[[list[int], Labels], Samples]
"""(columns selected so far, candidates) -> scores (n_candidates, n_test, n_prototypes) with each added."""
Scoring = Literal["accuracy", "log_likelihood"]
COLLINEAR = 1e-8
"""Relative eigenvalue of the within-class correlation below which a direction is dropped, as sklearn does."""


class ForwardSelector(SelectorMixin, MetaEstimatorMixin, BaseEstimator):  # type: ignore[misc]
    """Add columns one by one, each time the one that helps the classifier most in an inner cross-validation.

    The choice is that of `sklearn.feature_selection.SequentialFeatureSelector` with stratified folds.
    The scores of Gaussian naive Bayes, of the nearest class mean and of the nearest neighbour add up over
    columns, and linear discriminants need only the class means and one covariance; so each inner fold is
    fitted once and candidates are compared without fitting again. Any other classifier is fitted again and
    again.

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
        check_classification_targets(y)
        labels, splits = np.unique(y, return_inverse=True)[1], inner_splits(y, None, self.cv)
        every = np.arange(X.shape[1])
        if every.size <= self.n_features_to_select:
            self.support_ = np.ones(every.size, dtype=bool)
            return self
        score, selected = SubsetScore(self.estimator, X, labels, splits), list[int]()
        while len(selected) < self.n_features_to_select:
            candidates = np.setdiff1d(every, selected)
            selected.append(int(candidates[score.adding(selected, candidates.tolist()).argmax()]))
        self.support_ = np.isin(every, selected)
        return self

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_


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


class SubsetScore:
    """Cross-validated score of any subset of columns; larger is better.

    Parameters
    ----------
    estimator : classifier
        Unfitted; fitted once a fold if `closed_form` knows it, else once a fold and subset.
    X : ndarray of shape (n_samples, n_columns)
        Finite.
    labels : ndarray of shape (n_samples,)
        0 ... n_classes - 1.
    splits : list of (train, test)
        Inner folds.
    scoring : {"accuracy", "log_likelihood"}
        Share of hits, or the mean log probability of the true class, which still tells columns apart where
        the accuracy is saturated. For a classifier without probabilities it is the accuracy.
    """

    def __init__(
        self,
        estimator: Any,
        X: Samples,
        labels: Labels,
        splits: Sequence[Split],
        scoring: Scoring = "accuracy",
    ) -> None:
        self.estimator, self.labels = estimator, labels
        self.folds = [Fold(X, labels, split) for split in splits]
        forms = [closed_form(estimator, fold.learnt, fold.labels, fold.asked) for fold in self.folds]
        self.forms = [form for form in forms if form is not None]
        self.fast = len(self.forms) == len(self.folds)
        summing = isinstance(estimator, GaussianNB | LinearDiscriminantAnalysis)
        probable = summing if self.fast else hasattr(estimator, "predict_proba")
        self.soft = scoring == "log_likelihood" and probable
        self._known: dict[tuple[int, ...], float] = {}

    def of(self, columns: Sequence[int]) -> float:
        """Return the score of a subset; of none, that of guessing by the classes' shares."""
        if not len(columns):
            shares = np.bincount(self.labels) / len(self.labels)
            return float(shares @ np.log(shares)) if self.soft else float(shares.max())
        return float(self.adding(columns[:-1], columns[-1:])[0])

    def adding(self, selected: Sequence[int], candidates: Sequence[int]) -> Samples:
        """Return the score of `selected` with each of the candidates added, shape (n_candidates,)."""
        keys = [tuple(sorted((*selected, c))) for c in candidates]
        new = [c for c, key in zip(candidates, keys, strict=True) if key not in self._known]
        if new:
            scores = self._scores(selected, new)
            self._known |= {tuple(sorted((*selected, c))): float(s) for c, s in zip(new, scores, strict=True)}
        return np.array([self._known[key] for key in keys])

    def _scores(self, selected: Sequence[int], candidates: Sequence[int]) -> Samples:
        if self.fast:
            some, parts = np.asarray(candidates, dtype=np.intp), []
            for (scores_of, labels), fold in zip(self.forms, self.folds, strict=True):
                scores = scores_of(list(selected), some)
                if self.soft:
                    log_p = log_softmax(scores, axis=2)
                    parts.append(log_p[:, np.arange(fold.truth.size), fold.truth].mean(axis=1))
                else:
                    parts.append((labels[scores.argmax(axis=2)] == fold.truth).mean(axis=1))
        else:
            with without_remarks():
                parts = [
                    np.array([self._refitted(fold, [*selected, c]) for c in candidates])
                    for fold in self.folds
                ]
        # Rounded, so that equal candidates are equal.
        return np.asarray(np.mean(parts, axis=0).round(12))

    def _refitted(self, fold: Fold, columns: list[int]) -> float:
        if not self.soft:
            return float(fold.hits(self.estimator, columns).mean())
        p = fold.fitted(self.estimator, columns).predict_proba(fold.asked[:, columns])
        told = p[np.arange(fold.truth.size), fold.truth]
        return float(np.log(np.maximum(told, np.finfo(np.float64).tiny)).mean())


def closed_form(
    estimator: Any, train: Samples, labels: Labels, test: Samples
) -> tuple[Scores, Labels] | None:
    """Return a classifier fitted on a fold, able to answer for any subset; None without a closed form.

    Parameters
    ----------
    estimator : classifier
        Unfitted: `GaussianNB`, `NearestCentroid`, one nearest neighbour or `LinearDiscriminantAnalysis`,
        their parameters nearly as they come.
    train, test : ndarray of shape (n_samples, n_columns)
        Of the fold.
    labels : ndarray of shape (n_train,)
        0 ... n_classes - 1.

    Returns
    -------
    callable
        See `Scores`; the largest wins.
    ndarray of shape (n_prototypes,)
        The class of each prototype (a class mean, or for the nearest neighbour a training sample).
    """
    kind, classes = type(estimator), np.arange(labels.max() + 1)
    shares = np.log(np.bincount(labels) / len(labels))
    if kind is GaussianNB and estimator.priors is None:
        # log N(x; mean, variance) of each column, sample and class, without -log(2 pi) / 2.
        mean = class_means(train, labels)
        smoothing = estimator.var_smoothing * train.var(axis=0).max()
        variance = class_means((train - mean[labels]) ** 2, labels) + smoothing
        variance = np.maximum(variance, np.finfo(np.float64).tiny).T[:, None, :]
        terms = -0.5 * (np.log(variance) + (test.T[:, :, None] - mean.T[:, None, :]) ** 2 / variance)
        return _sums(terms, shares), classes
    if kind is NearestCentroid:
        uniform = getattr(estimator, "priors", "uniform") == "uniform"
        if estimator.metric == "euclidean" and estimator.shrink_threshold is None and uniform:
            return _sums(_distance_terms(class_means(train, labels), test)), classes
    if kind is KNeighborsClassifier:
        euclidean = (estimator.metric, estimator.p) == ("minkowski", 2) or estimator.metric == "euclidean"
        if estimator.n_neighbors == 1 and euclidean:
            return _sums(_distance_terms(train, test)), labels
    if kind is LinearDiscriminantAnalysis:
        plain = estimator.priors is None and estimator.covariance_estimator is None
        if plain and (estimator.shrinkage is None or isinstance(estimator.shrinkage, int | float)):
            shrinkage = float(estimator.shrinkage or 0.0)
            return _discriminant(train, labels, test, shares, shrinkage), classes
    return None


def _sums(terms: Samples, constant: Samples | float = 0.0) -> Scores:
    """Scores that are sums of terms (n_columns, n_test, n_prototypes) over columns."""
    return lambda selected, candidates: terms[candidates] + (terms[selected].sum(axis=0) + constant)


def _distance_terms(prototypes: Samples, test: Samples) -> Samples:
    return np.asarray(-((test.T[:, :, None] - prototypes.T[:, None, :]) ** 2))


def _discriminant(
    train: Samples, labels: Labels, test: Samples, log_priors: Samples, shrinkage: float
) -> Scores:
    """Linear discriminants of any subset of columns, from class means m and the within-class covariance W.

    score = (x - m / 2)' W^-1 m + log prior, W shrunk towards a multiple of the identity within the subset.
    """
    means = class_means(train, labels)
    residual = train - means[labels]
    # The divisor is sklearn's: n - n_classes in its svd solver, n where shrinkage asks for another solver.
    free = len(train) - (0 if shrinkage else len(means))
    # One sample a class has no spread; then the nearest class mean is meant, all columns counting alike.
    within = residual.T @ residual / free if free else np.eye(train.shape[1])

    def scores(selected: list[int], candidates: Labels) -> Samples:
        columns = np.column_stack([np.tile(selected, (len(candidates), 1)).astype(int), candidates])
        inverse = _inverse(within[columns[:, :, None], columns[:, None, :]], shrinkage)
        m = means[:, columns].swapaxes(0, 1)
        weights = inverse @ m.swapaxes(1, 2)
        bias = log_priors - 0.5 * np.einsum("ckp,cpk->ck", m, weights)
        return np.asarray(test[:, columns].swapaxes(0, 1) @ weights + bias[:, None, :])

    return scores


def _inverse(covariance: Samples, shrinkage: float) -> Samples:
    """Pseudo-inverse of covariances (n, p, p) by their correlation, which no unit of a column can upset."""
    p = covariance.shape[1]
    level = np.trace(covariance, axis1=1, axis2=2)[:, None, None] / p
    covariance = (1 - shrinkage) * covariance + shrinkage * level * np.eye(p)
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    deviation = np.where(deviation > 0, deviation, 1.0)
    scale = deviation[:, :, None] * deviation[:, None, :]
    if shrinkage > COLLINEAR**0.5 and (level > 0).all():  # positive definite: ten times faster
        return np.asarray(np.linalg.inv(covariance / scale) / scale)
    return np.asarray(np.linalg.pinv(covariance / scale, rcond=COLLINEAR, hermitian=True) / scale)
