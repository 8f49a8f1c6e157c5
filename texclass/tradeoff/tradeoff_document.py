"""A trade-off as a document: accuracy against latency, signal length, training recordings, rate and bits."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from texclass.evaluation.result import (
    again_facts,
    chance_of,
    classifier_title,
    dataset_facts,
    over,
    size,
)
from texclass.reporting import Document, Figure, Finding, Folded, Heading, Table
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import (
    FAINT,
    INK,
    LOOKS,
    MUTED,
    NARROW,
    OTHER,
    OURS,
    chance_line,
    legend_above,
    new_figure,
    per_cent_limits,
    row_axes,
)
from texclass.reporting.wording import aligned, counted, digits, estimate, interval, percent, points, sentence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

Data = Mapping[str, Any]
LOG_FROM = 8
"""Ratio of the largest to the smallest value from which an axis is logarithmic."""


def tradeoff_document(data: Data) -> Document:
    """Return a trade-off as a document.

    Parameters
    ----------
    data : mapping
        As `Tradeoff.to_dict` returns it, or its JSON read back.
    """
    felt = data["dataset"].get("max_seconds")
    knee, full, half, total = data["knee"], data["full"], data["at_half_cost"], data["total_ms"]
    against = f"{points(knee['accuracy']['mean'] - full['mean'])} points against the full set"
    finding = Finding(
        percent(knee["accuracy"]["mean"]),
        "%",
        interval(knee["accuracy"]),
        f"of recordings classified correctly at the knee point (selected on these folds, optimistic), with a "
        f"latency budget of {digits(knee['budget_ms'])} ms ({100 * knee['budget_ms'] / total:.0f} % of the "
        f"{digits(total)} ms of the full set). Protocol: {data['protocol']}; features are selected in each "
        f"training set; 95 % confidence interval{over(data)}; chance level {percent(chance_of(data))} %.",
        f"{against} ({estimate(full)} %); at half the cost of its features "
        f"{points(half['accuracy']['mean'] - full['mean'])} points, and "
        f"{points(half['plain']['mean'] - full['mean'])} by sequential selection "
        "that ignores costs and stops at the budget.",
        f"At the knee point, {digits(knee['budget_ms'])} ms per recording; {against}, {digits(total)} ms.",
    )
    return Document(
        f"{data['dataset']['name']}, accuracy against latency",
        list(_blocks(data)),
        f"Features {data['features']}: {size(data['dataset'])}{f', {felt:g} s of each' if felt else ''}",
        finding,
        dataset_facts(data),
        again_facts(data, data["features"]),
        data["versions"],
    )


def _blocks(data: Data) -> Iterator[Block]:
    yield Heading("Pareto front: accuracy against latency")
    yield _front(data)
    first, last, knee = data["front"][0], data["front"][-1], data["knee"]
    yield Figure(
        "front",
        "Accuracy against latency",
        f"From {_at(first)} to {_at(last)}; knee point: {_at(knee)}; chance level "
        f"{percent(chance_of(data))} %.",
        lambda width: draw_front(data, width),
    )
    yield list(_notes(data))
    if data.get("fewest"):
        scene = ", ".join(data["dataset"].get("surfaces") or ()) or "this scene"
        rows = [(str(n), estimate(found)) for n, found in data["fewest"]]
        yield Heading("Fewest columns for these surfaces")
        caption = f"Accuracy with the best columns, selected in each training set, for {scene}."
        yield Table(pd.DataFrame(rows, columns=["Columns", "% [95 %]"]), caption)
    if data.get("curves"):
        yield Heading("Accuracy against other costs")
        yield _curves(data["curves"], 100 * chance_of(data))
    yield Heading("Cost of each feature")
    yield _costs(data)
    parts = sorted(data["parts"].items(), key=lambda part: -part[1])
    yield Folded("Shared transforms", [Table(pd.DataFrame(parts, columns=["Transform", "ms per recording"]))])
    times = [(classifier_title(c["name"]), c["fit_ms"], c["predict_ms"]) for c in data["classifiers"]]
    titles = ["Classifier", "fit, all recordings, ms", "predict, one recording, ms"]
    yield Folded("Classifiers", [Table(pd.DataFrame(times, columns=titles), "On all columns.")])


def _at(point: Data) -> str:
    return f"{percent(point['accuracy']['mean'])} % at {digits(point['budget_ms'])} ms"


def _front(data: Data) -> Table:
    """Return accuracy and columns at each budget, and of the full set."""
    front = data["front"]
    marks = {"knee point": "knee", "half the cost": "at_half_cost"}
    marked = [", ".join(name for name, key in marks.items() if point == data[key]) for point in front]
    rows = [
        (digits(p["budget_ms"]), digits(p["ms"]), digits(p["n_features"]), digits(p["n_columns"]),
         estimate(p["accuracy"]), estimate(p["plain"]), mark)
        for p, mark in zip(front, marked, strict=True)
    ]  # fmt: skip
    every = len({cost["feature"] for cost in data["costs"]})
    rows.append(
        ("full set", digits(data["total_ms"]), str(every), "", estimate(data["full"]), "", "full set")
    )
    titles = [
        "Budget, ms", "Used, ms", "Features", "Columns", "Accuracy, % [95 %]", "Plain, % [95 %]", "Mark",
    ]  # fmt: skip
    return Table(
        pd.DataFrame(rows, columns=titles),
        "Features and columns: mean over folds; ms: latency per recording, one thread, this machine, with "
        "conditioning; plain: sequential selection that ignores costs. 95 % confidence intervals"
        f"{over(data)}; chance level {percent(chance_of(data))} %.",
        strong=[i for i, mark in enumerate(marked) if mark.startswith("knee")],
    )


def _notes(data: Data) -> Iterator[str]:
    chosen = data["chosen"]
    saved = f"; saved as {chosen['file']}" if chosen.get("file") else ""
    yield (
        f"Pipeline at the budget ({chosen['why']}): {counted(len(chosen['columns']), 'column')} of "
        f"{', '.join(chosen['features'])}; {digits(chosen['predicted_ms'])} ms by the cost model, "
        f"{digits(chosen['measured_ms'])} ms measured when pruned; {estimate(chosen['accuracy'])} %{saved}."
    )
    within = "of every cost" if data.get("whole_path") else "more"
    yield f"Segmentation takes {digits(data['segmentation_ms'])} ms {within}, for every selection."
    if machine := data.get("costs_of"):
        yield f"Latency was measured once on {machine}, and is stored in the cache folder."
    if rule := data.get("knee_rule"):
        yield sentence(f"Knee point: {rule}")
    if pairs := data.get("model_check"):
        worst = max(abs(predicted / measured - 1) for predicted, measured in pairs)
        yield (
            f"The cost model deviates from the measured cost of {counted(len(pairs), 'random subset')} by at "
            "most "
            f"{100 * worst:.0f} %."
        )
    yield from map(sentence, [*data.get("notes", ()), *data["dataset"].get("notes", ())])


def _curves(curves: Sequence[Data], chance: float) -> Figure:
    """Return accuracy against everything that is varied: one panel each."""
    rows = [
        (curve["name"], curve["series"], label, estimate(found))
        for curve in curves
        for label, found in zip(_labels(curve), curve["accuracy"], strict=True)
    ]
    said = [
        f"{curve['name']} ({curve['series']}): {percent(curve['accuracy'][0]['mean'])} % at "
        f"{_labels(curve)[0]}, {percent(curve['accuracy'][-1]['mean'])} % at {_labels(curve)[-1]}"
        for curve in curves
    ]
    notes = dict.fromkeys(sentence(curve["note"]) for curve in curves if curve.get("note"))
    return Figure(
        "curves",
        f"Accuracy in %, with 95 % confidence intervals; chance level {chance:.1f} %",
        " ".join([f"{'; '.join(said)}.", *notes]),
        lambda width: draw_curves(curves, width, chance),
        Table(pd.DataFrame(rows, columns=["Varied", "Curve", "Value", "% [95 %]"]), n_words=3),
    )


def _labels(curve: Data) -> list[str]:
    return curve.get("labels") or [f"{x:g}" for x in curve["x"]]


def _costs(data: Data) -> Figure:
    """Return what each feature costs: alone, its share of the full set, and what leaving it out saves."""
    costs = sorted(data["costs"], key=lambda cost: -cost["share"])
    frame = pd.DataFrame({"Feature": [cost["feature"] for cost in costs]})
    for title, key in {
        "Share of the full set": "share",
        "Alone": "alone",
        "Saved when left out": "last",
    }.items():
        frame[title] = aligned(cost[key] for cost in costs)
    return Figure(
        "costs",
        "Cost of features, one recording",
        f"The full set takes {digits(data['total_ms'])} ms; the most expensive of {len(costs)} features is "
        f"{costs[0]['feature']} with a share of {digits(costs[0]['share'])} ms.",
        lambda width: draw_costs(costs, set(data["chosen"]["features"]), width),
        Table(
            frame, "ms per recording; share: shared transforms split equally between those that need them."
        ),
    )


def draw_front(data: Data, width: float) -> "Drawing":
    """Draw accuracy against ms: the cost-aware choice, plain selection, the full set, the knee."""
    figure, axes = new_figure(width, 3.4)
    front, knee, full = data["front"], data["knee"], data["full"]
    ms = [point["budget_ms"] for point in front]
    for key, colour, shape, what in (
        ("plain", OTHER, "s", "plain sequential selection"),
        ("accuracy", OURS, "o", "cost-aware selection, 95 % interval"),
    ):
        found = [point[key] for point in front]
        says = [
            f"{what.split(',')[0]}, {digits(x)} ms: {estimate(a)} %" for x, a in zip(ms, found, strict=True)
        ]
        _line(axes, ms, found, colour, shape, what, says, band=key == "accuracy")
    axes.axhline(100 * full["mean"], color=MUTED, linewidth=1, linestyle=":", label="full set")
    at = (knee["budget_ms"], 100 * knee["accuracy"]["mean"])
    told = f"knee point: {percent(knee['accuracy']['mean'])} %, {digits(knee['budget_ms'])} ms"
    axes.plot(*at, "o", markersize=13, fillstyle="none", color=INK, label=told, clip_on=False)
    what = "samples to features" if data.get("whole_path") else "features"
    axes.set(xlabel=f"latency ({what}) per recording, ms", ylabel="accuracy, %")
    axes.set_xlim(0, 1.04 * max(data["total_ms"], ms[-1]))
    lows = [100 * point[key][end] for point in front for key, end in (("accuracy", "low"), ("plain", "mean"))]
    limit_accuracy(axes, lows, 100 * chance_of(data))
    legend_above(figure, axes)
    return figure


def limit_accuracy(axes: "Axes", lows: Sequence[float], chance: float) -> None:
    """Let the vertical axis, in per cent, begin below the least values, and draw the line of chance."""
    low, high = per_cent_limits(lows)
    chance_line(axes.axhline, chance, low)
    axes.set_ylim(low, high)


def draw_costs(costs: Sequence[Data], bought: Collection[str], width: float) -> "Drawing":
    """Draw two bars for each feature, apart, so that each can be pointed at: its share, and it alone."""
    names = [f"{'● ' if cost['feature'] in bought else ''}{cost['feature']}" for cost in costs]
    figure, axes = row_axes(width, names, "ms (● selected at the budget)")
    for key, colour, place, what in (
        ("share", OURS, -0.18, "share of the full set"),
        ("alone", FAINT, 0.18, "alone"),
    ):
        middles = [y + place for y in range(len(costs))]
        bars = axes.barh(middles, [cost[key] for cost in costs], 0.32, color=colour, label=what)
        for bar, cost in zip(bars, costs, strict=True):
            bar.set_gid(f"{cost['feature']}, {what}: {digits(cost[key])} ms")
    legend_above(figure, axes)
    return figure


def draw_curves(curves: Sequence[Data], width: float, chance: float) -> "Drawing":
    """Draw accuracy against everything that is varied, one panel each."""
    panels: dict[str, list[Data]] = {}
    for curve in curves:
        title = f"{curve['name']}, {curve['unit']}" if curve["unit"] else curve["name"]
        panels.setdefault(title, []).append(curve)
    from matplotlib.figure import Figure as Drawing
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    n_columns = 1 if width <= NARROW else min(3, len(panels))
    n_rows = -(-len(panels) // n_columns)
    figure = Drawing(figsize=(width, 2.7 * n_rows), layout=ConstrainedLayoutEngine(h_pad=0.1))
    every = figure.subplots(n_rows, n_columns, squeeze=False).ravel()
    for axes, (title, members) in zip(every, panels.items(), strict=False):
        _panel(axes, title, members, chance)
    for axes in every[len(panels) :]:
        axes.set_axis_off()
    return figure


def _panel(axes: "Axes", title: str, curves: Sequence[Data], chance: float) -> None:
    ticks: dict[float, str] = {}
    for curve, (colour, shape) in zip(curves, LOOKS, strict=False):
        labels = _labels(curve)
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
    limit_accuracy(axes, [100 * found["low"] for curve in curves for found in curve["accuracy"]], chance)
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
