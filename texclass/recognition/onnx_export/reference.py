"""What scikit-learn says of rows, as a graph has to."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.neighbors import KNeighborsClassifier

from texclass.recognition.calibration import class_scores
from texclass.recognition.model import Model
from texclass.recognition.onnx_export.answers import UNDEFINED
from texclass.recognition.unknown import strangeness
from texclass.recording import Samples

TOLERANCE = 1e-9
"""Largest difference of a probability, and relative difference of other numbers, that counts as none."""
ROUNDING = 1e-13
"""Of a squared distance, in squares of the length of the row: it may come from |a|^2 - 2 a b + |b|^2."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Labels, probabilities, scores of strangeness; NaN and "" where nothing can be said.

    Attributes
    ----------
    labels : ndarray of str, shape (n,)
        The likeliest material.
    probabilities : ndarray of shape (n, n_materials)
        Calibrated.
    strange, p_known : ndarray of shape (n,)
        How strange the rows are, and the p-value of "known".
    unknown : ndarray of bool, shape (n,)
        The verdict.
    tied : ndarray of bool, shape (n,)
        Where neighbours are so equally far that rounding says which of them count.
    """

    labels: NDArray[np.str_]
    probabilities: Samples
    strange: Samples
    p_known: Samples
    unknown: NDArray[np.bool_]
    tied: NDArray[np.bool_]

    @property
    def defined(self) -> NDArray[np.bool_]:
        """Where something can be said, shape (n,)."""
        return np.asarray(self.labels != UNDEFINED)


def judge(model: Model, X: Samples) -> Judged:
    """Return what a model says of rows of features (n, n_columns), at least one of which is defined."""
    prepared = X
    for _, step in model.recogniser.steps[1:-1]:
        prepared = prepared if step in (None, "passthrough") else step.transform(prepared)
    defined = np.asarray(np.isfinite(prepared).all(axis=1))
    classifier, seen = model.recogniser[-1], prepared[defined]
    decisions = class_scores(classifier, seen)
    p, p_known = model.judge(X[defined])
    strange = strangeness(model.novelty.kind, decisions, seen, model.novelty.nearness)
    return Judged(
        labels=np.array([UNDEFINED, *model.materials])[_placed(1 + p.argmax(axis=1), defined, 0)],
        probabilities=_placed(p, defined, np.nan),
        strange=_placed(strange, defined, np.nan),
        p_known=_placed(p_known, defined, np.nan),
        unknown=verdict(model, X, _placed(p_known, defined, 0.0)),
        tied=_placed(neighbours_tied(classifier, seen), defined, False),
    )


def verdict(model: Model, X: Samples, p_known: Samples) -> NDArray[np.bool_]:
    """Return which rows are unknown, of their p-values."""
    return np.asarray((p_known <= model.novelty.false_alarms) | np.isnan(X).all(axis=1))


def neighbours_tied(classifier: Any, rows: Samples) -> NDArray[np.bool_]:
    """Return where the last neighbour that counts and the next one are equally far, shape (n,)."""
    k = getattr(classifier, "n_neighbors", 0)
    if not isinstance(classifier, KNeighborsClassifier) or k >= classifier.n_samples_fit_:
        return np.zeros(len(rows), dtype=bool)
    squares = classifier.kneighbors(rows, k + 1)[0] ** 2
    rounding = TOLERANCE * squares[:, k] + ROUNDING * np.einsum("ij,ij->i", rows, rows)
    return np.asarray(squares[:, k] - squares[:, k - 1] <= rounding)


def _placed(values: NDArray[Any], where: NDArray[np.bool_], otherwise: Any) -> NDArray[Any]:
    """Return values at some of the rows, and another at the others."""
    whole = np.full((len(where), *values.shape[1:]), otherwise, dtype=values.dtype)
    whole[where] = values
    return whole
