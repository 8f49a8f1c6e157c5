"""Cross-validation loop: fit on the training set of each fold, and predict its test set.

All cross-validation in texclass uses `map_folds`. For each fold, it fits the preparation of the columns on
the training set and passes a `Fold` to a function, which fits classifiers and evaluates their predictions.
`evaluate` passes a function that computes accuracies. Any other function can be used in the same way:

>>> import numpy as np
>>> X, y = np.array([[0.0], [0.1], [5.0], [5.1]]), np.array(["cork", "cork", "slate", "slate"])
>>> splits = [(np.array([0, 2]), np.array([1, 3]))]
>>> from sklearn.neighbors import KNeighborsClassifier
>>> map_folds(lambda fold: fold.fit(KNeighborsClassifier(1)).predict(fold.X_test).tolist(), X, y, splits)
[['cork', 'slate']]
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from sklearn import config_context

from texclass.classifiers.fitting import fit, fit_varying, quiet_fits
from texclass.evaluation.accuracy import Accuracy, score
from texclass.evaluation.splits import Indices, Split
from texclass.evaluation.workers import one_thread
from texclass.recording import Samples

Labels = NDArray[Any]
R = TypeVar("R")


class Fold:
    """One fold of cross-validation: training set and test set, with a preparation fitted on the training set.

    Parameters
    ----------
    X : ndarray of shape (n_recordings, n_columns)
        Features; NaN where undefined.
    y : ndarray of shape (n_recordings,)
        Surfaces.
    split : (train, test)
        Row indices of the training set and of the test set.
    preparation : transformer, optional
        Imputation, scaling and selection (default: none).
    nested : bool
        Whether to fit the preparation on the training set (default True). If False, the preparation must
        already be fitted, for example on all rows including test sets.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.neighbors import KNeighborsClassifier
    >>> X, y = np.array([[0.0], [0.1], [5.0], [5.1]]), np.array(["cork", "cork", "slate", "slate"])
    >>> fold = Fold(X, y, (np.array([0, 2]), np.array([1, 3])))
    >>> fold.hits(KNeighborsClassifier(1))
    array([ True,  True])
    """

    def __init__(
        self, X: Samples, y: Labels, split: Split, preparation: Any = None, *, nested: bool = True
    ) -> None:
        self.train, self.test = split
        self.y_train, self.y_test = y[self.train], y[self.test]
        self._X, self._unfitted, self._nested = X, preparation, nested

    @cached_property
    def preparation(self) -> Any:
        """Preparation, fitted on the training set if `nested` is True."""
        if self._unfitted is None or not self._nested:
            return self._unfitted
        return fit(self._unfitted, self._X[self.train], self.y_train)

    @cached_property
    def X_train(self) -> Samples:  # noqa: N802 - name of scikit-learn
        """Prepared training set, shape (n_train, n_prepared)."""
        return self._prepare(self.train)

    @cached_property
    def X_test(self) -> Samples:  # noqa: N802 - name of scikit-learn
        """Prepared test set, shape (n_test, n_prepared)."""
        return self._prepare(self.test)

    @property
    def support(self) -> Samples:
        """Whether the preparation selects (1) or drops (0) each column, shape (n_columns,)."""
        n_columns = self._X.shape[1]
        selector = getattr(self.preparation, "steps", [("", self.preparation)])[-1][1]
        mask = selector.get_support() if hasattr(selector, "get_support") else np.ones(n_columns)
        return np.asarray(mask if len(mask) == n_columns else np.ones(n_columns), dtype=np.float64)

    def fit(self, classifier: Any, columns: Sequence[int] | slice = slice(None)) -> Any:
        """Return a clone of a classifier, fitted on these prepared columns of the training set."""
        return fit_varying(classifier, self.X_train[:, columns], self.y_train)

    def hits(self, classifier: Any, columns: Sequence[int] | slice = slice(None)) -> NDArray[np.bool_]:
        """Fit a clone of a classifier. Return whether each test prediction is correct, shape (n_test,)."""
        return np.asarray(self.fit(classifier, columns).predict(self.X_test[:, columns]) == self.y_test)

    def _prepare(self, rows: Indices) -> Samples:
        X = self._X[rows]
        prepared = X if self.preparation is None else self.preparation.transform(X)
        # `map_folds` disables the finiteness check of scikit-learn to save time.
        if not np.isfinite(prepared).all():
            raise ValueError(
                "the classifier receives undefined features (NaN). Add a step to the pipeline that replaces "
                "them, such as sklearn.impute.SimpleImputer"
            )
        return np.asarray(prepared)


def map_folds(
    work: Callable[[Fold], R],
    X: Samples,
    y: Labels,
    splits: Sequence[Split],
    preparation: Any = None,
    *,
    nested: bool = True,
) -> list[R]:
    """Call a function with each fold of a cross-validation and return its results.

    Parameters
    ----------
    work : callable
        Function that takes a `Fold` and returns any result.
    X, y, preparation
        See `Fold`. The preparation must be unfitted.
    splits : sequence of (train, test)
        Row indices of each fold.
    nested : bool
        Whether to fit the preparation in each fold (default True). If False, it is fitted once on all
        recordings, including the test sets, and accuracies are optimistic.

    Returns
    -------
    list
        Result of the function for each fold.

    Raises
    ------
    ValueError
        If a prepared column contains a value that is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> X, y = np.array([[0.0], [0.1], [5.0], [5.1]]), np.array(["cork", "cork", "slate", "slate"])
    >>> splits = [(np.array([0, 2]), np.array([1, 3])), (np.array([1, 3]), np.array([0, 2]))]
    >>> map_folds(lambda fold: fold.X_test[:, 0].tolist(), X, y, splits)
    [[0.1, 5.1], [0.0, 5.0]]
    """
    with (
        quiet_fits(),
        one_thread(),
        config_context(assume_finite=True, skip_parameter_validation=True),
    ):
        if preparation is not None and not nested:
            preparation = fit(preparation, X, y)
        return [work(Fold(X, y, split, preparation, nested=nested)) for split in splits]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Predictions for the test recordings of every fold, with their accuracy and cost.

    Attributes
    ----------
    y_true, y_pred : tuple of ndarray of shape (n_test,)
        True and predicted labels of each fold.
    accuracy : Accuracy
        Accuracy pooled over the folds, and accuracy of each fold.
    support : ndarray of shape (n_columns,)
        Fraction of the folds in which each column is selected for the classifier.
    fit_s, predict_s : float
        CPU time in s, averaged over folds. `fit_s` is the time to prepare a training set and fit the
        classifier; `predict_s` is the time to prepare and predict one test recording.
    """

    y_true: tuple[Labels, ...]
    y_pred: tuple[Labels, ...]
    accuracy: Accuracy
    support: Samples
    fit_s: float
    predict_s: float

    @property
    def hits(self) -> tuple[NDArray[np.bool_], ...]:
        """Whether each prediction is correct, by fold."""
        return tuple(t == p for t, p in zip(self.y_true, self.y_pred, strict=True))


