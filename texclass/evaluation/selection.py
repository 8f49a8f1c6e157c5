"""Selection of columns by cross-validation, fast where a classifier's scores have a closed form.

`SubsetScore` returns the score of a subset of columns. For the simplest classifiers it prepares each fold
once, not once per subset (`closed_form`); all other classifiers are fitted to each subset.
"""

from collections.abc import Callable, Sequence
from functools import cache
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

from texclass.classifiers.kernel_discriminant import class_means
from texclass.evaluation.folds import Fold, without_remarks
from texclass.evaluation.splits import Split
from texclass.recording import Samples

Labels = NDArray[np.intp]
Scores = Callable[[list[int], Labels], tuple[Samples, Samples]]
"""(selected columns, candidates) -> scores (n_candidates, n_test, n_classes) with each candidate added, and
a bound on their rounding error (n_candidates,), infinite where only a fit gives the answer."""
Scoring = Literal["accuracy", "log_likelihood"]
ROUNDING = 1e-11
"""Bound on the rounding error of a score, ours or scikit-learn's, relative to the largest term of its sum."""
FLAT = 1e-6
"""Deviation within classes, relative to the largest magnitude of a column, below which rounding decides."""
COLLINEAR = 1e-6
"""Smallest eigenvalue of a correlation matrix of which the closed form is used."""
TINY = float(np.finfo(np.float64).tiny)


class ForwardSelector(SelectorMixin, MetaEstimatorMixin, BaseEstimator):  # type: ignore[misc]
    """Add columns one by one, each time the one that helps the classifier most in an inner cross-validation.

    The choice is that of `sklearn.feature_selection.SequentialFeatureSelector` with stratified folds, ties
    included. The scores of Gaussian naive Bayes, of the nearest class mean and of the nearest neighbour are
    sums over columns, and linear discriminants need only the class means and one covariance. With these
    classifiers each inner fold is prepared once, and a candidate is fitted only where rounding could change a
    prediction: two classes score alike, or columns are collinear or constant. Any other classifier is fitted
    to every candidate.

    Unlike scikit-learn's, the selector does not stop where a classifier cannot be fitted: constant columns
    predict the commonest class, and a singular covariance scores 0.

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
            selected.append(
                int(candidates[score.adding(selected, candidates.tolist(), decimals=None).argmax()])
            )
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
        Unfitted; see `closed_form` for those that are not fitted to every subset.
    X : ndarray of shape (n_samples, n_columns)
        Finite.
    labels : ndarray of shape (n_samples,)
        0 ... n_classes - 1.
    splits : list of (train, test)
        Inner folds.
    scoring : {"accuracy", "log_likelihood"}
        Accuracy, or the mean log probability of the true class, which still separates columns where the
        accuracy is saturated. For a classifier without probabilities it is the accuracy.
    """

    def __init__(
        self,
        estimator: Any,
        X: Samples,
        labels: Labels,
        splits: Sequence[Split],
        scoring: Scoring = "accuracy",
    ) -> None:
        self.X, self.labels, self.splits = X, labels, splits
        self.estimators = [_fittable(estimator, labels[train]) for train, _ in splits]
        self.forms = [
            closed_form(judge, X[train], labels[train], X[test])
            for judge, (train, test) in zip(self.estimators, splits, strict=True)
        ]
        if any(self.forms):
            has_probabilities = isinstance(estimator, GaussianNB | LinearDiscriminantAnalysis)
        else:
            has_probabilities = hasattr(estimator, "predict_proba")
        self.soft = scoring == "log_likelihood" and has_probabilities
        self._means: dict[tuple[int, ...], float] = {}

    def of(self, columns: Sequence[int]) -> float:
        """Return the score of a subset; of none, that of guessing by the class shares."""
        if not len(columns):
            shares = np.bincount(self.labels) / len(self.labels)
            return float(shares @ np.log(shares)) if self.soft else float(shares.max())
        return float(self.adding(columns[:-1], columns[-1:])[0])

    def adding(
        self, selected: Sequence[int], candidates: Sequence[int], decimals: int | None = 12
    ) -> Samples:
        """Return the score of `selected` with each of the candidates added, shape (n_candidates,).

        Means of the same numbers in another order differ by rounding: with `decimals` they are equal, with
        None they are those of `sklearn.model_selection.cross_val_score`.
        """
        keys = [tuple(sorted((*selected, c))) for c in candidates]
        new = [c for c, key in zip(candidates, keys, strict=True) if key not in self._means]
        if new:
            with without_remarks():
                folds = [self._of_fold(i, selected, new) for i in range(len(self.splits))]
            for c, scores in zip(new, np.stack(folds, axis=1), strict=True):
                self._means[tuple(sorted((*selected, c)))] = float(scores.mean())
        means = np.array([self._means[key] for key in keys])
        return means if decimals is None else means.round(decimals)

    def _of_fold(self, i: int, selected: Sequence[int], candidates: Sequence[int]) -> Samples:
        """Return the scores of candidates on one fold; fit those of which the closed form is not certain."""
        form, (train, test) = self.forms[i], self.splits[i]
        scores = np.full(len(candidates), np.nan)
        if form is not None:
            of_classes, error = form(list(selected), np.asarray(candidates, dtype=np.intp))
            classes, truth = np.unique(self.labels[train]), self.labels[test]
            if self.soft:
                scores = _log_likelihood(log_softmax(of_classes, axis=2), classes, truth)
                certain = np.isfinite(error)
            else:
                scores = (classes[of_classes.argmax(axis=2)] == truth).mean(axis=1)
                second, best = np.moveaxis(np.partition(of_classes, -2, axis=2)[:, :, -2:], 2, 0)
                certain = (best - second > error[:, None]).all(axis=1)
            scores[~certain] = np.nan
        for j in np.flatnonzero(np.isnan(scores)):
            scores[j] = self._refitted(i, sorted((*selected, candidates[int(j)])))
        return scores

    def _refitted(self, i: int, columns: list[int]) -> float:
        # Columns in order and rows taken from them, as scikit-learn does: the same rounding.
        fold = Fold(self.X[:, columns], self.labels, self.splits[i])
        try:
            fitted = fold.fitted(self.estimators[i])
        except np.linalg.LinAlgError:
            return float(np.log(TINY)) if self.soft else 0.0
        if not self.soft:
            return float(np.mean(fitted.predict(fold.asked) == fold.truth))
        log_p = np.log(np.maximum(fitted.predict_proba(fold.asked), TINY))
        return float(_log_likelihood(log_p, fitted.classes_, fold.truth))


