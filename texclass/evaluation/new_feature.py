"""A new feature against the table: alone, added to the best row, its cost, its contract, what it repeats."""

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

from texclass.evaluation.accuracy import LEVEL
from texclass.evaluation.additions import unseen
from texclass.evaluation.benchmark import BenchmarkResult, run_benchmark
from texclass.evaluation.benchmark_document import benchmark_blocks, benchmark_document
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable, cached_table
from texclass.evaluation.pipeline import PipelineDefinition
from texclass.evaluation.result import classifier_title, over
from texclass.evaluation.workers import one_thread
from texclass.features.contract import Feature, Gain, UndefinedFeatureError
from texclass.features.contract_checks import EXACT, check_degenerate_inputs, measure_gain_law
from texclass.features.phase_view import View, views_of
from texclass.loaders.dataset import Dataset
from texclass.recording import Samples
from texclass.reporting import Document, Finding, Folded, Heading, Table, write_document
from texclass.reporting.blocks import Block
from texclass.reporting.wording import digits, estimate, p_value, percent, points, points_interval

Data = Mapping[str, Any]


class FeatureStudy(BenchmarkResult, kind="feature"):
    """A new feature against the table of a pipeline on a dataset; see `study_feature`.

    `data` is that of the benchmark, with a row for the feature alone and, as `gains`, what it adds to the
    best row; and `new_feature`: what it is, `ms_alone` and `ms_added` per recording, its `gain_law` as
    declared and as measured, its results for `degenerate_inputs`, and its `redundancy` (see `redundancy`).
    """

    @property
    def result(self) -> BenchmarkResult:
        """The benchmark alone."""
        return BenchmarkResult({key: value for key, value in self.data.items() if key != "new_feature"})

    @property
    def definitions(self) -> dict[str, tuple[str, str]]:
        """Name and hash of the pipeline that the feature was added to."""
        name, digest = super().definitions["pipeline"]
        return {
            "pipeline": (name.removesuffix(f"+{self.data['new_feature']['name']}"), digest.partition("+")[0])
        }

    def document(self) -> Document:
        """Return the study as a document."""
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
        "gain_law": measure_gain_law(feature, views),
        "degenerate_inputs": check_degenerate_inputs(feature),
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
        nearest = rho.reindex(rho.abs().sort_values(ascending=False, kind="stable").index)[:3]
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


def new_feature_document(data: Data) -> Document:
    """Return a study as a document: what the feature adds, what it is, then the table.

    Parameters
    ----------
    data : mapping
        As `FeatureStudy.to_dict` returns it, or its JSON read back.
    """
    table, new = benchmark_document(data), data["new_feature"]
    return Document(
        f"New feature {new['name']} on {table.title}",
        [Heading("The feature itself"), *_itself(new, data), *benchmark_blocks(data)],
        table.subtitle, _finding(data), table.data, table.again, table.versions,
    )  # fmt: skip


def _finding(data: Data) -> Finding:
    gains, name = data.get("gains"), data["new_feature"]["name"]
    groups = [group for group in gains["groups"] if group["paired"]] if gains else []
    if not gains or not groups:
        return Finding(
            "none", "", "", f"gain could be measured for {name}: there is no row that it can join."
        )
    paired, p = groups[0]["paired"], p_value(groups[0]["paired"]["p_value"])
    base = f"{gains['row']} with {classifier_title(gains['classifier'])}"
    seen = paired["p_value"] < LEVEL
    told = "" if seen else f" No difference seen{unseen(groups)}."
    return Finding(
        points(paired["difference"]), "points", points_interval(paired),
        f"of accuracy when {name} joins the best row, {base} "
        f"({percent(gains['without']['accuracy'])} % without it); p {p} by {paired['test']}, 95 % "
        f"interval{over(paired)}.{told}",
        brief=f"Gain when it joins {base}; p {p}.",
    )  # fmt: skip


def _itself(new: Data, data: Data) -> Iterator[Block]:
    """Yield what was found about the feature itself."""
    alone = data["rows"][-1]
    accuracies = [f"{classifier_title(n)} {estimate(a)} %" for n, a in alone["accuracy"].items()]
    cost = f"{digits(new['ms_alone'])} ms per recording alone"
    if new["ms_added"] is not None:
        cost += f"; {digits(max(new['ms_added'], 0.0))} ms more beside the best row"
    repeats = []
    for found in new["redundancy"]:
        kin = [f"{near['column']} {near['rank_correlation']:+.2f}" for near in found["nearest"]]
        repeats.append(f"{found['column']}: rank correlation with {', '.join(kin) or 'nothing'}")
        if (explained := found["explained"]) is not None:
            repeats[-1] += f"; all columns together explain R\N{SUPERSCRIPT TWO} = {explained:.2f}"
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
        "Gain law": _law(new["gain_law"]),
        "Repeats": "; ".join(repeats) or "nothing: it does not vary",
        "Degenerate input": title,
    }
    if len(invalid):
        yield Table(invalid, "Results that violate the feature contract.", n_words=4)
    yield Folded(f"Degenerate input: {title}", [Table(results, n_words=4)])


def _law(law: Data | None) -> str:
    if law is None:
        return "not measured: the feature has no value on the recordings it was tried on"
    declared = f"declared y(g x) = {Gain(**law['declared'])}"
    if law["holds"]:
        return f"{declared}; measured the same (to {law['deviation']:.0e})"
    found = f"y(g x) = {Gain(**law['measured'])}"
    if law.get("measured_deviation", 0.0) > EXACT:
        found = "another, of no power and no shift"
    return f"{declared}; BROKEN by {digits(law['deviation'])}; measured {found}"
