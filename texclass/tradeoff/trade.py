"""Speed against accuracy: what features cost, what every budget buys, and the pipeline at the budget."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid

from texclass.experiment.choice import NO_LIMITS, Limits, budgets_within, check, choose, deployed
from texclass.experiment.cost import ClassifierCost, CostMeter, CostModel, classifier_cost
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.protocols import find_protocol
from texclass.experiment.windows import touches
from texclass.experiment.workers import Progress
from texclass.features.extractor import Plan
from texclass.features.phase_view import Channels
from texclass.features.sets import FeatureSet
from texclass.loaders.dataset import Dataset
from texclass.provenance import versions
from texclass.tradeoff.curves import Study, order_curve, sensor_curves, touch_curve, training_curves
from texclass.tradeoff.front import Data, discriminant, nested_fewest, nested_front, preparation
from texclass.tradeoff.tradeoff_result import Chosen, Curve, Estimate, FeatureCost, Tradeoff

LIBRARIES = ("numpy", "scipy", "scikit-learn", "skops", "PyWavelets", "librosa")
CLASSIFIERS = {
    "naive_bayes": GaussianNB(),
    "lda": discriminant(),
    "euclidean": NearestCentroid(),
    "nearest_neighbour": KNeighborsClassifier(1),
}
MOST_COLUMNS = 12
"""Columns up to which the fewest for a scene are looked for."""
N_CHECKED = 10
"""Random subsets on which the cost model is checked."""


def run_tradeoff(
    dataset: Dataset,
    feature_set: FeatureSet,
    limits: Limits = NO_LIMITS,
    *,
    channels: Channels = "auto",
    protocol: str = "recording",
    n_folds: int = 5,
    n_repeats: int = 3,
    seed: int = 2015,
    with_curves: bool = True,
    n_jobs: int = 1,
    progress: Progress | None = None,
    model_file: str | Path | None = None,
) -> Tradeoff:
    """Measure what accuracy costs on a dataset, and save the pipeline at the budget.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings.
    feature_set : FeatureSet
        What may be bought.
    limits : Limits
        The budget.
    channels : {"combine", "each", "auto"}
        See `FeatureExtractor`.
    protocol : str
        How recordings are split; see `PROTOCOLS`.
    n_folds, n_repeats : int
        Of repeated cross-validation; features are chosen inside each training part.
    seed : int
        Of the folds.
    with_curves : bool
        Whether accuracy against touch, training, rate, bits and order is measured, too.
    n_jobs : int
        Processes.
    progress : callable, optional
        Called with (done, total, what).
    model_file : str or path, optional
        Where the pruned pipeline is saved (.skops).

    Raises
    ------
    RecordingError
        If no recording can be used.
    ValueError
        If a limit cannot be met, a material is unknown, or the protocol cannot split the dataset.
    """
    check(limits)
    dataset = _of_materials(dataset, limits.materials)
    study = Study(
        dataset, feature_set, channels, find_protocol(protocol), n_folds, n_repeats, seed, n_jobs, progress
    )
    offer = Offer.of(study, _felt(study, limits))
    front, full = nested_front(
        offer.data, study.splits(offer.table.frame), offer.costs, budgets_within(offer.costs, limits),
        max_features=limits.max_features, n_jobs=n_jobs, progress=progress,
    )  # fmt: skip
    fewest = _fewest(study, offer, limits)
    chosen = choose(limits, front, fewest, offer.data, offer.costs)
    return Tradeoff(
        **_facts(study, offer, limits),
        **_prices(offer, seed),
        full=full,
        front=front,
        fewest=fewest,
        curves=_curves(study, offer.table, limits) if with_curves else (),
        chosen=_made(chosen, offer, model_file),
    )


@dataclass(frozen=True, eq=False)
class Offer:
    """What can be bought, and for how much.

    Attributes
    ----------
    table
        Features of the recordings as they are felt.
    columns
        Those that some recording has.
    data
        The same as X, with labels and groups.
    meter
        Measures costs.
    plan, whole
        What computes all columns, and their costs.
    costs
        Those of `columns`.
    """

    table: FeatureTable
    columns: tuple[str, ...]
    data: Data
    meter: CostMeter
    plan: Plan
    whole: CostModel
    costs: CostModel

    @classmethod
    def of(cls, study: Study, felt: Dataset) -> "Offer":
        """Compute the features of a dataset, and measure what they cost."""
        table = study.table(felt)
        columns = tuple(c for c in table.columns if table.frame[c].notna().any())
        meter = CostMeter.on(felt, table.frame["recording_id"].tolist(), study.channels)
        plan, whole = Plan.of(study.feature_set, meter.channels), meter.model(study.feature_set)
        return cls(table, columns, study.data(table), meter, plan, whole, whole.restricted_to(columns))

    def in_ms(self, part: Plan) -> float:
        """Return what a part takes over what the whole takes at the same time, in ms of the cost model."""
        some, every = self.meter.measured(part, self.plan)
        return some / every * self.whole.total


def _felt(study: Study, limits: Limits) -> Dataset:
    """Return the recordings, or the first touch of each where its seconds are limited."""
    if limits.max_seconds is None:
        return study.dataset
    return touches(
        study.dataset, limits.max_seconds, per_recording=1, n_jobs=study.n_jobs, progress=study.progress
    )


def _fewest(study: Study, offer: Offer, limits: Limits) -> tuple[tuple[int, Estimate], ...]:
    """Return the accuracy of the best 1, 2, ... columns for a scene's materials; nothing without a scene."""
    if not limits.materials:
        return ()
    most = min(MOST_COLUMNS, limits.max_features or MOST_COLUMNS, len(offer.columns))
    return nested_fewest(offer.data, study.splits(offer.table.frame), most, n_jobs=study.n_jobs)


