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
from texclass.recording import Samples
from texclass.reporting.wording import counted

SIGNIFICANCE = 0.01
"""Largest rate at which drift is reported although there is none."""
MIN_SURFACES = 3
"""Minimum number of predicted surfaces, because a shift of one or two may be due to unknown surfaces."""


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

    The novelty p-values are averaged over the windows of each recording, and over the recordings of each
    surface that an adapted model predicts. Without drift, the mean over predicted surfaces is at least 0.5. A
    one-sided t-test with predicted surfaces as samples rejects this at `SIGNIFICANCE`. It allows for surfaces
    that differ in their p-values, and for correlated windows and recordings. An unknown surface lowers the
    p-values of one or a few predicted surfaces, which increases the variance between them and is not reported
    as drift.

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
    X, index = valid_rows(answers)
    recordings = np.unique(index, return_inverse=True)[1]
    n_recordings, problem = len(np.unique(index)), ""
    if not len(model.novelty.held_out):
        problem = "drift is not tested: no recordings were held out in training"
    elif n_recordings < (n_needed := LIMITS.min_unlabelled):
        problem = f"too few recordings to test for drift: {n_recordings}. Expected at least {n_needed}"
    if problem:
        return Drift(False, n_recordings, problem=problem)
    p, p_known = model.classify(X)
    shift = None
    if model.class_moments is not None:
        # Large shifts make all recordings resemble a few surfaces, which the features without them separate.
        moments, no_labels = class_moments_of(model), np.zeros(p.shape)
        scale, offset = fit_map(model, X, no_labels, moments, n_recordings)
        shift = describe_map(model.columns, X, (scale, offset), moments)
        p = model.classify(X * scale + offset)[0]
    is_window_of = np.eye(n_recordings)[recordings].T
    n_windows = is_window_of.sum(axis=1)
    p_known_mean = is_window_of @ p_known / n_windows
    share_unknown = float(np.mean(2 * is_window_of @ (p_known <= model.novelty.false_alarms) >= n_windows))
    surfaces, predicted = np.unique((is_window_of @ p).argmax(axis=1), return_inverse=True)
    p_surface = np.bincount(predicted, weights=p_known_mean) / np.bincount(predicted)
    drift = Drift(False, n_recordings, len(surfaces), float(p_surface.mean()), share_unknown)
    if len(surfaces) < MIN_SURFACES or effective_number(p.mean(axis=0)) < LIMITS.min_surfaces:
        problem = f"too few predicted surfaces to test for drift: {len(surfaces)}. Expected at least "
        return replace(drift, problem=f"{problem}{MIN_SURFACES}, with similar numbers of recordings")
    p_value = _p_value_of_drift(p_surface)
    if p_value > SIGNIFICANCE:
        return replace(drift, p_value=p_value)
    return replace(drift, is_detected=True, p_value=p_value, shift=shift)


def _p_value_of_drift(p_surface: Samples) -> float:
    """Return the p-value of a one-sided t-test of the mean p-values (n_surfaces,) against 0.5.

    The standard deviation is at least that of equal p-values in n surfaces by chance, 0.01, which only avoids
    a division by zero.
    """
    from scipy.stats import t

    n = len(p_surface)
    std = max(float(p_surface.std(ddof=1)), 0.01)
    return float(t.cdf((p_surface.mean() - 0.5) / std * np.sqrt(n), n - 1))


def adapt_to_answers(model: Model, answers: Sequence[Answer]) -> Model:
    """Return a model that is adapted to the features of answers, without labels.

    The adaptation is that of `adapt` without labels. The features in the answers are used, so the recordings
    are not read again: `Model.answer_again` then gives the answers of the adapted model.

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