def evaluate(
    X: Samples,
    y: Labels,
    splits: Sequence[Split],
    preparation: Any,
    classifier: Any,
    *,
    nested: bool = True,
    clusters: Labels | None = None,
    independent: Labels | None = None,
) -> Evaluation:
    """Evaluate one classifier by cross-validation; `evaluate_each` describes the parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.neighbors import KNeighborsClassifier
    >>> from sklearn.preprocessing import StandardScaler
    >>> X, y = np.array([[0.0], [0.1], [5.0], [5.1]]), np.array(["cork", "cork", "slate", "slate"])
    >>> splits = [(np.array([0, 2]), np.array([1, 3])), (np.array([1, 3]), np.array([0, 2]))]
    >>> evaluate(X, y, splits, StandardScaler(), KNeighborsClassifier(1)).accuracy.mean
    1.0
    """
    options: dict[str, Any] = {"nested": nested, "clusters": clusters, "independent": independent}
    return evaluate_each(X, y, splits, preparation, [classifier], **options)[0]


def evaluate_each(
    X: Samples,
    y: Labels,
    splits: Sequence[Split],
    preparation: Any,
    classifiers: Sequence[Any],
    *,
    nested: bool = True,
    clusters: Labels | None = None,
    independent: Labels | None = None,
) -> list[Evaluation]:
    """Evaluate several classifiers with the same preparation, which is fitted once per fold.

    Parameters
    ----------
    X, y, splits, preparation, nested
        See `map_folds`.
    classifiers : sequence of classifier
        Unfitted classifiers.
    clusters, independent : ndarray of shape (n_recordings,), optional
        Recording (or run) of each row of X, and independent unit of each row, for example the operator; see
        `score`.

    Returns
    -------
    list of Evaluation
        Evaluation of each classifier. Every `fit_s` and `predict_s` includes the time of the preparation.
    """

    def predict(fold: Fold) -> list[tuple[Labels, Samples, float, float]]:
        clock = time.process_time
        times = [clock()]
        for subset in ("X_train", "X_test"):  # the first access runs the preparation
            getattr(fold, subset)
            times.append(clock())
        prepare_train_s, prepare_test_s = np.diff(times).tolist()
        results = []
        for classifier in classifiers:
            fit_start = clock()
            model = fold.fit(classifier)
            predict_start = clock()
            labels = model.predict(fold.X_test)
            predict_s = (prepare_test_s + clock() - predict_start) / len(fold.test)
            results.append((labels, fold.support, prepare_train_s + predict_start - fit_start, predict_s))
        return results

    y_true = tuple(y[test] for _, test in splits)
    test_clusters, test_units = (
        None if groups is None else [groups[test] for _, test in splits] for groups in (clusters, independent)
    )
    evaluations = []
    for results in zip(*map_folds(predict, X, y, splits, preparation, nested=nested), strict=True):
        y_pred, support, *seconds = zip(*results, strict=True)
        accuracy = score(y_true, y_pred, test_clusters, test_units)
        costs = np.mean(seconds, axis=1).tolist()
        evaluations.append(Evaluation(y_true, y_pred, accuracy, np.mean(support, axis=0), *costs))
    return evaluations
