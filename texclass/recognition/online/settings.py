"""How a stream is listened to, and what is said of its windows."""

import math
from dataclasses import dataclass, field

from texclass.recognition.answer import Answer
from texclass.recognition.model import Model
from texclass.recognition.online.contact import ContactRules, Event
from texclass.recognition.online.evidence import CONFIDENCE, DISCOUNT, Kind, Verdict

DEFAULT_WINDOW_S = 1.0
LONGEST_WINDOW_S = 30.0
HOPS = 2
"""Windows that overlap, by default: a new answer after each half of a window."""


@dataclass(frozen=True, kw_only=True)
class OnlineSettings:
    """How a stream is listened to.

    Attributes
    ----------
    window_s
        Seconds of one answer; None: those the model was trained on.
    hop_s
        Seconds from one answer to the next; None: half a window.
    evidence
        How windows of a contact are put together; see `Evidence`.
    confidence, discount, forget_s
        See `Evidence`.
    stop_when_sure
        No more windows of a contact are computed once its verdict is sure.
    assume_contact
        Whether the stream begins in a movement; None: it does if the model was trained on movement only, else
        the first tenth of a second decides.
    rules
        When is what.
    """

    window_s: float | None = None
    hop_s: float | None = None
    evidence: Kind = "sequential"
    confidence: float = CONFIDENCE
    discount: float = DISCOUNT
    forget_s: float = math.inf
    stop_when_sure: bool = False
    assume_contact: bool | None = None
    rules: ContactRules = field(default_factory=ContactRules)

    def __post_init__(self) -> None:
        for name in ("window_s", "hop_s"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise ValueError(f"{name} is {value!r}; the rule is above 0, and finite")


@dataclass(frozen=True, eq=False)
class WindowAnswer:
    """What was said of one window of a stream.

    Attributes
    ----------
    start, stop
        Samples [start, stop) of the stream.
    known
        Samples that had come when it was due.
    answer
        Of this window alone: the same as the model gives for it as a recording.
    verdict
        Of the contact so far.
    onset
        Sample at which the contact began.
    ms
        What features and classifier took.
    """

    start: int
    stop: int
    known: int
    answer: Answer
    verdict: Verdict
    onset: int
    ms: float


Update = Event | WindowAnswer


def window_seconds(model: Model, settings: OnlineSettings) -> float:
    """Return the length of a window: as asked for, as trained on, or a second."""
    manifest = model.manifest
    trained = manifest.touch_s or manifest.shortest_s or DEFAULT_WINDOW_S
    return settings.window_s or min(trained, LONGEST_WINDOW_S)


def begins_in_contact(model: Model, settings: OnlineSettings) -> bool | None:
    """Return whether a stream begins in a movement: as asked for, or True if that is all a model knows."""
    if settings.assume_contact is not None:
        return settings.assume_contact
    return True if model.manifest.input.get("phases") == "movement" else None
