"""A stream that says what to do next: each gesture is heard by its own model, and all by one exploration."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from texclass.recognition.exploration import Advice, Exploration
from texclass.recognition.live.evidence import ContactVerdict
from texclass.recognition.live.session import Notice, OnlineSettings, Session, Update, WindowAnswer
from texclass.recognition.model import Model, ranked
from texclass.recognition.sources.blocks import Block

MOST_GESTURES = 64
"""After so many that leave a surface unsure, it is begun anew: memory does not grow with the stream."""


@dataclass(frozen=True)
class ExploredVerdict(ContactVerdict):
    """Which surface it is, after all gestures so far: `n_windows` of them, since the first was begun.

    Attributes
    ----------
    gesture
        The last one.
    advice
        What to do next; None when the surface is sure, or nothing more is to be learnt.
    """

    gesture: str = ""
    advice: Advice | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return what a machine reads, probabilities of all materials left out."""
        known = super().to_dict() | {"advice": None}
        if self.advice is not None:
            advice = vars(self.advice) | {"bits": round(self.advice.bits, 6), "text": str(self.advice)}
            known["advice"] = advice | {"between": list(self.advice.between)}
        return known


class AskingSession(Session):
    """A session of several models, one for each gesture, whose verdicts say what to do next.

    A contact that lasts is taken for the stroke that was asked for when it began, or, where none was, for the
    one that would have told most. A tap counts where one was asked for, or nothing was felt before: every
    stroke may begin with one, and a stroke that sticks and slips has several. After a surface is sure, the
    next contact is with another one.

    Parameters
    ----------
    models : mapping of str to Model
        KnownGesture -> what was trained on it.
    raw, settings
        See `Session`; the confidence is that of the exploration.
    seconds : mapping of str to float, optional
        See `Exploration.of`.
    """

    def __init__(
        self,
        models: Mapping[str, Model],
        *,
        raw: bool = True,
        settings: OnlineSettings | None = None,
        seconds: Mapping[str, float] | None = None,
    ) -> None:
        settings = settings or OnlineSettings()
        self.exploration = Exploration.of(models, seconds=seconds, confidence=settings.confidence)
        strokes = {name: model for name, model in models.items() if "movement" in model.manifest.phases}
        self._strokes = tuple(strokes)
        self._first = next(iter(strokes or models))
        super().__init__(models[self._first], raw=raw, settings=settings)
        rest = {name: model for name, model in models.items() if name != self._first}
        self._others = {name: Session(model, raw=raw, settings=settings) for name, model in rest.items()}
        self._taken: dict[int, tuple[str, bool]] = {}
        """Onset of a contact with this surface -> the gesture it is taken for, whether that is unknown."""

    def take(self, block: Block) -> tuple[Update | Notice, ...]:
        """Take in a block; see `Session.take`."""
        others = {name: session.take(block) for name, session in self._others.items()}
        return self._together(super().take(block), others)

    def finish(self) -> tuple[Update | Notice, ...]:
        """Say that the stream has ended; see `Session.finish`."""
        others = {name: session.finish() for name, session in self._others.items()}
        return self._together(super().finish(), others)

    def _together(
        self, found: Iterable[Update | Notice], others: Mapping[str, Iterable[Update | Notice]]
    ) -> tuple[Update | Notice, ...]:
        """Return events and notices of one session, and the answers of all that are of the gesture made."""
        told: list[Update | Notice] = []
        heard = [(self._first, update) for update in found]
        heard += [(name, u) for name, said in others.items() for u in said if isinstance(u, WindowAnswer)]
        for name, update in sorted(heard, key=lambda pair: getattr(pair[1], "known", 0)):
            if not isinstance(update, WindowAnswer):
                told.append(update)
            elif name == self._taken_for(name, update.onset):
                told.append(self._explored(name, update))
        return tuple(told)

    def _begin(self, block: Block) -> list[Update | Notice]:
        self._forget()
        return super()._begin(block)

    def _forget(self) -> None:
        self.exploration.reset()
        self._taken.clear()

    def _taken_for(self, name: str, onset: int) -> str | None:
        """Return which gesture a contact is, that the model of `name` has an answer to; None: none."""
        if onset not in self._taken:
            if self.exploration.sure or self.exploration.n_gestures >= MOST_GESTURES:
                self._forget()
            asked = self.exploration.best(self.exploration.gestures)
            if name in self._strokes:
                asked = self.exploration.best(self._strokes)
            elif asked in self._strokes:
                if self.exploration.n_gestures:
                    return None
                asked = name
            self._taken[onset] = asked, False
        return self._taken[onset][0]

    def _explored(self, name: str, update: WindowAnswer) -> WindowAnswer:
        """Return an answer with what all gestures on this surface say."""
        assert self.live is not None
        known, contact = self.exploration, update.verdict
        known.add(name, contact.probabilities, update.onset)
        self._taken[update.onset] = name, contact.unknown
        n_unknown = sum(unknown for _, unknown in self._taken.values())
        verdict = ExploredVerdict(
            unknown=2 * n_unknown >= known.n_gestures,
            sure=known.sure,
            n_windows=known.n_gestures,
            felt_s=(update.stop - min(self._taken)) / self.live.fs,
            gesture=name,
            advice=known.advice(),
            **ranked(known.probabilities, known.materials),
        )
        return replace(update, verdict=verdict)