def _fittable(estimator: Any, labels: Labels) -> Any:
    """Return the classifier, or the nearest class mean where a discriminant has one sample of each class."""
    alone = len(np.unique(labels)) == len(labels)
    return NearestCentroid() if alone and isinstance(estimator, LinearDiscriminantAnalysis) else estimator


def _log_likelihood(log_p: Samples, classes: Labels, truth: Labels) -> Samples:
    """Return the mean log probability of the true class, that of `TINY` where the class was not trained.

    `log_p` is of shape (..., n_test, n_classes).
    """
    column = np.minimum(np.searchsorted(classes, truth), len(classes) - 1)
    of_truth = log_p[..., np.arange(truth.size), column]
    return np.asarray(np.where(classes[column] == truth, of_truth, np.log(TINY)).mean(axis=-1))


def closed_form(estimator: Any, train: Samples, labels: Labels, test: Samples) -> Scores | None:
    """Return the class scores of any subset of columns of a fold; None for classifiers without closed form.

    Parameters
    ----------
    estimator : classifier
        Unfitted: `GaussianNB`, `NearestCentroid`, one nearest neighbour or `LinearDiscriminantAnalysis`
        with any solver and a fixed shrinkage; priors, metric and tolerances mostly at their defaults.
    train, test : ndarray of shape (n_samples, n_columns)
        Rows of the fold.
    labels : ndarray of shape (n_train,)
        Class of each training row.

    Returns
    -------
    callable
        See `Scores`; the class with the largest score is predicted. Classes are in the order of `np.unique`.
    """
    classes, labels = np.unique(labels, return_inverse=True)
    kind, priors = type(estimator), getattr(estimator, "priors", None)
    if len(classes) < 2:
        return None
    if kind is GaussianNB and priors is None:
        return _naive_bayes(train, labels, test, estimator.var_smoothing)
    if kind is NearestCentroid:
        plain = estimator.metric == "euclidean" and estimator.shrink_threshold is None
        means = class_means(train, labels)
        return _nearest(means, np.arange(len(means)), test) if plain and priors == "uniform" else None
    if kind is KNeighborsClassifier:
        euclidean = (estimator.metric, estimator.p) == ("minkowski", 2) or estimator.metric == "euclidean"
        plain = euclidean and estimator.n_neighbors == 1 and estimator.metric_params is None
        return _nearest(train, labels, test) if plain else None
    if kind is LinearDiscriminantAnalysis and priors is None and estimator.covariance_estimator is None:
        return _discriminant(estimator, train, labels, test)
    return None


