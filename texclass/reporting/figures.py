"""Pictures of a benchmark: the table, ours beside published, and who is taken for whom."""

from textwrap import fill, shorten
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from texclass.experiment.result import BenchmarkResult, Confusion, RowResult
from texclass.reporting.cells import cells, header
from texclass.reporting.tables import headline
from texclass.reporting.words import title_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, OURS, PAPER, FAINT = "#222222", "#1f5f99", "#c2571a", "#dddddd"
INCHES_PER_ROW = 0.27
CHARACTERS_PER_INCH = 12
"""Of a title."""
FEW = 8
"""Rows of which the ranking also writes the values."""


def draw_table(result: BenchmarkResult) -> "Figure":
    """Draw the table as text."""
    from matplotlib.figure import Figure

    rows = [header(result).texts, *(cells(result, row).texts for row in result.rows)]
    lacking = [False, *(not row.accuracy for row in result.rows)]
    widths = _widths(rows, lacking)
    title = headline(result).replace("`", "")
    widths[0] += max(0.0, 1.05 * len(title) - sum(widths))
    edges = np.concatenate([[0.0], np.cumsum(widths)])
    figure = Figure(figsize=(0.078 * edges[-1] + 0.4, INCHES_PER_ROW * (len(rows) + 2)), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(0, edges[-1]), ylim=(len(rows), -1.2))
    axes.set_axis_off()
    axes.text(0, -0.7, title, fontsize=9, weight="bold", color=INK)
    best = result.best
    room = int(edges[2 + len(result.classifiers)] - edges[2]) - 2
    for y, row in enumerate(rows):
        strong = y == 0 or (best is not None and result.rows[y - 1] is best[0])
        for x, text in enumerate(row):
            left = x == 0 or (lacking[y] and x == 2)
            shown = shorten(text, room, placeholder=" ...") if left and x == 2 else text
            axes.text(
                edges[x] if left else edges[x + 1] - 1,
                y + 0.5,
                shown,
                ha="left" if left else "right",
                va="center",
                fontsize=8,
                color="#888888" if lacking[y] else INK,
                weight="bold" if strong else "normal",
            )
        axes.axhline(y + 1, color=INK if y == 0 else FAINT, linewidth=0.8 if y == 0 else 0.5)
    return figure


def draw_ranking(result: BenchmarkResult) -> "Figure":
    """Draw each row's accuracy with its interval beside the published figure, one panel a classifier."""
    from matplotlib.figure import Figure

    shown = [row for row in result.rows if row.accuracy]
    n = len(result.classifiers)
    width = 3.2 + 2.9 * n
    title = fill(headline(result).replace("`", ""), int(CHARACTERS_PER_INCH * width))
    height = 1.35 + INCHES_PER_ROW * (max(len(shown), 1) + title.count("\n"))
    figure = Figure(figsize=(width, height), layout="constrained")
    panels = figure.subplots(1, n, sharex=True, sharey=True, squeeze=False)[0]
    chance = 100 / result.dataset["n_materials"]
    low = _low_end(shown, chance)
    for axes, classifier in zip(panels, result.classifiers, strict=True):
        _rank_panel(axes, shown, classifier)
        if chance >= low:
            axes.axvline(chance, color="#888888", linewidth=0.8, linestyle=":", label="chance")
        agreement = result.rank_agreement(classifier)
        spearman = "" if agreement is None else f"  (Spearman {agreement:.2f})"
        axes.set_title(f"{title_of(classifier)}{spearman}", fontsize=9)
        axes.set_xlabel(
            "accuracy (%)" if chance >= low else f"accuracy (%); chance: {chance:.2g}", fontsize=9
        )
    panels[0].set_xlim(low - (100 - low) / 50, 100 + (100 - low) / 50)
    panels[0].set_yticks(range(len(shown)), [row.name for row in shown], fontsize=8)
    panels[0].set_ylim(max(len(shown), 1) - 0.5, -0.5)
    figure.suptitle(title, fontsize=9, x=0.01, ha="left", weight="bold")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower right", ncols=3, fontsize=8, frameon=False)
    return figure


