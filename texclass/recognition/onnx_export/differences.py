"""Where a graph and scikit-learn say different things of the same rows, and rounding does not explain it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.recognition.model import Model
from texclass.recognition.onnx_export.answers import UNDEFINED
from texclass.recognition.onnx_export.reference import TOLERANCE, Judged, verdict
from texclass.recording import Samples

Found = dict[str, NDArray[Any]]
"""What a graph answers, by output."""
LEAST_STRANGENESS = 1e-3
"""Below it, differences of the strangeness count as if it were as large: decisions of a kernel reach 1."""


@dataclass(frozen=True, eq=False)
class Difference:
    """One thing that may differ.

    Attributes
    ----------
    what
        Its name.
    where : ndarray of bool, shape (n,)
        In which rows it does.
    found, expected : ndarray of shape (n,)
        In ONNX, and in scikit-learn.
    """

    what: str
    where: NDArray[np.bool_]
    found: NDArray[Any]
    expected: NDArray[Any]


def differences(model: Model, X: Samples, expected: Judged, found: Found) -> Iterator[Difference]:
    """Yield whatever may differ, and where it does; see `check_parity` for what is a tie."""
    yield _of_labels(model, expected, found)
    yield _of_probabilities(expected, found)
    p_known = found["p_known"]
    rounding = TOLERANCE * np.maximum(np.abs(expected.strange), LEAST_STRANGENESS)
    low, high = (model.novelty.p_value(expected.strange + side * rounding) for side in (1, -1))
    between = np.where(expected.defined, (low <= p_known) & (p_known <= high), np.isnan(p_known))
    yield Difference("p_known", ~between, p_known, expected.p_known)
    unknown = verdict(model, X, np.nan_to_num(p_known))
    yield Difference("unknown =", found["unknown"] != unknown, found["unknown"], unknown)


def apart(expected: Judged, found: Found) -> Samples:
    """Return the largest difference of a probability, (n,); 0 where both say nothing, inf where one does."""
    gap = np.abs(found["probabilities"] - expected.probabilities).max(axis=1)
    silent = ~expected.defined & np.isnan(found["probabilities"]).all(axis=1)
    return np.asarray(np.where(silent, 0.0, np.nan_to_num(gap, nan=np.inf)))


def _of_labels(model: Model, expected: Judged, found: Found) -> Difference:
    """Compare labels: each the largest of its own probabilities, and of the expected ones but for a tie."""
    labels = found["label"].astype(str)
    own, chosen = (
        _probability_of(labels, p, model.materials) for p in (found["probabilities"], expected.probabilities)
    )
    largest = expected.tied | (chosen >= expected.probabilities.max(axis=1) - 2 * TOLERANCE)
    right = np.where(
        expected.defined, largest & (own == found["probabilities"].max(axis=1)), labels == UNDEFINED
    )
    return Difference("label", ~right, labels, expected.labels)


def _of_probabilities(expected: Judged, found: Found) -> Difference:
    wrong = ~(apart(expected, found) <= TOLERANCE) & ~expected.tied
    gap = np.abs(found["probabilities"] - expected.probabilities)
    at = np.arange(len(gap)), np.nan_to_num(gap, nan=np.inf).argmax(axis=1)
    return Difference("probability", wrong, found["probabilities"][at], expected.probabilities[at])


def _probability_of(labels: NDArray[np.str_], p: Samples, materials: tuple[str, ...]) -> Samples:
    """Return the probability of each row's label, shape (n,); NaN for one that is no material."""
    place = {material: k for k, material in enumerate(materials)}
    k = np.array([place.get(label, -1) for label in labels.tolist()])
    return np.where(k >= 0, p[np.arange(len(p)), k], np.nan)
