"""What groups of features add to a row, as blocks of a document."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd

from texclass.document import Figure, Table
from texclass.document.blocks import Block
from texclass.document.figure_style import INK, OURS, PAPER, legend_above, row_axes
from texclass.document.wording import aligned, gain, p_value, percent, points
from texclass.experiment.result_words import classifier_title, over

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

LEVEL = 0.05
"""Corrected p-value below which a gain is called significant."""
COLUMNS = ("With", "Dim", "%", "Points [95 %]", "Folds +/-", "p", "p, Holm", "ms")
Gains = Mapping[str, Any]


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
            instead[i] = f"not computed: {group['missing'] or 'no reason given'}"
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
        return f"{gains['row']} recognises everything by itself: there is nothing to gain on this dataset."
    sure = [group for group in measured if group["p_corrected"] is not None and group["p_corrected"] < LEVEL]
    if not sure:
        groups = f"any of the {len(measured)} groups" if len(measured) > 1 else measured[0]["name"]
        return f"No difference seen with {groups} (corrected p below {LEVEL}){unseen(measured)}."
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
        f"; with {n} {what} less than {least} point{'s' * (least != '1')} could not be seen in 8 of 10 trials"
    )
    if n <= 5:
        told += f", and {n} {what} cannot reach {LEVEL:.0%} by their signs alone ({2.0 ** (1 - n):.1%})"
    ways = {"recording": "more recordings, or `--touch 1`", "run": "more runs, or `--protocol recording`"}
    return f"{told}; try {ways.get(paired['clusters'], f'more {what}, or `--protocol recording`')}"


def _sum(found: Gains) -> tuple[str, str]:
    return str(found["n_features"]), percent(found["accuracy"])


def _notes(gains: Gains, measured: list[Gains], seed: int) -> Iterator[str]:
    """Yield what a reader of the gains must know."""
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
