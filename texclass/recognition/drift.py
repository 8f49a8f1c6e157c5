"""Drift: detection of features that have shifted as a whole, and adaptation to it without labels.

As a sensor ages, the features of all surfaces shift, recordings of trained surfaces get low novelty p-values,
and some are reported as unknown. A new surface has the same effect on its own recordings alone.
`detect_drift` separates the two by the predicted surfaces: drift lowers the p-values of most of them.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.recognition.adaptation import (
    LIMITS,
    adapt_to_rows,
    class_moments_of,
    describe_map,
    effective_number,
    fit_map,
)
from texclass.recognition.answers import Answer
from texclass.recognition.model import Model
from texclass.recognition.model_document import describe_shift
from texclass.recognition.novelty import ClassMoments
from texclass.recording import Samples
from texclass.reporting.wording import counted

SIGNIFICANCE = 0.01
"""Largest rate at which drift is reported although there is none."""
MIN_SURFACES = 3
"""Minimum number of predicted surfaces, because a shift of one or two may be due to unknown surfaces."""

MIN_SPREAD = 0.25
"""Minimum of `spread_of_surfaces`: half of its value for two surfaces with equal numbers of recordings."""


@dataclass(frozen=True)
class Drift:
    """Result of a test for drift.

    Attributes
    ----------
    is_detected : bool
        Whether the p-values are lower than without drift, for most of the predicted surfaces.
    n_recordings, n_surfaces : int
        Number of recordings, and of surfaces that are predicted for them (0 if drift was not tested).
    p_known : float or None
        Novelty p-value, averaged over the recordings of each predicted surface and then over these surfaces;
        0.5 without drift. None if drift was not tested.
    share_unknown : float
        Share of the recordings that are reported as unknown.
    p_value : float or None
        p-value of the hypothesis that there is no drift; None if drift was not tested.
    shift : dict or None
        Change of the columns that an adaptation would compensate, as in the manifest of an adapted model;
        None without drift, and for an adapted model.
    problem : str
        Reason why drift was not tested, else empty.

    Examples
    --------
    >>> Drift(False, n_recordings=4, problem="too few recordings to test for drift").message
    ''
    """

    is_detected: bool
    n_recordings: int
    n_surfaces: int = 0
    p_known: float | None = None
    share_unknown: float = 0.0
    p_value: float | None = None
    shift: dict[str, Any] | None = None
    problem: str = ""

    @property
    def message(self) -> str:
        """What has shifted, and by how much; empty if no drift is detected."""
        if not self.is_detected:
            return ""
        shift = "" if self.shift is None else f"; {describe_shift(self.shift)}"
        n_recordings = counted(self.n_recordings, "recording")
        return (
            f"drift: features have shifted as a whole, for {counted(self.n_surfaces, 'predicted surface')}: "
            f"mean novelty p-value {self.p_known:.2f}, 0.5 without drift (p = {self.p_value:.2g}), "
            f"{100 * self.share_unknown:.0f} % of {n_recordings} unknown{shift}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON-compatible data."""
        return dict(vars(self))


def detect_drift(model: Model, answers: Sequence[Answer]) -> Drift:
    """Test whether the features of several recordings have shifted as a whole since the training.

    The novelty p-values (for windows: their median) are averaged over the recordings of each predicted
    surface. Without drift, the mean over predicted surfaces is at least 0.5. A one-sided t-test with
    predicted surfaces as samples rejects this at `SIGNIFICANCE`. It allows for surfaces that differ in
    their p-values, and for correlated windows and recordings. An unknown surface lowers the p-values of one
    or a few predicted surfaces, which increases the variance between them and is not reported as drift. A
    batch whose features vary as little as those of one surface (`spread_of_surfaces`) is not tested. If
    fewer than `MIN_SURFACES` are predicted, the surfaces that an adapted model predicts are used.

    Parameters
    ----------
    model : Model
        Trained model.
    answers : sequence of Answer
        Answers of this model, one for each recording.

    Returns
    -------
    Drift

    Examples
    --------
    >>> answers = model.predict(tx.open_dataset("new"))  # doctest: +SKIP
    >>> detect_drift(model, answers).is_detected  # doctest: +SKIP
    True
    """
    tested = [answer for answer in answers if any(row.is_valid for row in answer.rows)]
    n_recordings, problem = len(tested), ""
    if not len(model.novelty.held_out):
        problem = "drift is not tested: no recordings were held out in training"
    elif n_recordings < (n_needed := LIMITS.min_unlabelled):
        problem = f"too few recordings to test for drift: {n_recordings}. Expected at least {n_needed}"
    elif not _has_spread(model, valid_rows(tested)[0]):
        problem = f"{_ONE_SURFACE}, so drift is not tested"
    if problem:
        return Drift(False, n_recordings, problem=problem)
    p = np.array([[answer.probabilities[surface] for surface in model.surfaces] for answer in tested])
    shift = None
    if not _has_several_surfaces(p) and model.class_moments is not None:
        # A large shift makes all recordings resemble one or two surfaces: predict without the shift.
        p, shift = _predict_without_shift(model, tested)
    surfaces, predicted = np.unique(p.argmax(axis=1), return_inverse=True)
    p_known = np.array([answer.p_known for answer in tested])
    p_surface = np.bincount(predicted, weights=p_known) / np.bincount(predicted)
    share_unknown = float(np.mean([answer.unknown for answer in tested]))
    drift = Drift(False, n_recordings, len(surfaces), float(p_surface.mean()), share_unknown)
    if not _has_several_surfaces(p):
        problem = f"too few predicted surfaces to test for drift: {len(surfaces)}. Expected at least "
        return replace(drift, problem=f"{problem}{MIN_SURFACES}, with similar numbers of recordings")
    p_value = _p_value_of_drift(p_surface)
    if p_value > SIGNIFICANCE:
        return replace(drift, p_value=p_value)
    if shift is None and model.class_moments is not None:
        shift = _predict_without_shift(model, tested)[1]
    return replace(drift, is_detected=True, p_value=p_value, shift=shift)


