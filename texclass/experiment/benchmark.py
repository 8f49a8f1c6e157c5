"""The benchmark: dataset and pipeline in, the table out."""

from collections import Counter
from functools import partial
from typing import Any

import numpy as np
from sklearn.metrics import confusion_matrix

from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import FeatureTable, cached_table, metadata
from texclass.experiment.folds import Evaluation
from texclass.experiment.gain import choose_base, measure_gains
from texclass.experiment.nested_choice import choose_inside, inner_splits
from texclass.experiment.pipeline import MatchedRow, PipelineDefinition
from texclass.experiment.protocols import Protocol, Split, find_protocol
from texclass.experiment.result import BenchmarkResult, Confusion, RowResult, Undefined
from texclass.experiment.windows import parents
from texclass.experiment.workers import Progress, each
from texclass.loaders.dataset import Dataset
from texclass.provenance import versions

LIBRARIES = ("numpy", "scipy", "scikit-learn", "pandas", "PyWavelets", "librosa", "joblib")


def run_benchmark(
    dataset: Dataset,
    pipeline: PipelineDefinition,
    *,
    protocol: str | None = None,
    n_folds: int | None = None,
    choose: bool = False,
    n_jobs: int = 1,
    skip_bad: bool = False,
    progress: Progress | None = None,
) -> BenchmarkResult:
    """Evaluate every row of a pipeline on a dataset.

    Parameters
    ----------
    dataset : Dataset
        Labelled recordings, or `touches` of them: windows go where their recording goes, and it votes.
    pipeline : PipelineDefinition
        See `load_pipeline`.
    protocol : str, optional
        A name of `PROTOCOLS`; the pipeline's own by default.
    n_folds : int, optional
        Folds of "recording", "run" and "paper"; the pipeline's own by default.
    choose : bool
        Also choose a row and a classifier inside each training part, see `choose_inside`.
    n_jobs : int
        Processes.
    skip_bad : bool
        List bad recordings in the result instead of stopping at the first.
    progress : callable, optional
        Called with (done, total, what).

    Returns
    -------
    BenchmarkResult
        The same for the same dataset, pipeline, protocol and versions, apart from milliseconds.

    Raises
    ------
    RecordingError
        At a bad recording.
    ValueError
        If the protocol cannot split the dataset; the message names value and rule.
    """
    chosen = find_protocol(protocol or pipeline.protocol.name)
    folds = pipeline.protocol.folds if n_folds is None else n_folds
    # Before the features: a split that is impossible should not cost an extraction.
    facts = metadata(dataset.entries)
    splits = chosen.split(facts, folds, pipeline.seed)
    if choose:
        inner_splits(chosen, facts, splits, pipeline.seed)
    table = cached_table(
        dataset,
        *pipeline.needed,
        channels=pipeline.channels,
        n_jobs=n_jobs,
        skip_bad=skip_bad,
        progress=progress,
    )
    splits = chosen.split(table.frame, folds, pipeline.seed)
    rows = tuple(MatchedRow.of(row, pipeline.features, table) for row in pipeline.rows)
    meter = CostMeter.on(dataset, table.frame["recording_id"].tolist(), pipeline.channels)
    costs = _costs(rows, meter, pipeline)
    evaluations = _evaluate(rows, table, splits, pipeline, chosen, n_jobs=n_jobs, progress=progress)
    gains = None
    if pipeline.additions and (base := choose_base(pipeline, rows, evaluations)) is not None:
        gains = measure_gains(pipeline, table, base, chosen, folds, meter, n_jobs=n_jobs, progress=progress)
    choice = None
    if choose:
        choice = choose_inside(
            rows, table, splits, pipeline, chosen, evaluations, n_jobs=n_jobs, progress=progress
        )
    results = tuple(
        _row_result(row, cost, evaluations.get(row.definition.name, {}))
        for row, cost in zip(rows, costs, strict=True)
    )
    return BenchmarkResult(
        dataset=_facts(dataset, table),
        pipeline=pipeline.name,
        pipeline_hash=pipeline.hash,
        feature_set=pipeline.features.name,
        classifiers=tuple(pipeline.classifiers),
        protocol=chosen.name,
        protocol_description=chosen.description,
        unit=chosen.unit,
        n_folds=len(splits),
        rows=results,
        confusion=_confusion(evaluations, dataset.materials),
        versions=versions(*LIBRARIES),
        seed=pipeline.seed,
        input_hash=dataset.input_hash,
        left_out=table.left_out,
        flags=table.flags,
        undefined=_undefined(table),
        gains=gains,
        choice=choice,
    )


