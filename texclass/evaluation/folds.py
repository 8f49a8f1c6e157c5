"""The one loop over folds: what learns is fitted on the training part, then asked about the test part.

Whatever cross-validates in texclass goes through `over_folds`: it prepares the columns of each fold on its
training rows and hands a `Fold` to a function, which fits and asks classifiers. `evaluate` is the usual such
function; selections under a budget and recognisers that must know strangers have their own:

>>> import numpy as np
>>> X, y = np.array([[0.0], [0.1], [5.0], [5.1]]), np.array(["cork", "cork", "slate", "slate"])
>>> splits = [(np.array([0, 2]), np.array([1, 3]))]
>>> from sklearn.neighbors import NearestCentroid
>>> over_folds(lambda fold: fold.fitted(NearestCentroid()).predict(fold.asked).tolist(), X, y, splits)
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
    """One fold: its rows and labels, and its columns as prepared on the training part alone.

    Parameters
    ----------
    X : ndarray of shape (n_recordings, n_columns)
        Features; NaN where undefined.
    y : ndarray of shape (n_recordings,)
        Surfaces.
    split : (train, test)
        Row numbers.
    preparation : transformer, optional
        Imputation, scaling, selection; columns are taken as they are without it.
    nested : bool
        False says that the preparation is fitted already (on all rows, test parts included).
    """

    def __init__(
        self, X: Samples, y: Labels, split: Split, preparation: Any = None, *, nested: bool = True
    ) -> None:
        self.train, self.test = split
        self.labels, self.truth = y[self.train], y[self.test]
        self._X, self._unfitted, self._nested = X, preparation, nested

    @cached_property
    def preparation(self) -> Any:
        """The preparation, fitted on the training part."""
        if self._unfitted is None or not self._nested:
            return self._unfitted
        return fit(self._unfitted, self._X[self.train], self.labels)

    @cached_property
    def learnt(self) -> Samples:
        """The prepared training rows, shape (n_train, n_prepared)."""
        return self._prepared(self.train)

    @cached_property
    def asked(self) -> Samples:
        """The prepared test rows, shape (n_test, n_prepared)."""
        return self._prepared(self.test)

    @property
    def support(self) -> Samples:
        """Which columns the preparation has selected (1) or left out (0), shape (n_columns,)."""
        n_columns = self._X.shape[1]
        selector = getattr(self.preparation, "steps", [("", self.preparation)])[-1][1]
        mask = selector.get_support() if hasattr(selector, "get_support") else np.ones(n_columns)
        return np.asarray(mask if len(mask) == n_columns else np.ones(n_columns), dtype=np.float64)

    def fitted(self, classifier: Any, columns: Sequence[int] | slice = slice(None)) -> Any:
        """Return a classifier fitted on some of the prepared columns; see `fit_varying`."""
        return fit_varying(classifier, self.learnt[:, columns], self.labels)

    def hits(self, classifier: Any, columns: Sequence[int] | slice = slice(None)) -> NDArray[np.bool_]:
        """Return whether a classifier recognises each row of the test part by some of the columns."""
        return np.asarray(self.fitted(classifier, columns).predict(self.asked[:, columns]) == self.truth)

    def _prepared(self, rows: Indices) -> Samples:
        X = self._X[rows]
        prepared = X if self.preparation is None else self.preparation.transform(X)
        # scikit-learn's own check is switched off in `over_folds`, for speed.
        if not np.isfinite(prepared).all():
            raise ValueError(
                "features are undefined (NaN) at the classifier. Expected a step that fills them, "
                "such as sklearn.impute.SimpleImputer"
            )
        return np.asarray(prepared)


def over_folds(
    work: Callable[[Fold], R],
    X: Samples,
    y: Labels,
    splits: Sequence[Split],
    preparation: Any = None,
    *,
    nested: bool = True,
) -> list[R]:
    """Return what a function makes of each fold.

    Parameters
    ----------
    work : callable
        Fold -> anything.
    X, y, preparation
        See `Fold`; the preparation is unfitted.
    splits : sequence of (train, test)
        Row numbers.
    nested : bool
        False fits the preparation once on all recordings, test folds included: an optimistic accuracy.

    Raises
    ------
    ValueError
        If prepared columns are not finite.
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
    """Predictions of every test recording of every fold.

    Attributes
    ----------
    truth, predicted : tuple of ndarray of shape (n_test,)
        Labels of each fold.
    accuracy : Accuracy
        Pooled, with that of each fold.
    support : ndarray of shape (n_columns,)
        Share of folds in which a column reached the classifier.
    fit_s, predict_s : float
        CPU seconds, means over folds: preparing and fitting the training part; preparing and classifying one
        test recording.
    """

    truth: tuple[Labels, ...]
    predicted: tuple[Labels, ...]
    accuracy: Accuracy
    support: Samples
    fit_s: float
    predict_s: float

    @property
    def hits(self) -> tuple[NDArray[np.bool_], ...]:
        """Whether each test of each fold was right."""
        return tuple(t == p for t, p in zip(self.truth, self.predicted, strict=True))


def evaluate(
    X: Samples, y: Labels, splits: Sequence[Split], preparation: Any, classifier: Any, **options: Any
) -> Evaluation:
    """Fit on each fold's training recordings, predict its test recordings; see `evaluate_each`."""
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
    """Evaluate several classifiers that share their preparation, which is fitted once a fold.

    Parameters
    ----------
    X, y, splits, preparation, nested
        See `over_folds`.
    classifiers : sequence of classifier
        Unfitted.
    clusters, independent : ndarray of shape (n_recordings,), optional
        Which recording or run each row of X is a part of, and which operator or whatever is independent; see
        `score`.

    Returns
    -------
    list of Evaluation
        Of each classifier; the seconds of preparing count for each.
    """

    def answers(fold: Fold) -> list[tuple[Labels, Samples, float, float]]:
        clock = time.process_time
        times = [clock()]
        for part in ("learnt", "asked"):
            getattr(fold, part)
            times.append(clock())
        learnt_s, asked_s = np.diff(times).tolist()
        said = []
        for classifier in classifiers:
            start = clock()
            fitted = fold.fitted(classifier)
            middle = clock()
            predicted = fitted.predict(fold.asked)
            predict_s = (asked_s + clock() - middle) / len(fold.test)
            said.append((predicted, fold.support, learnt_s + middle - start, predict_s))
        return said

    truth = tuple(y[test] for _, test in splits)
    tested, over = (
        None if of is None else [of[test] for _, test in splits] for of in (clusters, independent)
    )
    evaluations = []
    for found in zip(*over_folds(answers, X, y, splits, preparation, nested=nested), strict=True):
        predicted, support, *seconds = zip(*found, strict=True)
        accuracy, costs = score(truth, predicted, tested, over), np.mean(seconds, axis=1).tolist()
        evaluations.append(Evaluation(truth, predicted, accuracy, np.mean(support, axis=0), *costs))
    return evaluations
