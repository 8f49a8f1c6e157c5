"""Answers for recordings and windows, and the accumulated evidence of the windows of one contact."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from texclass.recognition.prediction_sets import DEFAULT_LEVELS, ConformalCalibration, sets_as_json
from texclass.recognition.probabilities import (
    DEFAULT_CORRELATION,
    MIN_PROBABILITY,
    effective_windows,
    log_probabilities,
)
from texclass.recording import Samples

Kind = Literal["majority", "sequential"]
DEFAULT_CONFIDENCE = 0.95
"""Minimum probability of a sure verdict."""
CHANGE_WINDOWS = 3.0
"""Effective number of consecutive windows that must predict another surface before the evidence restarts."""
MAX_REASONS = 5
"""Maximum number of different reasons that are copied from the answers for single windows."""


@dataclass(frozen=True, eq=False)
class FeatureRow:
    """Features of one recording or window, from which a model can answer again after an adaptation.

    Attributes
    ----------
    values : ndarray of shape (n_columns,)
        One value per column of the model; NaN where undefined.
    reasons : tuple of str
        Warnings about the recording.
    recording_id : str
        Name of the recording.
    is_valid : bool
        Whether the recording can be classified.

    Examples
    --------
    >>> FeatureRow(np.array([0.5, np.nan]), reasons=("undefined: hardness (no tap)",)).is_valid
    True
    """

    values: Samples
    reasons: tuple[str, ...] = ()
    recording_id: str = ""
    is_valid: bool = True


@dataclass(frozen=True)
class Answer:
    """Predicted surface of one recording or window, with its uncertainty.

    Attributes
    ----------
    recording_id : str
        Name of the recording.
    surface : str
        Most probable surface of the training set, even if `unknown` is true.
    probability : float
        Calibrated probability of `surface`: of all answers with probability 0.8 for trained surfaces, 80 %
        are correct.
    runner_up : str
        Second most probable surface.
    unknown : bool
        Whether the surface is probably not in the training set, or the recording cannot be classified.
    p_known : float
        Conformal p-value of the hypothesis that the surface is in the training set. The answer is `unknown`
        if it does not exceed the rate of false alarms.
    reasons : tuple of str
        Warnings about the recording: undefined features, clipping, a wrong sampling rate, values outside the
        training range.
    probabilities : mapping of str to float
        Probability of every surface.
    prediction_sets : mapping of float to tuple of str
        Prediction set of each level, most probable surface first; see `ConformalCalibration`. Empty if the
        recording cannot be classified.
    rows : tuple of FeatureRow
        Features of the recording, or of each of its windows.

    Examples
    --------
    >>> answer = Answer("stroke_1", "oak", 0.9, "cork", unknown=False, p_known=0.4)
    >>> answer.to_dict()["surface"]
    'oak'
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
    rows: tuple[FeatureRow, ...] = field(default=(), repr=False, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as JSON-compatible data, without the probabilities of all surfaces."""
        return {
            "recording": self.recording_id,
            "surface": self.surface,
            "probability": round(self.probability, 6),
            "runner_up": self.runner_up,
            "unknown": self.unknown,
            "p_known": round(self.p_known, 6),
            "reasons": list(self.reasons),
            "prediction_sets": sets_as_json(self.prediction_sets),
        }


class Prediction(NamedTuple):
    """Answer for one recording, or the problem that prevented an answer; with the true surface if known.

    Examples
    --------
    >>> Prediction("empty.csv", answer=None, problem="empty.csv contains no samples").answer is None
    True
    """

    name: str
    answer: Answer | None
    problem: str = ""
    surface: str | None = None


def average_answers(answers: Sequence[Answer], recording_id: str) -> Answer:
    """Combine the answers for the windows of a recording by averaging their probabilities.

    The recording is unknown if at least half of its windows are unknown. The answer has no prediction sets.

    Parameters
    ----------
    answers : sequence of Answer
        Answers for the windows.
    recording_id : str
        Name of the recording.

    Examples
    --------
    >>> p = ({"oak": 0.9, "cork": 0.1}, {"oak": 0.6, "cork": 0.4})
    >>> windows = [Answer("", "oak", q["oak"], "cork", False, 0.5, probabilities=q) for q in p]
    >>> average_answers(windows, "stroke_1").probability
    0.75
    """
    surfaces = tuple(answers[0].probabilities)
    p = np.mean([[answer.probabilities[m] for m in surfaces] for answer in answers], axis=0)
    n_unknown = sum(answer.unknown for answer in answers)
    summary = (f"{n_unknown} of {len(answers)} windows are of an unknown surface",) if n_unknown else ()
    reasons = (r for answer in answers for r in answer.reasons if not r.startswith("unlike every"))
    return Answer(
        recording_id=recording_id,
        unknown=2 * n_unknown >= len(answers),
        p_known=float(np.median([answer.p_known for answer in answers])),
        reasons=(*summary, *tuple(dict.fromkeys(reasons))[:MAX_REASONS]),
        rows=tuple(row for answer in answers for row in answer.rows),
        **rank_surfaces(p, surfaces),
    )


def rank_surfaces(p: Samples, surfaces: Sequence[str]) -> dict[str, Any]:
    """Return the fields of an answer or verdict that are derived from probabilities (n_surfaces,)."""
    best, second = np.argsort(-p, kind="stable")[:2]
    return {
        "surface": surfaces[best],
        "probability": float(p[best]),
        "runner_up": surfaces[second],
        "probabilities": dict(zip(surfaces, p.tolist(), strict=True)),
    }


@dataclass(frozen=True)
class ContactVerdict:
    """Predicted surface of a contact, from all of its windows so far.

    Attributes
    ----------
    surface, probability, runner_up
        Prediction from all windows. With majority voting, the probability is (votes + 1) / (n + K), Laplace's
        estimate of the share of votes.
    unknown : bool
        Whether at least half of the windows are of an unknown surface.
    sure : bool
        Whether the probability reaches the confidence, and the surface is not unknown.
    n_windows : int
        Number of windows.
    contact_s : float
        Time from the onset of the contact to the end of the last window in s.
    probabilities : mapping of str to float
        Probability of every surface.
    prediction_sets : mapping of float to tuple of str
        Prediction set of each level. Empty unless the length of the windows and the settings of the evidence
        are those of the training.
    previous_surface : str
        Predicted surface of the earlier windows if this window restarted the evidence, else "".

    Examples
    --------
    >>> evidence = Evidence(("cork", "oak"))
    >>> p = {"cork": 0.02, "oak": 0.98}
    >>> window = Answer("stroke_1", "oak", 0.98, "cork", unknown=False, p_known=0.5, probabilities=p)
    >>> verdict = evidence.add(window, contact_s=1.0)
    >>> verdict.surface, verdict.sure
    ('oak', True)
    """

    surface: str
    probability: float
    runner_up: str
    unknown: bool
    sure: bool
    n_windows: int
    contact_s: float
    probabilities: Mapping[str, float] = field(default_factory=dict, repr=False)
    prediction_sets: Mapping[float, tuple[str, ...]] = field(default_factory=dict)
    previous_surface: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as JSON-compatible data, without the probabilities of all surfaces."""
        values = {name: value for name, value in vars(self).items() if name != "probabilities"}
        rounded = {name: round(values[name], 6) for name in ("probability", "contact_s")}
        return values | rounded | {"prediction_sets": sets_as_json(self.prediction_sets)}


class Evidence:
    """Accumulated evidence of the windows of one contact.

    With "majority", every window has one vote; the sum of the probabilities breaks ties. "sequential" is the
    mean log posterior of the windows times their effective number:

        log P(m) = W/N sum_k g^(n-k) log p_k(m) + constant, N = sum_k g^(n-k),
        W = V / (1 + r max(V - 1, 0)), V = sum_k g^(n-k) w_k,

    where p_k are the calibrated probabilities of window k under a flat prior, w_k is the fraction of window k
    that does not overlap the previous window, g is the decay per window. The correlation between windows is
    r. Windows of one contact have similar speed, force and position, so they are correlated (design effect of
    cluster sampling). For independent windows (r = 0), this is Bayes' rule; any number of correlated windows
    counts as at most 1/r independent ones. Finally, a probability of `lapse` is distributed evenly over all
    surfaces.

    Parameters
    ----------
    surfaces : tuple of str
        Surfaces in the order of the probabilities of an answer.
    kind : {"majority", "sequential"}
        Method (default "sequential").
    window_s, hop_s : float
        Length of a window, and time between the starts of two windows, in s (default 1).
    correlation : float
        Correlation between windows without overlap, 0 to 1 (default 1); see `fit_correlation`.
    lapse : float
        Residual probability of an error, whatever the evidence (default 0); 1 / (n + 2) for n training
        contacts.
    forget_s : float
        Time constant of the decay of evidence and votes in s (default: no decay).
    confidence : float
        Minimum probability of a sure verdict (default 0.95).
    set_calibrations : mapping of int to ConformalCalibration, optional
        Number of windows -> calibration of the prediction sets after this number of windows.
    levels : tuple of float
        Coverage of the prediction sets (default 0.9 and 0.95).

    References
    ----------
    Jamali, Sammut: Majority voting: material classification by tactile sensing using surface texture, IEEE
    Transactions on Robotics 27, 2011.

    Examples
    --------
    >>> evidence = Evidence(("cork", "oak"), correlation=0.2)
    >>> p = {"cork": 0.3, "oak": 0.7}
    >>> window = Answer("stroke_1", "oak", 0.7, "cork", unknown=False, p_known=0.5, probabilities=p)
    >>> [round(evidence.add(window, contact_s).probability, 2) for contact_s in (1.0, 2.0, 3.0)]
    [0.7, 0.8, 0.86]
    """

    def __init__(
        self,
        surfaces: tuple[str, ...],
        kind: Kind = "sequential",
        *,
        window_s: float = 1.0,
        hop_s: float = 1.0,
        correlation: float = DEFAULT_CORRELATION,
        lapse: float = 0.0,
        forget_s: float = math.inf,
        confidence: float = DEFAULT_CONFIDENCE,
        set_calibrations: Mapping[int, ConformalCalibration] | None = None,
        levels: tuple[float, ...] = DEFAULT_LEVELS,
    ) -> None:
        if kind not in ("majority", "sequential"):
            raise ValueError(f"evidence must be 'majority' or 'sequential', got {kind!r}")
        if not 0 < confidence < 1:
            raise ValueError(f"confidence must be between 0 and 1, got {confidence!r}")
        if not 0 <= correlation <= 1:
            raise ValueError(f"correlation must be in [0, 1], got {correlation!r}")
        if not 0 <= lapse < 1:
            raise ValueError(f"lapse must be in [0, 1), got {lapse!r}")
        if not forget_s > 0:
            raise ValueError(f"forget_s must be positive, got {forget_s!r} s")
        self.surfaces, self.kind, self.confidence = surfaces, kind, confidence
        self._correlation, self._lapse = correlation, lapse
        self.set_calibrations, self._levels = set_calibrations or {}, levels
        self._new_share = min(1.0, hop_s / window_s)
        self._decay = math.exp(-hop_s / forget_s)
        self.reset()

    @property
    def constants(self) -> dict[str, Any]:
        """Constants for another implementation of the evidence; see docs/stream-logic.md."""
        return {
            "kind": self.kind,
            "correlation": self._correlation,
            "lapse": self._lapse,
            "new_share": self._new_share,
            "decay": self._decay,
            "confidence": self.confidence,
            "min_probability": MIN_PROBABILITY,
            "change_windows": CHANGE_WINDOWS,
        }

    def reset(self) -> None:
        """Discard all windows, for a new contact."""
        self._votes, self._sum = np.zeros((2, len(self.surfaces)))
        self._n_decayed = self._n_new = self._n_unknown = 0.0
        self._n = 0
        self._contrary: list[Samples] = []
        """Probabilities of the last windows that all predict the same surface other than the verdict."""
        self.verdict: ContactVerdict | None = None

    def add(self, answer: Answer, contact_s: float) -> ContactVerdict:
        """Add the answer for a window, and return the verdict after it.

        The evidence restarts when the last windows all predict the same other surface, have a total length of
        at least `CHANGE_WINDOWS` windows, and reach the confidence without the earlier windows.

        Parameters
        ----------
        answer : Answer
            Answer for the window.
        contact_s : float
            Time from the onset of the contact to the end of the window in s.
        """
        p = np.array([answer.probabilities[m] for m in self.surfaces])
        if not self._is_change(p, is_unknown=answer.unknown):
            return self._add(p, answer.unknown, contact_s)
        previous, contrary = self.verdict, self._contrary
        self.reset()
        for window in contrary:
            self._add(window, False, contact_s)
        assert previous is not None
        assert self.verdict is not None
        self.verdict = replace(self.verdict, previous_surface=previous.surface)
        return self.verdict

    def _is_change(self, p: Samples, *, is_unknown: bool) -> bool:
        """Return whether the last windows, including this one, indicate a surface other than the verdict."""
        best = int(np.argmax(p))
        is_contrary = (
            self.verdict is not None
            and not is_unknown
            and self.surfaces[best] != self.verdict.surface
            and self._decay == 1  # evidence that decays follows a change without a restart
        )
        if not is_contrary:
            self._contrary = []
            return False
        if self._contrary and int(np.argmax(self._contrary[-1])) != best:
            self._contrary = []
        self._contrary.append(p)
        n_new = 1 + (len(self._contrary) - 1) * self._new_share
        if n_new < CHANGE_WINDOWS:
            return False
        mean = log_probabilities(np.array(self._contrary)).mean(axis=0)
        scores = mean * effective_windows(n_new, self._correlation)
        odds = np.exp(scores - scores.max())
        return bool((1 - self._lapse) / odds.sum() + self._lapse / len(p) >= self.confidence)

    def _add(self, p: Samples, is_unknown: bool, contact_s: float) -> ContactVerdict:
        self._n += 1
        self._n_decayed = self._decay * self._n_decayed + 1
        self._n_unknown = self._decay * self._n_unknown + is_unknown
        sets: dict[float, tuple[str, ...]] = {}
        if self.kind == "majority":
            total = self._add_vote(p)
        else:
            scores = self._add_log_posterior(p)
            # Use the calibration for the largest number of windows that this contact has reached.
            if n_calibrated := [n for n in self.set_calibrations if n <= self._n_new]:
                calibration = self.set_calibrations[max(n_calibrated)]
                sets = calibration.predict_sets(scores, self.surfaces, self._levels)
            total = np.exp(scores)  # the largest value is 1, so exp cannot overflow
        total = (1 - self._lapse) * total / total.sum() + self._lapse / len(p)
        unknown = 2 * self._n_unknown >= self._n_decayed
        self.verdict = ContactVerdict(
            prediction_sets=sets,
            unknown=unknown,
            sure=bool(total.max() >= self.confidence) and not unknown,
            n_windows=self._n,
            contact_s=contact_s,
            **rank_surfaces(total, self.surfaces),
        )
        return self.verdict

    def _add_vote(self, p: Samples) -> Samples:
        """Return the votes plus 1, with the mean probabilities as a tie-breaker."""
        self._votes *= self._decay
        self._votes[int(np.argmax(p))] += 1
        self._sum = self._decay * self._sum + p
        return self._votes + 1 + 1e-6 * self._sum / self._n_decayed

    def _add_log_posterior(self, p: Samples) -> Samples:
        """Return the log posterior of all windows, whose largest value is 0."""
        self._sum = self._decay * self._sum + log_probabilities(p)
        self._sum -= self._sum.max()
        self._n_new = self._decay * self._n_new + (1.0 if self._n == 1 else self._new_share)
        n_effective = effective_windows(self._n_new, self._correlation)
        return np.asarray(n_effective / self._n_decayed * self._sum)
