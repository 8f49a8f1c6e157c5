"""Active exploration: the next gesture is the one with the highest expected information gain per second.

Each gesture (tap, slow stroke, ...) has its own model. `Exploration` combines their answers for one surface
and recommends the next gesture (Bayesian exploration, after Fishel and Loeb, Frontiers in Neurorobotics 6:4,
2012). `ExplorationSession` does this in a stream, `rehearse` with a simulated hand.
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

REHEARSAL_RECIPE = Recipe(n_surfaces=6, n_recordings=8, n_operators=4, duration_s=5.0, fs=10_000, seed=6)
"""Surfaces and operators of the dataset `simulated6`."""


class GestureStatistics(NamedTuple):
    """Duration and expected answers of a gesture.

    Attributes
    ----------
    seconds
        Duration of the gesture, including the time to lift the tool and reach for the surface.
    confusion : ndarray of shape (n_surfaces, n_surfaces)
        Mean predicted probabilities (columns) for each true surface (rows).
    correlation
        Correlation between the answers for repetitions of the gesture by one operator on one surface, from 0
        to 1; see `fit_correlation`.

    Examples
    --------
    >>> tap = GestureStatistics(0.8, np.array([[0.9, 0.1], [0.2, 0.8]]), correlation=0.3)
    >>> tap.seconds
    0.8
    """

    seconds: float
    confusion: Samples
    correlation: float

    @classmethod
    def from_model(cls, model: Model, seconds: float | None = None) -> "GestureStatistics":
        """Return the statistics of a gesture, from the held-out recordings of its model.

        Parameters
        ----------
        model : Model
            Model that was trained on recordings of the gesture.
        seconds : float, optional
            Duration of the gesture. The default is the duration of the signal that an answer needs (0.3 s for
            a tap), plus 0.5 s to lift the tool and reach for the surface.

        Raises
        ------
        ValueError
            If the model file has no confusion matrix, or `seconds` is not positive.
        """
        calibration = model.manifest.calibration
        if "confusion" not in calibration:
            raise ValueError(f"{model!r} has no confusion matrix. Train the model again")
        signal_s = model.manifest.window_s or model.manifest.shortest_s or 0.3
        duration_s = 0.5 + signal_s if seconds is None else seconds
        if not duration_s > 0:
            raise ValueError(f"the duration of a gesture must be positive, got {seconds!r} s")
        confusion = np.asarray(calibration["confusion"], dtype=np.float64)
        return cls(
            duration_s,
            confusion / confusion.sum(axis=1, keepdims=True),
            calibration["repetition_correlation"],
        )


@dataclass(frozen=True)
class Advice:
    """Recommended next gesture.

    Attributes
    ----------
    gesture
        Gesture with the highest expected information gain per second.
    bits
        Expected information gain in bits.
    n_repetitions
        Number of times that the gesture has already been made on this surface.
    candidates
        The two most probable surfaces; none before the first gesture.

    Examples
    --------
    >>> str(Advice("stroke", bits=0.7, n_repetitions=1, candidates=("oak", "slate")))
    'stroke once more: oak or slate?'
    """

    gesture: str
    bits: float
    n_repetitions: int
    candidates: tuple[str, ...]

    def __str__(self) -> str:
        gesture = f"{self.gesture} once more" if self.n_repetitions else self.gesture
        return f"{gesture}: {' or '.join(self.candidates)}?" if self.candidates else gesture


class Exploration:
    """Combined answers of several gestures on one surface, and the recommended next gesture.

    The probability of surface m is log P(m) = sum_g w(n_g) mean_i log p_gi(m) + constant. Here p_gi are the
    calibrated probabilities of repetition i of gesture g. Repetitions by one operator have the correlation
    r_g, so w(n) = n / (1 + r_g (n - 1)) is their effective number.

    The expected gain of a gesture is the mutual information of surface and answer (`information_bits`) times
    w(n + 1) - w(n). The recommended gesture has the highest gain per second.

    Parameters
    ----------
    surfaces : tuple of str
        Surfaces, in the order of the confusion matrices.
    gestures : mapping of str to GestureStatistics
        Available gestures.
    confidence : float
        Probability at which the surface is sure and no further gesture is recommended (default 0.95).

    References
    ----------
    Fishel, Loeb: Bayesian exploration for intelligent identification of textures, Frontiers in Neurorobotics
    6:4, 2012. Xu, Loeb, Fishel: Tactile identification of objects using Bayesian exploration, ICRA 2013.

    Examples
    --------
    >>> tap = GestureStatistics(0.8, np.array([[0.7, 0.3], [0.3, 0.7]]), correlation=0.5)
    >>> stroke = GestureStatistics(1.5, np.array([[0.95, 0.05], [0.05, 0.95]]), correlation=0.1)
    >>> exploration = Exploration(("oak", "slate"), {"tap": tap, "stroke": stroke})
    >>> print(exploration.advice())
    stroke
    >>> exploration.add("stroke", {"oak": 0.8, "slate": 0.2})
    >>> print(exploration.advice())
    stroke once more: oak or slate?
    >>> exploration.add("stroke", {"oak": 0.97, "slate": 0.03})
    >>> exploration.sure, exploration.advice() is None
    (True, True)
    """

    def __init__(
        self,
        surfaces: tuple[str, ...],
        gestures: Mapping[str, GestureStatistics],
        confidence: float = DEFAULT_CONFIDENCE,
    ) -> None:
        if not gestures:
            raise ValueError("gestures must contain at least one gesture, got none")
        if not 0 < confidence < 1:
            raise ValueError(f"confidence must be between 0 and 1, got {confidence!r}")
        self.surfaces, self.gestures, self.confidence = surfaces, dict(gestures), confidence
        self.reset()

    @classmethod
    def from_models(
        cls,
        models: Mapping[str, Model],
        *,
        seconds: Mapping[str, float] | None = None,
        confidence: float = DEFAULT_CONFIDENCE,
    ) -> "Exploration":
        """Return the exploration with one trained model per gesture.

        Parameters
        ----------
        models : mapping of str to Model
            Gesture -> model. All models must have the same surfaces.
        seconds : mapping of str to float, optional
            Gesture -> duration in seconds (default: see `GestureStatistics.from_model`).
        confidence : float
            Probability at which the surface is sure (default 0.95).

        Raises
        ------
        ValueError
            If the models have different surfaces, or `seconds` contains a gesture without a model.
        """
        durations, surfaces = dict(seconds or {}), {name: model.surfaces for name, model in models.items()}
        if unknown := [name for name in durations if name not in models]:
            raise ValueError(
                f"seconds has unknown gestures: {', '.join(unknown)}. Expected some of {', '.join(models)}"
            )
        first = next(iter(surfaces.values()), ())
        if others := [name for name, names in surfaces.items() if names != first]:
            raise ValueError(
                f"all gestures must have the same surfaces, got {', '.join(first)} for {next(iter(models))} "
                f"and {', '.join(surfaces[others[0]])} for {others[0]}"
            )
        gestures = {
            name: GestureStatistics.from_model(model, durations.get(name)) for name, model in models.items()
        }
        return cls(first, gestures, confidence)

    def reset(self) -> None:
        """Delete all answers, before another surface is explored."""
        self._answers: dict[Any, tuple[str, Samples]] = {}
        """Contact, or number of the answer -> gesture, log probabilities."""

    def add(self, gesture: str, probabilities: Mapping[str, float], contact: Any = None) -> None:
        """Add the answer for a gesture.

        Parameters
        ----------
        gesture : str
            Name of the gesture.
        probabilities : mapping of str to float
            Surface -> calibrated probability, as in an `Answer`.
        contact : hashable, optional
            Identifier of the contact: a later answer for the same contact replaces the earlier one.

        Raises
        ------
        ValueError
            If there is no such gesture.
        """
        if gesture not in self.gestures:
            raise ValueError(f"gesture must be one of {', '.join(self.gestures)}, got {gesture!r}")
        p = np.array([probabilities[m] for m in self.surfaces])
        key = len(self._answers) if contact is None else ("contact", contact)
        self._answers[key] = gesture, log_probabilities(p)

    @property
    def n_gestures(self) -> int:
        """Number of gestures on this surface."""
        return len(self._answers)

    @property
    def probabilities(self) -> Samples:
        """Probabilities of the surfaces after all gestures, shape (n_surfaces,)."""
        total = np.zeros(len(self.surfaces))
        for name, statistics in self.gestures.items():
            if logs := [log_p for gesture, log_p in self._answers.values() if gesture == name]:
                total += effective_windows(len(logs), statistics.correlation) * np.mean(logs, axis=0)
        return softmax(total)

    @property
    def sure(self) -> bool:
        """Whether the most probable surface has reached the confidence."""
        return bool(self.probabilities.max() >= self.confidence)

    def expected_bits(self) -> dict[str, float]:
        """Return the expected information gain of each gesture as the next one: gesture -> bits."""
        bits, p = {}, self.probabilities
        for name, statistics in self.gestures.items():
            n, r = self._count(name), statistics.correlation
            gain = float(
                effective_windows(n + 1, r) - effective_windows(n, r)
            )  # in effective independent repetitions
            bits[name] = information_bits(p, statistics.confusion) * gain
        return bits

    def best_gesture(self, names: Iterable[str]) -> str:
        """Return the gesture among `names` with the highest expected information gain per second."""
        bits = self.expected_bits()
        return max(names, key=lambda name: bits[name] / self.gestures[name].seconds)

    def advice(self) -> Advice | None:
        """Return the recommended gesture; None if the surface is sure, or no gesture adds information."""
        best = self.best_gesture(self.gestures)
        bits = self.expected_bits()[best]
        if self.sure or bits < 1e-3:  # less than 0.001 bit is not worth a gesture
            return None
        candidates = np.argsort(-self.probabilities, kind="stable")[: 2 if self._answers else 0]
        return Advice(best, bits, self._count(best), tuple(self.surfaces[i] for i in candidates))

    def _count(self, gesture: str) -> int:
        return sum(name == gesture for name, _ in self._answers.values())


def entropy_bits(p: ArrayLike) -> Any:
    """Return the entropy -sum_k p_k log2 p_k over the last axis of probabilities p, in bits.

    Examples
    --------
    >>> float(entropy_bits([0.5, 0.25, 0.25]))
    1.5
    """
    p = np.asarray(p, dtype=np.float64)
    return -np.sum(p * np.log2(np.maximum(p, MIN_PROBABILITY)), axis=-1)


def information_bits(p: Samples, confusion: Samples) -> float:
    """Return the mutual information of surface m and answer a in bits.

    It is H(sum_m p_m P(a|m)) - sum_m p_m H(P(a|m)), with the entropy H.

    Parameters
    ----------
    p : ndarray of shape (n_surfaces,)
        Prior probabilities of the surfaces.
    confusion : ndarray of shape (n_surfaces, n_answers)
        Probabilities P(a|m), one row per surface.

    Examples
    --------
    >>> information_bits(np.array([0.5, 0.5]), np.eye(2))  # a perfect classifier
    1.0
    """
    return float(entropy_bits(p @ confusion) - p @ entropy_bits(confusion))


def load_gestures(folder: str | Path) -> dict[str, Model]:
    """Load the models of a folder, one per gesture: `slow_stroke.skops` is the model of "slow stroke".

    Raises
    ------
    ValueError
        If the folder contains no model, or a file is not a valid model (see `load_model`).

    Examples
    --------
    >>> list(load_gestures("gestures"))  # doctest: +SKIP
    ['slow stroke', 'tap']
    """
    files = sorted(file for file in Path(folder).glob("*.skops") if not is_hidden(file.name))
    if not files:
        raise ValueError(f"{folder} contains no models. Expected one file GESTURE.skops per gesture")
    return {file.stem.replace("_", " "): load_model(file) for file in files}


@dataclass(frozen=True)
class ExplorationVerdict(ContactVerdict):
    """Verdict for a surface after `n_windows` gestures.

    Attributes
    ----------
    gesture
        Last gesture.
    advice
        Recommended next gesture; None if the surface is sure, or no gesture adds information.

    Examples
    --------
    >>> advice = Advice("stroke", bits=0.7, n_repetitions=0, candidates=("oak", "slate"))
    >>> verdict = ExplorationVerdict("oak", 0.8, "slate", False, False, 1, 0.3, gesture="tap", advice=advice)
    >>> verdict.to_dict()["advice"]["text"]
    'stroke: oak or slate?'
    """

    gesture: str = ""
    advice: Advice | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the verdict as JSON, without the probabilities of all surfaces."""
        facts = super().to_dict() | {"advice": None}
        if self.advice is not None:
            advice = vars(self.advice) | {"bits": round(self.advice.bits, 6), "text": str(self.advice)}
            facts["advice"] = advice | {"candidates": list(self.advice.candidates)}
        return facts


