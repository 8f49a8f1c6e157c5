"""Predictions for held-out recordings, from which accuracy, calibration and thresholds follow."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from texclass.evaluation.folds import Fold, map_folds
from texclass.evaluation.splits import Split
from texclass.recognition.candidates import Candidate
from texclass.recognition.novelty import fit_class_distance, novelty_scores, score_kind
from texclass.recognition.probabilities import class_scores
from texclass.recording import Samples


@dataclass(frozen=True, eq=False)
class HeldOutPredictions:
    """Predictions for the test recordings of every fold, concatenated in fold order.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        Row of the feature table.
    decisions : ndarray of shape (n, n_classes)
        Decisions, with the classes in sorted order.
    novelty : ndarray of shape (n,)
        Novelty scores; see `novelty_scores`.
    labels : ndarray of int, shape (n,)
        True class.
    """

    rows: NDArray[np.intp]
    decisions: Samples
    novelty: Samples
    labels: NDArray[np.intp]

    @property
    def hits(self) -> NDArray[np.bool_]:
        """Whether the largest decision is that of the true class, shape (n,)."""
        return np.asarray(self.decisions.argmax(axis=1) == self.labels)


def predict_held_out(
    candidate: Candidate, frame: pd.DataFrame, splits: Sequence[Split]
) -> HeldOutPredictions:
    """Fit a candidate to the training set of each fold, and predict the test set.

    Parameters
    ----------
    candidate : Candidate
        Preparation and classifier.
    frame : DataFrame
        Feature table with the surfaces.
    splits : sequence of (train, test)
        Rows of the training set and the test set of each fold.
    """
    X, y = candidate.training_set(frame)
    classes, labels = np.unique(y, return_inverse=True)
    if not splits:
        empty = np.empty(0, dtype=np.intp)
        return HeldOutPredictions(empty, np.empty((0, len(classes))), np.empty(0), empty)

    def predict_fold(fold: Fold) -> tuple[NDArray[Any], ...]:
        classifier = fold.fit(candidate.classifier)
        decisions = np.full((len(fold.test), len(classes)), -np.inf)
        decisions[:, np.searchsorted(classes, classifier.classes_)] = class_scores(classifier, fold.X_test)
        kind, distance = score_kind(classifier), None
        if kind == "distance":
            distance = fit_class_distance(fold.X_train, np.unique(fold.y_train, return_inverse=True)[1])
        novelty = novelty_scores(kind, decisions, fold.X_test, distance)
        return fold.test, decisions, novelty, labels[fold.test]

    folds = map_folds(predict_fold, X, y, splits, candidate.preparation)
    return HeldOutPredictions(*(np.concatenate(arrays) for arrays in zip(*folds, strict=True)))
