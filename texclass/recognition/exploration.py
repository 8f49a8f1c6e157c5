"""What should I do next? Which gesture would tell most of a surface, by what is known and what each costs.

Every gesture has a model of its own: recordings of taps train one, recordings of slow strokes another. What
they say of one surface is put together, and the next gesture is the one that is expected to tell most in a
second (Bayesian exploration, after Fishel and Loeb, Frontiers in Neurorobotics 6:4, 2012).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from texclass.recognition.live.evidence import CONFIDENCE, independent
from texclass.recognition.model import Model, load_model
from texclass.recognition.probabilities import LEAST_PROBABILITY
from texclass.recording import Samples

TAP_S, REACH_S = 0.3, 0.5
"""What a tap takes, and what lifting the tool and reaching the surface takes of any gesture."""
LEAST_BITS = 1e-3
"""Expected information below which no gesture is worth making."""


class KnownGesture(NamedTuple):
    """What is known of a gesture before it is made.

    Attributes
    ----------
    seconds
        What it costs.
    confusion : ndarray of shape (n_materials, n_materials)
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
            What it costs; by default what an answer feels (a tap: `TAP_S`), and `REACH_S`.

        Raises
        ------
        ValueError
            If the model was trained by a texclass that did not look at this.
        """
        known, felt = model.manifest.calibration, model.manifest.touch_s or model.manifest.shortest_s
        if "confusion" not in known:
            raise ValueError(f"{model!r} does not say what it confuses; the rule is to train it again")
        confusion = np.asarray(known["confusion"], dtype=np.float64)
        costs = REACH_S + (felt or TAP_S) if seconds is None else seconds
        if not costs > 0:
            raise ValueError(f"a gesture costs {seconds!r} s; the rule is above 0")
        return cls(costs, confusion / confusion.sum(axis=1, keepdims=True), known["repetition"])


@dataclass(frozen=True)
class Advice:
    """What to do next.

    Attributes
    ----------
    gesture
        The one that is expected to tell most in a second.
    bits
        Information about the material that is expected of it.
    n_before
        How often it was made on this surface.
    between
        The two likeliest materials; none before the first gesture.
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
    one hand are worth. Of a gesture is expected what its answers tell of the material (`information_bits`),
    less what repeating it adds: w(n + 1) - w(n); a second of it is to tell most.

    Parameters
    ----------
    materials : tuple of str
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
        self, materials: tuple[str, ...], gestures: Mapping[str, KnownGesture], confidence: float = CONFIDENCE
    ) -> None:
        if not gestures or not 0 < confidence < 1:
            raise ValueError(
                f"{len(gestures)} gestures, confidence {confidence!r}; the rule is one gesture or more, "
                "and a confidence above 0 and below 1"
            )
        self.materials, self.gestures, self.confidence = materials, dict(gestures), confidence
        self.reset()

    @classmethod
    def of(
        cls,
        models: Mapping[str, Model],
        *,
        seconds: Mapping[str, float] | None = None,
        confidence: float = CONFIDENCE,
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
            If the models know different materials, or a gesture is not among them.
        """
        costs, materials = dict(seconds or {}), {name: model.materials for name, model in models.items()}
        if unknown := [name for name in costs if name not in models]:
            raise ValueError(f"seconds of {unknown[0]!r}; the rule is one of {', '.join(models)}")
        first = next(iter(materials.values()), ())
        if others := [name for name, known in materials.items() if known != first]:
            raise ValueError(
                f"{others[0]} knows {', '.join(materials[others[0]])}, {next(iter(models))} "
                f"{', '.join(first)}; the rule is one set of materials for all gestures"
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
            Material -> calibrated probability, as an `Answer` has them.
        contact : hashable, optional
            Names the contact: a later answer of the same contact takes the place of the earlier one.

        Raises
        ------
        ValueError
            If there is no such gesture.
        """
        if gesture not in self.gestures:
            raise ValueError(f"gesture is {gesture!r}; the rule is one of {', '.join(self.gestures)}")
        p = np.array([probabilities[m] for m in self.materials])
        key = len(self._felt) if contact is None else ("contact", contact)
        self._felt[key] = gesture, np.log(np.maximum(p, LEAST_PROBABILITY))

    @property
    def n_gestures(self) -> int:
        """How many were made on this surface."""
        return len(self._felt)

    @property
    def probabilities(self) -> Samples:
        """Of the materials, shape (n_materials,), after all gestures."""
        total = np.zeros(len(self.materials))
        for name, known in self.gestures.items():
            if said := [log_p for made, log_p in self._felt.values() if made == name]:
                total += independent(len(said), known.correlation) * np.mean(said, axis=0)
        p = np.exp(total - total.max())
        return np.asarray(p / p.sum())

    @property
    def sure(self) -> bool:
        """Whether the likeliest material has reached the confidence."""
        return bool(self.probabilities.max() >= self.confidence)

    def expected_bits(self) -> dict[str, float]:
        """Return what each gesture is expected to tell, made next: gesture -> bits."""
        p = self.probabilities
        return {
            name: information_bits(p, known.confusion) * self._more(name)
            for name, known in self.gestures.items()
        }

    def best(self, among: Iterable[str]) -> str:
        """Return which of some gestures is expected to tell most in a second."""
        bits = self.expected_bits()
        return max(among, key=lambda name: bits[name] / self.gestures[name].seconds)

    def advice(self) -> Advice | None:
        """Return what to do next; None when the material is sure, or nothing more is to be learnt."""
        best = self.best(self.gestures)
        bits = self.expected_bits()[best]
        if self.sure or bits < LEAST_BITS:
            return None
        likeliest = np.argsort(-self.probabilities, kind="stable")[: 2 if self._felt else 0]
        return Advice(best, bits, self._made(best), tuple(self.materials[i] for i in likeliest))

    def _made(self, gesture: str) -> int:
        return sum(name == gesture for name, _ in self._felt.values())

    def _more(self, gesture: str) -> float:
        """Return how many independent repetitions one more is worth."""
        n, r = self._made(gesture), self.gestures[gesture].correlation
        return float(independent(n + 1, r) - independent(n, r))


def entropy_bits(p: ArrayLike) -> Any:
    """Return -sum_k p_k log2 p_k over the last axis of probabilities p, in bits."""
    p = np.asarray(p, dtype=np.float64)
    return -np.sum(p * np.log2(np.maximum(p, LEAST_PROBABILITY)), axis=-1)


def information_bits(p: Samples, confusion: Samples) -> float:
    """Return what an answer a tells of the material m: H(sum_m p_m P(a|m)) - sum_m p_m H(P(a|m)), in bits.

    Parameters
    ----------
    p : ndarray of shape (n_materials,)
        What is believed before.
    confusion : ndarray of shape (n_materials, n_answers)
        P(a|m), a row each material.
    """
    return float(entropy_bits(p @ confusion) - p @ entropy_bits(confusion))


def load_gestures(folder: str | Path) -> dict[str, Model]:
    """Read the models of a folder, one for each gesture: `slow_stroke.skops` is the slow stroke.

    Raises
    ------
    ValueError
        If the folder holds none; and as `load_model`.
    """
    files = sorted(Path(folder).glob("*.skops"))
    if not files:
        raise ValueError(f"{folder}: holds no model; the rule is a file GESTURE.skops for each gesture")
    return {file.stem.replace("_", " "): load_model(file) for file in files}
