"""What a model says of a recording, what touches of one say together, and what windows of one contact do."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from texclass.recognition.conformal import LEVELS, Conformity, as_facts
from texclass.recognition.probabilities import CORRELATION, LEAST_PROBABILITY, independent, log_of
from texclass.recording import Samples

Kind = Literal["majority", "sequential"]
CONFIDENCE = 0.95
"""From which probability on a verdict is sure, unless something else is asked for."""
CHANGED_WINDOWS = 3.0
"""Independent windows in a row that have to name another surface before a contact may have moved on to it."""


@dataclass(frozen=True)
class Answer:
    """Which surface a recording is of.

    Attributes
    ----------
    recording_id
        The recording.
    surface
        The likeliest known surface; also where `unknown`.
    probability
        Calibrated: of many answers of 0.8, eight in ten are right, if the surface is a known one.
    runner_up
        The second likeliest.
    unknown
        Whether this is probably none of the known surfaces, or a recording that cannot be judged.
    p_known
        Conformal p-value of "a known surface"; at most the model's false-alarm rate where `unknown`.
    reasons
        What a user should know: undefined features, clipping, a wrong rate, values never seen in training.
    probabilities
        Surface -> probability, all of them.
    prediction_sets
        Level -> surfaces, likeliest first, among which the right one is so often, if the surface is a known
        one; see `Conformity`. No level where nothing can be judged.
    """

    recording_id: str
    surface: str
    probability: float
    runner_up: str
    unknown: bool
    p_known: float
    reasons: tuple[str, ...] = ()
    probabilities: Mapping[str, float] = field(default_factory=dict, repr=False)
    prediction_sets: Mapping[float, tuple[str, ...]] = field(default_factory=dict)
    changed_from: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return what a machine reads, probabilities of all surfaces left out."""
        return {
            "recording": self.recording_id,
            "surface": self.surface,
            "probability": round(self.probability, 6),
            "runner_up": self.runner_up,
            "unknown": self.unknown,
            "p_known": round(self.p_known, 6),
            "reasons": list(self.reasons),
            "prediction_sets": as_facts(self.prediction_sets),
        }


class Prediction(NamedTuple):
    """Answer for one recording, or the problem that prevents one; and its true surface if known."""

    name: str
    answer: Answer | None
    problem: str = ""
    surface: str | None = None


def joined(answers: Sequence[Answer], recording_id: str) -> Answer:
    """Return the answer of several touches of one recording: the mean of their probabilities."""
    surfaces = tuple(answers[0].probabilities)
    p = np.mean([[answer.probabilities[m] for m in surfaces] for answer in answers], axis=0)
    n_unknown = sum(answer.unknown for answer in answers)
    said = (f"{n_unknown} of {len(answers)} touches are of no known surface",) if n_unknown else ()
    others = (r for answer in answers for r in answer.reasons if not r.startswith("unlike every"))
    return Answer(
        recording_id=recording_id,
        unknown=2 * n_unknown >= len(answers),
        p_known=float(np.median([answer.p_known for answer in answers])),
        reasons=(*said, *tuple(dict.fromkeys(others))[:5]),
        **ranked(p, surfaces),
    )