_ONE_SURFACE = (
    "the features vary as little as those of one surface, and the effects of sensor and surface cannot be "
    "separated"
)


def spread_of_surfaces(X: Samples, moments: ClassMoments) -> float:
    """Return the variance between the surfaces of a batch, relative to that between all trained surfaces.

    For each column, this is the variance of the batch minus the variance within a surface, divided by the
    variance of the class means; the result is the median over columns. It is 0 for a single surface, whether
    trained or not, and 1 - 1/m on average for m surfaces with equal numbers of recordings. A shift of all
    features does not change it.

    Parameters
    ----------
    X : ndarray of shape (n, n_columns)
        Features; NaN where undefined.
    moments : ClassMoments
        Moments of the training features.

    Examples
    --------
    >>> moments = ClassMoments(means=np.array([[0.0], [8.0]]), within_std=np.array([1.0]))
    >>> spread_of_surfaces(np.array([[9.0], [10.0], [11.0]]), moments)
    0.0
    """
    between = np.nan_to_num(np.nanvar(moments.means, axis=0, ddof=1))
    is_usable = (between > 0) & (np.isfinite(X).sum(axis=0) > 1)
    excess = np.nanvar(X[:, is_usable], axis=0, ddof=1) - moments.within_std[is_usable] ** 2
    return float(np.median(excess / between[is_usable])) if is_usable.any() else 0.0


def _has_spread(model: Model, X: Samples) -> bool:
    """Return whether features (n, n_columns) vary like those of several surfaces, if this is known."""
    return model.class_moments is None or spread_of_surfaces(X, class_moments_of(model)) >= MIN_SPREAD


def _has_several_surfaces(p: Samples) -> bool:
    """Return whether probabilities (n, n_surfaces) predict enough surfaces, none of them too often."""
    n_surfaces = len(np.unique(p.argmax(axis=1)))
    return n_surfaces >= MIN_SURFACES and effective_number(p.mean(axis=0)) >= LIMITS.min_surfaces


def _predict_without_shift(model: Model, answers: Sequence[Answer]) -> tuple[Samples, dict[str, Any]]:
    """Return probabilities (n_answers, n_surfaces) after an adaptation, and the description of its map."""
    X, index = valid_rows(answers)
    moments, no_labels = class_moments_of(model), np.zeros((len(X), len(model.surfaces)))
    scale, offset = fit_map(model, X, no_labels, moments, len(answers))
    is_row_of = np.eye(len(answers))[index].T
    p = is_row_of @ model.classify(X * scale + offset)[0] / is_row_of.sum(axis=1, keepdims=True)
    return p, describe_map(model.columns, X, (scale, offset), moments)


def _p_value_of_drift(p_surface: Samples) -> float:
    """Return the p-value of a one-sided t-test of the mean p-values (n_surfaces,) against 0.5.

    The standard deviation is at least 0.01, which only avoids a division by zero.
    """
    from scipy.special import stdtr

    n = len(p_surface)
    std = max(float(p_surface.std(ddof=1)), 0.01)
    return float(stdtr(n - 1, (p_surface.mean() - 0.5) / std * np.sqrt(n)))


def adapt_to_answers(model: Model, answers: Sequence[Answer]) -> Model:
    """Return a model that is adapted to the features of answers, without labels.

    The adaptation is that of `adapt` without labels. A batch whose features vary as little as those of one
    surface (`spread_of_surfaces`) is refused, because the surface may be unknown. The features in the answers
    are used, so the recordings are not read again: `Model.answer_again` then gives the answers of the adapted
    model.

    Parameters
    ----------
    model : Model
        Trained model.
    answers : sequence of Answer
        Answers of this model, one for each recording; at least 10 of several surfaces.

    Raises
    ------
    ValueError
        If there are too few recordings or surfaces, or the model is already adapted.

    Examples
    --------
    >>> answers = model.predict(tx.open_dataset("new"))  # doctest: +SKIP
    >>> adapted = adapt_to_answers(model, answers)  # doctest: +SKIP
    >>> answers = [adapted.answer_again(answer) for answer in answers]  # doctest: +SKIP
    """
    X, recording_index = valid_rows(answers)
    if len(np.unique(recording_index)) >= LIMITS.min_unlabelled and not _has_spread(model, X):
        raise ValueError(f"{_ONE_SURFACE}. Expected recordings of at least {MIN_SURFACES} surfaces")
    names = [(answer.recording_id, None) for answer in answers if any(row.is_valid for row in answer.rows)]
    entry = {"references": names, "hash": hashlib.sha256(X.tobytes()).hexdigest()}
    return adapt_to_rows(model, X, np.zeros((len(X), len(model.surfaces))), recording_index, entry)


def valid_rows(answers: Sequence[Answer]) -> tuple[Samples, NDArray[np.intp]]:
    """Return the features (n, n_columns) of valid recordings or windows, and their answer's index (n,)."""
    rows = [(row.values, i) for i, answer in enumerate(answers) for row in answer.rows if row.is_valid]
    if not rows:
        return np.empty((0, 0)), np.empty(0, dtype=np.intp)
    values, index = zip(*rows, strict=True)
    return np.array(values), np.array(index, dtype=np.intp)
