"""Ablation: accuracy gained by adding feature groups to a row, on the same splits."""

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
from texclass.evaluation.protocols import Protocol, repeated
from texclass.evaluation.result import classifier_title, over
from texclass.evaluation.workers import Progress, each
from texclass.reporting import Figure, Table
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import INK, OURS, PAPER, legend_above, row_axes
from texclass.reporting.wording import aligned, gain, p_value, percent, points

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

COLUMNS = ("With", "Dim", "%", "Points [95 %]", "Folds +/-", "p", "p, Holm", "ms")
Gains = Mapping[str, Any]


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
    pairs = [(name, judge) for name in candidates for judge in judges if judge in evaluations.get(name, {})]
    if not pairs:
        return None
    name, judge = max(pairs, key=lambda pair: evaluations[pair[0]][pair[1]].accuracy.mean)
    named = settings.base == name
    if named and settings.classifier:
        return candidates[name], judge, "row and classifier named by the pipeline"
    what = "classifier of this row" if named else "row without features of any addition"
    return candidates[name], judge, f"the most accurate {what}, selected on these recordings"


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
    n_repeats = pipeline.gain.repeats if protocol.is_random else 1
    repeats = repeated(protocol, table.frame, n_folds, n_repeats, pipeline.seed)
    trials = [pipeline.trial(row, classifier, table) for row in rows]
    calls = [partial(trial, splits, nested=protocol.is_nested) for trial in trials for splits in repeats]
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
    measured, told = zip(sums[1:], paired, corrected, strict=True), []
    for group in groups:
        joined, pair, p = next(measured) if group.columns else (None, None, None)
        told.append(
            {
                "name": group.definition.name,
                "n_columns": group.n_features,
                "joined": joined,
                "paired": pair,
                "p_corrected": p,
                "missing": group.missing,
                "reference": group.definition.reference,
            }
        )
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


def gains_blocks(gains: Gains, seed: int) -> Iterator[Block]:
    """Yield table, figure and notes of what each group adds."""
    measured = [group for group in gains["groups"] if group["paired"]]
    instead = {}
    joined = [gains["without"], *(group["joined"] for group in gains["groups"])]
    ms = aligned(found and found["ms_per_recording"] for found in joined)
    rows = [[gains["row"], *_sum(gains["without"]), "", "", "", "", ms[0]]]
    for i, group in enumerate(gains["groups"], start=1):
        paired, name = group["paired"], f"+ {group['name']}"
        if not paired:
            instead[i] = f"not evaluated: {group['missing'] or 'no reason given'}"
            rows.append([name, *[""] * (len(COLUMNS) - 1)])
            continue
        folds = [difference for repeat in paired["folds"] for difference in repeat]
        better, worse = sum(d > 0 for d in folds), sum(d < 0 for d in folds)
        p_values = map(p_value, (paired["p_value"], group["p_corrected"]))
        rows.append([name, *_sum(group["joined"]), gain(paired), f"{better}/{worse}", *p_values, ms[i]])
    yield Table(pd.DataFrame(rows, columns=list(COLUMNS)), instead=instead)
    if measured:
        yield Figure(
            "gains",
            f"Gain over {gains['row']}, {classifier_title(gains['classifier'])}",
            verdict(gains),
            lambda width: draw_gains(measured, width),
        )
    yield list(_notes(gains, measured, seed))


def draw_gains(groups: list[Gains], width: float) -> "Drawing":
    """Draw what each measured group adds, with its interval; filled where it is significant, corrected."""
    figure, axes = row_axes(width, [f"+ {group['name']}" for group in groups], "gain, points")
    for y, group in enumerate(groups):
        paired, p = group["paired"], group["p_corrected"]
        sure = p is not None and p < LEVEL
        axes.plot([100 * paired["low"], 100 * paired["high"]], [y, y], color=OURS)
        axes.plot(
            100 * paired["difference"], y, "o", color=OURS, markerfacecolor=OURS if sure else PAPER,
            gid=f"{group['name']}: {gain(paired)} points, p {p_value(p)}",
            label="significant, 95 % interval" if sure else "not significant",
        )  # fmt: skip
    axes.axvline(0, color=INK, linewidth=1)
    legend_above(figure, axes)
    return figure


def verdict(gains: Gains) -> str:
    """Return one sentence: which groups change the accuracy, as far as these recordings can tell."""
    measured = [group for group in gains["groups"] if group["paired"]]
    if not measured:
        return "The dataset has none of the groups."
    if gains["without"]["accuracy"] == 1:
        return f"{gains['row']} classifies everything correctly: no gain is possible on this dataset."
    sure = [group for group in measured if group["p_corrected"] is not None and group["p_corrected"] < LEVEL]
    if not sure:
        groups = f"any of the {len(measured)} groups" if len(measured) > 1 else measured[0]["name"]
        return f"No significant difference with {groups} (corrected p below {LEVEL}){unseen(measured)}."
    listed = ", ".join(f"{group['name']} {points(group['paired']['difference'])} points" for group in sure)
    return (
        f"{len(sure)} of {len(measured)} groups change the accuracy significantly (corrected p below "
        f"{LEVEL}): {listed}."
    )


def unseen(groups: list[Gains]) -> str:
    """Return what could not be seen with so few independent tests, as the end of a sentence."""
    paired = max((group["paired"] for group in groups), key=lambda paired: paired.get("least") or 0.0)
    if not paired.get("least"):  # an older result
        return ""
    n, what = paired["n_clusters"], f"{paired['clusters']}s"
    least = f"{100 * paired['least']:.1f}".removesuffix(".0")
    told = (
        f"; minimum detectable difference at 80 % power with {n} {what}: {least} point{'s' * (least != '1')}"
    )
    if n <= 5:
        told += f", and {n} {what} cannot reach {LEVEL:.0%} by their signs alone ({2.0 ** (1 - n):.1%})"
    ways = {"recording": "more recordings, or `--window 1`", "run": "more runs, or `--protocol recording`"}
    return f"{told}; try {ways.get(paired['clusters'], f'more {what}, or `--protocol recording`')}"


def _sum(found: Gains) -> tuple[str, str]:
    return str(found["n_features"]), percent(found["accuracy"])


def _notes(gains: Gains, measured: list[Gains], seed: int) -> Iterator[str]:
    """Yield the notes on the gains."""
    yield (
        f"Added to {gains['row']}, {classifier_title(gains['classifier'])} ({gains['chosen']}): "
        f"{percent(gains['without']['accuracy'])} % without any group; with and without on the same splits."
    )
    n_folds, n_repeats = gains["n_folds"], gains["n_repeats"]
    if n_folds > 1:
        seeds = f"{n_repeats} repeats of {n_folds} folds, seeds {seed} to {seed + n_repeats - 1}"
        folds = seeds if n_repeats > 1 else f"{n_folds} folds"
        yield f"{folds}; folds +/-: in how many the group helps, in how many it harms."
    if tests := sorted({group["paired"]["test"] for group in measured}):
        n = over(measured[0]["paired"])
        yield f"Interval and p: {', '.join(tests)}{n}; Holm: corrected for the number of groups."
    if gains.get("selects"):
        yield f"{gains['row']} selects its columns: a group competes for the same number of places."
    for group in measured:
        if group["missing"]:
            yield f"{group['name']}: without features the dataset lacks: {group['missing']}."