class ExplorationSession(Session):
    """Session with one model per gesture, whose verdicts recommend the next gesture.

    - A movement counts as the recommended gesture; if a tap was recommended, it counts as the stroke with the
      highest expected gain per second.
    - A tap counts if a tap was recommended, or if it is the first gesture on a surface. All other taps are
      ignored, because strokes often start with a tap, and a stroke with stick-slip contains several.
    - Once a surface is sure, the next contact starts a new exploration.

    Parameters
    ----------
    models : mapping of str to Model
        Gesture -> model.
    raw, settings
        See `Session`; the confidence of `settings` applies to the exploration.
    seconds : mapping of str to float, optional
        Gesture -> duration in seconds, see `Exploration.from_models`.

    Examples
    --------
    >>> session = ExplorationSession(load_gestures("gestures"))  # doctest: +SKIP
    >>> for update in session.run(open_source("ros2:/imu")):  # doctest: +SKIP
    ...     print(update)
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
        self.exploration = Exploration.from_models(models, seconds=seconds, confidence=settings.confidence)
        strokes = {name: model for name, model in models.items() if "movement" in model.manifest.phases}
        self._strokes = tuple(strokes)
        self._first = next(iter(strokes or models))
        super().__init__(models[self._first], raw=raw, settings=settings)
        others = {name: model for name, model in models.items() if name != self._first}
        self._others = {name: Session(model, raw=raw, settings=settings) for name, model in others.items()}
        self._contacts: dict[int, tuple[str, bool]] = {}
        """Onset of a contact with this surface -> its gesture, and whether its surface is unknown."""

    def push(self, block: Block) -> tuple[Update | Notice, ...]:
        """Process a block; see `Session.push`."""
        others = {name: session.push(block) for name, session in self._others.items()}
        return self._merge(super().push(block), others)

    def finish(self) -> tuple[Update | Notice, ...]:
        """End the stream; see `Session.finish`."""
        others = {name: session.finish() for name, session in self._others.items()}
        return self._merge(super().finish(), others)

    def _merge(
        self, first: Iterable[Update | Notice], others: Mapping[str, Iterable[Update | Notice]]
    ) -> tuple[Update | Notice, ...]:
        """Return all updates of the first session, and from every session the answers for its own gesture."""
        pairs = [(self._first, update) for update in first]
        pairs += [
            (name, update)
            for name, updates in others.items()
            for update in updates
            if isinstance(update, WindowAnswer)
        ]
        merged: list[Update | Notice] = []
        for name, update in sorted(pairs, key=lambda pair: getattr(pair[1], "n_received", 0)):
            if not isinstance(update, WindowAnswer):
                merged.append(update)
            elif name == self._gesture_of(name, update.onset):
                merged.append(self._add_answer(name, update))
        return tuple(merged)

    def _start(self, block: Block) -> list[Update | Notice]:
        self._reset()
        return super()._start(block)

    def _reset(self) -> None:
        self.exploration.reset()
        self._contacts.clear()

    def _gesture_of(self, name: str, onset: int) -> str | None:
        """Return the gesture of a contact that model `name` has classified; None if it is ignored."""
        if onset not in self._contacts:
            # Memory must not grow with the stream: after 64 gestures, the exploration restarts.
            if self.exploration.sure or self.exploration.n_gestures >= 64:
                self._reset()
            gesture = self.exploration.best_gesture(self.exploration.gestures)
            if name in self._strokes:
                gesture = self.exploration.best_gesture(self._strokes)
            elif gesture in self._strokes:
                if self.exploration.n_gestures:
                    return None
                gesture = name
            self._contacts[onset] = gesture, False
        return self._contacts[onset][0]

    def _add_answer(self, name: str, update: WindowAnswer) -> WindowAnswer:
        """Add an answer to the exploration and return it with the verdict after all gestures."""
        assert self.recogniser is not None
        exploration, verdict = self.exploration, update.verdict
        exploration.add(name, verdict.probabilities, update.onset)
        self._contacts[update.onset] = name, verdict.unknown
        n_unknown = sum(is_unknown for _, is_unknown in self._contacts.values())
        exploration_verdict = ExplorationVerdict(
            unknown=2 * n_unknown >= exploration.n_gestures,
            sure=exploration.sure,
            n_windows=exploration.n_gestures,
            contact_s=(update.stop - min(self._contacts)) / self.recogniser.fs,
            gesture=name,
            advice=exploration.advice(),
            **rank_surfaces(exploration.probabilities, exploration.surfaces),
        )
        return replace(update, verdict=exploration_verdict)


def train_gestures(
    recipe: Recipe = REHEARSAL_RECIPE,
    gestures: Iterable[str] | None = None,
    *,
    n_jobs: int = 1,
    progress: Callable[..., Any] | None = None,
) -> dict[str, Model]:
    """Train one model per simulated gesture, evaluated by leave-one-operator-out.

    Parameters
    ----------
    recipe : Recipe
        Surfaces, operators and number of recordings.
    gestures : iterable of str, optional
        Some of `texclass.simulate.GESTURES` (default: all).
    n_jobs, progress
        See `train`.

    Returns
    -------
    models : dict of str to Model
        Gesture -> model.

    Examples
    --------
    >>> models = train_gestures(gestures=["tap", "slow stroke"])  # doctest: +SKIP
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
    recipe: Recipe = REHEARSAL_RECIPE,
    seed: int = 0,
    seconds: Mapping[str, float] | None = None,
    confidence: float = 0.95,
) -> Iterator[dict[str, Any]]:
    """Explore a simulated surface with a simulated hand, which makes the recommended gestures.

    Parameters
    ----------
    models : mapping of str to Model
        Gesture -> model, as `train_gestures` returns them.
    surface : str
        Name of a surface of the recipe. The simulated operator is not one of the recipe.
    recipe : Recipe
        Surfaces that can be simulated.
    seed : int
        Seed of the simulated gestures.
    seconds, confidence
        See `Exploration.from_models`.

    Yields
    ------
    dict
        Result of one gesture: its name `gesture`, total time in `seconds`, `answer` for this gesture alone,
        most probable `surface` after all gestures with its `probability`, whether it is `sure`, and `advice`
        (the next gesture, or None).

    Raises
    ------
    ValueError
        If the surface is not in the recipe or in the models, or a gesture cannot be simulated.

    Examples
    --------
    >>> for step in rehearse(load_gestures("gestures"), "wood-03"):  # doctest: +SKIP
    ...     print(step["gesture"], step["surface"], step["probability"])
    """
    from texclass.simulate import operator_catalogue, record_gesture

    exploration = Exploration.from_models(models, seconds=seconds, confidence=confidence)
    surfaces = {item.name: item for item in recipe.surfaces if item.name in exploration.surfaces}
    if surface not in surfaces:
        names = ", ".join(surfaces) or "the surfaces of the models"
        raise ValueError(f"cannot simulate the surface {surface!r}. Expected one of {names}")
    new_operator = operator_catalogue(recipe.n_operators + 1, recipe.seed)[-1]
    total_s = 0.0
    # If twelve gestures do not make the surface sure, further ones will not either.
    while (advice := exploration.advice()) is not None and exploration.n_gestures < 12:
        gesture, n = advice.gesture, exploration.n_gestures
        recording = record_gesture(
            gesture, surfaces[surface], new_operator, seed=(recipe.seed, seed, n), fs=recipe.fs
        )
        answer = models[gesture].answer(recording.with_(phases=None))
        exploration.add(gesture, answer.probabilities)
        total_s += exploration.gestures[gesture].seconds
        best = int(exploration.probabilities.argmax())
        yield {
            "gesture": gesture,
            "seconds": total_s,
            "answer": answer,
            "surface": exploration.surfaces[best],
            "probability": float(exploration.probabilities[best]),
            "sure": exploration.sure,
            "advice": exploration.advice(),
        }
