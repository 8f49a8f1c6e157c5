"""What several windows of one contact say together: a majority, or the sum of their log posteriors."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from texclass.recognition.model import Answer, ranked

Kind = Literal["majority", "sequential"]
CONFIDENCE = 0.95
DISCOUNT = 0.5
"""Weight of a second of touch against an independent one: windows of one stroke resemble each other."""


@dataclass(frozen=True)
class ContactVerdict:
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
        facts = {name: value for name, value in vars(self).items() if name != "probabilities"}
        return facts | {name: round(facts[name], 6) for name in ("probability", "felt_s")}


class Evidence:
    """All windows of one contact.

    By "majority", every window has one vote; of equally many, the larger sum of probabilities wins.
    "sequential" is the mean log posterior of the windows, times how many independent ones they are worth:

        log P(m) = W/N sum_k g^(n-k) log p_k(m) + constant, N = sum_k g^(n-k), W = sum_k g^(n-k) w_k,

    where p_k are the calibrated probabilities of window k under a flat prior, w_k what it adds to what was
    felt (1 for the first), and g what is remembered from one window to the next. Windows that share nothing
    and are independent add up to Bayes' rule; no window counts more than another.

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

    References
    ----------
    Jamali, Sammut: Majority voting: material classification by tactile sensing using surface texture, IEEE
    Transactions on Robotics 27, 2011.
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
        self._g = math.exp(-hop_s / forget_s)
        self.reset()

    def reset(self) -> None:
        """Forget everything: another contact."""
        self._votes, self._sum = np.zeros((2, len(self.materials)))
        self._weight = self._worth = 0.0
        self._n = self._n_unknown = 0
        self._sure = False
        self.verdict: ContactVerdict | None = None

    def add(self, answer: Answer, felt_s: float) -> ContactVerdict:
        """Take in the answer of a window that ends `felt_s` after the onset; return what is known now."""
        p = np.array([answer.probabilities[m] for m in self.materials])
        self._n += 1
        self._n_unknown += answer.unknown
        if self.kind == "majority":
            self._votes[int(np.argmax(p))] += 1
            self._sum += p
            tie_break = 1e-6 * self._sum / self._n
            together = (self._votes + 1 + tie_break) / (self._n + len(p))
        else:
            self._sum = self._g * self._sum + np.log(np.maximum(p, 1e-12))
            self._sum -= self._sum.max()
            self._weight = self._g * self._weight + 1
            self._worth = self._g * self._worth + (1.0 if self._n == 1 else self._later)
            together = np.exp(self._worth / self._weight * self._sum)  # the largest is 1: no overflow
        together /= together.sum()
        self._sure = self._sure or bool(together.max() >= self.confidence)
        self.verdict = ContactVerdict(
            unknown=2 * self._n_unknown >= self._n,
            sure=self._sure,
            n_windows=self._n,
            felt_s=felt_s,
            **ranked(together, self.materials),
        )
        return self.verdict
