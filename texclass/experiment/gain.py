"""What each group of features adds to a row of the table: with it and without it, on the same splits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from texclass.experiment.cost import CostMeter
from texclass.experiment.feature_table import FeatureTable
from texclass.experiment.folds import Evaluation
from texclass.experiment.paired import Hits, Paired, compare_once, compare_repeats, holm
from texclass.experiment.pipeline import MatchedRow, PipelineDefinition
from texclass.experiment.protocols import Protocol, Split, repeated
from texclass.experiment.result import Gains, GroupGain, RowSum
from texclass.experiment.workers import Progress, each


@dataclass(frozen=True)
class Base:
    """The row that groups are added to, the classifier that judges, and how both were chosen."""

    row: MatchedRow
    classifier: str
    chosen: str


def choose_base(
    pipeline: PipelineDefinition,
    rows: Sequence[MatchedRow],
    evaluations: Mapping[str, Mapping[str, Evaluation]],
) -> Base | None:
    """Return the row that is added to: the one the pipeline names, else the most accurate one.

    Parameters
    ----------
    pipeline : PipelineDefinition
        Says which rows hold no feature of any addition, and perhaps which of them and which classifier.
    rows : sequence of MatchedRow
        Rows of the table.
    evaluations : mapping
        Row -> classifier -> evaluation.

    Returns
    -------
    Base or None
        None when no such row could be computed.
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
        chosen = "row and classifier named by the pipeline"
    else:
        what = "classifier of this row" if named else "row without features of any addition"
        chosen = f"the most accurate {what}, found on these very recordings"
    return Base(candidates[name], judge, chosen)


def measure_gains(
    pipeline: PipelineDefinition,
    table: FeatureTable,
    base: Base,
    protocol: Protocol,
    n_folds: int,
    meter: CostMeter,
    *,
    n_jobs: int = 1,
    progress: Progress | None = None,
) -> Gains:
    """Add every group of a pipeline to a row, one at a time, and compare on the same splits.

    A row with sequential selection keeps its number of columns: the group competes for places.

    Parameters
    ----------
    pipeline : PipelineDefinition
        With `additions`.
    table : FeatureTable
        Features of rows and additions.
    base : Base
        See `choose_base`.
    protocol : Protocol
        Folds that it draws are drawn `pipeline.gain.repeats` times, with seed, seed + 1, ..., and compared by
        `compare_repeats`; one set of splits is compared by `compare_once`.
    n_folds : int
        Where the protocol draws folds.
    meter : CostMeter
        Measures the features with and without each group.
    n_jobs : int
        Processes.
    progress : callable, optional
        Called with (done, total, "additions").
    """
    groups = [MatchedRow.of(group, pipeline.features, table) for group in pipeline.additions]
    rows = [base.row, *(_joined(base.row, group) for group in groups if group.columns)]
    n_repeats = pipeline.gain.repeats if protocol.drawn else 1
    repeats = repeated(protocol, table.frame, n_folds, n_repeats, pipeline.seed)
    trials = [pipeline.trial(row, base.classifier, table) for row in rows]
    calls = [partial(trial, splits, nested=protocol.nested) for trial in trials for splits in repeats]
    found = [e.hits for e in each(calls, n_jobs=n_jobs, progress=progress, what="additions")]
    hits = [found[i : i + n_repeats] for i in range(0, len(found), n_repeats)]
    paired = [_compare(h, hits[0], repeats, protocol, table, pipeline.seed) for h in hits[1:]]
    every = dict.fromkeys(name for row in rows for name in row.definition.features)
    model = meter.model(pipeline.features.restricted_to(every))
    sums = [
        RowSum(row.n_features, _mean(h), model.cost(row.columns)) for row, h in zip(rows, hits, strict=True)
    ]
    return Gains(
        row=base.row.definition.name,
        classifier=base.classifier,
        chosen=base.chosen,
        selects=base.row.definition.select is not None,
        without=sums[0],
        n_repeats=n_repeats,
        n_folds=len(repeats[0]),
        groups=_groups(groups, sums[1:], paired),
    )


def _groups(groups: list[MatchedRow], sums: list[RowSum], paired: list[Paired]) -> tuple[GroupGain, ...]:
    """Describe every group; those that the dataset has, in order, by what was measured."""
    corrected = holm([p.p_value for p in paired]).tolist()
    measured = iter(zip(sums, paired, corrected, strict=True))
    described = []
    for group in groups:
        joined, comparison, p = next(measured) if group.columns else (None, None, None)
        name, reference = group.definition.name, group.definition.reference
        described.append(GroupGain(name, group.n_features, joined, comparison, p, group.missing, reference))
    return tuple(described)


def _compare(
    hits: Hits,
    without: Hits,
    repeats: Sequence[tuple[Split, ...]],
    protocol: Protocol,
    table: FeatureTable,
    seed: int,
) -> Paired:
    if protocol.drawn:
        ratio = float(np.mean([test.size / train.size for train, test in repeats[0]]))
        return compare_repeats(hits, without, ratio)
    cluster = protocol.clusters(table.frame)
    return compare_once(hits, without, [cluster[test] for _, test in repeats[0]], seed, protocol.unit)


def _mean(hits: Hits) -> float:
    return float(np.concatenate([fold for repeat in hits for fold in repeat]).mean())


def _joined(base: MatchedRow, group: MatchedRow) -> MatchedRow:
    """Return the base row with the columns of a group behind its own, under the group's name."""
    columns = (*base.columns, *group.columns)
    select = base.definition.select
    features = (*base.definition.features, *group.definition.features)
    definition = base.definition.model_copy(update={"name": group.definition.name, "features": features})
    return MatchedRow(definition, columns, min(select.n, len(columns)) if select else len(columns))