def _nearest(prototypes: Samples, labels: Labels, test: Samples) -> Scores:
    """Nearest prototype m of each class: |x - m|^2 is smallest where the sum of x m - m^2/2 is largest."""
    order = np.argsort(labels, kind="stable")
    starts, m = np.flatnonzero(np.diff(labels[order], prepend=-1)), prototypes[order].T[:, None, :]
    terms = test.T[:, :, None] * m - m**2 / 2
    magnitude = np.maximum(np.abs(prototypes).max(axis=0), np.abs(test).max(axis=0)) ** 2

    def scores(selected: list[int], candidates: Labels) -> tuple[Samples, Samples]:
        sums = terms[candidates] + terms[selected].sum(axis=0)
        best = sums if len(starts) == len(labels) else np.maximum.reduceat(sums, starts, axis=2)
        return best, ROUNDING * (magnitude[candidates] + magnitude[selected].sum())

    return scores


def _naive_bayes(train: Samples, labels: Labels, test: Samples, var_smoothing: float) -> Scores:
    """Gaussian naive Bayes: log prior + sum over columns of log N(x; m, v + e), without log(2 pi)/2.

    e is `var_smoothing` times the largest variance of the columns of the subset.
    """
    m, total = class_means(train, labels), train.var(axis=0)
    v = class_means((train - m[labels]) ** 2, labels)
    log_priors = np.log(np.bincount(labels) / len(labels))
    largest = np.maximum(np.abs(train).max(axis=0), np.abs(test).max(axis=0))

    def terms(columns: Any, variance: float) -> tuple[Samples, Samples]:
        ve = (v[:, columns] + var_smoothing * variance).T[:, None, :]
        flat = np.sqrt(ve.min(axis=(1, 2))) <= FLAT * largest[columns]
        ve = np.where(ve > 0, ve, 1.0)
        # log N(x; m, v + e)
        log_n = -0.5 * (np.log(ve) + (test.T[columns, :, None] - m.T[columns, None, :]) ** 2 / ve)
        return log_n, np.where(flat, np.inf, ROUNDING * np.abs(log_n).max(axis=(1, 2)))

    def scores(selected: list[int], candidates: Labels) -> tuple[Samples, Samples]:
        shared = float(total[selected].max(initial=0.0))
        log_n, error = terms(candidates, shared)
        before, error_before = terms(selected, shared) if selected else (np.zeros((1, 1, 1)), np.zeros(1))
        sums, errors = log_n + (before.sum(axis=0) + log_priors), error + error_before.sum()
        for i in np.flatnonzero(total[candidates] > shared):  # which raise the variance that e depends on
            log_n, error = terms([*selected, candidates[i]], float(total[candidates[i]]))
            sums[i], errors[i] = log_n.sum(axis=0) + log_priors, error.sum()
        return sums, errors

    return scores


@cache
def svd_degrees_of_freedom_per_class() -> float:
    """Return c of the divisor n - c n_classes of the covariance in scikit-learn's svd solver.

    It is 1 up to scikit-learn 1.8 and 0 from 1.9 on. A small example measures it: the class means are 1 and
    12, the scatter is 2 + 8, and the coefficient is (12 - 1)/(scatter/divisor).
    """
    fitted = LinearDiscriminantAnalysis().fit([[0.0], [2.0], [10.0], [12.0], [14.0]], [0, 0, 1, 1, 1])
    divisor = float(fitted.coef_[0, 0]) * 10 / 11
    return round((5 - divisor) / 2, 9)


