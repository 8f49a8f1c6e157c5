"""Pictures of a trade-off study: the front, what features cost, accuracy against what else costs."""

from typing import TYPE_CHECKING

import numpy as np

from texclass.reporting.figures import FAINT, INK, OURS, PAPER
from texclass.tradeoff.tradeoff_result import Curve, Estimate, Tradeoff

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY = "#8a8a8a"


def draw_front(result: Tradeoff) -> "Figure":
    """Draw accuracy against ms: the cost-aware choice, plain selection, the full set, the knee."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.add_subplot()
    ms = [point.budget_ms for point in result.front]
    _line(axes, ms, [point.accuracy for point in result.front], OURS, "cost-aware choice, 95 % interval")
    plain = [100 * point.plain.mean for point in result.front]
    axes.plot(ms, plain, "s--", color=PAPER, markersize=4, linewidth=1.2, label="plain sequential selection")
    axes.axhline(100 * result.full.mean, color=GREY, linewidth=1, linestyle=":", label="full set")
    knee = result.knee
    told = f"knee: {100 * knee.accuracy.mean:.1f} % for {knee.budget_ms:.3g} ms"
    at = (knee.budget_ms, 100 * knee.accuracy.mean)
    axes.plot(*at, "o", markersize=12, fillstyle="none", color=INK, label=told)
    axes.set_xlabel("features of one recording (ms)", fontsize=9)
    axes.set_xlim(0, 1.04 * result.total_ms)
    # What is nearly free is nearly worthless; drawing it would flatten all the rest.
    worth = [p.accuracy.low for p in result.front if p.budget_ms >= 0.2 * result.total_ms]
    axes.set_ylim(max(0.0, 100 * min(worth, default=0.0) - 10), 101)
    _finish(axes, "What a millisecond buys")
    axes.set_ylabel("accuracy (%)", fontsize=9)
    axes.legend(loc="lower right", fontsize=8, frameon=False)
    facts = result.dataset
    figure.suptitle(
        f"{facts['name']}: {facts['n_materials']} materials, {facts['n_recordings']} recordings, "
        f"features {result.features}",
        fontsize=9, x=0.01, ha="left", weight="bold",
    )  # fmt: skip
    return figure


def draw_costs(result: Tradeoff) -> "Figure":
    """Draw a bar for each feature: its share of the full set, behind it what it costs alone."""
    from matplotlib.figure import Figure

    costs = result.costs
    figure = Figure(figsize=(7.2, 1.4 + 0.26 * len(costs)), layout="constrained")
    axes = figure.add_subplot()
    y = np.arange(len(costs))
    axes.barh(y, [c.alone for c in costs], height=0.75, color=FAINT, label="alone")
    axes.barh(y, [c.share for c in costs], height=0.45, color=OURS, label="share of the full set")
    bought = set(result.chosen.features)
    for i, cost in enumerate(costs):
        axes.text(max(cost.alone, cost.share), i, f"  {cost.share:.2g}", va="center", fontsize=8, color=INK)
    axes.set_yticks(y, [f"{'● ' if c.feature in bought else ''}{c.feature}" for c in costs], fontsize=8)
    axes.set_ylim(len(costs) - 0.4, -0.6)
    axes.set_xlabel("ms per recording", fontsize=9)
    axes.tick_params(axis="x", labelsize=8)
    axes.grid(axis="x", color=FAINT, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set_title(
        f"{result.dataset['name']}: {result.total_ms:.3g} ms together; ● bought at the budget",
        fontsize=9, loc="left", weight="bold",
    )  # fmt: skip
    axes.legend(loc="lower right", fontsize=8, frameon=False)
    return figure


def draw_curves(result: Tradeoff) -> "Figure":
    """Draw accuracy against whatever else costs, one panel each."""
    from matplotlib.figure import Figure

    panels: dict[str, list[Curve]] = {}
    for curve in result.curves:
        panels.setdefault(curve.name, []).append(curve)
    n = len(panels) + bool(result.fewest)
    n_columns = min(3, n)
    n_rows = -(-n // n_columns)
    figure = Figure(figsize=(0.6 + 3.2 * n_columns, 0.5 + 2.7 * n_rows), layout="constrained")
    axes = figure.subplots(n_rows, n_columns, sharey=True, squeeze=False).ravel()
    for panel, curves in zip(axes, panels.values(), strict=False):
        _curve_panel(panel, curves)
    if result.fewest:
        numbers, accuracies = zip(*result.fewest, strict=True)
        _line(axes[len(panels)], list(numbers), list(accuracies), OURS, "")
        chosen = (len(result.chosen.columns), 100 * result.chosen.accuracy.mean)
        axes[len(panels)].plot(*chosen, "o", markersize=13, fillstyle="none", color=INK)
        _finish(axes[len(panels)], "columns, chosen for this scene")
    for panel in axes[n:]:
        panel.set_axis_off()
    for panel in axes[::n_columns]:
        panel.set_ylabel("accuracy (%)", fontsize=9)
    axes[0].set_ylim(0, 102)
    figure.suptitle(
        f"{result.dataset['name']}: accuracy against what costs (95 % intervals)",
        fontsize=10, x=0.01, ha="left", weight="bold",
    )  # fmt: skip
    return figure


def _curve_panel(axes: "Axes", curves: list[Curve]) -> None:
    ticks: dict[float, str] = {}
    for curve, colour in zip(curves, (OURS, PAPER), strict=False):
        _line(axes, list(curve.x), list(curve.accuracy), colour, curve.series)
        ticks |= dict(zip(curve.x, curve.labels, strict=True))
    first = curves[0]
    axes.set_xscale("linear" if first.unit == "bits" else "log")
    axes.set_xticks(list(ticks), list(ticks.values()))
    axes.minorticks_off()
    _finish(axes, f"{first.name}{f' ({first.unit})' if first.unit else ''}")
    if first.note:
        axes.set_xlabel(first.note, fontsize=7, color=GREY)
    axes.legend(loc="lower right", fontsize=7, frameon=False)


def _line(axes: "Axes", x: list[float], accuracies: list[Estimate], colour: str, label: str) -> None:
    mean = np.array([100 * a.mean for a in accuracies])
    low, high = np.array([(100 * a.low, 100 * a.high) for a in accuracies]).T
    axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(x, mean, "o-", color=colour, markersize=4, linewidth=1.4, label=label)


def _finish(axes: "Axes", title: str) -> None:
    axes.set_title(title, fontsize=9, loc="left")
    axes.tick_params(labelsize=8)
    axes.grid(color=FAINT, linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
