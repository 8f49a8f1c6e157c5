"""Pictures of a benchmark: every row beside the published figure, and what groups of features add."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from texclass.document.figure_style import (
    INK,
    MUTED,
    OTHER,
    OURS,
    PAPER,
    legend_above,
    per_cent_limits,
    row_axes,
)
from texclass.document.wording import estimate, gain, p_value

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVEL = 0.05
"""Corrected p-value below which a gain is called significant."""


def draw_rows(data: Mapping[str, Any], classifier: str, width: float) -> "Figure":
    """Draw each row's accuracy with its interval beside the published figure, and chance where in sight."""
    rows = [row for row in data["rows"] if classifier in row["accuracy"]]
    figure, axes = row_axes(width, [row["name"] for row in rows], "accuracy, %")
    lows = []
    for y, row in enumerate(rows):
        found, theirs = row["accuracy"][classifier], row.get("paper", {}).get(classifier)
        mean, low, high = (100 * found[key] for key in ("mean", "low", "high"))
        lows.append(low)
        axes.plot([low, high], [y, y], color=OURS)
        if theirs is not None:
            lows.append(100 * theirs)
            said = f"{row['name']}: published {100 * theirs:.0f} %"
            axes.plot(
                100 * theirs,
                y,
                "D",
                color=OTHER,
                markerfacecolor=PAPER,
                markersize=5.5,
                gid=said,
                label="published",
            )
        said = f"{row['name']}: ours {estimate(found)}"
        axes.plot(mean, y, "o", color=OURS, gid=said, label="ours, 95 % interval")
    low, high = per_cent_limits(lows)
    chance = 100 / data["dataset"]["n_materials"]
    if low <= chance:
        axes.axvline(chance, color=MUTED, linewidth=1, linestyle=":", label="chance")
    axes.set_xlim(low, high)
    legend_above(figure, axes)
    return figure


def draw_gains(groups: Sequence[Mapping[str, Any]], width: float) -> "Figure":
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
