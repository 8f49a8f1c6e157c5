"""Speed against accuracy: what features cost, what every budget buys, and the pipeline at the budget."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
from sklearn.pipeline import Pipeline

from texclass.evaluation.cost import CostMeter, CostModel, classifier_cost
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.protocols import find_protocol
from texclass.evaluation.result import COMPUTED_BY
from texclass.evaluation.windows import cut_windows
from texclass.evaluation.workers import Progress
from texclass.features.phase_view import Channels
from texclass.features.plan import Plan
from texclass.features.sets import FeatureSet, load_feature_set
from texclass.loaders import open_dataset
from texclass.loaders.dataset import Dataset
from texclass.provenance import code_provenance, versions
from texclass.reporting import Document
from texclass.reporting.result_files import Result
from texclass.tradeoff.curves import Conditions, order_curve, sensor_curves, touch_curve, training_curves
from texclass.tradeoff.front import (
    KNEE_LOSS,
    Facts,
    Labelled,
    Limits,
    budgets_of,
    cost_aware,
    discriminant,
    fewest_path,
    knee,
    nested_fewest,
    nested_front,
    preparation,
    study_facts,
)
from texclass.tradeoff.recogniser import fit_recogniser, save_recogniser

CLASSIFIERS = {
    "naive_bayes": GaussianNB(),
    "lda": discriminant(),
    "euclidean": NearestCentroid(),
    "nearest_neighbour": KNeighborsClassifier(1),
}
MOST_COLUMNS = 12
"""Columns up to which the fewest for a scene are looked for."""


class Tradeoff(Result, kind="tradeoff"):
    """What accuracy costs on a dataset; see `trade_off`.

    `data` holds `costs` (a feature's `share` of the full set, `alone`, and what leaving it out would save:
    `last`), shared `parts`, `segmentation_ms` and `total_ms` (from samples to features), whose milliseconds
    these are (`costs_of`), the `front` (see `nested_front`) with its `knee` and the point `at_half_cost`
    (of the features), the accuracy of the `full` set, the `fewest` columns for a scene's surfaces, `curves`
    (accuracy against touch, training, rate, bits, order), what `classifiers` cost, what was `chosen`, and
    what is needed to do it again.
    """

    @property
    def stem(self) -> str:
        """What the names of its files begin with: dataset, surfaces of a scene, seconds, "tradeoff"."""
        return tradeoff_stem(self.data["dataset"])

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of the feature set."""
        return {"feature set": (self.data["features"], self.data.get("features_hash", ""))}

    def document(self) -> Document:
        """Return the trade-off as a document."""
        from texclass.tradeoff.tradeoff_document import tradeoff_document

        return tradeoff_document(self.data)


def tradeoff_stem(dataset: Facts) -> str:
    """Return what the names of a trade-off's files begin with, from the facts of its dataset."""
    scene = f"-{len(dataset['surfaces'])}-surfaces" if dataset.get("surfaces") else ""
    seconds = f"-{dataset['max_seconds']:g}s" if dataset.get("max_seconds") else ""
    return f"{dataset['name']}{scene}{seconds}-tradeoff"


