"""Ablation: accuracy gained by adding feature groups to a row of the pipeline, on the same splits."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from texclass.evaluation.accuracy import LEVEL, compare, holm
from texclass.evaluation.cost import CostMeter
from texclass.evaluation.feature_table import FeatureTable
from texclass.evaluation.folds import Evaluation
from texclass.evaluation.pipeline import MatchedRow, PipelineDefinition
from texclass.evaluation.protocols import Protocol, repeated_splits
from texclass.evaluation.result_facts import classifier_title, cluster_phrase
from texclass.evaluation.workers import Progress, run_parallel
from texclass.reporting import Figure, Table
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import INK, OURS, PAPER, legend_above, row_axes
from texclass.reporting.wording import aligned, gain, p_value, percent, points

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

COLUMNS = ("With", "Dim", "%", "Points [95 %]", "Folds +/-", "p", "p, Holm", "ms")
Ablation = Mapping[str, Any]


def select_base(
    pipeline: PipelineDefinition,
    rows: Sequence[MatchedRow],
    evaluations: Mapping[str, Mapping[str, Evaluation]],
) -> tuple[MatchedRow, str, str] | None:
    """Return the base row of the ablation, its classifier, and how they were selected.

    Parameters
    ----------
    pipeline : PipelineDefinition
        Pipeline with additions. Its settings can name the base row and the classifier. By default, the pair
        with the highest accuracy is selected.
    rows : sequence of MatchedRow
        Rows of the benchmark table.
    evaluations : mapping
        Evaluation of each row with each classifier: row name -> classifier name -> evaluation.

    Returns
    -------
    tuple or None
        Row, name of the classifier, and description of the selection. None if no base row can be evaluated.
    """
    settings = pipeline.gain
    base_names = {row.name for row in pipeline.bases}
    candidates = {
        row.definition.name: row for row in rows if row.columns and row.definition.name in base_names
    }
    if settings.base in candidates:
        candidates = {settings.base: candidates[settings.base]}
    classifiers = [settings.classifier] if settings.classifier else list(pipeline.classifiers)
    pairs = [(name, c) for name in candidates for c in classifiers if c in evaluations.get(name, {})]
    if not pairs:
        return None
    name, classifier = max(pairs, key=lambda pair: evaluations[pair[0]][pair[1]].accuracy.mean)
    is_base_set = settings.base == name
    if is_base_set and settings.classifier:
        return candidates[name], classifier, "row and classifier named by the pipeline"
    what = "classifier of this row" if is_base_set else "row without features of any addition"
    return candidates[name], classifier, f"the most accurate {what}, selected on these recordings"


def measure_ablation(
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
    """Measure the accuracy gained by adding each feature group to a row, on the same splits.

    If the row uses forward selection, the number of selected columns stays the same, and the columns of
    the group compete with the columns of the row for selection.

    Parameters
    ----------
    pipeline : PipelineDefinition
        Pipeline with `additions`.
    table : FeatureTable
        Feature table with the columns of all rows and additions.
    base : (MatchedRow, str, str)
        Base row, classifier and description from `select_base`.
    protocol : Protocol
        Protocol of the splits. Random folds are drawn `pipeline.gain.repeats` times, with different seeds.
    n_folds : int
        Number of folds, for protocols that draw folds.
    meter : CostMeter
        Cost meter of the dataset.
    n_jobs : int
        Number of processes (default 1).
    progress : callable, optional
        Function called with (done, total, "additions").

    Returns
    -------
    dict
        JSON values: `row` and `classifier`, how they were selected (`selection`), whether the row `selects`
        columns, accuracy and cost of the `base` row, number of repeats and folds, and the `groups`. Each
        group has the accuracy and cost of the `combined` row, its `comparison` with the base row (see
        `compare`), its Holm-corrected p-value (`p_corrected`), and the reason why features are `missing`.
    """
    row, classifier, selection = base
    groups = [MatchedRow.match(group, pipeline.features, table) for group in pipeline.additions]
    rows = [row, *(_combine(row, group) for group in groups if group.columns)]
    n_repeats = pipeline.gain.repeats if protocol.is_random else 1
    repeats = repeated_splits(protocol, table.frame, n_folds, n_repeats, pipeline.seed)
    trials = [pipeline.trial(row, classifier, table) for row in rows]
    calls = [partial(trial, splits, nested=protocol.is_nested) for trial in trials for splits in repeats]
    options: dict[str, Any] = {"n_jobs": n_jobs, "progress": progress, "total": len(calls)}
    all_hits = [evaluation.hits for evaluation in run_parallel(calls, stage="additions", **options)]
    hits = [all_hits[i : i + n_repeats] for i in range(0, len(all_hits), n_repeats)]
    independent = protocol.independent(table.frame)
    comparisons = [compare(h, hits[0], repeats[0], protocol, independent) for h in hits[1:]]
    model = meter.model(pipeline.features.restricted_to(f for one in rows for f in one.definition.features))
    summaries = [
        {
            "n_features": one.n_features,
            "accuracy": float(np.concatenate([fold for repeat in h for fold in repeat]).mean()),
            "ms_per_recording": model.cost(one.columns),
        }
        for one, h in zip(rows, hits, strict=True)
    ]
    p_corrected = holm([comparison["p_value"] for comparison in comparisons]).tolist()
    measurements, group_results = zip(summaries[1:], comparisons, p_corrected, strict=True), []
    for group in groups:
        combined, comparison, p = next(measurements) if group.columns else (None, None, None)
        group_results.append(
            {
                "name": group.definition.name,
                "n_columns": group.n_features,
                "combined": combined,
                "comparison": comparison,
                "p_corrected": p,
                "missing": group.missing,
                "reference": group.definition.reference,
            }
        )
    return {
        "row": row.definition.name,
        "classifier": classifier,
        "selection": selection,
        "selects": row.definition.select is not None,
        "base": summaries[0],
        "n_repeats": n_repeats,
        "n_folds": len(repeats[0]),
        "groups": group_results,
    }


def _combine(base: MatchedRow, group: MatchedRow) -> MatchedRow:
    """Append the columns of a group to the base row. Return the new row, which has the name of the group."""
    columns = (*base.columns, *group.columns)
    select = base.definition.select
    features = (*base.definition.features, *group.definition.features)
    definition = base.definition.model_copy(update={"name": group.definition.name, "features": features})
    n_features = min(select.n, len(columns)) if select else len(columns)
    return replace(base, definition=definition, columns=columns, n_features=n_features)


def ablation_blocks(ablation: Ablation, seed: int) -> Iterator[Block]:
    """Yield the table, the figure and the notes of an ablation."""
    groups = [group for group in ablation["groups"] if group["comparison"]]
    messages = {}
    summaries = [ablation["base"], *(group["combined"] for group in ablation["groups"])]
    ms = aligned(summary and summary["ms_per_recording"] for summary in summaries)
    rows = [[ablation["row"], *_summary_cells(ablation["base"]), "", "", "", "", ms[0]]]
    for i, group in enumerate(ablation["groups"], start=1):
        comparison, name = group["comparison"], f"+ {group['name']}"
        if not comparison:
            messages[i] = f"not evaluated: {group['missing'] or 'no reason given'}"
            rows.append([name, *[""] * (len(COLUMNS) - 1)])
            continue
        folds = [difference for repeat in comparison["folds"] for difference in repeat]
        n_better, n_worse = sum(d > 0 for d in folds), sum(d < 0 for d in folds)
        p_values = map(p_value, (comparison["p_value"], group["p_corrected"]))
        cells = _summary_cells(group["combined"])
        rows.append([name, *cells, gain(comparison), f"{n_better}/{n_worse}", *p_values, ms[i]])
    yield Table(pd.DataFrame(rows, columns=list(COLUMNS)), messages=messages)
    if groups:
        yield Figure(
            "gains",
            f"Gain over {ablation['row']}, {classifier_title(ablation['classifier'])}",
            verdict(ablation),
            lambda width: draw_ablation(groups, width),
        )
    yield list(_notes(ablation, groups, seed))


def draw_ablation(groups: list[Ablation], width: float) -> "Drawing":
    """Plot the gain of each group with its confidence interval. Filled markers denote significant gains."""
    figure, axes = row_axes(width, [f"+ {group['name']}" for group in groups], "gain, points")
    for y, group in enumerate(groups):
        comparison, p = group["comparison"], group["p_corrected"]
        is_significant = p is not None and p < LEVEL
        axes.plot([100 * comparison["low"], 100 * comparison["high"]], [y, y], color=OURS)
        axes.plot(
            100 * comparison["difference"], y, "o", color=OURS,
            markerfacecolor=OURS if is_significant else PAPER,
            gid=f"{group['name']}: {gain(comparison)} points, p {p_value(p)}",
            label="significant, 95 % interval" if is_significant else "not significant",
        )  # fmt: skip
    axes.axvline(0, color=INK, linewidth=1)
    legend_above(figure, axes)
    return figure


def verdict(ablation: Ablation) -> str:
    """Return one sentence that states which groups change the accuracy significantly."""
    groups = [group for group in ablation["groups"] if group["comparison"]]
    if not groups:
        return "The dataset has none of the groups."
    if ablation["base"]["accuracy"] == 1:
        return f"{ablation['row']} classifies everything correctly: no gain is possible on this dataset."
    significant = [
        group for group in groups if group["p_corrected"] is not None and group["p_corrected"] < LEVEL
    ]
    if not significant:
        names = f"any of the {len(groups)} groups" if len(groups) > 1 else groups[0]["name"]
        return f"No significant difference with {names} (corrected p below {LEVEL}){detectable(groups)}."
    gains = ", ".join(
        f"{group['name']} {points(group['comparison']['difference'])} points" for group in significant
    )
    return (
        f"{len(significant)} of {len(groups)} groups change the accuracy significantly (corrected p below "
        f"{LEVEL}): {gains}."
    )


def detectable(groups: list[Ablation]) -> str:
    """Return a clause that states the minimum detectable difference and how to reduce it."""
    comparisons = [group["comparison"] for group in groups]
    comparison = max(comparisons, key=lambda comparison: float(comparison["minimum_detectable"]))
    n, units = comparison["n_clusters"], f"{comparison['clusters']}s"
    minimum = f"{100 * comparison['minimum_detectable']:.1f}".removesuffix(".0")
    text = (
        f"; minimum detectable difference at 80 % power with {n} {units}: "
        f"{minimum} point{'s' * (minimum != '1')}"
    )
    if n <= 5:
        text += f", and a sign test of {n} {units} cannot reach {LEVEL:.0%} (at best {2.0 ** (1 - n):.1%})"
    remedies = {
        "recording": "more recordings, or `--window 1`",
        "run": "more runs, or `--protocol recording`",
    }
    return f"{text}; try {remedies.get(comparison['clusters'], f'more {units}, or `--protocol recording`')}"


def _summary_cells(summary: Ablation) -> tuple[str, str]:
    return str(summary["n_features"]), percent(summary["accuracy"])


def _notes(ablation: Ablation, groups: list[Ablation], seed: int) -> Iterator[str]:
    yield (
        f"Added to {ablation['row']}, {classifier_title(ablation['classifier'])} ({ablation['selection']}): "
        f"{percent(ablation['base']['accuracy'])} % without any group; with and without on the same splits."
    )
    n_folds, n_repeats = ablation["n_folds"], ablation["n_repeats"]
    if n_folds > 1:
        seeds = f"{n_repeats} repeats of {n_folds} folds, seeds {seed} to {seed + n_repeats - 1}"
        folds = seeds if n_repeats > 1 else f"{n_folds} folds"
        yield f"{folds}; folds +/-: number of folds with a gain, number of folds with a loss."
    if tests := sorted({group["comparison"]["test"] for group in groups}):
        n = cluster_phrase(groups[0]["comparison"])
        yield f"Interval and p: {', '.join(tests)}{n}; Holm: corrected for the number of groups."
    if ablation.get("selects"):
        yield f"{ablation['row']} selects its columns: the number of columns stays the same with each group."
    for group in groups:
        if group["missing"]:
            yield f"{group['name']}: without features the dataset lacks: {group['missing']}."
