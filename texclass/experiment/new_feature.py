"""A new feature against the table: alone, added to the best row, its cost, its contract, what it repeats."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from sklearn.impute import SimpleImputer
from sklearn.linear_model import RidgeCV
from sklearn.model_selection import KFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from texclass.experiment.benchmark import run_benchmark
from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import FeatureTable, cached_table
from texclass.experiment.pipeline import PipelineDefinition
from texclass.experiment.result import BenchmarkResult
from texclass.features.contract import Feature, UndefinedFeatureError
from texclass.features.examination import Behaviour, GainLaw, View, behaviour, gain_law
from texclass.features.phase_view import views_of
from texclass.loaders.dataset import Dataset
from texclass.recording import Samples

N_NEAREST = 3
"""Existing columns that are named for each new one."""


class Kin(NamedTuple):
    """An existing column and its rank correlation (Spearman) with a new one."""

    column: str
    rank_correlation: float


@dataclass(frozen=True)
class Redundancy:
    """What a new column repeats of the columns that the pipeline has.

    Attributes
    ----------
    column
        The new one.
    nearest
        The existing columns of the largest |rank correlation| with it, over recordings.
    explained
        R^2 of its prediction from all existing columns together, by ridge regression on left-out recordings:
        1 says that it is a linear mixture of them, 0 or less that it is not; None if it is constant.
    """

    column: str
    nearest: tuple[Kin, ...]
    explained: float | None


@dataclass(frozen=True, eq=False)
class FeatureStudy:
    """A new feature against the table of a pipeline on a dataset.

    Attributes
    ----------
    feature
        The feature.
    result
        The pipeline's table, with a row for the feature alone and, as `gains`, what it adds to the best row.
    ms_alone
        Milliseconds per recording when nothing else is computed.
    law
        Gain law, declared and measured on recordings of the dataset; None if it has no value there.
    behaviour
        Answers to degenerate input.
    redundancy
        For each of its columns that has values.
    """

    feature: Feature
    result: BenchmarkResult
    ms_alone: float
    law: GainLaw | None
    behaviour: tuple[Behaviour, ...]
    redundancy: tuple[Redundancy, ...]

    @property
    def ms_added(self) -> float | None:
        """Milliseconds per recording that it adds to the best row, which may share its transforms."""
        gains = self.result.gains
        if gains is None or gains.groups[0].joined is None:
            return None
        return gains.groups[0].joined.ms_per_recording - gains.without.ms_per_recording

    def to_dict(self) -> dict[str, Any]:
        """Return the study as plain JSON values: those of the result, and "new_feature"."""
        found = {
            "name": self.feature.name,
            "summary": self.feature.summary,
            "phase": self.feature.phase,
            "unit": self.feature.unit,
            "reference": self.feature.reference,
            "columns": self.feature.columns(self.feature.name, {}),
            "ms_alone": self.ms_alone,
            "ms_added": self.ms_added,
            "gain_law": None if self.law is None else {**asdict(self.law), "holds": self.law.holds},
            "behaviour": [asdict(answer) for answer in self.behaviour],
            "redundancy": [
                {**asdict(r), "nearest": [kin._asdict() for kin in r.nearest]} for r in self.redundancy
            ],
        }
        return {**self.result.to_dict(), "new_feature": found}

    def to_json(self) -> str:
        """Return the study as JSON text."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"


def study_feature(
    dataset: Dataset, pipeline: PipelineDefinition, feature: Feature, **options: Any
) -> FeatureStudy:
    """Put a new feature against the table of a pipeline.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings.
    pipeline : PipelineDefinition
        Its table; its own additions are left out, for the question is what this feature adds.
    feature : Feature
        See `texclass.features.load_feature`.
    **options
        As in `run_benchmark`.

    Raises
    ------
    ValueError
        As `run_benchmark`; and if the pipeline's feature set has the feature already, or the feature fails.
    """
    extended = pipeline.with_feature(feature)
    result = run_benchmark(dataset, extended, **options)
    kept = {key: options[key] for key in ("n_jobs", "skip_bad") if key in options}
    # Computed a moment ago: this only reads the cache.
    table = cached_table(dataset, *extended.needed, channels=pipeline.channels, **kept)
    meter = CostMeter.on(dataset, table.frame["recording_id"].tolist(), pipeline.channels)
    alone = extended.features.restricted_to([feature.name])
    new = table.matching(alone.column_names)
    return FeatureStudy(
        feature,
        result,
        meter.model(alone).total,
        gain_law(feature, _views(meter, feature)),
        behaviour(feature),
        redundancy(table, new),
    )


def redundancy(table: FeatureTable, new: Sequence[str]) -> tuple[Redundancy, ...]:
    """Compare new columns with all others of a table.

    Parameters
    ----------
    table : FeatureTable
        Both.
    new : sequence of str
        The new columns; those without two different values are left out.
    """
    values = table.frame[list(table.columns)].astype(np.float64)
    existing = values.drop(columns=list(new)).dropna(axis=1, how="all")
    existing = existing.loc[:, existing.max() > existing.min()]
    varying = [column for column in new if values[column].max() > values[column].min()]
    return tuple(_redundancy(values[column].dropna(), existing) for column in varying)


def _redundancy(column: "pd.Series[float]", existing: pd.DataFrame) -> Redundancy:
    if existing.empty:
        return Redundancy(str(column.name), (), None)
    others = existing.loc[column.index]
    rho = others.corrwith(column, method="spearman").dropna()
    nearest = rho.reindex(rho.abs().sort_values(ascending=False, kind="stable").index)[:N_NEAREST]
    kin = tuple(Kin(str(name), float(value)) for name, value in nearest.items())
    return Redundancy(
        str(column.name), kin, _explained(others.to_numpy(np.float64), np.asarray(column, dtype=np.float64))
    )


def _explained(X: Samples, y: Samples) -> float | None:
    """Return R^2 = 1 - sum (y - y^)^2 / sum (y - mean y)^2, y^ from five-fold cross-validation."""
    if y.size < 10:
        return None
    model = make_pipeline(SimpleImputer(strategy="median"), StandardScaler(), RidgeCV(np.logspace(-3, 3, 7)))
    folds = KFold(5, shuffle=True, random_state=0)
    z = (y - y.mean()) / y.std()
    with threadpool_limits(1):
        predicted = cross_val_predict(model, X, z, cv=folds)
    return float(1 - np.mean((z - predicted) ** 2))


def _views(meter: CostMeter, feature: Feature) -> list[View]:
    """Return the views of the meter's recordings that the feature reads, where they have its phase."""
    found: list[View] = []
    for recording in meter.recordings:
        for views in views_of(recording, meter.channels).values():
            try:
                found.append(views.of(feature.phase))
            except UndefinedFeatureError:
                continue
    return found
