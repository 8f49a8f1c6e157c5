"""A new feature against the table: alone, added to the best row, its cost, its contract, what it repeats."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.impute import SimpleImputer
from sklearn.linear_model import RidgeCV
from sklearn.model_selection import KFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from texclass.document import Document, write_document
from texclass.experiment.benchmark import run_benchmark
from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import FeatureTable, cached_table
from texclass.experiment.pipeline import PipelineDefinition
from texclass.experiment.result import BenchmarkResult
from texclass.experiment.workers import one_thread
from texclass.features.contract import Feature, UndefinedFeatureError
from texclass.features.examination import View, behaviour, gain_law
from texclass.features.phase_view import views_of
from texclass.loaders.dataset import Dataset
from texclass.recording import Samples

N_NEAREST = 3
"""Existing columns that are named for each new one."""


class FeatureStudy(BenchmarkResult):
    """A new feature against the table of a pipeline on a dataset; see `study_feature`.

    `data` is that of the benchmark, with a row for the feature alone and, as `gains`, what it adds to the
    best row; and `new_feature`: what it is, `ms_alone` and `ms_added` per recording, its `gain_law` as
    declared and as measured, its `behaviour` on degenerate input, and its `redundancy` (see `redundancy`).
    """

    @property
    def result(self) -> BenchmarkResult:
        """The benchmark alone."""
        return BenchmarkResult({key: value for key, value in self.data.items() if key != "new_feature"})

    def document(self) -> Document:
        """Return the study as a document."""
        from texclass.experiment.new_feature_document import new_feature_document

        return new_feature_document(self.data)

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the benchmark, and beside it what was found about the feature."""
        stem = f"{self.stem}-feature"
        written = write_document(self.document(), folder, stem, json=self.to_json(), pictures=False)
        return (*self.result.save(folder), *written)


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
    views: list[View] = []
    for recording in meter.recordings:
        for of_channel in views_of(recording, meter.channels).values():
            with suppress(UndefinedFeatureError):
                views.append(of_channel.of(feature.phase))
    gains = result.data["gains"]
    joined = gains and gains["groups"][0]["joined"]
    found = {
        "name": feature.name,
        "phase": feature.phase,
        "unit": feature.unit,
        "reference": feature.reference,
        "columns": feature.columns(feature.name, {}),
        "ms_alone": meter.model(alone).total,
        # It may share transforms with the row that it is added to.
        "ms_added": joined and joined["ms_per_recording"] - gains["without"]["ms_per_recording"],
        "gain_law": gain_law(feature, views),
        "behaviour": behaviour(feature),
        "redundancy": redundancy(table, table.matching(alone.column_names)),
    }
    return FeatureStudy({**result.data, "new_feature": found})


def redundancy(table: FeatureTable, new: Sequence[str]) -> list[dict[str, Any]]:
    """Compare new columns with all others of a table.

    Parameters
    ----------
    table : FeatureTable
        Both.
    new : sequence of str
        The new columns; those without two different values are left out.

    Returns
    -------
    list of dict
        For each `column`: the existing ones that are `nearest`, by their `rank_correlation` (Spearman) with
        it; and how much of it is `explained` by all of them together: R^2 of its prediction by ridge
        regression on left-out recordings. 1 says that it is a linear mixture of them, 0 or less that it is
        not; None that it is constant, or that there are too few recordings.
    """
    values = table.frame[list(table.columns)].astype(np.float64)
    existing = values.drop(columns=list(new)).dropna(axis=1, how="all")
    existing = existing.loc[:, existing.max() > existing.min()]
    varying = [column for column in new if values[column].max() > values[column].min()]
    found: list[dict[str, Any]] = []
    for name in varying:
        column = values[name].dropna()
        others = existing.loc[column.index]
        rho = others.corrwith(column, method="spearman").dropna()
        nearest = rho.reindex(rho.abs().sort_values(ascending=False, kind="stable").index)[:N_NEAREST]
        found.append(
            {
                "column": name,
                "nearest": [{"column": str(c), "rank_correlation": float(r)} for c, r in nearest.items()],
                "explained": _explained(others.to_numpy(np.float64), column.to_numpy(np.float64)),
            }
        )
    return found


def _explained(X: Samples, y: Samples) -> float | None:
    """Return R^2 = 1 - sum (y - y^)^2 / sum (y - mean y)^2, y^ from five-fold cross-validation."""
    if y.size < 10 or not X.size:
        return None
    model = make_pipeline(SimpleImputer(strategy="median"), StandardScaler(), RidgeCV(np.logspace(-3, 3, 7)))
    folds = KFold(5, shuffle=True, random_state=0)
    z = (y - y.mean()) / y.std()
    with one_thread():
        predicted = cross_val_predict(model, X, z, cv=folds)
    return float(1 - np.mean((z - predicted) ** 2))
