"""Study of a new feature: accuracy alone and with the best row, cost, declared properties and redundancy."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from sklearn.impute import SimpleImputer
from sklearn.linear_model import RidgeCV
from sklearn.model_selection import KFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from texclass.evaluation.ablation import detectable
from texclass.evaluation.accuracy import LEVEL
from texclass.evaluation.axes import AxesOption
from texclass.evaluation.benchmark import BenchmarkResult, run_benchmark
from texclass.evaluation.benchmark_document import benchmark_blocks, benchmark_document
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable, cached_table
from texclass.evaluation.pipeline import PipelineDefinition
from texclass.evaluation.result_facts import classifier_title, cluster_phrase
from texclass.evaluation.workers import Progress, one_thread
from texclass.features.contract import Feature, Gain, UndefinedFeatureError
from texclass.features.contract_checks import MAX_LAW_DEVIATION, check_degenerate_inputs, measure_gain_law
from texclass.features.phase_view import View, views_of
from texclass.loaders.dataset import Dataset
from texclass.recording import Samples
from texclass.reporting import Details, Document, Finding, Heading, Table, write_document
from texclass.reporting.blocks import Block
from texclass.reporting.wording import digits, estimate, p_value, percent, points, points_interval

Data = Mapping[str, Any]


class FeatureStudy(BenchmarkResult, kind="feature"):
    """Comparison of a new feature with the rows of a pipeline on a dataset; returned by `study_feature`.

    `data` contains the values of the benchmark, including a row for the feature alone and the gain of adding
    it to the best row (`ablation`). `new_feature` contains the declaration of the feature, its latency alone
    (`ms_alone`), the latency that it adds to the best row (`ms_added`), its declared and measured `gain_law`,
    its `behaviour` on degenerate input, and its `redundancy` (see the function `redundancy`).
    """

    @property
    def result(self) -> BenchmarkResult:
        """Benchmark result without the values of `new_feature`."""
        return BenchmarkResult({key: value for key, value in self.data.items() if key != "new_feature"})

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of the pipeline to which the feature was added."""
        name, digest = super().definitions["pipeline"]
        return {
            "pipeline": (name.removesuffix(f"+{self.data['new_feature']['name']}"), digest.partition("+")[0])
        }

    def document(self) -> Document:
        """Return the study of the feature as a document."""
        return new_feature_document(self.data)

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the benchmark and the study of the feature into a folder."""
        stem = f"{self.stem}-feature"
        written = write_document(self.document(), folder, stem, json=self.to_json(), pictures=False)
        return (*self.result.save(folder), *written)


def study_feature(
    dataset: Dataset,
    pipeline: PipelineDefinition,
    feature: Feature,
    *,
    protocol: str | None = None,
    n_folds: int | None = None,
    nested_cv: bool | None = None,
    axes: AxesOption = "auto",
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> FeatureStudy:
    """Compare a new feature with the rows of a pipeline.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings.
    pipeline : PipelineDefinition
        Pipeline whose rows are compared with the feature. The feature replaces its additions.
    feature : Feature
        New feature; see `texclass.features.load_feature`.
    protocol, n_folds, nested_cv, axes, n_jobs, skip_bad, progress : optional
        See `run_benchmark`.

    Returns
    -------
    FeatureStudy
        The study.

    Raises
    ------
    ValueError
        If the feature raises an error, the feature set already has a feature of this name, or the protocol
        cannot split the dataset.
    """
    extended = pipeline.with_feature(feature)
    result = run_benchmark(
        dataset,
        extended,
        protocol=protocol,
        n_folds=n_folds,
        nested_cv=nested_cv,
        axes=axes,
        n_jobs=n_jobs,
        skip_bad=skip_bad,
        progress=progress,
    )
    channels = result.data["channels"]
    # This reads the table from the cache, because `run_benchmark` has computed it.
    table = cached_table(dataset, *extended.needed, channels=channels, n_jobs=n_jobs, skip_bad=skip_bad)
    meter = CostMeter.from_dataset(dataset, table.frame["recording_id"].tolist(), channels)
    alone = extended.features.restricted_to([feature.name])
    views: list[View] = []
    for recording in meter.recordings:
        for channel_views in views_of(recording, meter.channels).values():
            with suppress(UndefinedFeatureError):
                views.append(channel_views.of(feature.phase))
    ablation = result.data["ablation"]
    combined = ablation and ablation["groups"][0]["combined"]
    study = {
        "name": feature.name,
        "phase": feature.phase,
        "unit": feature.unit,
        "reference": feature.reference,
        "columns": feature.columns(feature.name, {}),
        "ms_alone": meter.model(alone).total,
        # Less than `ms_alone` if the feature shares transforms with the base row.
        "ms_added": combined and combined["ms_per_recording"] - ablation["base"]["ms_per_recording"],
        "gain_law": measure_gain_law(feature, views),
        "degenerate_inputs": check_degenerate_inputs(feature),
        "redundancy": redundancy(table, table.match_columns(alone.column_names)),
    }
    return FeatureStudy({**result.data, "new_feature": study})


def redundancy(table: FeatureTable, new: Sequence[str]) -> list[dict[str, Any]]:
    """Return the correlation of new columns with the existing columns of a table.

    Parameters
    ----------
    table : FeatureTable
        Table with new and existing columns.
    new : sequence of str
        Names of the new columns. Constant columns are skipped.

    Returns
    -------
    list of dict
        For each `column`: the three existing columns with the highest rank correlation (`nearest`, each with
        its Spearman `rank_correlation`), and `explained`, the R^2 of its prediction from all existing columns
        by ridge regression with five-fold cross-validation. `explained` is about 1 for a linear combination
        of existing columns, 0 or less for an unpredictable column, and None if there are fewer than ten
        recordings.
    """
    values = table.frame[list(table.columns)].astype(np.float64)
    existing = values.drop(columns=list(new)).dropna(axis=1, how="all")
    existing = existing.loc[:, existing.max() > existing.min()]
    varying = [column for column in new if values[column].max() > values[column].min()]
    results: list[dict[str, Any]] = []
    for name in varying:
        column = values[name].dropna()
        others = existing.loc[column.index]
        rho = others.corrwith(column, method="spearman").dropna()
        nearest = rho.reindex(rho.abs().sort_values(ascending=False, kind="stable").index)[:3]
        results.append(
            {
                "column": name,
                "nearest": [{"column": str(c), "rank_correlation": float(r)} for c, r in nearest.items()],
                "explained": _explained(others.to_numpy(np.float64), column.to_numpy(np.float64)),
            }
        )
    return results


def _explained(X: Samples, y: Samples) -> float | None:
    """Return R^2 = 1 - sum (y - y^)^2 / sum (y - mean y)^2, where five-fold cross-validation predicts y^."""
    if y.size < 10 or not X.size:
        return None
    model = make_pipeline(SimpleImputer(strategy="median"), StandardScaler(), RidgeCV(np.logspace(-3, 3, 7)))
    folds = KFold(5, shuffle=True, random_state=0)
    z = (y - y.mean()) / y.std()
    with one_thread():
        predicted = cross_val_predict(model, X, z, cv=folds)
    return float(1 - np.mean((z - predicted) ** 2))


def new_feature_document(data: Data) -> Document:
    """Return the document of a feature study: gain and properties of the feature, then the benchmark.

    Parameters
    ----------
    data : mapping
        Values of a `FeatureStudy`.
    """
    table, new = benchmark_document(data), data["new_feature"]
    assert table.finding is not None
    summary = f"Table with the new feature: {table.finding.number} {table.finding.rest}"
    return Document(
        f"New feature {new['name']} on {table.title}",
        [Heading("The feature itself"), *_feature_blocks(new, data), summary, *benchmark_blocks(data)],
        table.subtitle, _finding(data), table.dataset, table.reproduction, table.versions,
    )  # fmt: skip


def _finding(data: Data) -> Finding:
    ablation, name = data.get("ablation"), data["new_feature"]["name"]
    groups = [group for group in ablation["groups"] if group["comparison"]] if ablation else []
    if not ablation or not groups:
        return Finding(
            "none", "", "", f"gain could be measured for {name}: there is no row to which it can be added."
        )
    comparison = groups[0]["comparison"]
    p = p_value(comparison["p_value"])
    base = f"{ablation['row']} with {classifier_title(ablation['classifier'])}"
    is_significant = comparison["p_value"] < LEVEL
    remark = "" if is_significant else f" No significant difference{detectable(groups)}."
    return Finding(
        points(comparison["difference"]), "points", points_interval(comparison),
        f"of accuracy when {name} is added to the best row, {base} "
        f"({percent(ablation['base']['accuracy'])} % without it); p {p} by {comparison['test']}, 95 % "
        f"interval{cluster_phrase(comparison)}.{remark}",
        brief=f"Gain when it is added to {base}; p {p}.",
    )  # fmt: skip


def _feature_blocks(new: Data, data: Data) -> Iterator[Block]:
    """Yield blocks on accuracy, cost, gain law, redundancy and behaviour of the feature."""
    alone = data["rows"][-1]
    accuracies = [f"{classifier_title(n)} {estimate(a)} %" for n, a in alone["accuracy"].items()]
    cost = f"{digits(new['ms_alone'])} ms per recording alone"
    if new["ms_added"] is not None:
        cost += f"; {digits(max(new['ms_added'], 0.0))} ms more with the best row"
    redundancies = []
    for column in new["redundancy"]:
        nearest = [f"{near['column']} {near['rank_correlation']:+.2f}" for near in column["nearest"]]
        redundancies.append(f"{column['column']}: rank correlation with {', '.join(nearest) or 'nothing'}")
        if (explained := column["explained"]) is not None:
            redundancies[-1] += f"; all columns together explain R\N{SUPERSCRIPT TWO} = {explained:.2f}"
    results = pd.DataFrame(
        [
            (r["input"], r["outcome"], r["detail"], "valid" if r["is_valid"] else "INVALID")
            for r in new["degenerate_inputs"]
        ],
        columns=["Input", "Result", "Detail", "Contract"],
    )
    invalid = results[results["Contract"] == "INVALID"]
    title = f"{len(results) - len(invalid)} of {len(results)} results meet the feature contract"
    yield {
        "Feature": f"{new['name']}: {new.get('summary', '')} Phase {new['phase']}, unit {new['unit']}, "
        f"{new['reference']}.",
        "Alone": alone["missing"] or ", ".join(accuracies),
        "Cost": cost,
        "Gain law": _gain_law_text(new["gain_law"]),
        "Redundancy": "; ".join(redundancies) or "none: the feature is constant",
        "Degenerate input": title,
    }
    if len(invalid):
        yield Table(invalid, "Results that violate the feature contract.", n_words=4)
    yield Details(f"Degenerate input: {title}", [Table(results, n_words=4)])


def _gain_law_text(law: Data | None) -> str:
    if law is None:
        return "not measured: the feature is undefined for the recordings of the measurement"
    declared = f"declared y(g x) = {Gain(**law['declared'])}"
    if law["holds"]:
        return f"{declared}; measured the same (to {law['deviation']:.0e})"
    measured = f"y(g x) = {Gain(**law['measured'])}"
    if law.get("measured_deviation", 0.0) > MAX_LAW_DEVIATION:
        measured = "another law, neither a power nor a shift"
    return f"{declared}; BROKEN by {digits(law['deviation'])}; measured {measured}"
