"""What several windows of one contact say together: a majority, or the sum of their log posteriors."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np

from texclass.recognition.answer import Answer
from texclass.recording import Samples

Kind = Literal["majority", "sequential"]
CONFIDENCE = 0.95
DISCOUNT = 0.5
"""Weight of a second of touch against an independent one: windows of one stroke resemble each other."""


@dataclass(frozen=True)
class Verdict:
    """Which surface the contact is with, after all windows so far.

    Attributes
    ----------
    surface, probability, runner_up
        Of all windows together. By majority, the probability is (votes + 1) / (n + K), Laplace's estimate of
        the share of votes.
    unknown
        Whether at least half of the windows are of no known surface.
    sure
        Whether the probability has reached the confidence asked for, now or before in this contact.
    n_windows
        How many have spoken.
    felt_s
        Seconds from the onset of the contact to the end of the last of them.
    probabilities
        Material -> probability.
    """

    surface: str
    probability: float
    runner_up: str
    unknown: bool
    sure: bool
    n_windows: int
    felt_s: float
    probabilities: Mapping[str, float] = field(default_factory=dict, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return what a machine reads, probabilities of all materials left out."""
        return {
            "surface": self.surface,
            "probability": round(self.probability, 6),
            "runner_up": self.runner_up,
            "unknown": self.unknown,
            "sure": self.sure,
            "n_windows": self.n_windows,
            "felt_s": round(self.felt_s, 6),
        }


class Rule(Protocol):
    """How windows are put together; memory of a fixed size."""

    def add(self, p: Samples, weight: float) -> Samples:
        """Take in the probabilities (n_materials,) of a window and return those of the contact."""


class Majority:
    """Votes of windows; of equally many, the larger sum of probabilities wins.

    References
    ----------
    Jamali, Sammut: Majority voting: material classification by tactile sensing using surface texture, IEEE
    Transactions on Robotics 27, 2011.
    """

    def __init__(self, n_materials: int) -> None:
        self._votes, self._sum = np.zeros(n_materials), np.zeros(n_materials)

    def add(self, p: Samples, weight: float) -> Samples:
        """Count a vote; every window has one, whatever its weight."""
        self._votes[int(np.argmax(p))] += 1
        self._sum += p
        n, n_materials = self._votes.sum(), len(p)
        tie_break = 1e-6 * self._sum / n
        share = (self._votes + 1 + tie_break) / (n + n_materials)
        return np.asarray(share / share.sum())


class Sequential:
    """The mean log posterior of the windows, times how many independent ones they are worth.

    log P(m) = W/N sum_k g^(n-k) log p_k(m) + constant, N = sum_k g^(n-k), W = sum_k g^(n-k) w_k, where p_k
    are the calibrated probabilities of window k under a flat prior, w_k what it adds to what was felt (1 for
    the first), and g what is remembered from one window to the next. Windows that share nothing and are
    independent add up to Bayes' rule; no window counts more than another.

    Parameters
    ----------
    n_materials : int
        Surfaces.
    remember : float
        g, above 0 and at most 1.
    """

    def __init__(self, n_materials: int, remember: float = 1.0) -> None:
        self._sum, self._g = np.zeros(n_materials), remember
        self._n = self._worth = 0.0

    def add(self, p: Samples, weight: float) -> Samples:
        """Add a window's log probabilities."""
        self._sum = self._g * self._sum + np.log(np.maximum(p, 1e-12))
        self._sum -= self._sum.max()
        self._n, self._worth = self._g * self._n + 1, self._g * self._worth + weight
        together = np.exp(self._worth / self._n * self._sum)  # the largest is 1: nothing overflows
        return np.asarray(together / together.sum())


class Evidence:
    """All windows of one contact.

    Parameters
    ----------
    materials : tuple of str
        In the order of an answer's probabilities.
    kind : {"majority", "sequential"}
        How windows are put together.
    window_s, hop_s : float
        Length of a window, and time from one to the next: overlapping windows share what they felt.
    discount : float
        Weight of a second of touch against an independent one.
    forget_s : float
        Time constant of forgetting, for tools that slide from one surface to another; infinite for never.
    confidence : float
        From which probability on the verdict is sure.
    """

    def __init__(
        self,
        materials: tuple[str, ...],
        kind: Kind = "sequential",
        *,
        window_s: float = 1.0,
        hop_s: float = 1.0,
        discount: float = DISCOUNT,
        forget_s: float = math.inf,
        confidence: float = CONFIDENCE,
    ) -> None:
        if kind not in ("majority", "sequential"):
            raise ValueError(f"evidence is {kind!r}; the rule is 'majority' or 'sequential'")
        if not 0 < confidence < 1:
            raise ValueError(f"confidence is {confidence!r}; the rule is above 0 and below 1")
        if not (0 < discount <= 1 and forget_s > 0):
            raise ValueError(
                f"discount is {discount!r}, forget_s {forget_s!r}; the rule is above 0 (a discount at most 1)"
            )
        self.materials, self.kind, self.confidence = materials, kind, confidence
        self._later = min(1.0, hop_s / window_s) * discount
        self._first = 1.0
        self._remember = math.exp(-hop_s / forget_s)
        self.reset()

    def reset(self) -> None:
        """Forget everything: another contact."""
        n = len(self.materials)
        self._rule: Rule = Majority(n) if self.kind == "majority" else Sequential(n, self._remember)
        self._n = self._n_unknown = 0
        self._sure = False
        self.verdict: Verdict | None = None

    def add(self, answer: Answer, felt_s: float) -> Verdict:
        """Take in the answer of a window that ends `felt_s` after the onset; return what is known now."""
        p = np.array([answer.probabilities[m] for m in self.materials])
        together = self._rule.add(p, self._later if self._n else self._first)
        self._n += 1
        self._n_unknown += answer.unknown
        best, second = np.argsort(-together, kind="stable")[:2]
        self._sure = self._sure or bool(together[best] >= self.confidence)
        self.verdict = Verdict(
            surface=self.materials[best],
            probability=float(together[best]),
            runner_up=self.materials[second],
            unknown=2 * self._n_unknown >= self._n,
            sure=self._sure,
            n_windows=self._n,
            felt_s=felt_s,
            probabilities=dict(zip(self.materials, together.tolist(), strict=True)),
        )
        return self.verdict
