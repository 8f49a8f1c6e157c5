"""What should I do next? Which gesture would tell most of a surface, by what is known and what each costs.

Every gesture has a model of its own: recordings of taps train one, recordings of slow strokes another. What
they say of one surface is put together, and the next gesture is the one that is expected to tell most in a
second (Bayesian exploration, after Fishel and Loeb, Frontiers in Neurorobotics 6:4, 2012).

`AskingSession` is a stream that asks: each gesture is heard by its own model, and all by one exploration.
`rehearse` shows it with a simulated hand that does as it is told.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from texclass.loaders.data_files import is_hidden
from texclass.recognition.answers import DEFAULT_CONFIDENCE, ContactVerdict, rank_surfaces
from texclass.recognition.live.online_recogniser import OnlineSettings, Update, WindowAnswer
from texclass.recognition.live.session import Notice, Session
from texclass.recognition.model import Model, load_model
from texclass.recognition.probabilities import MIN_PROBABILITY, effective_windows, log_probabilities, softmax
from texclass.recognition.sources.blocks import Block
from texclass.recording import Samples
from texclass.simulate import Recipe

REHEARSED = Recipe(n_surfaces=6, n_recordings=8, n_operators=4, duration_s=5.0, fs=10_000, seed=6)
"""The surfaces and the people of the dataset `simulated6`."""


class KnownGesture(NamedTuple):
    """What is known of a gesture before it is made.

    Attributes
    ----------
    seconds
        What it costs.
    confusion : ndarray of shape (n_surfaces, n_surfaces)
        Row m: the mean probabilities that were answered where m was felt.
    correlation
        Of what is answered when a hand repeats it on a surface, from 0 to 1; see `fit_correlation`.
    """

    seconds: float
    confusion: Samples
    correlation: float

    @classmethod
    def of(cls, model: Model, seconds: float | None = None) -> "KnownGesture":
        """Return what the held-out recordings of a model's training say of its gesture.

        Parameters
        ----------
        model : Model
            Trained on recordings of this gesture.
        seconds : float, optional
            What it costs; by default what an answer feels (a tap: 0.3), and 0.5 to lift the tool and reach.

        Raises
        ------
        ValueError
            If the model was trained by a texclass that did not look at this.
        """
        known, felt = model.manifest.calibration, model.manifest.window_s or model.manifest.shortest_s
        if "confusion" not in known:
            raise ValueError(f"{model!r} has no confusion matrix. Train it again")
        confusion = np.asarray(known["confusion"], dtype=np.float64)
        costs = 0.5 + (felt or 0.3) if seconds is None else seconds
        if not costs > 0:
            raise ValueError(f"the time of a gesture must be positive, got {seconds!r} s")
        return cls(costs, confusion / confusion.sum(axis=1, keepdims=True), known["repetition_correlation"])


@dataclass(frozen=True)
class Advice:
    """What to do next.

    Attributes
    ----------
    gesture
        The one that is expected to tell most in a second.
    bits
        Information about the surface that is expected of it.
    n_before
        How often it was made on this surface.
    between
        The two likeliest surfaces; none before the first gesture.
    """

    gesture: str
    bits: float
    n_before: int
    between: tuple[str, ...]

    def __str__(self) -> str:
        once_more = f"{self.gesture} once more" if self.n_before else self.gesture
        return f"{once_more}: {' or '.join(self.between)}?" if self.between else once_more


class Exploration:
    """What the gestures made on one surface say together, and which one to make next.

    log P(m) = sum_g w(n_g) mean_i log p_gi(m) + constant, where p_gi are the calibrated probabilities of
    repetition i of gesture g, and w(n) = n / (1 + r_g (n - 1)) is how many independent ones n repetitions by
    one hand are worth. Of a gesture is expected what its answers tell of the surface (`information_bits`),
    less what repeating it adds: w(n + 1) - w(n); a second of it is to tell most.

    Parameters
    ----------
    surfaces : tuple of str
        In the order of the confusions.
    gestures : mapping of str to KnownGesture
        That can be made.
    confidence : float
        Probability from which on no more is asked.

    References
    ----------
    Fishel, Loeb: Bayesian exploration for intelligent identification of textures, Frontiers in Neurorobotics
    6:4, 2012. Xu, Loeb, Fishel: Tactile identification of objects using Bayesian exploration, ICRA 2013.
    """

    def __init__(
        self,
        surfaces: tuple[str, ...],
        gestures: Mapping[str, KnownGesture],
        confidence: float = DEFAULT_CONFIDENCE,
    ) -> None:
        if not gestures or not 0 < confidence < 1:
            raise ValueError(
                f"{len(gestures)} gestures, confidence {confidence!r}. Expected one gesture or more, "
                "and a confidence above 0 and below 1"
            )
        self.surfaces, self.gestures, self.confidence = surfaces, dict(gestures), confidence
        self.reset()

    @classmethod
    def of(
        cls,
        models: Mapping[str, Model],
        *,
        seconds: Mapping[str, float] | None = None,
        confidence: float = DEFAULT_CONFIDENCE,
    ) -> "Exploration":
        """Return the exploration of surfaces that models know, one model for each gesture.

        Parameters
        ----------
        models : mapping of str to Model
            KnownGesture -> what was trained on it.
        seconds : mapping of str to float, optional
            KnownGesture -> what it costs, where that is known better than `KnownGesture.of` knows it.
        confidence : float
            See `Exploration`.

        Raises
        ------
        ValueError
            If the models know different surfaces, or a gesture is not among them.
        """
        costs, surfaces = dict(seconds or {}), {name: model.surfaces for name, model in models.items()}
        if unknown := [name for name in costs if name not in models]:
            raise ValueError(f"seconds of {unknown[0]!r}. Expected one of {', '.join(models)}")
        first = next(iter(surfaces.values()), ())
        if others := [name for name, known in surfaces.items() if known != first]:
            raise ValueError(
                f"{others[0]} knows {', '.join(surfaces[others[0]])}, {next(iter(models))} "
                f"{', '.join(first)}. Expected one set of surfaces for all gestures"
            )
        known = {name: KnownGesture.of(model, costs.get(name)) for name, model in models.items()}
        return cls(first, known, confidence)

    def reset(self) -> None:
        """Forget everything: another surface."""
        self._felt: dict[Any, tuple[str, Samples]] = {}

    def add(self, gesture: str, probabilities: Mapping[str, float], contact: Any = None) -> None:
        """Take in what was answered of a gesture.

        Parameters
        ----------
        gesture : str
            Which was made.
        probabilities : mapping of str to float
            Surface -> calibrated probability, as an `Answer` has them.
        contact : hashable, optional
            Names the contact: a later answer of the same contact takes the place of the earlier one.

        Raises
        ------
        ValueError
            If there is no such gesture.
        """
        if gesture not in self.gestures:
            raise ValueError(f"gesture is {gesture!r}. Expected one of {', '.join(self.gestures)}")
        p = np.array([probabilities[m] for m in self.surfaces])
        key = len(self._felt) if contact is None else ("contact", contact)
        self._felt[key] = gesture, log_probabilities(p)

    @property
    def n_gestures(self) -> int:
        """How many were made on this surface."""
        return len(self._felt)

    @property
    def probabilities(self) -> Samples:
        """Of the surfaces, shape (n_surfaces,), after all gestures."""
        total = np.zeros(len(self.surfaces))
        for name, known in self.gestures.items():
            if said := [log_p for made, log_p in self._felt.values() if made == name]:
                total += effective_windows(len(said), known.correlation) * np.mean(said, axis=0)
        return softmax(total)

    @property
    def sure(self) -> bool:
        """Whether the likeliest surface has reached the confidence."""
        return bool(self.probabilities.max() >= self.confidence)

    def expected_bits(self) -> dict[str, float]:
        """Return what each gesture is expected to tell, made next: gesture -> bits."""
        bits, p = {}, self.probabilities
        for name, known in self.gestures.items():
            n, r = self._made(name), known.correlation
            more = float(effective_windows(n + 1, r) - effective_windows(n, r))  # independent repetitions
            bits[name] = information_bits(p, known.confusion) * more
        return bits

    def best(self, among: Iterable[str]) -> str:
        """Return which of some gestures is expected to tell most in a second."""
        bits = self.expected_bits()
        return max(among, key=lambda name: bits[name] / self.gestures[name].seconds)

    def advice(self) -> Advice | None:
        """Return what to do next; None when the surface is sure, or nothing more is to be learnt."""
        best = self.best(self.gestures)
        bits = self.expected_bits()[best]
        if self.sure or bits < 1e-3:  # not worth a gesture
            return None
        likeliest = np.argsort(-self.probabilities, kind="stable")[: 2 if self._felt else 0]
        return Advice(best, bits, self._made(best), tuple(self.surfaces[i] for i in likeliest))

    def _made(self, gesture: str) -> int:
        return sum(name == gesture for name, _ in self._felt.values())


def entropy_bits(p: ArrayLike) -> Any:
    """Return -sum_k p_k log2 p_k over the last axis of probabilities p, in bits."""
    p = np.asarray(p, dtype=np.float64)
    return -np.sum(p * np.log2(np.maximum(p, MIN_PROBABILITY)), axis=-1)


def information_bits(p: Samples, confusion: Samples) -> float:
    """Return what an answer a tells of the surface m: H(sum_m p_m P(a|m)) - sum_m p_m H(P(a|m)), in bits.

    Parameters
    ----------
    p : ndarray of shape (n_surfaces,)
        What is believed before.
    confusion : ndarray of shape (n_surfaces, n_answers)
        P(a|m), a row each surface.
    """
    return float(entropy_bits(p @ confusion) - p @ entropy_bits(confusion))


def load_gestures(folder: str | Path) -> dict[str, Model]:
    """Read the models of a folder, one for each gesture: `slow_stroke.skops` is the slow stroke.

    Raises
    ------
    ValueError
        If the folder holds none; and as `load_model`.
    """
    files = sorted(file for file in Path(folder).glob("*.skops") if not is_hidden(file.name))
    if not files:
        raise ValueError(f"{folder}: holds no model. Expected a file GESTURE.skops for each gesture")
    return {file.stem.replace("_", " "): load_model(file) for file in files}


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
        """Return what a machine reads, probabilities of all surfaces left out."""
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
            # Memory must not grow with the stream: after 64 gestures an unsure surface is begun anew.
            if self.exploration.sure or self.exploration.n_gestures >= 64:
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
            contact_s=(update.stop - min(self._taken)) / self.live.fs,
            gesture=name,
            advice=known.advice(),
            **rank_surfaces(known.probabilities, known.surfaces),
        )
        return replace(update, verdict=verdict)


def train_gestures(
    recipe: Recipe = REHEARSED,
    gestures: Iterable[str] | None = None,
    *,
    n_jobs: int = 1,
    progress: Callable[..., Any] | None = None,
) -> dict[str, Model]:
    """Train a model for each simulated gesture; each person of a recipe is held out in turn.

    Parameters
    ----------
    recipe : Recipe
        As many recordings of each gesture.
    gestures : iterable of str, optional
        Some of `texclass.simulate.GESTURES`; all of them by default.
    n_jobs, progress
        As `train` takes them.
    """
    from texclass.loaders.simulated import open_gestures
    from texclass.recognition.training import train
    from texclass.simulate import GESTURES

    return {
        gesture: train(
            open_gestures(recipe, gesture),
            row="Taps" if gesture == "tap" else "Several time scales",
            classifier="lda",
            protocol="operator",
            n_jobs=n_jobs,
            progress=progress,
        )
        for gesture in (GESTURES if gestures is None else gestures)
    }


def rehearse(
    models: Mapping[str, Model],
    surface: str,
    *,
    recipe: Recipe = REHEARSED,
    seed: int = 0,
    seconds: Mapping[str, float] | None = None,
    confidence: float = 0.95,
) -> Iterator[dict[str, Any]]:
    """Yield the gestures that are made on a simulated surface, each as it was asked for, until it is sure.

    What is yielded says which `gesture` was made, what all so far have cost in `seconds`, the `answer` of
    this one alone, the likeliest `surface` after all with its `probability`, whether that is `sure`, and the
    `advice` what to do next: None when it is, or nothing more is to be learnt.

    Parameters
    ----------
    models : mapping of str to Model
        As `train_gestures` returns them.
    surface : str
        One of the recipe's. The hand is of a person whom the recipe does not know.
    recipe : Recipe
        Of the surfaces.
    seed : int
        Of what the hand does.
    seconds, confidence
        See `Exploration.of`.

    Raises
    ------
    ValueError
        If there is no such surface, or none that the models know, or a gesture cannot be simulated.
    """
    from texclass.simulate import operator_catalogue, record_gesture

    known, spent = Exploration.of(models, seconds=seconds, confidence=confidence), 0.0
    surfaces = {one.name: one for one in recipe.surfaces if one.name in known.surfaces}
    if surface not in surfaces:
        able = ", ".join(surfaces) or "those that the models know"
        raise ValueError(f"surface is {surface!r}, to be simulated. Expected one of {able}")
    stranger = operator_catalogue(recipe.n_operators + 1, recipe.seed)[-1]
    while (asked := known.advice()) is not None and known.n_gestures < 12:  # enough, or never sure
        n = known.n_gestures
        felt = record_gesture(
            asked.gesture, surfaces[surface], stranger, seed=(recipe.seed, seed, n), fs=recipe.fs
        )
        answer = models[asked.gesture].answer(felt.with_(phases=None))
        known.add(asked.gesture, answer.probabilities)
        spent += known.gestures[asked.gesture].seconds
        best = int(known.probabilities.argmax())
        yield {
            "gesture": asked.gesture,
            "seconds": spent,
            "answer": answer,
            "surface": known.surfaces[best],
            "probability": float(known.probabilities[best]),
            "sure": known.sure,
            "advice": known.advice(),
        }
