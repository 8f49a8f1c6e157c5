"""Contacts whose material is known, held out or felt later: how they conformed, of which sets are made."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texclass.experiment.feature_table import metadata
from texclass.loaders.dataset import Dataset
from texclass.recognition.conformal import LEVELS, Conformity, log_odds, recency
from texclass.recognition.live.evidence import independent, so_far
from texclass.recognition.model import Model
from texclass.recognition.probabilities import Calibration
from texclass.recording import Samples

Labels = NDArray[Any]
HALF_LIFE = 5.0
"""Recordings of a surface after which an earlier one counts half, where it is known which came later."""


def conformities(
    decisions: Samples,
    labels: Labels,
    contacts: ArrayLike,
    calibration: Calibration,
    *,
    correlation: float | None = None,
    counts: ArrayLike = 1.0,
) -> dict[str, Conformity]:
    """Return how answers conformed: each, and of touches what a contact says together.

    Parameters
    ----------
    decisions : ndarray of shape (n, n_classes)
        Of answers on contacts that did not train, in the order in which they were felt.
    labels : ndarray of int, shape (n,)
        Which column is right.
    contacts : array_like of shape (n,)
        Which recording each is of.
    calibration : Calibration
        Of these decisions.
    correlation : float, optional
        Of the windows of a contact; None where contacts are answered as a whole.
    counts : array_like of shape (n,)
        How much the contact counts; see `recency`.

    Returns
    -------
    dict of str to Conformity
        "answer"; with a correlation also "recording", the mean log posterior of all windows, and "contact 1",
        "contact 2", "contact 4", ..., the evidence of so many, while half of the contacts go on. Windows of a
        contact count as many answers as they are independent (`independent`).
    """
    right, told = np.arange(len(labels)), np.asarray(contacts)
    counts = np.broadcast_to(np.asarray(counts, dtype=np.float64), len(labels))
    odds = log_odds(calibration.beta * decisions)[right, labels]
    if correlation is None:
        return {"answer": Conformity.of(odds, told, counts)}
    logs, n, of = so_far(calibration(decisions), told)
    felt = np.bincount(of)[of]
    found = {"answer": Conformity.of(odds, told, counts * independent(felt, correlation))}
    last = n == felt
    odds = log_odds(logs)[right, labels]
    found["recording"] = Conformity.of(odds[last], told[last], counts[last])
    odds = log_odds(independent(n, correlation)[:, None] * logs)[right, labels]
    at = 1
    while 2 * np.count_nonzero(n == at) >= np.count_nonzero(last):
        found[f"contact {at}"] = Conformity.of(odds[n == at], told[n == at], counts[n == at])
        at *= 2
    return found


def n_later(materials: Labels, repetitions: Labels) -> NDArray[np.intp]:
    """Return how many repetitions of its surface came later, for each of n answers, shape (n,)."""
    return np.array(
        [
            len(set(repetitions[(materials == m) & (repetitions > r)]))
            for m, r in zip(materials, repetitions, strict=True)
        ]
    )


def facts_of(conformity: Mapping[str, Conformity]) -> dict[str, Any]:
    """Return what a manifest tells of sets: what held-out contacts count, and the log odds of members.

    These are None where too few contacts were held out for the level.
    """
    least = {
        kind: {f"{level:g}": found if np.isfinite(found := known.least(level)) else None for level in LEVELS}
        for kind, known in conformity.items()
    }
    return {"n": round(conformity["answer"].n, 6), "least": least}


def with_references(model: Model, references: Dataset) -> Model:
    """Return a model whose sets follow recordings that were felt since its training.

    A sensor that drifts makes right materials less likely than they were when the model was trained.
    Recordings of known surfaces, felt now and then, tell how likely they are now. Each counts half with every
    `HALF_LIFE` recordings of its surface that came later; so do contacts held out in training, which all
    references followed. Answers and probabilities stay as they are.

    Parameters
    ----------
    model : Model
        Trained.
    references : Dataset
        Whole recordings of surfaces that it knows, not among those that trained it; in their order of
        repetitions where these are numbered, else all count the same.

    Raises
    ------
    ValueError
        If a surface is unknown to the model, or a recording cannot be judged by it; the message names it.
    """
    table = metadata(references.entries)
    materials = table["material"].to_numpy(dtype=str)
    if unknown := sorted({*materials.tolist()} - {*model.materials}):
        raise ValueError(
            f"{references.name}: {unknown[0]!r} is no surface of the model; the rule is one of "
            f"{', '.join(model.materials)}"
        )
    rows, contacts = list[Samples](), list[int]()
    for i, recording in enumerate(references):
        if unlike := model.unlike(recording.fs, recording.unit):
            raise ValueError(f"{recording.recording_id}: {unlike[0]}")
        for touch in model.cut(recording) or (recording,):
            rows.append(model.deployed.compute(touch).values)
            contacts.append(i)
    numbered = table["repetition"].notna().all()
    ages = n_later(materials, table["repetition"].to_numpy()) if numbered else np.zeros(len(table))
    renewed = with_answers(model, np.array(rows), materials[contacts], contacts, ages[contacts])
    calibration = dict(renewed.manifest.calibration)
    calibration["sets"] = {**calibration["sets"], "references": references.input_hash}
    return replace(renewed, manifest=renewed.manifest.model_copy(update={"calibration": calibration}))


def with_answers(
    model: Model, X: Samples, materials: ArrayLike, contacts: ArrayLike, ages: ArrayLike
) -> Model:
    """Return a model whose sets follow features of recordings felt since its training; see `with_references`.

    Parameters
    ----------
    model : Model
        Trained.
    X : ndarray of shape (n, n_columns)
        Of whole recordings or touches, in the order in which they were felt.
    materials, contacts : array_like of shape (n,)
        Which material, and which recording each is of.
    ages : array_like of shape (n,)
        How many recordings of its surface came later.

    Raises
    ------
    ValueError
        If the model keeps no sets.
    """
    if not model.conformity:
        raise ValueError(f"{model!r} has no sets; the rule is a model of format 2.3 or later: train it again")
    place = {name: i for i, name in enumerate(model.materials)}
    later = conformities(
        model.deployed.decided(X)[1],
        np.array([place[name] for name in np.asarray(materials).tolist()]),
        contacts,
        model.calibration,
        correlation=model.manifest.calibration.get("correlation"),
        counts=recency(ages, HALF_LIFE),
    )
    share = float(recency(1 + np.max(ages), HALF_LIFE))
    conformity = {
        kind: known.and_later(later[kind], share) if kind in later else known
        for kind, known in model.conformity.items()
    }
    told = {**model.manifest.calibration, "sets": facts_of(conformity)}
    return replace(
        model, conformity=conformity, manifest=model.manifest.model_copy(update={"calibration": told})
    )
