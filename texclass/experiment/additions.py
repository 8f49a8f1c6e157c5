"""What each group of features adds to a row of the table: with it and without it, on the same splits."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.folds import Evaluation
from texclass.experiment.paired import compare, holm
from texclass.experiment.pipeline import MatchedRow, PipelineDefinition
from texclass.experiment.protocols import Protocol, repeated
from texclass.experiment.workers import Progress, each


def choose_base(
    pipeline: PipelineDefinition,
    rows: Sequence[MatchedRow],
    evaluations: Mapping[str, Mapping[str, Evaluation]],
) -> tuple[MatchedRow, str, str] | None:
    """Return the row that is added to, its classifier, and how both were chosen; None if none is computable.

    Parameters
    ----------
    pipeline : PipelineDefinition
        Says which rows hold no feature of any addition, and perhaps which of them and which classifier; else
        the most accurate are taken.
    rows : sequence of MatchedRow
        Rows of the table.
    evaluations : mapping
        Row -> classifier -> evaluation.
    """
    settings = pipeline.gain
    free = {row.name for row in pipeline.bases}
    candidates = {row.definition.name: row for row in rows if row.columns and row.definition.name in free}
    if settings.base in candidates:
        candidates = {settings.base: candidates[settings.base]}
    judges = [settings.classifier] if settings.classifier else list(pipeline.classifiers)
    pairs = [(name, judge) for name in candidates for judge in judges if judge in evaluations[name]]
    if not pairs:
        return None
    name, judge = max(pairs, key=lambda pair: evaluations[pair[0]][pair[1]].accuracy.mean)
    named = settings.base == name
    if named and settings.classifier:
        return candidates[name], judge, "row and classifier named by the pipeline"
    what = "classifier of this row" if named else "row without features of any addition"
    return candidates[name], judge, f"the most accurate {what}, found on these very recordings"


def measure_additions(
    pipeline: PipelineDefinition,
    table: FeatureTable,
    base: tuple[MatchedRow, str, str],
    protocol: Protocol,
    n_folds: int,
    meter: CostMeter,
    *,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Add every group of a pipeline to a row, one at a time, and compare on the same splits.

    A row with sequential selection keeps its number of columns: the group competes for places.

    Parameters
    ----------
    pipeline : PipelineDefinition
        With `additions`.
    table : FeatureTable
        Features of rows and additions.
    base : (MatchedRow, str, str)
        See `choose_base`.
    protocol : Protocol
        Folds that it draws are drawn `pipeline.gain.repeats` times, with seed, seed + 1, ...; see `compare`.
    n_folds : int
        Where the protocol draws folds.
    meter : CostMeter
        Measures the features with and without each group.
    n_jobs : int
        Processes.
    progress : callable, optional
        Called with (done, total, "additions").

    Returns
    -------
    dict
        As JSON: `row`, `classifier`, how they were `chosen`, whether the row `selects` a number of columns,
        what it reaches `without` any group, the splits, and the `groups`: each `joined` to the row, `paired`
        with it, and `p_corrected` for their number (Holm), or what is `missing`.
    """
    row, classifier, chosen = base
    groups = [MatchedRow.of(group, pipeline.features, table) for group in pipeline.additions]
    rows = [row, *(_joined(row, group) for group in groups if group.columns)]
    n_repeats = pipeline.gain.repeats if protocol.drawn else 1
    repeats = repeated(protocol, table.frame, n_folds, n_repeats, pipeline.seed)
    trials = [pipeline.trial(row, classifier, table) for row in rows]
    calls = [partial(trial, splits, nested=protocol.nested) for trial in trials for splits in repeats]
    found = [
        e.hits for e in each(calls, n_jobs=n_jobs, progress=progress, what="additions", total=len(calls))
    ]
    hits = [found[i : i + n_repeats] for i in range(0, len(found), n_repeats)]
    independent = protocol.independent(table.frame)
    paired = [compare(h, hits[0], repeats[0], protocol, independent) for h in hits[1:]]
    model = meter.model(pipeline.features.restricted_to(f for one in rows for f in one.definition.features))
    sums = [
        {
            "n_features": one.n_features,
            "accuracy": float(np.concatenate([fold for repeat in h for fold in repeat]).mean()),
            "ms_per_recording": model.cost(one.columns),
        }
        for one, h in zip(rows, hits, strict=True)
    ]
    corrected = holm([pair["p_value"] for pair in paired]).tolist()
    told: list[dict[str, Any]] = [
        {
            "name": group.definition.name,
            "n_columns": group.n_features,
            "joined": None,
            "paired": None,
            "p_corrected": None,
            "missing": group.missing,
            "reference": group.definition.reference,
        }
        for group in groups
    ]
    measured = [line for line, group in zip(told, groups, strict=True) if group.columns]
    for line, joined, pair, p in zip(measured, sums[1:], paired, corrected, strict=True):
        line |= {"joined": joined, "paired": pair, "p_corrected": p}
    return {
        "row": row.definition.name,
        "classifier": classifier,
        "chosen": chosen,
        "selects": row.definition.select is not None,
        "without": sums[0],
        "n_repeats": n_repeats,
        "n_folds": len(repeats[0]),
        "groups": told,
    }


def _joined(base: MatchedRow, group: MatchedRow) -> MatchedRow:
    """Return the base row with the columns of a group behind its own, under the group's name."""
    columns = (*base.columns, *group.columns)
    select = base.definition.select
    features = (*base.definition.features, *group.definition.features)
    definition = base.definition.model_copy(update={"name": group.definition.name, "features": features})
    n_features = min(select.n, len(columns)) if select else len(columns)
    return replace(base, definition=definition, columns=columns, n_features=n_features)
