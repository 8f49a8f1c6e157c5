"""The answer to "which surface is this"."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


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
    """

    recording_id: str
    surface: str
    probability: float
    runner_up: str
    unknown: bool
    p_known: float
    reasons: tuple[str, ...] = ()
    probabilities: Mapping[str, float] = field(default_factory=dict, repr=False)

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
        }
