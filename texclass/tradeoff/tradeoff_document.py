"""Create the report of a trade-off: accuracy against latency, signal length, training set, rate and bits."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from texclass.evaluation.result_facts import (
    chance_level,
    classifier_title,
    cluster_phrase,
    dataset_facts,
    dataset_size,
    reproduction_facts,
)
from texclass.reporting import Details, Document, Figure, Finding, Heading, Table
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
    """Return the report of a trade-off.

    Parameters
    ----------
    data : mapping
        Result of `Tradeoff.to_dict`, or its JSON.
    """
    window_s = data["dataset"].get("max_seconds")
    window = f", {window_s:g} s of each" if window_s else ""
    knee, full, half, total = data["knee"], data["full"], data["at_half_cost"], data["total_ms"]
    difference = f"{points(knee['accuracy']['mean'] - full['mean'])} points relative to the full set"
    finding = Finding(
        percent(knee["accuracy"]["mean"]),
        "%",
        interval(knee["accuracy"]),
        "of recordings classified correctly at the knee point (selected on the test folds, "
        "optimistic), with a "
        f"latency budget of {digits(knee['budget_ms'])} ms ({100 * knee['budget_ms'] / total:.0f} % of the "
        f"{digits(total)} ms of the full set). Protocol: {data['protocol']}; features are selected "
        "inside each "
        f"training set; 95 % confidence interval{cluster_phrase(data)}; "
        f"chance level {percent(chance_level(data))} %.",
        f"{difference} ({estimate(full)} %). At half the cost of its features: "
        f"{points(half['accuracy']['mean'] - full['mean'])} points, and "
        f"{points(half['plain']['mean'] - full['mean'])} points with sequential selection that ignores costs "
        "and stops at the budget.",
        f"At the knee point, {digits(knee['budget_ms'])} ms per recording; {difference} "
        f"({digits(total)} ms).",
    )
    return Document(
        f"{data['dataset']['name']}, accuracy against latency",
        list(_blocks(data)),
        f"Features {data['features']}: {dataset_size(data['dataset'])}{window}",
        finding,
        dataset_facts(data),
        reproduction_facts(data, data["features"]),
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
        f"{percent(chance_level(data))} %.",
        lambda width: draw_front(data, width),
    )
    yield list(_notes(data))
    if data.get("smallest_subsets"):
        scene = ", ".join(data["dataset"].get("surfaces") or ()) or "this scene"
        rows = [(str(n), estimate(accuracy)) for n, accuracy in data["smallest_subsets"]]
        yield Heading("Smallest subsets of columns for these surfaces")
        caption = f"Accuracy for {scene} with the best columns, selected inside each training set."
        yield Table(pd.DataFrame(rows, columns=["Columns", "% [95 %]"]), caption)
    if data.get("curves"):
        yield Heading("Accuracy against other costs")
        yield _curves(data["curves"], 100 * chance_level(data))
    yield Heading("Cost of each feature")
    yield _costs(data)
    parts = sorted(data["parts"].items(), key=lambda part: -part[1])
    yield Details(
        "Shared transforms", [Table(pd.DataFrame(parts, columns=["Transform", "ms per recording"]))]
    )
    times = [(classifier_title(c["name"]), c["fit_ms"], c["predict_ms"]) for c in data["classifiers"]]
    titles = ["Classifier", "fit on all recordings, ms", "predict one recording, ms"]
    yield Details("Classifiers", [Table(pd.DataFrame(times, columns=titles), "Times with all columns.")])


def _at(point: Data) -> str:
    return f"{percent(point['accuracy']['mean'])} % at {digits(point['budget_ms'])} ms"


def _front(data: Data) -> Table:
    """Return a table with accuracy and number of columns for each budget and for the full set."""
    front = data["front"]
    keys = {"knee point": "knee", "half the cost": "at_half_cost"}
    marks = [", ".join(name for name, key in keys.items() if point == data[key]) for point in front]
    rows = [
        (digits(p["budget_ms"]), digits(p["ms"]), digits(p["n_features"]), digits(p["n_columns"]),
         estimate(p["accuracy"]), estimate(p["plain"]), mark)
        for p, mark in zip(front, marks, strict=True)
    ]  # fmt: skip
    n_features = len({cost["feature"] for cost in data["costs"]})
    rows.append(
        ("full set", digits(data["total_ms"]), str(n_features), "", estimate(data["full"]), "", "full set")
    )
    titles = [
        "Budget, ms", "Used, ms", "Features", "Columns", "Accuracy, % [95 %]", "Plain, % [95 %]", "Mark",
    ]  # fmt: skip
    return Table(
        pd.DataFrame(rows, columns=titles),
        "Features and columns: mean over folds; ms: latency per recording, one thread, this machine, "
        "including "
        "conditioning; Plain: sequential selection that ignores costs. 95 % confidence intervals"
        f"{cluster_phrase(data)}; chance level {percent(chance_level(data))} %.",
        bold_rows=[i for i, mark in enumerate(marks) if mark.startswith("knee")],
    )


def _notes(data: Data) -> Iterator[str]:
    selection = data["selection"]
    file = f"; saved as {selection['file']}" if selection.get("file") else ""
    n_columns = counted(len(selection["columns"]), "column")
    yield (
        f"Selected pipeline ({selection['reason']}): {n_columns} of "
        f"{', '.join(selection['features'])}; latency {digits(selection['predicted_ms'])} ms by the "
        "cost model, "
        f"{digits(selection['measured_ms'])} ms measured without the other features; "
        f"{estimate(selection['accuracy'])} %{file}."
    )
    share = "included in each latency" if data.get("whole_path") else "not included in the latencies"
    yield f"Segmentation takes {digits(data['segmentation_ms'])} ms for every selection, {share}."
    if machine := data.get("costs_of"):
        yield f"Latency was measured once on {machine} and cached."
    if note := data.get("knee_note"):
        yield sentence(f"Knee point: {note}")
    if pairs := data.get("model_check"):
        worst = max(abs(predicted / measured - 1) for predicted, measured in pairs)
        yield (
            f"The cost model deviates from the measured cost of {counted(len(pairs), 'random subset')} by at "
            f"most {100 * worst:.0f} %."
        )
    yield from map(sentence, [*data.get("notes", ()), *data["dataset"].get("notes", ())])


def _curves(curves: Sequence[Data], chance: float) -> Figure:
    """Return a figure of accuracy against other costs, with one panel per cost, and its table."""
    rows = [
        (curve["name"], curve["series"], label, estimate(accuracy))
        for curve in curves
        for label, accuracy in zip(_labels(curve), curve["accuracy"], strict=True)
    ]
    summaries = [
        f"{curve['name']} ({curve['series']}): {percent(curve['accuracy'][0]['mean'])} % at "
        f"{_labels(curve)[0]}, {percent(curve['accuracy'][-1]['mean'])} % at {_labels(curve)[-1]}"
        for curve in curves
    ]
    notes = dict.fromkeys(sentence(curve["note"]) for curve in curves if curve.get("note"))
    return Figure(
        "curves",
        f"Accuracy in %, with 95 % confidence intervals; chance level {chance:.1f} %",
        " ".join([f"{'; '.join(summaries)}.", *notes]),
        lambda width: draw_curves(curves, width, chance),
        Table(pd.DataFrame(rows, columns=["Varied", "Curve", "Value", "% [95 %]"]), n_words=3),
    )


def _labels(curve: Data) -> list[str]:
    return curve.get("labels") or [f"{x:g}" for x in curve["x"]]


def _costs(data: Data) -> Figure:
    """Return a figure of feature costs: share of the full set, cost alone, and time saved without it."""
    costs = sorted(data["costs"], key=lambda cost: -cost["share"])
    frame = pd.DataFrame({"Feature": [cost["feature"] for cost in costs]})
    for title, key in {
        "Share of the full set": "share",
        "Alone": "alone",
        "Saving without it": "last",
    }.items():
        frame[title] = aligned(cost[key] for cost in costs)
    return Figure(
        "costs",
        "Cost of features, one recording",
        f"The full set takes {digits(data['total_ms'])} ms. The most expensive of its {len(costs)} "
        "features is "
        f"{costs[0]['feature']}, with a share of {digits(costs[0]['share'])} ms.",
        lambda width: draw_costs(costs, set(data["selection"]["features"]), width),
        Table(
            frame,
            "ms per recording. In the share, the cost of a shared transform is split equally between "
            "the features "
            "that use it.",
        ),
    )


def draw_front(data: Data, width: float) -> "Drawing":
    """Draw accuracy against latency: cost-aware and plain selection, the full set and the knee point."""
    figure, axes = new_figure(width, 3.4)
    plot_front(data, axes)
    legend_above(figure, axes)
    return figure


def plot_front(data: Data, axes: "Axes") -> None:
    """Plot accuracy against latency: cost-aware and plain selection, the full set and the knee point."""
    front, knee, full = data["front"], data["knee"], data["full"]
    ms = [point["budget_ms"] for point in front]
    for key, colour, shape, label in (
        ("plain", OTHER, "s", "plain sequential selection"),
        ("accuracy", OURS, "o", "cost-aware selection, 95 % interval"),
    ):
        accuracies = [point[key] for point in front]
        tooltips = [
            f"{label.split(',')[0]}, {digits(x)} ms: {estimate(a)} %"
            for x, a in zip(ms, accuracies, strict=True)
        ]
        _line(axes, ms, accuracies, colour, shape, label, tooltips, band=key == "accuracy")
    axes.axhline(100 * full["mean"], color=MUTED, linewidth=1, linestyle=":", label="full set")
    position = (knee["budget_ms"], 100 * knee["accuracy"]["mean"])
    label = f"knee point: {percent(knee['accuracy']['mean'])} %, {digits(knee['budget_ms'])} ms"
    axes.plot(*position, "o", markersize=13, fillstyle="none", color=INK, label=label, clip_on=False)
    stages = "samples to features" if data.get("whole_path") else "features"
    axes.set(xlabel=f"latency ({stages}) per recording, ms", ylabel="accuracy, %")
    axes.set_xlim(0, 1.04 * max(data["total_ms"], ms[-1]))
    lows = [100 * point[key][end] for point in front for key, end in (("accuracy", "low"), ("plain", "mean"))]
    limit_accuracy(axes, lows, 100 * chance_level(data))


def limit_accuracy(axes: "Axes", lows: Sequence[float], chance: float) -> None:
    """Set the limits of the accuracy axis to include the smallest value, and draw the chance level."""
    low, high = per_cent_limits(lows)
    chance_line(axes.axhline, chance, low)
    axes.set_ylim(low, high)


def draw_costs(costs: Sequence[Data], selected: Collection[str], width: float) -> "Drawing":
    """Draw two bars for each feature: its share of the full set and its cost alone, each with a tooltip."""
    names = [f"{'● ' if cost['feature'] in selected else ''}{cost['feature']}" for cost in costs]
    figure, axes = row_axes(width, names, "ms (● selected at the budget)")
    for key, colour, offset, label in (
        ("share", OURS, -0.18, "share of the full set"),
        ("alone", FAINT, 0.18, "alone"),
    ):
        middles = [y + offset for y in range(len(costs))]
        bars = axes.barh(middles, [cost[key] for cost in costs], 0.32, color=colour, label=label)
        for bar, cost in zip(bars, costs, strict=True):
            bar.set_gid(f"{cost['feature']}, {label}: {digits(cost[key])} ms")
    legend_above(figure, axes)
    return figure


def draw_curves(curves: Sequence[Data], width: float, chance: float) -> "Drawing":
    """Draw accuracy against other costs, with one panel per cost."""
    panels: dict[str, list[Data]] = {}
    for curve in curves:
        title = f"{curve['name']}, {curve['unit']}" if curve["unit"] else curve["name"]
        panels.setdefault(title, []).append(curve)
    from matplotlib.figure import Figure as Drawing
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    n_columns = 1 if width <= NARROW else min(3, len(panels))
    n_rows = -(-len(panels) // n_columns)
    figure = Drawing(figsize=(width, 2.7 * n_rows), layout=ConstrainedLayoutEngine(h_pad=0.1))
    grid = figure.subplots(n_rows, n_columns, squeeze=False).ravel()
    for axes, (title, members) in zip(grid, panels.items(), strict=False):
        _panel(axes, title, members, chance)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    return figure


def _panel(axes: "Axes", title: str, curves: Sequence[Data], chance: float) -> None:
    ticks: dict[float, str] = {}
    for curve, (colour, shape) in zip(curves, LOOKS, strict=False):
        labels = _labels(curve)
        tooltips = [
            f"{curve['series']}, {label}: {estimate(accuracy)} %"
            for label, accuracy in zip(labels, curve["accuracy"], strict=True)
        ]
        _line(axes, curve["x"], curve["accuracy"], colour, shape, curve["series"], tooltips)
        ticks |= dict(zip(curve["x"], labels, strict=True))
    if min(ticks) > 0 and max(ticks) / min(ticks) >= LOG_FROM:
        axes.set_xscale("log")
    axes.set_xticks(list(ticks), list(ticks.values()), fontsize=8)
    axes.minorticks_off()
    lows = [100 * accuracy["low"] for curve in curves for accuracy in curve["accuracy"]]
    limit_accuracy(axes, lows, chance)
    axes.set_title(title[0].upper() + title[1:])
    axes.legend(loc="lower right", fontsize=8)


def _line(
    axes: "Axes",
    x: Sequence[float],
    accuracies: Sequence[Data],
    colour: str,
    shape: str,
    label: str,
    tooltips: Sequence[str],
    *,
    band: bool = True,
) -> None:
    """Draw accuracies as a line and their confidence intervals as a band, with a tooltip for each point."""
    mean, low, high = (100 * np.array([a[key] for a in accuracies]) for key in ("mean", "low", "high"))
    if band:
        axes.fill_between(x, low, high, color=colour, alpha=0.12, linewidth=0)
    axes.plot(x, mean, "-" if band else "--", marker=shape, markersize=5, color=colour, label=label)
    for position, value, tooltip in zip(x, mean, tooltips, strict=True):
        axes.plot(position, value, shape, markersize=5, color=colour, gid=tooltip)
