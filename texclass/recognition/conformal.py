"""Sets that hold: surfaces among which the right one is as often as asked for, as far as the past tells."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.recognition.probabilities import Calibration, Labels, independent, so_far
from texclass.recording import Samples

LEVELS = (0.9, 0.95)
"""How often the right surface is to be in the sets that are told beside an answer."""
ROUNDING = 1e-9
"""Of log odds, which two orders of the same sum may differ by."""
HALF_LIFE = 5.0
"""Recordings of a surface after which an earlier one counts half, where it is known which came later."""


def log_odds(scores: Samples) -> Samples:
    """Return s_m - log sum_{k != m} exp(s_k) of each surface m, both of shape (n, n_surfaces).

    They are the log odds of the softmax of scores, and tell answers apart whose probabilities round to 1.
    """
    s = np.maximum(scores, -1e9)  # of a surface that was in no training part, -inf
    rows, best = np.arange(len(s)), s.argmax(axis=1)
    largest = s[rows, best]
    others = s.copy()
    others[rows, best] = -np.inf
    second = others.max(axis=1)
    share = np.exp(others - largest[:, None])
    found = s - largest[:, None] - np.log1p(share.sum(axis=1, keepdims=True) - share)
    found[rows, best] = largest - second - np.log(np.exp(others - second[:, None]).sum(axis=1))
    return np.asarray(found)


@dataclass(frozen=True, eq=False)
class Conformity:
    """How right surfaces were thought of: the log odds of each held-out answer, and how much it counts.

    A set holds every surface whose log odds are at least `least`. Of all sets that hold the right surface
    as often, these are the smallest in the mean (Sadinle et al.). They may be empty: where answers are right
    more often than sets have to be, the least sure of them get none.

    Attributes
    ----------
    odds : ndarray of shape (n,)
        Log odds of the right surface, by a recogniser that had not seen the contact; ascending.
    weights : ndarray of shape (n,)
        Of each; the contact that is asked about counts 1. Answers of one contact share what it counts.

    References
    ----------
    Sadinle, Lei, Wasserman: Least ambiguous set-valued classifiers with bounded error levels, Journal of the
    American Statistical Association 114, 2019. Barber, Candès, Ramdas, Tibshirani: Conformal prediction
    beyond exchangeability, Annals of Statistics 51, 2023 (weights under drift). Lee, Barber, Willett:
    Distribution-free inference with hierarchical data, arXiv 2306.06342, 2023 (answers of one contact).
    """

    odds: Samples
    weights: Samples

    def __post_init__(self) -> None:
        rising = np.all(self.odds[1:] >= self.odds[:-1])
        if self.odds.shape != self.weights.shape or self.odds.ndim != 1 or not rising:
            raise ValueError(
                f"odds have shape {self.odds.shape}, weights {self.weights.shape}. Expected one weight "
                "each, odds ascending"
            )
        if not np.all((self.weights >= 0) & (self.weights <= 1)):
            raise ValueError("a weight is below 0 or above 1. Expected 0 to 1")

    @classmethod
    def of(cls, odds: ArrayLike, contacts: ArrayLike, counts: ArrayLike = 1.0) -> Self:
        """Return the conformity of held-out answers.

        Parameters
        ----------
        odds : array_like of shape (n,)
            Log odds that each gave to the right surface.
        contacts : array_like of shape (n,)
            Which contact each is of.
        counts : array_like of shape (n,)
            How much its contact counts: less where it was long ago (`recency`), more where its answers are
            independent of each other; as many as it has answers at most.
        """
        found = np.asarray(odds, dtype=np.float64)
        _, contact, n = np.unique(np.asarray(contacts), return_inverse=True, return_counts=True)
        order = np.argsort(found, kind="stable")
        return cls(found[order], (np.broadcast_to(counts, found.shape) / n[contact])[order])

    @property
    def n(self) -> float:
        """How many contacts all answers together count."""
        return float(self.weights.sum())

    def too_few(self, levels: Sequence[float]) -> str:
        """Return in words for which of the levels too few contacts were held out; "" for none."""
        lacking = [level for level in levels if self.least(level) == -np.inf]
        if not lacking:
            return ""
        shown, rule = " and ".join(f"{100 * level:g}" for level in lacking), lacking[0] / (1 - lacking[0])
        return (
            f"sets of {shown} % contain all surfaces: {self.n:.3g} contacts were held out, "
            f"at least {rule:.3g} are needed"
        )

    def least(self, level: float) -> float:
        """Return the log odds from which on a surface is in the set; -inf where too few were held out.

        They are the largest that answers of the share `level` reach: sum_{i: s_i >= least} w_i >= level
        (1 + sum_i w_i). The contact that is asked about is one of these, and may be worse than all of them.
        """
        reach = np.cumsum(self.weights[::-1])[::-1]
        enough = np.flatnonzero(reach >= level * (1 + self.n) - ROUNDING)
        return float(self.odds[enough[-1]]) if len(enough) else -np.inf

    def sets(
        self, scores: Samples, surfaces: Sequence[str], levels: Sequence[float] = LEVELS
    ) -> dict[float, tuple[str, ...]]:
        """Return level -> surfaces, likeliest first, from the scores (n_surfaces,) of an answer."""
        odds = log_odds(scores[None])[0]
        order = np.argsort(-odds, kind="stable")
        least = {level: self.least(level) - ROUNDING for level in levels}
        return {
            level: tuple(surfaces[i] for i in order if odds[i] >= at_least)
            for level, at_least in least.items()
        }

    def and_later(self, later: Self, share: float) -> Self:
        """Return the conformity of these answers, of which a share still counts, and of later ones."""
        odds = np.concatenate([self.odds, later.odds])
        order = np.argsort(odds, kind="stable")
        return type(self)(odds[order], np.concatenate([share * self.weights, later.weights])[order])


def recency(ages: ArrayLike, half_life: float) -> Samples:
    """Return how much contacts count of which so many later ones are known: half after each half-life."""
    return np.asarray(0.5 ** (np.asarray(ages, dtype=np.float64) / half_life))


def conformities(
    decisions: Samples,
    labels: Labels,
    contacts: ArrayLike,
    calibration: Calibration,
    *,
    correlation: float | None = None,
    counts: ArrayLike = 1.0,
) -> dict[str, Conformity]:
    """Return how answers conformed: each, and of touches what a contact says together.

    Parameters
    ----------
    decisions : ndarray of shape (n, n_classes)
        Of answers on contacts that did not train, in the order in which they were felt.
    labels : ndarray of int, shape (n,)
        Which column is right.
    contacts : array_like of shape (n,)
        Which recording each is of.
    calibration : Calibration
        Of these decisions.
    correlation : float, optional
        Of the windows of a contact; None where contacts are answered as a whole.
    counts : array_like of shape (n,)
        How much the contact counts; see `recency`.

    Returns
    -------
    dict of str to Conformity
        "answer"; with a correlation also "recording", the mean log posterior of all windows, and "contact 1",
        "contact 2", "contact 4", ..., the evidence of so many, while half of the contacts go on. Windows of a
        contact count as many answers as they are independent (`independent`).
    """
    right, told = np.arange(len(labels)), np.asarray(contacts)
    counts = np.broadcast_to(np.asarray(counts, dtype=np.float64), len(labels))
    odds = log_odds(calibration.beta * decisions)[right, labels]
    if correlation is None:
        return {"answer": Conformity.of(odds, told, counts)}
    logs, n, of = so_far(calibration(decisions), told)
    felt = np.bincount(of)[of]
    found = {"answer": Conformity.of(odds, told, counts * independent(felt, correlation))}
    last = n == felt
    odds = log_odds(logs)[right, labels]
    found["recording"] = Conformity.of(odds[last], told[last], counts[last])
    odds = log_odds(independent(n, correlation)[:, None] * logs)[right, labels]
    at = 1
    while 2 * np.count_nonzero(n == at) >= np.count_nonzero(last):
        found[f"contact {at}"] = Conformity.of(odds[n == at], told[n == at], counts[n == at])
        at *= 2
    return found


def n_later(surfaces: NDArray[Any], repetitions: NDArray[Any]) -> Labels:
    """Return how many repetitions of its surface came later, for each of n answers, shape (n,)."""
    return np.array(
        [
            len(set(repetitions[(surfaces == m) & (repetitions > r)]))
            for m, r in zip(surfaces, repetitions, strict=True)
        ]
    )


def facts_of(conformity: Mapping[str, Conformity]) -> dict[str, Any]:
    """Return what a manifest tells of sets: what held-out contacts count, and the log odds of members.

    These are None where too few contacts were held out for the level.
    """
    least = {
        kind: {f"{level:g}": found if np.isfinite(found := known.least(level)) else None for level in LEVELS}
        for kind, known in conformity.items()
    }
    return {"n": round(conformity["answer"].n, 6), "least": least}


def told(sets: Mapping[float, Sequence[str]], n_surfaces: int) -> dict[str, str]:
    """Return level -> set in words: "oak or felt"; none, or any of all surfaces."""

    def words(members: Sequence[str]) -> str:
        if len(members) in (0, n_surfaces):
            return "any" if members else "none"
        more = len(members) - 3
        return " or ".join(members[:3]) + (f" or {more} more" if more > 0 else "")

    return {f"{100 * level:g} %": words(members) for level, members in sets.items()}


def as_facts(sets: Mapping[float, Sequence[str]]) -> dict[str, Any]:
    """Return what a machine reads: level -> surfaces."""
    return {f"{level:g}": list(members) for level, members in sets.items()}