def draw_confusion(confusion: Confusion) -> "Figure":
    """Draw a confusion matrix, readable up to some hundred materials."""
    from matplotlib.figure import Figure

    n = len(confusion.materials)
    tested = np.maximum(confusion.counts.sum(axis=1, keepdims=True), 1)
    side = 2.4 + min(max(0.19 * n, 2.4), 16.0)
    figure = Figure(figsize=(side, side - 0.4), layout="constrained")
    axes = figure.add_subplot()
    image = axes.imshow(confusion.counts / tested, cmap="Blues", vmin=0, vmax=1, interpolation="nearest")
    font = 7 if n <= 84 else 5
    axes.set_xticks(range(n), confusion.materials, rotation=90, fontsize=font)
    axes.set_yticks(range(n), confusion.materials, fontsize=font)
    axes.set_xticks(np.arange(n - 1) + 0.5, minor=True)
    axes.set_yticks(np.arange(n - 1) + 0.5, minor=True)
    axes.grid(which="minor", color=FAINT, linewidth=0.4)
    axes.tick_params(which="both", length=0)
    for i, j in np.argwhere(confusion.counts > 0):
        share = confusion.counts[i, j] / tested[i, 0]
        text = str(confusion.counts[i, j])
        axes.text(j, i, text, ha="center", va="center", fontsize=font, color="white" if share > 0.5 else INK)
    hits = confusion.counts.trace() / max(confusion.counts.sum(), 1)
    axes.set_title(f"{confusion.row}, {title_of(confusion.classifier)}: {hits:.1%} correct", fontsize=9)
    axes.set_xlabel("recognised as", fontsize=9)
    axes.set_ylabel("explored", fontsize=9)
    bar = figure.colorbar(image, ax=axes, shrink=0.6)
    bar.set_label("share of the material's tests", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return figure


def _low_end(rows: list[RowResult], chance: float) -> float:
    """Return where the axis begins: the ten below all that is drawn, or 0 where that is near to chance."""
    drawn = [100 * accuracy.interval[0] for row in rows for accuracy in row.accuracy.values()]
    drawn += [theirs for row in rows for theirs in row.published.values()]
    low = min(90.0, 10 * np.floor(min(drawn, default=0.0) / 10))
    return 0.0 if low <= max(30.0, chance) else float(low)


def _rank_panel(axes: "Axes", rows: list[RowResult], classifier: str) -> None:
    judged = [(i, row.accuracy[classifier]) for i, row in enumerate(rows) if classifier in row.accuracy]
    y = np.array([i for i, _ in judged])
    mean = np.array([100 * found.mean for _, found in judged])
    interval = 100 * np.array([found.interval for _, found in judged]).reshape(-1, 2)
    axes.errorbar(
        mean, y, xerr=(mean - interval[:, 0], interval[:, 1] - mean), fmt="o", color=OURS, markersize=4.5,
        linewidth=1.4, label="ours, 95 % interval",
    )  # fmt: skip
    theirs = [(row.published[classifier], i) for i, row in enumerate(rows) if classifier in row.published]
    if theirs:
        axes.plot(
            *zip(*theirs, strict=True), "D", color=PAPER, markersize=4, fillstyle="none", label="published"
        )
    if len(rows) <= FEW:
        _write_values(axes, y, mean)
    axes.spines[["left", "right", "top"]].set_visible(False)
    axes.spines["bottom"].set_color("#888888")
    axes.tick_params(labelsize=8, color="#888888")
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="both", color=FAINT, linewidth=0.5)
    axes.set_axisbelow(True)


def _write_values(axes: "Axes", places: NDArray[np.intp], values: NDArray[np.float64]) -> None:
    """Write each value beside its panel, the largest strong."""
    for y, value in zip(places, values, strict=True):
        weight = "bold" if value == values.max() else "normal"
        axes.text(
            1.02, y, f"{value:.1f}", transform=axes.get_yaxis_transform(), va="center", fontsize=8, color=INK,
            weight=weight,
        )  # fmt: skip


def _widths(rows: list[tuple[str, ...]], lacking: list[bool]) -> list[float]:
    """Column widths in characters; the remark of a missing row may run over its neighbours."""
    counted = [
        [len(text) for x, text in enumerate(row) if x == column and not (gap and x == 2)]
        for column in range(len(rows[0]))
        for row, gap in zip(rows, lacking, strict=True)
    ]
    n_rows = len(rows)
    return [
        2.0
        + max((length for lengths in counted[c * n_rows : (c + 1) * n_rows] for length in lengths), default=0)
        for c in range(len(rows[0]))
    ]
