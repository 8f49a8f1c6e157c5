"""What each group of features adds to a row: as a table, as Markdown and as a picture of the differences."""

from collections.abc import Iterator
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from texclass.experiment.result import Gains, GroupGain
from texclass.reporting.terminal import name_cell, table_of
from texclass.reporting.words import line_of, title_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import RenderableType

LEVEL = 0.05
"""Corrected p-value below which a gain is called significant."""
LONGEST = 40
"""Characters of a group's name in the picture."""
TITLE = "What each group adds"
TITLES = ("With", "Dim", "%", "Points [95 %]", "+/-", "p", "Holm", "ms")
"""Of the columns in a terminal."""
HEADER = ("With", "Dim", "%", "Points [95 %]", "Folds +/-", "p", "p, Holm", "ms")


def gain_cells(group: GroupGain) -> tuple[str, ...]:
    """Return one group as text, in the order of `HEADER`; a group that the dataset lacks says so."""
    if group.joined is None or group.paired is None or group.p_corrected is None:
        return (f"+ {group.name}", "", "", group.missing or "", "", "", "", "")
    low, high = group.paired.interval
    return (
        f"+ {group.name}",
        str(group.joined.n_features),
        f"{100 * group.joined.accuracy:.1f}",
        f"{100 * group.paired.difference:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]",
        f"{group.paired.n_better}/{group.paired.n_worse}",
        _p(group.paired.p_value),
        _p(group.p_corrected),
        f"{group.joined.ms_per_recording:.3g}",
    )


def gain_rows(gains: Gains) -> list[tuple[str, ...]]:
    """Return the row without any group, then every group."""
    without = gains.without
    first = (gains.row, str(without.n_features), f"{100 * without.accuracy:.1f}", "", "", "", "")
    return [(*first, f"{without.ms_per_recording:.3g}"), *map(gain_cells, gains.groups)]


def gain_notes(gains: Gains, seed: int) -> Iterator[str]:
    """Yield what a reader of the gains must know, one sentence a note."""
    yield verdict(gains)
    added_to = f"{gains.row}, {title_of(gains.classifier)}"
    yield f"Added to: {added_to} ({gains.chosen}); with and without on the same splits."
    if gains.n_folds > 1:
        seeds = f" repeats of {gains.n_folds} folds, seeds {seed} to {seed + gains.n_repeats - 1}"
        folds = f"{gains.n_repeats}{seeds}" if gains.n_repeats > 1 else f"{gains.n_folds} folds"
        yield f"{folds}; folds +/-: in how many the group helps, in how many it harms."
    if tests := {group.paired.test for group in gains.groups if group.paired is not None}:
        yield f"Interval and p: {', '.join(sorted(tests))}; Holm: corrected for the number of groups."
    if gains.selects:
        yield f"{gains.row} selects its columns: a group competes for the same number of places."
    for group in gains.groups:
        if group.joined is not None and group.missing:
            yield f"{group.name}: without features the dataset lacks: {group.missing}."


def verdict(gains: Gains) -> str:
    """Return one sentence: which groups change the accuracy, as far as these recordings can tell."""
    measured = [g for g in gains.groups if g.paired is not None]
    if not measured:
        return "The dataset has none of the groups."
    if gains.without.accuracy == 1:
        return f"{gains.row} recognises everything by itself: there is nothing to gain on this dataset."
    sure = [g for g in measured if g.p_corrected is not None and g.p_corrected < LEVEL]
    if not sure:
        groups = f"any of the {len(measured)} groups" if len(measured) > 1 else measured[0].name
        return f"No significant difference with {groups} (corrected p below {LEVEL})."
    listed = ", ".join(f"{g.name} {100 * g.paired.difference:+.1f} points" for g in sure if g.paired)
    return f"Significant (corrected p below {LEVEL}): {listed}."


def gain_table(gains: Gains, seed: int) -> "RenderableType":
    """Return the gains for a terminal, with their notes below."""
    from rich.console import Group
    from rich.text import Text

    rows: list[tuple[str, ...]] = []
    for (name, *texts), group in zip(gain_rows(gains), (None, *gains.groups), strict=True):
        lacking = group is not None and group.joined is None
        missing = group.missing if lacking and group is not None else None
        rows.append((name_cell(name, missing), *([""] * len(texts) if lacking else texts)))
    styles = ["", *("dim" if group.joined is None else "" for group in gains.groups)]
    table = table_of(TITLES, rows, styles)
    notes = [Text(f"- {note}", style="dim") for note in gain_notes(gains, seed)]
    return Group(Text(TITLE, style="bold"), table, *notes)


def gain_markdown(gains: Gains, seed: int) -> list[str]:
    """Return the gains as lines of Markdown."""
    table = [line_of(HEADER), "|---|" + "---:|" * (len(HEADER) - 1), *map(line_of, gain_rows(gains))]
    return [f"## {TITLE}", "", *table, "", *(f"- {note}" for note in gain_notes(gains, seed))]


def draw_gains(gains: Gains) -> "Figure":
    """Draw every group's gain with its interval; filled where it is significant after correction."""
    from matplotlib.figure import Figure

    from texclass.reporting.figures import FAINT, INCHES_PER_ROW, INK, OURS

    shown = [g for g in gains.groups if g.paired is not None]
    figure = Figure(figsize=(6.4, 1.3 + INCHES_PER_ROW * max(len(shown), 1)), layout="constrained")
    axes = figure.add_subplot()
    for y, group in enumerate(shown):
        assert group.paired is not None
        assert group.p_corrected is not None
        gain, ends = 100 * group.paired.difference, 100 * np.array(group.paired.interval)
        sure = group.p_corrected < LEVEL
        axes.plot(ends, [y, y], color=OURS, linewidth=1.2)
        axes.plot(gain, y, "o", color=OURS, markersize=5, fillstyle="full" if sure else "none")
    axes.axvline(0, color=INK, linewidth=0.8)
    axes.grid(axis="x", color=FAINT, linewidth=0.5)
    axes.set_axisbelow(True)
    names = [shorten(g.name, LONGEST, placeholder=" ...") for g in shown]
    labels = [f"+ {name} ({_p(g.p_corrected)})" for name, g in zip(names, shown, strict=True)]
    axes.set_yticks(range(len(shown)), labels, fontsize=8)
    axes.set_ylim(max(len(shown), 1) - 0.5, -0.5)
    axes.tick_params(labelsize=8)
    below = f"gain in points, 95 % interval; filled: corrected p (in brackets) below {LEVEL}"
    figure.supxlabel(below, fontsize=8)
    title = f"Added to {gains.row}, {title_of(gains.classifier)} ({100 * gains.without.accuracy:.1f} %)"
    figure.suptitle(title, fontsize=9, x=0.01, ha="left", weight="bold")
    return figure


def _p(p: float | None) -> str:
    return "" if p is None else "<0.001" if p < 0.001 else f"{p:.3f}"
