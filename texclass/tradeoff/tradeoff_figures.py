"""Pictures of a trade-off: the front and its knee, what features cost, accuracy against what else costs."""

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from texclass.document.figure_style import (
    FAINT,
    INK,
    LOOKS,
    MUTED,
    NARROW,
    OTHER,
    OURS,
    legend_above,
    new_figure,
    per_cent_limits,
    row_axes,
)
from texclass.document.wording import digits, estimate, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Data = Mapping[str, Any]
LOG_FROM = 8
"""Ratio of the largest to the smallest value from which an axis is logarithmic."""


def draw_front(data: Data, width: float) -> Figure:
    """Draw accuracy against ms: the cost-aware choice, plain selection, the full set, the knee."""
    figure, axes = new_figure(width, 3.4)
    front, knee, full = data["front"], data["knee"], data["full"]
    ms = [point["budget_ms"] for point in front]
    for key, colour, shape, what in (
        ("plain", OTHER, "s", "plain sequential selection"),
        ("accuracy", OURS, "o", "cost-aware choice, 95 % interval"),
    ):
        found = [point[key] for point in front]
        says = [
            f"{what.split(',')[0]}, {digits(x)} ms: {estimate(a)} %" for x, a in zip(ms, found, strict=True)
        ]
        _line(axes, ms, found, colour, shape, what, says, band=key == "accuracy")
    axes.axhline(100 * full["mean"], color=MUTED, linewidth=1, linestyle=":", label="full set")
    at = (knee["budget_ms"], 100 * knee["accuracy"]["mean"])
    told = f"knee: {percent(knee['accuracy']['mean'])} %, {digits(knee['budget_ms'])} ms"
    axes.plot(*at, "o", markersize=13, fillstyle="none", color=INK, label=told, clip_on=False)
    axes.set(xlabel="features of one recording, ms", ylabel="accuracy, %")
    axes.set_xlim(0, 1.04 * max(data["total_ms"], ms[-1]))
    lows = [100 * point[key][end] for point in front for key, end in (("accuracy", "low"), ("plain", "mean"))]
    axes.set_ylim(*per_cent_limits(lows))
    legend_above(figure, axes)
    return figure


def draw_costs(costs: Sequence[Data], bought: Collection[str], width: float) -> Figure:
    """Draw a bar for each feature: its share of the full set, behind it what it costs alone."""
    names = [f"{'● ' if cost['feature'] in bought else ''}{cost['feature']}" for cost in costs]
    figure, axes = row_axes(width, names, "ms (● bought at the budget)")
    for key, colour, height, what in (
        ("alone", FAINT, 0.55, "alone"),
        ("share", OURS, 0.3, "share of the full set"),
    ):
        bars = axes.barh(range(len(costs)), [cost[key] for cost in costs], height, color=colour, label=what)
        for bar, cost in zip(bars, costs, strict=True):
            bar.set_gid(f"{cost['feature']}, {what}: {digits(cost[key])} ms")
    legend_above(figure, axes)
    return figure


def draw_curves(curves: Sequence[Data], width: float) -> Figure:
    """Draw accuracy against everything that is varied, one panel each."""
    panels: dict[str, list[Data]] = {}
    for curve in curves:
        title = f"{curve['name']}, {curve['unit']}" if curve["unit"] else curve["name"]
        panels.setdefault(title, []).append(curve)
    n_columns = 1 if width <= NARROW else min(3, len(panels))
    n_rows = -(-len(panels) // n_columns)
    figure = Figure(figsize=(width, 2.7 * n_rows), layout=ConstrainedLayoutEngine(h_pad=0.1))
    every = figure.subplots(n_rows, n_columns, squeeze=False).ravel()
    for axes, (title, members) in zip(every, panels.items(), strict=False):
        _panel(axes, title, members)
    for axes in every[len(panels) :]:
        axes.set_axis_off()
    return figure


def _panel(axes: "Axes", title: str, curves: Sequence[Data]) -> None:
    ticks: dict[float, str] = {}
    for curve, (colour, shape) in zip(curves, LOOKS, strict=False):
        labels = curve.get("labels") or [f"{x:g}" for x in curve["x"]]
        says = [
            f"{curve['series']}, {label}: {estimate(found)} %"
            for label, found in zip(labels, curve["accuracy"], strict=True)
        ]
        _line(axes, curve["x"], curve["accuracy"], colour, shape, curve["series"], says)
        ticks |= dict(zip(curve["x"], labels, strict=True))
    if min(ticks) > 0 and max(ticks) / min(ticks) >= LOG_FROM:
        axes.set_xscale("log")
    axes.set_xticks(list(ticks), list(ticks.values()), fontsize=8)
    axes.minorticks_off()
    axes.set_ylim(*per_cent_limits([100 * found["low"] for curve in curves for found in curve["accuracy"]]))
    axes.set_title(title[0].upper() + title[1:])
    axes.legend(loc="lower right", fontsize=8)


def _line(
    axes: "Axes",
    x: Sequence[float],
    found: Sequence[Data],
    colour: str,
    shape: str,
    label: str,
    says: Sequence[str],
    *,
    band: bool = True,
) -> None:
    """Draw accuracies along a line, their intervals as a band, and what each point says."""
    mean, low, high = (100 * np.array([one[key] for one in found]) for key in ("mean", "low", "high"))
    if band:
        axes.fill_between(x, low, high, color=colour, alpha=0.12, linewidth=0)
    axes.plot(x, mean, "-" if band else "--", marker=shape, markersize=5, color=colour, label=label)
    for place, value, said in zip(x, mean, says, strict=True):
        axes.plot(place, value, shape, markersize=5, color=colour, gid=said)
