"""An exploration rehearsed: models of simulated gestures, and a simulated hand that does as it is told."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from texclass.recognition.exploration import Exploration
from texclass.recognition.model import Model
from texclass.simulate import GESTURES, Recipe, operator_catalogue, record_gesture

REHEARSED = Recipe(n_surfaces=6, n_recordings=8, n_operators=4, duration_s=5.0, fs=10_000, seed=6)
"""The surfaces and the people of the dataset `simulated6`."""
ROWS = {"tap": "Taps"}
"""Row of the pipeline `texclass` that a gesture is trained with."""
STROKES = "Several time scales"
MOST_STEPS = 12


def train_gestures(
    recipe: Recipe = REHEARSED,
    gestures: Iterable[str] = GESTURES,
    *,
    n_jobs: int = 1,
    progress: Callable[..., Any] | None = None,
) -> dict[str, Model]:
    """Train a model for each simulated gesture; each person of a recipe is held out in turn.

    Parameters
    ----------
    recipe : Recipe
        As many recordings of each gesture.
    gestures : iterable of str
        Some of `GESTURES`.
    n_jobs, progress
        As `train` takes them.
    """
    from texclass.loaders.simulated import open_gestures
    from texclass.recognition.training import train

    return {
        gesture: train(
            open_gestures(recipe, gesture),
            row=ROWS.get(gesture, STROKES),
            classifier="lda",
            protocol="operator",
            n_jobs=n_jobs,
            progress=progress,
        )
        for gesture in gestures
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
    known, spent = Exploration.of(models, seconds=seconds, confidence=confidence), 0.0
    surfaces = {one.name: one for one in recipe.surfaces if one.name in known.materials}
    if surface not in surfaces:
        able = ", ".join(surfaces) or "those that the models know"
        raise ValueError(f"surface is {surface!r}, to be simulated; the rule is one of {able}")
    stranger = operator_catalogue(recipe.n_operators + 1, recipe.seed)[-1]
    while (asked := known.advice()) is not None and known.n_gestures < MOST_STEPS:
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
            "surface": known.materials[best],
            "probability": float(known.probabilities[best]),
            "sure": known.sure,
            "advice": known.advice(),
        }