def ranked(p: Samples, surfaces: Sequence[str]) -> dict[str, Any]:
    """Return what probabilities (n_surfaces,) say, as fields of an answer or of a verdict."""
    best, second = np.argsort(-p, kind="stable")[:2]
    return {
        "surface": surfaces[best],
        "probability": float(p[best]),
        "runner_up": surfaces[second],
        "probabilities": dict(zip(surfaces, p.tolist(), strict=True)),
    }


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
        Whether the probability is at least the confidence asked for, and the surface is a known one.
    changed_from
        Surface of the windows before, if the last ones contradict them so clearly that the evidence was
        restarted with this window; else "".
    n_windows
        How many have spoken.
    felt_s
        Seconds from the onset of the contact to the end of the last of them.
    probabilities
        Surface -> probability.
    prediction_sets
        Level -> surfaces among which the right one is as often, if the surface is a known one; of models of
        touches, where windows are as long and add up as in the training.
    """

    surface: str
    probability: float
    runner_up: str
    unknown: bool
    sure: bool
    n_windows: int
    felt_s: float
    probabilities: Mapping[str, float] = field(default_factory=dict, repr=False)
    prediction_sets: Mapping[float, tuple[str, ...]] = field(default_factory=dict)
    changed_from: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return what a machine reads, probabilities of all surfaces left out."""
        facts = {name: value for name, value in vars(self).items() if name != "probabilities"}
        rounded = {name: round(facts[name], 6) for name in ("probability", "felt_s")}
        return facts | rounded | {"prediction_sets": as_facts(self.prediction_sets)}