def _costs(
    rows: tuple[MatchedRow, ...], meter: CostMeter, pipeline: PipelineDefinition
) -> list[float | None]:
    return [
        meter.milliseconds(pipeline.features.restricted_to(row.definition.features)) if row.columns else None
        for row in rows
    ]


def _evaluate(
    rows: tuple[MatchedRow, ...],
    table: FeatureTable,
    splits: tuple[Split, ...],
    pipeline: PipelineDefinition,
    protocol: Protocol,
    *,
    n_jobs: int,
    progress: Progress | None,
) -> dict[str, dict[str, Evaluation]]:
    """Evaluate every computable row with every classifier: row name -> classifier -> evaluation."""
    options = {"nested": protocol.nested, "clusters": protocol.clusters(table.frame), "seed": pipeline.seed}
    tasks = [
        (row, name) for row in rows if row.columns for name in row.definition.judged_by(pipeline.classifiers)
    ]
    calls = [partial(pipeline.trial(row, name, table), splits, **options) for row, name in tasks]
    found = each(calls, n_jobs=n_jobs, progress=progress, what="rows")
    evaluations: dict[str, dict[str, Evaluation]] = {}
    for (row, name), evaluation in zip(tasks, found, strict=True):
        evaluations.setdefault(row.definition.name, {})[name] = evaluation
    return evaluations


def _row_result(row: MatchedRow, cost: float | None, evaluations: dict[str, Evaluation]) -> RowResult:
    selected = {
        name: {c: float(share) for c, share in zip(row.columns, e.support, strict=True) if share > 0}
        for name, e in evaluations.items()
        if row.definition.select is not None
    }
    return RowResult(
        name=row.definition.name,
        n_features=row.n_features,
        accuracy={name: e.accuracy for name, e in evaluations.items()},
        published=row.definition.published,
        ms_per_recording=cost,
        missing=row.missing,
        selected=selected,
        reference=row.definition.reference,
    )


def _confusion(evaluations: dict[str, dict[str, Evaluation]], materials: tuple[str, ...]) -> Confusion | None:
    """Confusion matrix of the row and classifier with the highest accuracy."""
    pairs = [(row, name) for row, found in evaluations.items() for name in found]
    if not pairs:
        return None
    row, name = max(pairs, key=lambda pair: evaluations[pair[0]][pair[1]].accuracy.mean)
    best = evaluations[row][name]
    return Confusion(
        row,
        name,
        materials,
        confusion_matrix(np.concatenate(best.truth), np.concatenate(best.predicted), labels=list(materials)),
    )


def _facts(dataset: Dataset, table: FeatureTable) -> dict[str, Any]:
    frame = table.frame
    return {
        "name": dataset.name,
        "title": dataset.title,
        "n_recordings": int(parents(frame).nunique()),
        **({"n_windows": len(frame)} if "parent" in frame else {}),
        "n_materials": int(frame["material"].nunique()),
        "n_operators": int(frame["operator"].nunique()),
        "n_sessions": int(frame["session"].nunique()),
        "materials": list(dataset.materials),
        "licence": dataset.licence,
        "source": dataset.source,
        "notes": list(dataset.notes),
    }


def _undefined(table: FeatureTable) -> tuple[Undefined, ...]:
    """Summarise undefined values by feature: the commonest reason, and the number of recordings."""
    by_feature: dict[str, Counter[str]] = {}
    for reason in table.reasons:
        by_feature.setdefault(reason.feature, Counter())[reason.reason] += 1
    return tuple(
        Undefined(feature, reasons.most_common(1)[0][0], reasons.total())
        for feature, reasons in by_feature.items()
    )
