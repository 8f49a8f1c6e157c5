"""Evaluate one fold: tune inside the training set, predict the test set, and compute every score.

All methods are treated alike. The best of their choices (feature subset and classifier) is selected by
cross-validation inside the training set, whose predictions also calibrate probabilities and prediction sets.
"""

import pickle
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sklearn.metrics import balanced_accuracy_score, f1_score, roc_auc_score

from texclass.evaluation.folds import Fold, map_folds
from texclass.evaluation.splits import Split
from texclass.evaluation.windows import parents
from texclass.recognition.novelty import ScoreKind, fit_class_distance, novelty_scores
from texclass.recognition.prediction_sets import TIE_TOLERANCE, ConformalCalibration, log_odds
from texclass.recognition.probabilities import class_scores, expected_calibration_error, fit_calibration
from texclass.recording import Samples

COVERAGE = 0.9
"""Nominal coverage of the prediction sets."""
N_UNKNOWN_GROUPS = 3
"""Number of groups of surfaces, each of which is unknown in some folds for the AUROC of unknown surfaces."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Feature subset with a classifier, one of the choices of a method.

    Attributes
    ----------
    name : str
        Name in the table.
    columns : ndarray of int
        Columns of the feature matrix.
    preparation, classifier : estimator
        Unfitted steps and classifier.
    novelty : {"decision", "distance"}
        Novelty score; see `novelty_scores`.
    """

    name: str
    columns: NDArray[np.intp]
    preparation: Any
    classifier: Any
    novelty: ScoreKind = "decision"


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions for the test set of a fold.

    Attributes
    ----------
    decisions : ndarray of shape (n_test, n_classes)
        Decisions of the classifier; -inf for classes that are missing in the training set.
    novelty : ndarray of shape (n_test,)
        Novelty scores.
    predict_ms : float
        CPU time of preparation and prediction per test in ms.
    kb : float
        Size of the fitted steps and classifier in kB (1000 bytes), as a pickle.
    """

    decisions: Samples
    novelty: Samples
    predict_ms: float
    kb: float


def predict_fold(choice: Choice, X: Samples, y: NDArray[Any], split: Split) -> Predictions:
    """Fit a choice to a training set and predict a test set.

    Parameters
    ----------
    choice : Choice
        Feature subset and classifier.
    X : ndarray of shape (n, n_columns)
        Features of all rows; NaN where undefined.
    y : ndarray of shape (n,)
        Surfaces.
    split : (train, test)
        Rows of the training set and of the test set.
    """
    classes = np.unique(y)

    def predict(fold: Fold) -> Predictions:
        classifier = fold.fit(choice.classifier)
        start = time.process_time()
        prepared = fold.X_test
        decisions = np.full((len(fold.test), len(classes)), -np.inf)
        decisions[:, np.searchsorted(classes, classifier.classes_)] = class_scores(classifier, prepared)
        predict_ms = 1e3 * (time.process_time() - start) / len(fold.test)
        distance = None
        if choice.novelty == "distance":
            distance = fit_class_distance(fold.X_train, np.unique(fold.y_train, return_inverse=True)[1])
        novelty = novelty_scores(choice.novelty, decisions, prepared, distance)
        kb = len(pickle.dumps((fold.preparation, classifier))) / 1000
        return Predictions(decisions, novelty, predict_ms, kb)

    (predictions,) = map_folds(predict, X[:, choice.columns], y, [split], choice.preparation)
    return predictions


def evaluate_fold(
    choices: Sequence[Choice],
    X: Samples,
    frame: pd.DataFrame,
    split: Split,
    inner: Sequence[Split],
    unknown: Sequence[NDArray[np.str_]],
    ms_of: Callable[[Choice], float],
) -> tuple[dict[str, Any], NDArray[np.bool_]]:
    """Select a choice inside the training set, predict the test set, and compute the scores.

    Parameters
    ----------
    choices : sequence of Choice
        Choices of the method. If several are equally accurate inside the training set, the first is selected.
    X : ndarray of shape (n, n_columns)
        Features of all rows.
    frame : DataFrame
        Labels of all rows.
    split : (train, test)
        Rows of the training set and of the test set.
    inner : sequence of (train, test)
        Splits of the training set, as rows of the frame. If it is empty, the first choice is selected, and
        calibration error and coverage are undefined.
    unknown : sequence of ndarray of str
        Groups of surfaces that are left out of the training set for the AUROC; see `auroc_of_unknown`.
    ms_of : callable
        Function that returns the latency of the features of a choice in ms.

    Returns
    -------
    scores : dict
        `choice`, `n_train`, `n_test`, `accuracy`, `balanced_accuracy`, `macro_f1`, `auroc_unknown`, `ece`,
        `coverage`, `set_size`, `ms` and `kb`. Undefined scores are NaN.
    hits : ndarray of bool, shape (n_test,)
        Whether each prediction is correct.
    """
    y = frame["surface"].to_numpy(dtype=str)
    classes, labels = np.unique(y, return_inverse=True)
    train, test = split
    held_out = [[predict_fold(choice, X, y, one) for one in inner] for choice in choices]
    rows = np.concatenate([test for _, test in inner]) if inner else np.empty(0, dtype=np.intp)
    decisions = [np.concatenate([p.decisions for p in one]) for one in held_out] if inner else []
    n_hits = [np.count_nonzero(d.argmax(axis=1) == labels[rows]) for d in decisions]
    best = int(np.argmax(n_hits)) if inner else 0
    choice = choices[best]
    predictions = predict_fold(choice, X, y, split)
    predicted = classes[predictions.decisions.argmax(axis=1)]
    hits = predicted == y[test]
    calibrated = dict.fromkeys(("ece", "coverage", "set_size"), np.nan)
    if inner:
        calibrated = _calibrated_scores(
            decisions[best], labels[rows], parents(frame).to_numpy()[rows], predictions, labels[test]
        )
    scores = {
        "choice": choice.name,
        "n_train": len(train),
        "n_test": len(test),
        "accuracy": float(hits.mean()),
        "balanced_accuracy": float(balanced_accuracy_score(y[test], predicted)),
        "macro_f1": float(f1_score(y[test], predicted, average="macro")),
        "auroc_unknown": auroc_of_unknown(choice, X, y, split, unknown),
        **calibrated,
        "ms": ms_of(choice) + predictions.predict_ms,
        "kb": predictions.kb,
    }
    return scores, hits


def _calibrated_scores(
    held_out: Samples,
    held_out_labels: NDArray[np.intp],
    recordings: NDArray[Any],
    predictions: Predictions,
    labels: NDArray[np.intp],
) -> dict[str, float]:
    """Return calibration error, and coverage and mean size of prediction sets, from held-out decisions."""
    # A class that is missing in an inner training set gets the lowest decision of the row.
    is_finite = np.isfinite(held_out)
    lowest = held_out.min(axis=1, where=is_finite, initial=np.inf, keepdims=True)
    finite = np.where(is_finite, held_out, lowest)
    calibration = fit_calibration(finite, held_out_labels)
    odds = log_odds(calibration.beta * finite)[np.arange(len(finite)), held_out_labels]
    threshold = ConformalCalibration.from_answers(odds, recordings).threshold(COVERAGE) - TIE_TOLERANCE
    p = calibration(predictions.decisions)
    is_member = log_odds(calibration.beta * predictions.decisions) >= threshold
    rows, best = np.arange(len(p)), p.argmax(axis=1)
    is_member[rows, best] = True
    return {
        "ece": expected_calibration_error(p[rows, best], best == labels),
        "coverage": float(is_member[rows, labels].mean()),
        "set_size": float(is_member.sum(axis=1).mean()),
    }


def unknown_groups(surfaces: NDArray[np.str_], fold: int, n_folds: int) -> list[NDArray[np.str_]]:
    """Return the groups of surfaces that are unknown in a fold.

    The surfaces are divided into three groups. In each fold, one group is unknown, in turn; with fewer than
    three folds, all groups in every fold. There is no group if there are fewer than three surfaces.

    Parameters
    ----------
    surfaces : ndarray of str
        Sorted names of all surfaces.
    fold, n_folds : int
        Number of the fold, and number of folds.

    Examples
    --------
    >>> [group.tolist() for group in unknown_groups(np.array(["cork", "felt", "oak", "tin"]), 3, 10)]
    [['cork', 'tin']]
    """
    if len(surfaces) < N_UNKNOWN_GROUPS:
        return []
    groups = [surfaces[first::N_UNKNOWN_GROUPS] for first in range(N_UNKNOWN_GROUPS)]
    return groups if n_folds < N_UNKNOWN_GROUPS else [groups[fold % N_UNKNOWN_GROUPS]]


def auroc_of_unknown(
    choice: Choice, X: Samples, y: NDArray[Any], split: Split, unknown: Sequence[NDArray[np.str_]]
) -> float:
    """Return the AUROC of the novelty score for surfaces that are missing in the training set.

    Each group is left out of the training set once, and the score has to separate its test recordings from
    those of the other surfaces.

    Parameters
    ----------
    choice, X, y, split
        As for `predict_fold`.
    unknown : sequence of ndarray of str
        Groups of surfaces.

    Returns
    -------
    float
        Mean over groups; NaN if no group can be tested.
    """
    train, test = split
    areas = []
    for group in unknown:
        known_train = train[~np.isin(y[train], group)]
        is_unknown = np.isin(y[test], group)
        if 0 < is_unknown.sum() < len(test) and len(np.unique(y[known_train])) >= 2:
            novelty = predict_fold(choice, X, y, (known_train, test)).novelty
            areas.append(roc_auc_score(is_unknown, novelty))
    return float(np.mean(areas)) if areas else float("nan")
