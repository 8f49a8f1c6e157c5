"""Cross-validate one row of the table with one classifier: what learns is fitted on training folds."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn import config_context
from sklearn.base import clone
from sklearn.dummy import DummyClassifier
from sklearn.pipeline import Pipeline
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from texclass.experiment.accuracy import Accuracy, score
from texclass.experiment.protocols import Split
from texclass.recording import Samples

Labels = NDArray[Any]

# Redundant columns (the discriminant drops collinear directions) and columns that are constant within classes
# (the class mean needs no deviation) are no news.
EXPECTED = ("Variables are collinear", "self.within_class_std_dev_ has at least 1 zero")


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Predictions of every test recording of every fold.

    Attributes
    ----------
    truth, predicted : ndarray of shape (n_tested,)
        Labels, fold after fold.
    accuracy : Accuracy
        Pooled, with that of each fold.
    support : ndarray of shape (n_columns,)
        Share of folds in which a column reached the classifier.
    """

    truth: Labels
    predicted: Labels
    accuracy: Accuracy
    support: Samples


def evaluate(
    X: Samples,
    y: Labels,
    splits: tuple[Split, ...],
    preparation: Pipeline,
    classifier: Any,
    *,
    nested: bool = True,
    clusters: Labels | None = None,
    seed: int = 0,
) -> Evaluation:
    """Fit on each fold's training recordings, predict its test recordings.

    Parameters
    ----------
    X : ndarray of shape (n_recordings, n_columns)
        Features; NaN where undefined.
    y : ndarray of shape (n_recordings,)
        Materials.
    splits : tuple of (train, test)
        Row numbers.
    preparation : Pipeline
        Imputation, scaling, selection; unfitted.
    classifier : classifier
        Unfitted.
    nested : bool
        False fits the preparation once on all recordings, test folds included: an optimistic accuracy.
    clusters : ndarray of shape (n_recordings,), optional
        Which recording or run each row of X is a part of; see `score`.
    seed : int
        Of the bootstrap over clusters.
    """
    with (
        warnings.catch_warnings(),
        threadpool_limits(1),
        config_context(assume_finite=True, skip_parameter_validation=True),
    ):
        for message in EXPECTED:
            warnings.filterwarnings("ignore", message=message)
        prepared = None if nested else clone(preparation).fit(X, y)
        folds = [_fold(X, y, split, prepared or preparation, classifier, nested=nested) for split in splits]
    truth = [y[test] for _, test in splits]
    predicted = [p for p, _ in folds]
    tested = None if clusters is None else [clusters[test] for _, test in splits]
    return Evaluation(
        np.concatenate(truth),
        np.concatenate(predicted),
        score(truth, predicted, tested, seed=seed),
        np.mean([support for _, support in folds], axis=0),
    )


def _fold(
    X: Samples, y: Labels, split: Split, preparation: Pipeline, classifier: Any, *, nested: bool
) -> tuple[Labels, Samples]:
    """Return the predictions of a fold's test recordings and which columns reached the classifier."""
    train, test = split
    prepare = clone(preparation).fit(X[train], y[train]) if nested else preparation
    learnt = _finite(prepare.transform(X[train]))
    # Columns that are constant on the training set say nothing, and most classifiers refuse them.
    silent = not np.ptp(learnt, axis=0).any()
    recogniser = (DummyClassifier() if silent else clone(classifier)).fit(learnt, y[train])
    return recogniser.predict(_finite(prepare.transform(X[test]))), _support(prepare, X.shape[1])


def _finite(prepared: Samples) -> Samples:
    # scikit-learn's own check is switched off above, for speed.
    if not np.isfinite(prepared).all():
        raise ValueError(
            "features are undefined (NaN) at the classifier; the rule is a step that fills them, "
            "such as sklearn.impute.SimpleImputer"
        )
    return prepared


def _support(preparation: Pipeline, n_columns: int) -> Samples:
    selector = preparation.steps[-1][1]
    mask = selector.get_support() if hasattr(selector, "get_support") else np.ones(n_columns)
    return np.asarray(mask if len(mask) == n_columns else np.ones(n_columns), dtype=np.float64)
