"""What a model says of a recording, and what several touches of one say together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from texclass.recognition.conformal import as_facts
from texclass.recording import Samples


@dataclass(frozen=True)
class Answer:
    """Which surface a recording is of.

    Attributes
    ----------
    recording_id
        The recording.
    surface
        The likeliest known material; also where `unknown`.
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
        Material -> probability, all of them.
    sets
        Level -> materials, likeliest first, among which the right one is so often, if the surface is a known
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
    sets: Mapping[float, tuple[str, ...]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return what a machine reads, probabilities of all materials left out."""
        return {
            "recording": self.recording_id,
            "surface": self.surface,
            "probability": round(self.probability, 6),
            "runner_up": self.runner_up,
            "unknown": self.unknown,
            "p_known": round(self.p_known, 6),
            "reasons": list(self.reasons),
            "sets": as_facts(self.sets),
        }


class Prediction(NamedTuple):
    """What became of one file: an answer, or the problem that there is none."""

    name: str
    answer: Answer | None
    problem: str = ""


def joined(answers: Sequence[Answer], recording_id: str) -> Answer:
    """Return the answer of several touches of one recording: the mean of their probabilities."""
    materials = tuple(answers[0].probabilities)
    p = np.mean([[answer.probabilities[m] for m in materials] for answer in answers], axis=0)
    n_unknown = sum(answer.unknown for answer in answers)
    said = (f"{n_unknown} of {len(answers)} touches are of no known surface",) if n_unknown else ()
    others = (r for answer in answers for r in answer.reasons if not r.startswith("unlike every"))
    return Answer(
        recording_id=recording_id,
        unknown=2 * n_unknown >= len(answers),
        p_known=float(np.median([answer.p_known for answer in answers])),
        reasons=(*said, *tuple(dict.fromkeys(others))[:5]),
        **ranked(p, materials),
    )


def ranked(p: Samples, materials: Sequence[str]) -> dict[str, Any]:
    """Return what probabilities (n_materials,) say, as fields of an answer or of a verdict."""
    best, second = np.argsort(-p, kind="stable")[:2]
    return {
        "surface": materials[best],
        "probability": float(p[best]),
        "runner_up": materials[second],
        "probabilities": dict(zip(materials, p.tolist(), strict=True)),
    }
