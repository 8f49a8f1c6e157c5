"""Trade-off study: accuracy and cost of feature subsets, and a fitted pipeline within a budget."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier, NearestCentroid
from sklearn.pipeline import Pipeline

from texclass.evaluation.cost import CostMeter, CostModel, classifier_cost
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.protocols import find_protocol
from texclass.evaluation.result_facts import CODE_DEPENDENCIES
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
from texclass.tradeoff.cost_curves import (
    Conditions,
    order_curve,
    sensor_curves,
    signal_length_curve,
    training_curves,
)
from texclass.tradeoff.pareto_front import (
    KNEE_LOSS,
    Facts,
    LabelledData,
    Limits,
    cost_aware_selector,
    discriminant,
    knee_point,
    latency_budgets,
    nested_front,
    nested_smallest_subsets,
    preprocessing,
    smallest_subsets,
    study_facts,
)
from texclass.tradeoff.recogniser import fit_recogniser, save_recogniser

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CLASSIFIERS = {
    "naive_bayes": GaussianNB(),
    "lda": discriminant(),
    "euclidean": NearestCentroid(),
    "nearest_neighbour": KNeighborsClassifier(1),
}
MAX_COLUMNS = 12
"""Largest number of columns in the search for the smallest subset that separates the surfaces of a scene."""


class Tradeoff(Result, kind="tradeoff"):
    """Accuracy against cost on a dataset; returned by `trade_off`.

    `data` contains

    - `costs`: for each feature, its `share` of the cost of the full set, its cost `alone`, and the saving if
      it is dropped (`last`); `parts`: costs of shared transforms; `segmentation_ms` and `total_ms` (from
      samples to features); `costs_of`: the machine; `classifiers`: costs of classifiers;
    - `front`: points of the Pareto front (see `nested_front`); its `knee`, and the point `at_half_cost` of
      the features; `full`: accuracy of the full set; `smallest_subsets`: accuracy of the best 1, 2, ...
      columns for the surfaces of a scene;
    - `curves`: accuracy against signal length, training recordings, sampling rate, bits and model order;
    - `selection`: the pipeline selected within the budget; and all settings that are needed to repeat the
      study.

    Examples
    --------
    >>> data = {"kind": "tradeoff", "dataset": {"name": "plates", "surfaces": ["oak", "cork"]}}
    >>> Tradeoff(data).stem
    'plates-2-surfaces-tradeoff'
    """

    @property
    def stem(self) -> str:
        """Prefix of the file names.

        It consists of the dataset, the number of surfaces (for a scene), the signal length in s (if it is
        limited), and "tradeoff".
        """
        return tradeoff_stem(self.data["dataset"])

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of the feature set."""
        return {"feature set": (self.data["features"], self.data.get("features_hash", ""))}

    def document(self) -> Document:
        """Return the trade-off as a document."""
        from texclass.tradeoff.tradeoff_document import tradeoff_document

        return tradeoff_document(self.data)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Plot the Pareto front: accuracy against latency, with the knee point.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on (default: axes of a new figure).

        Returns
        -------
        matplotlib.axes.Axes
            The axes, with latency in ms and accuracy in per cent.
        """
        from texclass.evaluation.plots import axes_or_new
        from texclass.tradeoff.tradeoff_document import plot_front

        ax = axes_or_new(ax)
        plot_front(self.data, ax)
        ax.legend(loc="lower right", frameon=False)
        return ax


def tradeoff_stem(dataset: Facts) -> str:
    """Return the prefix of the file names of a trade-off, given the facts of its dataset."""
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
        Budget (default: no limits, which selects the knee point).
    channels : {"combine", "each", "auto", "all"}
        See `FeatureExtractor`.
    protocol : str
        Name of a protocol; see `PROTOCOLS` (default "recording").
    n_folds, n_repeats : int
        Number of folds (default 5) and of repeats (default 3) of cross-validation. Features are selected in
        each training set.
    seed : int
        Random seed of the folds (default 2015).
    with_curves : bool
        Whether to also measure accuracy against signal length, training recordings, sampling rate, bits and
        model order (default True).
    n_jobs : int
        Number of processes (default 1).
    progress : callable, optional
        Function called with (done, total, stage).
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

    Examples
    --------
    This takes about a minute::

        result = trade_off("simulated", limits=Limits(max_ms=5.0), with_curves=False)
        result.data["selection"]["features"]
    """
    limits = limits or Limits()
    dataset = dataset if isinstance(dataset, Dataset) else open_dataset(dataset)
    dataset = _of_surfaces(dataset, limits.surfaces)
    features = features if isinstance(features, FeatureSet) else load_feature_set(features)
    conditions = Conditions(
        dataset, features, channels, find_protocol(protocol), n_folds, n_repeats, seed, n_jobs, progress
    )
    windows = dataset
    if limits.max_seconds is not None:  # the first window of each recording
        windows = cut_windows(dataset, limits.max_seconds, per_recording=1, n_jobs=n_jobs, progress=progress)
    feature_costs = FeatureCosts.of(conditions, windows)
    splits = conditions.splits(feature_costs.table.frame)
    front, full = nested_front(
        feature_costs.data, splits, feature_costs.costs, latency_budgets(feature_costs.costs, limits.max_ms),
        max_features=limits.max_features, n_jobs=n_jobs, progress=progress,
    )  # fmt: skip
    subsets: list[tuple[int, Facts]] = []
    if limits.surfaces:
        n_columns = len(feature_costs.costs.columns)
        max_columns = min(MAX_COLUMNS, limits.max_features or MAX_COLUMNS, n_columns)
        subsets = nested_smallest_subsets(feature_costs.data, splits, max_columns, n_jobs=n_jobs)
    facts = study_facts(
        dataset,
        features,
        feature_costs.table.frame,
        feature_costs.meter.recordings[0],
        conditions.protocol,
        splits,
        seed,
    )
    facts["dataset"] |= {"surfaces": list(limits.surfaces), "max_seconds": limits.max_seconds}
    middle = feature_costs.costs.total - feature_costs.costs.features_ms / 2
    cheaper_half = [p for p in front if p["budget_ms"] <= middle * (1 + 1e-9)]
    n_repeats = n_repeats if conditions.protocol.is_random else 1
    left_out = (f"left out: {item}" for item in feature_costs.table.left_out[:4])
    return Tradeoff(
        {
            **facts,
            "protocol": f"{protocol}, {n_repeats} x {n_folds} folds",
            **_costs(feature_costs, seed),
            "full": full,
            "front": front,
            "knee": knee_point(front),
            "knee_note": f"cheapest point within {KNEE_LOSS:.0%} of the best of {len(front)} accuracies, "
            "selected on the test folds (optimistic); with a budget (`--max-ms`) nothing is selected on them",
            "at_half_cost": cheaper_half[-1] if cheaper_half else front[0],
            "smallest_subsets": subsets,
            "curves": _curves(conditions, feature_costs.table, limits) if with_curves else [],
            "selection": _select_pipeline(limits, front, subsets, feature_costs, model_file),
            "versions": {
                **versions("numpy", "scipy", "scikit-learn", "skops", "PyWavelets", "librosa"),
                "machine": platform.machine(),
            },
            **code_provenance(*CODE_DEPENDENCIES, "tradeoff"),
            "notes": [*left_out, *dataset.notes],
        }
    )