def trade_off(
    dataset: Dataset | str | Path,
    features: FeatureSet | str | Path = "texclass",
    limits: Limits | None = None,
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
    """Measure accuracy against latency on a dataset, and select a pipeline within a budget.

    Parameters
    ----------
    dataset : Dataset, str or path
        Labelled recordings, or an argument of `open_dataset`.
    features : FeatureSet, str or path
        Feature set from which subsets are selected (default "texclass").
    limits : Limits, optional
        Budget.
    channels : {"combine", "each", "auto", "all"}
        See `FeatureExtractor`.
    protocol : str
        Protocol; see `PROTOCOLS` (default "recording").
    n_folds, n_repeats : int
        Folds and repeats of cross-validation (default 5 and 3). Features are selected in each training set.
    seed : int
        Seed of the folds (default 2015).
    with_curves : bool
        Also measure accuracy against signal length, training recordings, sampling rate, bits and model order
        (default True).
    n_jobs : int
        Number of processes (default 1).
    progress : callable, optional
        Called with (done, total, what).
    model_file : str or path, optional
        File to which the pruned pipeline is saved (.skops).

    Returns
    -------
    Tradeoff
        Pareto front, knee point, curves and costs; `save(folder)` writes JSON, Markdown and figures.

    Raises
    ------
    RecordingError
        If no recording can be used.
    ValueError
        If a limit cannot be met, a surface is not in the dataset, or the protocol cannot split the dataset.
    """
    limits = limits or Limits()
    dataset = dataset if isinstance(dataset, Dataset) else open_dataset(dataset)
    dataset = _of_surfaces(dataset, limits.surfaces)
    features = features if isinstance(features, FeatureSet) else load_feature_set(features)
    conditions = Conditions(
        dataset, features, channels, find_protocol(protocol), n_folds, n_repeats, seed, n_jobs, progress
    )
    felt = dataset
    if limits.max_seconds is not None:  # the first touch of each recording
        felt = cut_windows(dataset, limits.max_seconds, per_recording=1, n_jobs=n_jobs, progress=progress)
    offer = Offer.of(conditions, felt)
    splits = conditions.splits(offer.table.frame)
    front, full = nested_front(
        offer.data, splits, offer.costs, budgets_of(offer.costs, limits.max_ms),
        max_features=limits.max_features, n_jobs=n_jobs, progress=progress,
    )  # fmt: skip
    fewest: list[tuple[int, Facts]] = []
    if limits.surfaces:
        most = min(MOST_COLUMNS, limits.max_features or MOST_COLUMNS, len(offer.costs.columns))
        fewest = nested_fewest(offer.data, splits, most, n_jobs=n_jobs)
    facts = study_facts(
        dataset, features, offer.table.frame, offer.meter.recordings[0], conditions.protocol, splits, seed
    )
    facts["dataset"] |= {"surfaces": list(limits.surfaces), "max_seconds": limits.max_seconds}
    middle = offer.costs.total - offer.costs.features_ms / 2
    half = [p for p in front if p["budget_ms"] <= middle * (1 + 1e-9)]
    n_drawn = n_repeats if conditions.protocol.is_random else 1
    left_out = (f"left out: {item}" for item in offer.table.left_out[:4])
    return Tradeoff(
        {
            **facts,
            "protocol": f"{protocol}, {n_drawn} x {n_folds} folds",
            **_prices(offer, seed),
            "full": full,
            "front": front,
            "knee": knee(front),
            "knee_rule": f"cheapest point within {KNEE_LOSS:.0%} of the best of {len(front)} accuracies, "
            "picked on the very folds that measure it, so optimistic; a budget of yours (`--max-ms`) picks "
            "nothing",
            "at_half_cost": half[-1] if half else front[0],
            "fewest": fewest,
            "curves": _curves(conditions, offer.table, limits) if with_curves else [],
            "chosen": _chosen(limits, front, fewest, offer, model_file),
            "versions": {
                **versions("numpy", "scipy", "scikit-learn", "skops", "PyWavelets", "librosa"),
                "machine": platform.machine(),
            },
            **code_provenance(*COMPUTED_BY, "tradeoff"),
            "notes": [*left_out, *dataset.notes],
        }
    )


@dataclass(frozen=True, eq=False)
class Offer:
    """What can be bought, and for how much.

    Attributes
    ----------
    table
        Features of the recordings as they are felt.
    data
        Those that some recording has as X, with labels and groups.
    meter
        Measures costs.
    plan, whole
        What computes all columns, and their costs.
    costs
        Those of the columns of X.
    """

    table: FeatureTable
    data: Labelled
    meter: CostMeter
    plan: Plan
    whole: CostModel
    costs: CostModel

    @classmethod
    def of(cls, conditions: Conditions, felt: Dataset) -> "Offer":
        """Compute the features of a dataset, and measure what they cost."""
        table = conditions.table(felt)
        meter = CostMeter.on(felt, table.frame["recording_id"].tolist(), conditions.channels)
        plan, whole = Plan.of(conditions.features, meter.channels), meter.kept(conditions.features)
        data = conditions.data(table)
        return cls(table, data, meter, plan, whole, whole.restricted_to(table.defined))

    def in_ms(self, part: Plan) -> float:
        """Return what a part takes, in ms of the cost model: its features over all at the same time."""
        some, every = self.meter.measured(part, self.plan)
        return self.whole.segmentation_ms + some / every * self.whole.features_ms

    def fitted(self, columns: Sequence[str]) -> Pipeline:
        """Return the pruned pipeline of some columns, fitted on all recordings."""
        plan = self.plan.restricted_to(columns)
        X = self.table.of(plan.columns)
        steps = [*preparation().steps, ("classifier", discriminant())]
        return fit_recogniser(plan, X, self.data.y, steps)


def check_model(offer: Offer, seed: int, n: int = 10) -> list[tuple[float, float]]:
    """Return (predicted, measured) ms of random subsets of the features."""
    rng, costs = np.random.default_rng(seed), offer.whole
    names, pairs = np.array(list(dict.fromkeys(costs.features))), []
    for size in rng.integers(1, len(names) + 1, size=n):
        some = set(rng.choice(names, size, replace=False))
        columns = [c for c, f in zip(costs.columns, costs.features, strict=True) if f in some]
        pairs.append((costs.cost(columns), offer.in_ms(offer.plan.restricted_to(columns))))
    return pairs


def _of_surfaces(dataset: Dataset, surfaces: Sequence[str]) -> Dataset:
    """Return the recordings of a scene's surfaces."""
    if not surfaces:
        return dataset
    if unknown := [m for m in surfaces if m not in dataset.surfaces]:
        raise ValueError(
            f"{dataset.name} has no surface {unknown[0]!r}; its surfaces are {', '.join(dataset.surfaces)}"
        )
    if len(set(surfaces)) < 2:
        raise ValueError(f"surfaces are {', '.join(surfaces)}. Expected at least two to tell apart")
    return replace(dataset, entries=tuple(e for e in dataset.entries if e.surface in surfaces))


def _prices(offer: Offer, seed: int) -> dict[str, Any]:
    """Return what things cost, dearest first."""
    costs = offer.costs
    by_feature = costs.by_feature().sort_values("share", ascending=False, kind="stable")
    used = np.atleast_1d(costs.needs.any(axis=0))
    parts = {n: float(ms) for n, ms, u in zip(costs.parts, costs.ms, used, strict=True) if u}
    shared = sorted(parts.items(), key=lambda part: -part[1])
    X = preparation().fit_transform(offer.data.X)
    return {
        "costs": by_feature.reset_index().to_dict("records"),
        "parts": {name: ms for name, ms in shared if name not in costs.features},
        "whole_path": True,
        "segmentation_ms": offer.whole.segmentation_ms,
        "total_ms": costs.total,
        "costs_of": costs.machine,
        "model_check": check_model(offer, seed),
        "classifiers": [
            {"name": name, **classifier_cost(classifier, X, offer.data.y)}
            for name, classifier in CLASSIFIERS.items()
        ],
    }


def _curves(conditions: Conditions, table: FeatureTable, limits: Limits) -> list[Facts]:
    whole = table if limits.max_seconds is None else conditions.table(conditions.dataset)
    found = [
        touch_curve(conditions, whole),
        *training_curves(conditions, whole),
        *sensor_curves(conditions),
        order_curve(conditions),
    ]
    return [curve for curve in found if curve is not None]


def _chosen(
    limits: Limits, front: Sequence[Facts], fewest: Sequence[tuple[int, Facts]], offer: Offer, file: Any
) -> dict[str, Any]:
    """Choose on all recordings by the rule that did best, or was asked for, inside the folds; save that."""
    costs, (X, y, groups, _) = offer.costs, offer.data
    prepared = preparation().fit_transform(X)
    if fewest and limits.max_ms is None:
        best = max(accuracy["mean"] for _, accuracy in fewest)
        n, accuracy = next(pair for pair in fewest if pair[1]["mean"] >= best - KNEE_LOSS)
        columns: Sequence[int] = fewest_path(prepared, y, groups, n)[n - 1]
        why = f"the fewest columns within {KNEE_LOSS:.0%} of the best that separate these surfaces"
    else:
        if limits.max_ms is None:
            point = knee(front)
            why = f"knee: the cheapest budget within {KNEE_LOSS:.0%} of the best accuracy"
        else:
            point = [p for p in front if p["budget_ms"] <= limits.max_ms * (1 + 1e-9)][-1]
            why = f"the best for {limits.max_ms:g} ms on {costs.machine}"
        accuracy, most = point["accuracy"], limits.max_features
        if most is None and point["budget_ms"] >= costs.total:
            columns, why = range(len(costs.columns)), f"{why}: everything"
        else:
            selector = cost_aware(costs, max_cost=point["budget_ms"], max_features=most)
            columns = selector.fit(prepared, y, groups).get_support(indices=True).tolist()
    names = [costs.columns[i] for i in sorted(columns)]
    recogniser = offer.fitted(names)
    if file is not None:
        save_recogniser(recogniser, file)
    return {
        "why": why,
        "columns": names,
        "features": list(dict.fromkeys(costs.features[i] for i in sorted(columns))),
        "predicted_ms": costs.of(sorted(columns)),
        "measured_ms": offer.in_ms(recogniser[0].plan_),
        "accuracy": accuracy,
        "file": str(file or ""),
    }
