"""Speed against accuracy: what features cost, what every budget buys, and the pipeline at the budget."""

import platform
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid

from texclass.experiment.choice import NO_LIMITS, Limits, budgets_within, check, choose, deployed
from texclass.experiment.cost import ClassifierCost, CostMeter, CostModel, classifier_cost
from texclass.experiment.curves import Study, order_curve, sensor_curves, touch_curve, training_curves
from texclass.experiment.environment import versions
from texclass.experiment.extraction import Progress
from texclass.experiment.front import (
    Data,
    discriminant,
    nested_fewest,
    nested_front,
    preparation,
)
from texclass.experiment.protocols import find_protocol
from texclass.experiment.table import FeatureTable
from texclass.experiment.tradeoff_result import (
    Curve,
    Estimate,
    FeatureCost,
    Tradeoff,
)
from texclass.experiment.windows import touches
from texclass.features.extractor import Plan
from texclass.features.sets import FeatureSet
from texclass.features.views import Channels
from texclass.loaders.dataset import Dataset

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
    felt = dataset
    if limits.max_seconds is not None:
        felt = touches(dataset, limits.max_seconds, per_recording=1, n_jobs=n_jobs, progress=progress)
    study = Study(
        dataset, feature_set, channels, find_protocol(protocol), n_folds, n_repeats, seed, n_jobs, progress
    )
    table = study.table(felt)
    meter = CostMeter.on(felt, table.frame["recording_id"].tolist(), channels)
    costs = meter.model(feature_set)
    data, usable = study.data(table), [c for c in table.columns if table.frame[c].notna().any()]
    usable_costs, splits = costs.restricted_to(usable), study.splits(table.frame)
    budgets = budgets_within(usable_costs, limits)
    front, full = nested_front(
        data, splits, usable_costs, budgets,
        max_features=limits.max_features, n_jobs=n_jobs, progress=progress,
    )  # fmt: skip
    fewest: tuple[tuple[int, Estimate], ...] = ()
    if limits.materials:
        most = min(MOST_COLUMNS, limits.max_features or MOST_COLUMNS, len(usable))
        fewest = nested_fewest(data, splits, most, n_jobs=n_jobs)
    chosen = choose(limits, front, fewest, data, usable_costs)
    plan = Plan.of(feature_set, meter.channels)
    recogniser = deployed(plan.restricted_to(usable), data, usable, chosen.columns)
    if model_file is not None:
        recogniser.save(model_file)
    measured = _in_ms(meter, recogniser[0].plan_, plan, costs)
    return Tradeoff(
        dataset=_facts(dataset, table, limits),
        features=feature_set.name,
        protocol=f"{protocol}, {n_repeats if study.protocol.drawn else 1} x {n_folds} folds",
        costs=_feature_costs(usable_costs),
        parts=_shared_parts(usable_costs),
        segmentation_ms=costs.segmentation_ms,
        total_ms=usable_costs.total,
        model_check=check_model(meter, plan, costs, seed),
        classifiers=_classifier_costs(data),
        full=full,
        front=front,
        fewest=fewest,
        curves=_curves(study, table, limits) if with_curves else (),
        chosen=replace(chosen, measured_ms=measured, file=str(model_file or "")),
        versions={**versions(*LIBRARIES), "machine": platform.machine()},
        seed=seed,
        input_hash=dataset.input_hash,
        notes=(*(f"left out: {item}" for item in table.left_out[:4]), *dataset.notes),
    )


def check_model(
    meter: CostMeter, plan: Plan, costs: CostModel, seed: int, n: int = N_CHECKED
) -> tuple[tuple[float, float], ...]:
    """Return (predicted, measured) ms of random subsets of the features."""
    rng = np.random.default_rng(seed)
    names, pairs = np.array(list(dict.fromkeys(costs.features))), []
    for size in rng.integers(1, len(names) + 1, size=n):
        some = set(rng.choice(names, size, replace=False))
        columns = [c for c, f in zip(costs.columns, costs.features, strict=True) if f in some]
        pairs.append((costs.cost(columns), _in_ms(meter, plan.restricted_to(columns), plan, costs)))
    return tuple(pairs)


def _in_ms(meter: CostMeter, part: Plan, whole: Plan, costs: CostModel) -> float:
    """Return what a part takes over what the whole takes at the same time, in ms of the cost model."""
    some, every = meter.measured(part, whole)
    return some / every * costs.total


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


def _facts(dataset: Dataset, table: FeatureTable, limits: Limits) -> dict[str, Any]:
    return {
        "name": dataset.name,
        "title": dataset.title,
        "n_recordings": len(table.frame),
        "n_materials": int(table.frame["material"].nunique()),
        "materials": list(limits.materials),
        "max_seconds": limits.max_seconds,
    }
