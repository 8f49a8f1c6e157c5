"""Rows of features that a trained model remembers of its surfaces: training samples, or means of classes."""

from typing import Any

import numpy as np
from sklearn.feature_selection import SelectorMixin
from sklearn.impute import SimpleImputer

from texclass.experiment.kernel_discriminant import KernelDiscriminant
from texclass.experiment.vote_of_pieces import VoteOfPieces
from texclass.recognition.model import Model
from texclass.recognition.unknown import Nearness
from texclass.recording import Samples

FITTED = ("means_", "theta_", "centroids_", "_fit_X")
"""Attributes in which classifiers of scikit-learn keep prepared rows: of classes, or training samples."""


def remembered(model: Model) -> Samples:
    """Return rows like those it was trained on, shape (n, n_columns).

    None, where nothing is remembered, or a step cannot be undone.
    """
    prepared = [*_of_classifier(model.recogniser[-1]), *_of_nearness(model.novelty.nearness)]
    rows = np.concatenate(prepared) if prepared else np.empty((0, 0))
    for _, step in reversed(model.recogniser.steps[1:-1]):
        if step in (None, "passthrough") or (isinstance(step, SimpleImputer) and step.keep_empty_features):
            continue
        if not hasattr(step, "inverse_transform") or isinstance(step, SelectorMixin | SimpleImputer):
            return np.empty((0, len(model.columns)))
        rows = step.inverse_transform(rows) if len(rows) else rows
    return rows if len(rows) else np.empty((0, len(model.columns)))


def _of_classifier(classifier: Any) -> list[Samples]:
    if isinstance(classifier, VoteOfPieces):
        return [] if classifier.whole_ is None else _of_classifier(classifier.whole_)
    if isinstance(classifier, KernelDiscriminant):
        view, prototypes = classifier.views_[0], classifier.prototypes_[0]
        if view.weights.ndim > 1:
            return []
        constant = np.isinf(view.scale)
        size = np.where(constant, 0.0, np.where(constant, 1.0, view.scale) / view.weights)
        return [view.mean + prototypes * size]
    return [np.asarray(getattr(classifier, name)) for name in FITTED if hasattr(classifier, name)]


def _of_nearness(near: Nearness | None) -> list[Samples]:
    """Return the rows in which the view sees the class means: those closest to the mean of all."""
    return [] if near is None else [near.mean + near.means @ np.linalg.pinv(near.view)]