def _made(chosen: Chosen, offer: Offer, file: str | Path | None) -> Chosen:
    """Fit the chosen pipeline, measure it, and save it where that is asked for."""
    recogniser = deployed(offer.plan.restricted_to(offer.columns), offer.data, offer.columns, chosen.columns)
    if file is not None:
        recogniser.save(file)
    return replace(chosen, measured_ms=offer.in_ms(recogniser[0].plan_), file=str(file or ""))


def check_model(offer: Offer, seed: int, n: int = N_CHECKED) -> tuple[tuple[float, float], ...]:
    """Return (predicted, measured) ms of random subsets of the features."""
    rng, costs = np.random.default_rng(seed), offer.whole
    names, pairs = np.array(list(dict.fromkeys(costs.features))), []
    for size in rng.integers(1, len(names) + 1, size=n):
        some = set(rng.choice(names, size, replace=False))
        columns = [c for c, f in zip(costs.columns, costs.features, strict=True) if f in some]
        pairs.append((costs.cost(columns), offer.in_ms(offer.plan.restricted_to(columns))))
    return tuple(pairs)


def _of_materials(dataset: Dataset, materials: Sequence[str]) -> Dataset:
    """Return the recordings of a scene's materials."""
    if not materials:
        return dataset
    if unknown := [m for m in materials if m not in dataset.materials]:
        raise ValueError(
            f"{dataset.name} has no material {unknown[0]!r}; its materials are {', '.join(dataset.materials)}"
        )
    if len(set(materials)) < 2:
        raise ValueError(f"materials are {', '.join(materials)}; the rule is at least two to tell apart")
    return replace(dataset, entries=tuple(e for e in dataset.entries if e.material in materials))


def _prices(offer: Offer, seed: int) -> dict[str, Any]:
    """Return the fields of a `Tradeoff` that say what things cost."""
    return {
        "costs": _feature_costs(offer.costs),
        "parts": _shared_parts(offer.costs),
        "segmentation_ms": offer.whole.segmentation_ms,
        "total_ms": offer.costs.total,
        "model_check": check_model(offer, seed),
        "classifiers": _classifier_costs(offer.data),
    }


def _feature_costs(costs: CostModel) -> tuple[FeatureCost, ...]:
    alone, last = costs.alone(), costs.last()
    rows = [FeatureCost(f, share, alone[f], last[f]) for f, share in costs.shares().items()]
    return tuple(sorted(rows, key=lambda row: -row.share))


def _shared_parts(costs: CostModel) -> dict[str, float]:
    """Return conditioning and transforms -> ms, dearest first."""
    needed = np.atleast_1d(costs.needs.any(axis=0)).tolist()
    parts = [
        (name, float(ms))
        for name, ms, used in zip(costs.parts, costs.ms, needed, strict=True)
        if used and name not in costs.features
    ]
    return dict(sorted(parts, key=lambda part: -part[1]))


def _classifier_costs(data: Data) -> tuple[ClassifierCost, ...]:
    X = preparation().fit_transform(data.X)
    return tuple(classifier_cost(name, c, X, data.y) for name, c in CLASSIFIERS.items())


def _curves(study: Study, table: FeatureTable, limits: Limits) -> tuple[Curve, ...]:
    whole = table if limits.max_seconds is None else study.table(study.dataset)
    found = [
        touch_curve(study, whole),
        *training_curves(study, whole),
        *sensor_curves(study),
        order_curve(study),
    ]
    return tuple(curve for curve in found if curve is not None)


def _facts(study: Study, offer: Offer, limits: Limits) -> dict[str, Any]:
    """Return the fields of a `Tradeoff` that say what was studied, and how to do it again."""
    protocol, dataset = study.protocol, study.dataset
    n_repeats = study.n_repeats if protocol.drawn else 1
    return {
        "dataset": _described(dataset, offer.table, limits),
        "features": study.feature_set.name,
        "protocol": f"{protocol.name}, {n_repeats} x {study.n_folds} folds",
        "versions": {**versions(*LIBRARIES), "machine": platform.machine()},
        "seed": study.seed,
        "input_hash": dataset.input_hash,
        "notes": (*(f"left out: {item}" for item in offer.table.left_out[:4]), *dataset.notes),
    }


def _described(dataset: Dataset, table: FeatureTable, limits: Limits) -> dict[str, Any]:
    return {
        "name": dataset.name,
        "title": dataset.title,
        "n_recordings": len(table.frame),
        "n_materials": int(table.frame["material"].nunique()),
        "materials": list(limits.materials),
        "max_seconds": limits.max_seconds,
    }
