"""Conformal prediction sets, which contain the true surface with a given probability."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recognition.probabilities import Calibration, Labels, effective_windows, running_log_posterior
from texclass.recording import Samples

DEFAULT_LEVELS = (0.9, 0.95)
"""Coverage of the prediction sets of an answer."""
TIE_TOLERANCE = 1e-9
"""Log odds that differ by less count as equal, because their rounding depends on the order of a sum."""
MIN_SCORE = -1e9
"""Replaces the score -inf of a surface that is missing in a training set, to keep differences finite."""
HALF_LIFE = 5.0
"""Number of later recordings of a surface after which the weight of a recording is halved."""


def log_odds(scores: Samples) -> Samples:
    """Return log(p / (1 - p)) with p = softmax(scores), also where p rounds to 1.

    Parameters
    ----------
    scores : ndarray of shape (n, n_surfaces)
        Decisions times the inverse temperature of the calibration, or log probabilities.

    Returns
    -------
    ndarray of shape (n, n_surfaces)
        s_m - log sum_{k != m} exp(s_k) for each surface m.
    """
    s = np.maximum(scores, MIN_SCORE)
    rows, best = np.arange(len(s)), s.argmax(axis=1)
    largest = s[rows, best]
    others = s.copy()
    others[rows, best] = -np.inf
    second = others.max(axis=1)
    # The sum over all surfaces except m is the largest term, plus the sum of all other terms, minus term m.
    share = np.exp(others - largest[:, None])
    odds = s - largest[:, None] - np.log1p(share.sum(axis=1, keepdims=True) - share)
    odds[rows, best] = largest - second - np.log(np.exp(others - second[:, None]).sum(axis=1))
    return np.asarray(odds)


@dataclass(frozen=True, eq=False)
class ConformalCalibration:
    """Held-out log odds of the true surface, from which the thresholds of prediction sets are derived.

    A prediction set contains every surface whose log odds reach `threshold`. Among all sets with the same
    coverage, these are the smallest on average (Sadinle et al.). The most probable surface is always
    included, because the set could otherwise be empty for an uncertain answer of an accurate model.

    Attributes
    ----------
    log_odds : ndarray of shape (n,)
        Log odds of the true surface, predicted by models that were not trained on the recording; ascending.
    weights : ndarray of shape (n,)
        Weight of each answer in [0, 1], relative to 1 for a new recording. Answers of one recording share its
        weight.

    References
    ----------
    Sadinle, Lei, Wasserman: Least ambiguous set-valued classifiers with bounded error levels, Journal of the
    American Statistical Association 114, 2019. Barber, Candès, Ramdas, Tibshirani: Conformal prediction
    beyond exchangeability, Annals of Statistics 51, 2023 (weights for drift). Lee, Barber, Willett:
    Distribution-free inference with hierarchical data, arXiv 2306.06342, 2023 (several answers of one
    recording).

    Examples
    --------
    >>> import numpy as np
    >>> held_out = np.linspace(-1, 4, 39)
    >>> calibration = ConformalCalibration.from_answers(held_out, recordings=np.arange(39))
    >>> calibration.predict_sets(np.log([0.6, 0.3, 0.1]), ("oak", "cork", "tin"))
    {0.9: ('oak',), 0.95: ('oak', 'cork')}
    """

    log_odds: Samples
    weights: Samples

    def __post_init__(self) -> None:
        if self.log_odds.ndim != 1 or self.log_odds.shape != self.weights.shape:
            raise ValueError(
                "log_odds and weights must be one-dimensional and of the same length, got shapes "
                f"{self.log_odds.shape} and {self.weights.shape}"
            )
        if not np.all(self.log_odds[1:] >= self.log_odds[:-1]):
            raise ValueError("log_odds must be in ascending order")
        if not np.all((self.weights >= 0) & (self.weights <= 1)):
            raise ValueError(
                f"weights must be in [0, 1], got {self.weights.min():g} to {self.weights.max():g}"
            )

    @classmethod
    def from_answers(cls, log_odds: ArrayLike, recordings: ArrayLike, weights: ArrayLike = 1.0) -> Self:
        """Build the calibration from held-out answers.

        Parameters
        ----------
        log_odds : array_like of shape (n,)
            Log odds of the true surface in each answer.
        recordings : array_like of shape (n,)
            Recording of each answer.
        weights : array_like of shape (n,)
            Weight of the recording of each answer (default 1): lower if it is old (`recency_weights`), higher
            if its answers are independent, up to its number of answers.
        """
        odds = np.asarray(log_odds, dtype=np.float64)
        _, index, n_answers = np.unique(np.asarray(recordings), return_inverse=True, return_counts=True)
        return cls._sorted(odds, np.broadcast_to(weights, odds.shape) / n_answers[index])

    @classmethod
    def _sorted(cls, log_odds: Samples, weights: Samples) -> Self:
        order = np.argsort(log_odds, kind="stable")
        return cls(log_odds[order], weights[order])

    @property
    def effective_n(self) -> float:
        """Effective number of held-out recordings: the sum of the weights."""
        return float(self.weights.sum())

    def threshold(self, level: float) -> float:
        """Return the minimum log odds of a surface in the set; -inf if there are too few recordings.

        The threshold is the largest t with sum_{i: odds_i >= t} w_i >= level (1 + sum_i w_i). The 1 is the
        weight of the new recording, whose log odds may be lower than those of all held-out recordings.
        """
        weight_above = np.cumsum(self.weights[::-1])[::-1]
        indices = np.flatnonzero(weight_above >= level * (1 + self.effective_n) - TIE_TOLERANCE)
        return float(self.log_odds[indices[-1]]) if len(indices) else -np.inf

    def predict_sets(
        self, scores: Samples, surfaces: Sequence[str], levels: Sequence[float] = DEFAULT_LEVELS
    ) -> dict[float, tuple[str, ...]]:
        """Return the prediction set of each level, most probable surface first; no set is empty.

        Parameters
        ----------
        scores : ndarray of shape (n_surfaces,)
            Scores of one answer; see `log_odds`.
        surfaces : sequence of str
            Name of each surface.
        levels : sequence of float
            Coverage of the sets (default 0.9 and 0.95).
        """
        odds = log_odds(scores[None])[0]
        ranking = np.argsort(-odds, kind="stable")
        sets = {}
        for level in levels:
            threshold = self.threshold(level) - TIE_TOLERANCE
            n_members = max(1, np.count_nonzero(odds >= threshold))
            sets[level] = tuple(surfaces[i] for i in ranking[:n_members])
        return sets

    def worst_case(self, other: Self) -> Self:
        """Return the calibration with the smaller log odds of two hold-outs at each quantile.

        Its prediction sets cover the recordings of both hold-outs, for example of an earlier and a later
        period. The weights are those of this calibration.

        Examples
        --------
        >>> early, late = (ConformalCalibration.from_answers(x, range(2)) for x in ([0, 3], [1, 2]))
        >>> early.worst_case(late).log_odds.tolist()
        [0.0, 2.0]
        """
        share, other_share = (np.cumsum(one.weights) / one.effective_n for one in (self, other))
        index = np.minimum(np.searchsorted(other_share, share - TIE_TOLERANCE), len(other_share) - 1)
        return type(self)(np.minimum(self.log_odds, other.log_odds[index]), self.weights)

    def updated(self, later: Self, discount: float) -> Self:
        """Add later answers to the calibration, and multiply its current weights by `discount`."""
        return self._sorted(
            np.concatenate([self.log_odds, later.log_odds]),
            np.concatenate([discount * self.weights, later.weights]),
        )

    @property
    def median(self) -> float:
        """Weighted median of the log odds."""
        weight_below = np.cumsum(self.weights)
        return float(self.log_odds[np.searchsorted(weight_below, 0.5 * weight_below[-1])])

    def moved(self, change: float) -> Self:
        """Add `change` to all log odds."""
        return type(self)(self.log_odds + change, self.weights)

    def warning(self, levels: Sequence[float]) -> str:
        """Return a warning about levels with too few held-out recordings; empty if there is none."""
        undefined = [level for level in levels if self.threshold(level) == -np.inf]
        if not undefined:
            return ""
        names, n_needed = (
            " and ".join(f"{100 * level:g}" for level in undefined),
            undefined[0] / (1 - undefined[0]),
        )
        return (
            f"prediction sets at {names} % contain all surfaces: they need at least {n_needed:.3g} held-out "
            f"recordings, got {self.effective_n:.3g}"
        )


def recency_weights(ages: ArrayLike, half_life: float) -> Samples:
    """Return the weights 0.5^(age / half_life).

    Parameters
    ----------
    ages : array_like of shape (n,)
        Age of each recording: the number of later recordings.
    half_life : float
        Age at which the weight is 0.5.
    """
    return np.asarray(0.5 ** (np.asarray(ages, dtype=np.float64) / half_life))


def calibrate_sets(
    decisions: Samples,
    labels: Labels,
    recordings: ArrayLike,
    calibration: Calibration,
    *,
    correlation: float | None = None,
    weights: ArrayLike = 1.0,
) -> dict[str, ConformalCalibration]:
    """Calibrate prediction sets for single answers and, for windows, for recordings and contacts.

    Parameters
    ----------
    decisions : ndarray of shape (n, n_classes)
        Decisions on held-out windows or recordings, in chronological order.
    labels : ndarray of int, shape (n,)
        Column of the true surface.
    recordings : array_like of shape (n,)
        Recording of each decision.
    calibration : Calibration
        Calibration of these decisions.
    correlation : float, optional
        Correlation between windows of one recording; None if recordings are classified as a whole.
    weights : array_like of shape (n,)
        Weight of the recording of each decision (default 1); see `recency_weights`.

    Returns
    -------
    dict of str to ConformalCalibration
        "answer": single decisions. With a correlation also "recording", the mean log posterior of all
        windows, and "contact 1", "contact 2", "contact 4", ...: the evidence after this number of windows, as
        long as at least half of the recordings have as many windows.
    """
    rows, names = np.arange(len(labels)), np.asarray(recordings)
    weights = np.broadcast_to(np.asarray(weights, dtype=np.float64), len(labels))
    odds = log_odds(calibration.beta * decisions)[rows, labels]
    if correlation is None:
        return {"answer": ConformalCalibration.from_answers(odds, names, weights)}
    mean_log_posterior, n_so_far, recording = running_log_posterior(calibration(decisions), names)
    n_windows = np.bincount(recording)[recording]
    answer_weights = weights * effective_windows(n_windows, correlation)
    calibrations = {"answer": ConformalCalibration.from_answers(odds, names, answer_weights)}

    def add(kind: str, scores: Samples, is_included: NDArray[np.bool_]) -> None:
        odds = log_odds(scores)[rows, labels]
        calibrations[kind] = ConformalCalibration.from_answers(
            odds[is_included], names[is_included], weights[is_included]
        )

    is_last = n_so_far == n_windows
    add("recording", mean_log_posterior, is_last)
    evidence = effective_windows(n_so_far, correlation)[:, None] * mean_log_posterior
    n = 1
    while 2 * np.count_nonzero(n_so_far == n) >= np.count_nonzero(is_last):
        add(f"contact {n}", evidence, n_so_far == n)
        n *= 2
    return calibrations


def n_later_repetitions(surfaces: NDArray[Any], repetitions: NDArray[Any]) -> Labels:
    """Return the number of later repetitions of the same surface, for each of n answers, shape (n,)."""
    return np.array(
        [
            len(set(repetitions[(surfaces == surface) & (repetitions > repetition)]))
            for surface, repetition in zip(surfaces, repetitions, strict=True)
        ]
    )


def manifest_entry(calibrations: Mapping[str, ConformalCalibration]) -> dict[str, Any]:
    """Return the entry of a manifest: effective number of recordings, thresholds (None if undefined)."""

    def thresholds(calibration: ConformalCalibration) -> dict[str, float | None]:
        values = {f"{level:g}": calibration.threshold(level) for level in DEFAULT_LEVELS}
        return {level: value if np.isfinite(value) else None for level, value in values.items()}

    return {
        "n": round(calibrations["answer"].effective_n, 6),
        "thresholds": {kind: thresholds(calibration) for kind, calibration in calibrations.items()},
    }


def describe_sets(sets: Mapping[float, Sequence[str]], n_surfaces: int, max_names: int = 3) -> dict[str, str]:
    """Return each prediction set as text.

    Parameters
    ----------
    sets : mapping of float to sequence of str
        Level -> surfaces.
    n_surfaces : int
        Number of surfaces of the model.
    max_names : int
        Number of surfaces that are listed by name (default 3).

    Examples
    --------
    >>> describe_sets({0.9: ("oak",), 0.95: ("oak", "felt"), 0.99: ("oak", "felt", "tin")}, n_surfaces=3)
    {'90 %': 'oak', '95 %': 'oak or felt', '99 %': 'any'}
    """

    def words(members: Sequence[str]) -> str:
        if len(members) == n_surfaces:
            return "any"
        n_more = len(members) - max_names
        return " or ".join([*members[:max_names], *([f"{n_more} more"] if n_more > 0 else [])])

    return {f"{100 * level:g} %": words(members) for level, members in sets.items()}


def sets_as_json(sets: Mapping[float, Sequence[str]]) -> dict[str, Any]:
    """Return prediction sets with JSON-compatible keys and values: level -> surfaces."""
    return {f"{level:g}": list(members) for level, members in sets.items()}