@dataclass(frozen=True, eq=False)
class FeatureCosts:
    """Features of a dataset and their measured costs.

    Attributes
    ----------
    table
        Feature table of the recordings or windows.
    data
        Columns X that are defined for at least one recording, with labels and groups.
    meter
        Cost meter of the dataset.
    plan, full_costs
        Plan of all columns, and the cost model of these columns.
    costs
        Cost model of the columns of X.
    """

    table: FeatureTable
    data: LabelledData
    meter: CostMeter
    plan: Plan
    full_costs: CostModel
    costs: CostModel

    @classmethod
    def of(cls, conditions: Conditions, dataset: Dataset) -> "FeatureCosts":
        """Compute the features of a dataset and measure their costs."""
        table = conditions.table(dataset)
        meter = CostMeter.from_dataset(dataset, table.frame["recording_id"].tolist(), conditions.channels)
        plan, full_costs = (
            Plan.of(conditions.features, meter.channels),
            meter.cached_model(conditions.features),
        )
        data = conditions.data(table)
        return cls(table, data, meter, plan, full_costs, full_costs.restricted_to(table.defined_columns))

    def measure_ms(self, part: Plan) -> float:
        """Return the latency of some features in ms.

        All features are measured alternately with them, which corrects for changes of the machine's speed.
        """
        part_ms, all_ms = self.meter.measure(part, self.plan)
        return self.full_costs.segmentation_ms + part_ms / all_ms * self.full_costs.features_ms

    def fit_pipeline(self, columns: Sequence[str]) -> Pipeline:
        """Return the pruned pipeline that computes some columns, fitted to all recordings."""
        plan = self.plan.restricted_to(columns)
        X = self.table.select(plan.columns)
        steps = [*preprocessing().steps, ("classifier", discriminant())]
        return fit_recogniser(plan, X, self.data.y, steps)