class Evidence:
    """All windows of one contact.

    By "majority", every window has one vote; of equally many, the larger sum of probabilities wins.
    "sequential" is the mean log posterior of the windows, times how many independent ones they are worth:

        log P(m) = W/N sum_k g^(n-k) log p_k(m) + constant, N = sum_k g^(n-k),
        W = V / (1 + r max(V - 1, 0)), V = sum_k g^(n-k) w_k,

    where p_k are the calibrated probabilities of window k under a flat prior, w_k the share of it not felt
    before, g what is remembered from one window to the next, and r the correlation of windows that share
    a contact: its speed, its force, its spot, which all of them hold against the training [design effect of a
    cluster]. Windows that are independent (r = 0) add up to Bayes' rule; however many there are, they are
    worth at most 1/r. Of the whole, a share `lapse` is left to all surfaces alike.

    Parameters
    ----------
    surfaces : tuple of str
        In the order of an answer's probabilities.
    kind : {"majority", "sequential"}
        How windows are put together.
    window_s, hop_s : float
        Length of a window, and time from one to the next: overlapping windows share what they felt.
    correlation : float
        Of windows of one contact that share nothing, from 0 to 1; see `fit_correlation`.
    lapse : float
        What the contacts of the training do not rule out: 1 / (n + 2) after n of them.
    forget_s : float
        Time constant of forgetting (votes, too), for what goes on to other surfaces; infinite for never.
    confidence : float
        From which probability on the verdict is sure.
    conformity : mapping of int to Conformity, optional
        Windows -> how held-out contacts conformed after so many of them, of which sets are made at `levels`.
    levels : tuple of float
        How often the right surface is to be in them.

    References
    ----------
    Jamali, Sammut: Majority voting: surface classification by tactile sensing using surface texture, IEEE
    Transactions on Robotics 27, 2011.
    """

    def __init__(
        self,
        surfaces: tuple[str, ...],
        kind: Kind = "sequential",
        *,
        window_s: float = 1.0,
        hop_s: float = 1.0,
        correlation: float = CORRELATION,
        lapse: float = 0.0,
        forget_s: float = math.inf,
        confidence: float = CONFIDENCE,
        conformity: Mapping[int, Conformity] | None = None,
        levels: tuple[float, ...] = LEVELS,
    ) -> None:
        if kind not in ("majority", "sequential"):
            raise ValueError(f"evidence is {kind!r}. Expected 'majority' or 'sequential'")
        if not 0 < confidence < 1:
            raise ValueError(f"confidence is {confidence!r}. Expected a number between 0 and 1")
        if not (0 <= correlation <= 1 and 0 <= lapse < 1 and forget_s > 0):
            raise ValueError(
                f"correlation is {correlation!r}, lapse {lapse!r}, forget_s {forget_s!r}. Expected 0 to "
                "1, and a time above 0"
            )
        self.surfaces, self.kind, self.confidence = surfaces, kind, confidence
        self._correlation, self._lapse = correlation, lapse
        self._conformity, self._levels = conformity or {}, levels
        self._later = min(1.0, hop_s / window_s)
        self._g = math.exp(-hop_s / forget_s)
        self.reset()

    @property
    def constants(self) -> dict[str, Any]:
        """What a program needs to know that puts answers together as docs/stream-logic.md says."""
        return {
            "kind": self.kind,
            "correlation": self._correlation,
            "lapse": self._lapse,
            "later": self._later,
            "remembered": self._g,
            "confidence": self.confidence,
            "least_probability": LEAST_PROBABILITY,
            "changed_windows": CHANGED_WINDOWS,
        }

    def reset(self) -> None:
        """Forget everything: another contact."""
        self._votes, self._sum = np.zeros((2, len(self.surfaces)))
        self._weight = self._worth = self._unknown = 0.0
        self._n = 0
        self._contrary: list[Samples] = []
        """Probabilities of the last windows, as far as they name one other surface than the verdict."""
        self.verdict: ContactVerdict | None = None

    def add(self, answer: Answer, felt_s: float) -> ContactVerdict:
        """Take in the answer of a window that ends `felt_s` after the onset; return what is known now.

        The evidence restarts where windows worth `CHANGED_WINDOWS` independent ones in a row name one other
        surface, and alone would be sure of it.
        """
        p = np.array([answer.probabilities[m] for m in self.surfaces])
        if not self._is_change(p, is_unknown=answer.unknown):
            return self._add(p, answer.unknown, felt_s)
        before, contrary = self.verdict, self._contrary
        self.reset()
        for window in contrary:
            self._add(window, False, felt_s)
        assert before is not None
        assert self.verdict is not None
        self.verdict = replace(self.verdict, changed_from=before.surface)
        return self.verdict

    def _is_change(self, p: Samples, *, is_unknown: bool) -> bool:
        """Whether the last windows, this one included, are of another surface than those before."""
        named = int(np.argmax(p))
        if self.verdict is None or is_unknown or self.surfaces[named] == self.verdict.surface or self._g < 1:
            self._contrary = []
            return False
        if self._contrary and int(np.argmax(self._contrary[-1])) != named:
            self._contrary = []
        self._contrary.append(p)
        n = len(self._contrary)
        n_independent = 1 + (n - 1) * self._later
        if n_independent < CHANGED_WINDOWS:
            return False
        scores = log_of(np.array(self._contrary)).mean(axis=0) * independent(n_independent, self._correlation)
        odds = np.exp(scores - scores.max())
        return bool((1 - self._lapse) / odds.sum() + self._lapse / len(p) >= self.confidence)

    def _add(self, p: Samples, is_unknown: bool, felt_s: float) -> ContactVerdict:
        g, self._n, sets = self._g, self._n + 1, dict[float, tuple[str, ...]]()
        self._weight = g * self._weight + 1
        self._unknown = g * self._unknown + is_unknown
        if self.kind == "majority":
            self._votes *= g
            self._votes[int(np.argmax(p))] += 1
            self._sum = g * self._sum + p
            together = self._votes + 1 + 1e-6 * self._sum / self._weight
        else:
            self._sum = g * self._sum + log_of(p)
            self._sum -= self._sum.max()
            self._worth = g * self._worth + (1.0 if self._n == 1 else self._later)
            worth = independent(self._worth, self._correlation)
            scores = worth / self._weight * self._sum
            # By contacts that had been felt about as long.
            if felt := [n for n in self._conformity if n <= self._worth]:
                sets = self._conformity[max(felt)].sets(scores, self.surfaces, self._levels)
            together = np.exp(scores)  # the largest is 1: no overflow
        together = (1 - self._lapse) * together / together.sum() + self._lapse / len(p)
        unknown = 2 * self._unknown >= self._weight
        self.verdict = ContactVerdict(
            prediction_sets=sets,
            unknown=unknown,
            sure=bool(together.max() >= self.confidence) and not unknown,
            n_windows=self._n,
            felt_s=felt_s,
            **ranked(together, self.surfaces),
        )
        return self.verdict