def _discriminant(estimator: Any, train: Samples, labels: Labels, test: Samples) -> Scores | None:
    """Linear discriminants of any subset of columns, from class means m and the within-class covariance W.

    score = x' W^-1 m - m' W^-1 m/2 + log prior, W shrunk within the subset to a multiple of the identity.
    None where the solver is unknown, or refuses the shrinkage.
    """
    svd, shrinkage, counts = estimator.solver == "svd", estimator.shrinkage, np.bincount(labels)
    if estimator.solver not in ("svd", "lsqr", "eigen") or (svd and shrinkage is not None):
        return None
    if not isinstance(shrinkage, int | float | None):
        return None
    shrinkage, tol = float(shrinkage or 0.0), estimator.tol if svd else 0.0
    divisor = len(train) - (svd_degrees_of_freedom_per_class() * len(counts) if svd else 0)
    if divisor <= 0:
        return None
    means, shares = class_means(train, labels), counts / len(train)
    residual = train - means[labels]
    within = residual.T @ residual / divisor
    largest = np.maximum(np.abs(train).max(axis=0), np.abs(test).max(axis=0))
    is_flat = np.sqrt(np.diagonal(within)) <= FLAT * largest
    centre = shares @ means

    def scores(selected: list[int], candidates: Labels) -> tuple[Samples, Samples]:
        columns = np.column_stack([np.tile(selected, (len(candidates), 1)).astype(int), candidates])
        deviation, whitening, smallest = _whitening(
            within[columns[:, :, None], columns[:, None, :]], shrinkage
        )
        x, m = ((a - centre)[:, columns].swapaxes(0, 1) @ whitening for a in (test, means))
        magnitude = ((largest[columns] / deviation) ** 2).sum(axis=1) / smallest
        doubtful = is_flat[columns].any(axis=1) | (smallest < max(COLLINEAR, 2 * tol**2))
        if svd:
            doubtful |= _is_truncated(np.sqrt(counts)[:, None] * m, tol)
        # x' W^-1 m - m' W^-1 m/2 + log prior, whitened, from the common centre
        of_classes = x @ m.swapaxes(1, 2) + (np.log(shares) - 0.5 * (m**2).sum(axis=2))[:, None, :]
        return of_classes, np.where(doubtful, np.inf, ROUNDING * magnitude)

    return scores


def _whitening(covariance: Samples, shrinkage: float) -> tuple[Samples, Samples, Samples]:
    """Return deviations (n, p) and B (n, p, p), B B' = W^-1, of covariances W (n, p, p).

    The correlation is inverted, whose smallest eigenvalue (n,) no unit of a column changes.
    """
    p = covariance.shape[1]
    level = np.trace(covariance, axis1=1, axis2=2)[:, None, None] / p
    covariance = (1 - shrinkage) * covariance + shrinkage * level * np.eye(p)
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    deviation = np.where(deviation > 0, deviation, 1.0)
    eigenvalues, vectors = np.linalg.eigh(covariance / (deviation[:, :, None] * deviation[:, None, :]))
    eigenvalues = np.maximum(eigenvalues, np.finfo(np.float64).eps)
    return deviation, vectors / np.sqrt(eigenvalues)[:, None, :] / deviation[:, :, None], eigenvalues[:, 0]


def _is_truncated(centres: Samples, tol: float) -> NDArray[np.bool_]:
    """Return where the svd solver may drop a direction of weighted class centres (n, n_classes, p).

    It drops singular values below `tol` times the largest; those that are 0 but for rounding do not matter.
    """
    squares = np.linalg.eigvalsh(centres.swapaxes(1, 2) @ centres)
    ratio = squares / np.maximum(squares[:, -1:], TINY)
    return np.asarray(((ratio > 1e-13) & (ratio < 2 * tol**2)).any(axis=1))