def check_cost_model(feature_costs: FeatureCosts, seed: int, n: int = 10) -> list[tuple[float, float]]:
    """Return the predicted and the measured latency in ms of `n` random subsets of the features."""
    rng, costs = np.random.default_rng(seed), feature_costs.full_costs
    names, pairs = np.array(list(dict.fromkeys(costs.features))), []
    for size in rng.integers(1, len(names) + 1, size=n):
        subset = set(rng.choice(names, size, replace=False))
        columns = [c for c, f in zip(costs.columns, costs.features, strict=True) if f in subset]
        pairs.append(
            (
                costs.cost(columns),
                feature_costs.measure_ms(feature_costs.plan.restricted_to(columns)),
            )
        )
    return pairs


def _of_surfaces(dataset: Dataset, surfaces: Sequence[str]) -> Dataset:
    """Return the recordings of the surfaces of a scene."""
    if not surfaces:
        return dataset
    if unknown := [m for m in surfaces if m not in dataset.surfaces]:
        raise ValueError(
            f"{dataset.name} has no surface {', '.join(map(repr, unknown))}. Expected at least two of "
            f"{', '.join(dataset.surfaces)}"
        )
    if len(set(surfaces)) < 2:
        raise ValueError(f"surfaces must contain at least two surfaces, got {', '.join(surfaces)}")
    return replace(dataset, entries=tuple(e for e in dataset.entries if e.surface in surfaces))


def _costs(feature_costs: FeatureCosts, seed: int) -> dict[str, Any]:
    """Return the costs of features, shared transforms and classifiers, in descending order."""
    costs = feature_costs.costs
    by_feature = costs.by_feature().sort_values("share", ascending=False, kind="stable")
    used = np.atleast_1d(costs.needs.any(axis=0))
    parts = {n: float(ms) for n, ms, u in zip(costs.parts, costs.ms, used, strict=True) if u}
    shared = sorted(parts.items(), key=lambda part: -part[1])
    X = preprocessing().fit_transform(feature_costs.data.X)
    return {
        "costs": by_feature.reset_index().to_dict("records"),
        "parts": {name: ms for name, ms in shared if name not in costs.features},
        "whole_path": True,
        "segmentation_ms": feature_costs.full_costs.segmentation_ms,
        "total_ms": costs.total,
        "costs_of": costs.machine,
        "model_check": check_cost_model(feature_costs, seed),
        "classifiers": [
            {"name": name, **classifier_cost(classifier, X, feature_costs.data.y)}
            for name, classifier in CLASSIFIERS.items()
        ],
    }


def _curves(conditions: Conditions, table: FeatureTable, limits: Limits) -> list[Facts]:
    whole = table if limits.max_seconds is None else conditions.table(conditions.dataset)
    curves = [
        signal_length_curve(conditions, whole),
        *training_curves(conditions, whole),
        *sensor_curves(conditions),
        order_curve(conditions),
    ]
    return [curve for curve in curves if curve is not None]


def _select_pipeline(
    limits: Limits,
    front: Sequence[Facts],
    subsets: Sequence[tuple[int, Facts]],
    feature_costs: FeatureCosts,
    file: Any,
) -> dict[str, Any]:
    """Select columns on all recordings with the size or budget found in the folds, and save the pipeline."""
    costs, (X, y, groups, _) = feature_costs.costs, feature_costs.data
    X = preprocessing().fit_transform(X)
    if subsets and limits.max_ms is None:
        best = max(accuracy["mean"] for _, accuracy in subsets)
        n, accuracy = next(pair for pair in subsets if pair[1]["mean"] >= best - KNEE_LOSS)
        columns: Sequence[int] = smallest_subsets(X, y, groups, n)[n - 1]
        reason = f"smallest subset of columns within {KNEE_LOSS:.0%} of the best accuracy for these surfaces"
    else:
        if limits.max_ms is None:
            point = knee_point(front)
            reason = f"knee point: the cheapest budget within {KNEE_LOSS:.0%} of the best accuracy"
        else:
            point = [p for p in front if p["budget_ms"] <= limits.max_ms * (1 + 1e-9)][-1]
            reason = f"the best within {limits.max_ms:g} ms on {costs.machine}"
        accuracy, max_features = point["accuracy"], limits.max_features
        if max_features is None and point["budget_ms"] >= costs.total:
            columns, reason = range(len(costs.columns)), f"{reason}: all columns"
        else:
            selector = cost_aware_selector(costs, max_cost=point["budget_ms"], max_features=max_features)
            columns = selector.fit(X, y, groups).get_support(indices=True).tolist()
    names = [costs.columns[i] for i in sorted(columns)]
    recogniser = feature_costs.fit_pipeline(names)
    if file is not None:
        save_recogniser(recogniser, file)
    return {
        "reason": reason,
        "columns": names,
        "features": list(dict.fromkeys(costs.features[i] for i in sorted(columns))),
        "predicted_ms": costs.cost_of_indices(sorted(columns)),
        "measured_ms": feature_costs.measure_ms(recogniser[0].plan_),
        "accuracy": accuracy,
        "file": str(file or ""),
    }
