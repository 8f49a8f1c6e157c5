"""Fitting of classifiers: constant columns are supported, and expected warnings are silenced."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.dummy import DummyClassifier

from texclass.recording import Samples


def fit(estimator: Any, X: Samples, y: NDArray[Any]) -> Any:
    """Return a fitted clone of an estimator.

    Raises
    ------
    ValueError
        If the estimator cannot be fitted to the data, for example for lack of memory.
    LinAlgError
        If a matrix is singular.
    """
    try:
        return clone(estimator).fit(X, y)
    except np.linalg.LinAlgError:  # feature selection scores these columns as useless
        raise
    except Exception as error:  # a file may combine any estimator with any parameters
        steps = [step for _, step in getattr(estimator, "steps", [("", estimator)])]
        names = ", ".join(step if isinstance(step, str) else type(step).__name__ for step in steps)
        raise ValueError(
            f"{names} cannot be fitted to {X.shape[0]} rows of {X.shape[1]} columns: {error}"
        ) from error


def fit_varying(classifier: Any, X: Samples, y: NDArray[Any]) -> Any:
    """Fit a clone of a classifier, or a majority-class classifier if all columns are constant.

    Most classifiers raise an error if all columns are constant.
    """
    is_constant = not np.ptp(X, axis=0).any()
    return fit(DummyClassifier() if is_constant else classifier, X, y)


@contextmanager
def quiet_fits() -> Iterator[None]:
    """Silence expected warnings of scikit-learn: collinear or constant columns, and lack of convergence.

    Such fits are usable: a discriminant drops collinear directions, and a class mean needs no standard
    deviation. Any loss is visible in the accuracy.
    """
    with warnings.catch_warnings():
        for message in (
            "Variables are collinear",
            ".*at least 1 zero",
            "Only one sample available",
            "invalid value encountered in divide",
            "lbfgs failed to converge",
        ):
            warnings.filterwarnings("ignore", message=message)
        yield
