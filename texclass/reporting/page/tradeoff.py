"""A trade-off study on the page: the front and its knee, the curves, and what each feature costs."""

from collections.abc import Iterator
from typing import Any

from texclass.reporting.page.blocks import (
    Block,
    Figure,
    Finding,
    Folded,
    Head,
    Heading,
    Notes,
    Panels,
    Row,
    Section,
    Table,
    heading,
    number,
    simple_table,
)  # fmt: skip
from texclass.reporting.page.scales import Scale, around, per_cent_scale
from texclass.reporting.page.svg import Point, Series, Spot, row_plot, xy_plot
from texclass.reporting.page.wording import digits, interval, percent, points, sentence, size, title_of

LOOKS = (("ours", "disc"), ("paper", "square"), ("third", "diamond"), ("fourth", "triangle"))
LOG_FROM = 8
"""Ratio of the largest to the smallest value from which an axis is logarithmic."""
PANEL_HEIGHT = 190


def tradeoff_section(data: dict[str, Any]) -> Section:
    """Return the section of a trade-off study."""
    knee, full, total = data["knee"], data["full"], data["total_ms"]
    half = data["at_half_cost"]
    felt = data["dataset"].get("max_seconds")
    return Section(
        f"{data['dataset']['name']}, speed against accuracy",
        f"Features {data['features']}: {size(data['dataset'])}{f', {felt:g} s of each' if felt else ''}",
        Finding(
            percent(knee["accuracy"]["mean"]),
            "%",
            interval(knee["accuracy"]),
            f"of recordings recognised at the knee, for a budget of {digits(knee['budget_ms'])} ms per "
            f"recording ({100 * knee['budget_ms'] / total:.0f} % of the {digits(total)} ms of the full set). "
            f"Protocol: {data['protocol']}; features are chosen inside each training part; 95 % interval.",
            brief=f"At the knee, for {digits(knee['budget_ms'])} ms per recording; "
            f"{points(knee['accuracy']['mean'] - full['mean'])} points against the full set, {digits(total)} "
            "ms.",
            beside=f"{points(knee['accuracy']['mean'] - full['mean'])} points against the full set "
            f"({percent(full['mean'])} % {interval(full)}); at half its cost "
            f"{points(half['accuracy']['mean'] - full['mean'])} points.",
        ),
        tuple(_blocks(data)),
    )


def _blocks(data: dict[str, Any]) -> Iterator[Block]:
    yield Heading("What a millisecond buys")
    yield front_figure(data)
    yield Notes(tuple(_notes(data)))
    if data.get("fewest"):
        yield Heading("The fewest columns for this scene")
        yield fewest_table(data)
    if data.get("curves"):
        yield Heading("Accuracy against what else costs")
        yield Panels(tuple(curve_figures(data["curves"])))
    yield Heading("What each feature costs")
    yield cost_figure(data)
    parts = sorted(data["parts"].items(), key=lambda part: -part[1])
    rows = ((name, digits(ms)) for name, ms in parts)
    yield Folded(
        "Shared transforms", simple_table("Shared transforms, ms per recording", ("Transform", "ms"), rows)
    )
    times = ((title_of(c["name"]), digits(c["fit_ms"]), digits(c["predict_ms"])) for c in data["classifiers"])
    titles = ("Classifier", "fit, all recordings, ms", "predict, one recording, ms")
    yield Folded("Classifiers", simple_table("Cost of classifiers on all columns", titles, times))


def front_figure(data: dict[str, Any]) -> Figure:
    """Return accuracy against budget: cost-aware choice, plain selection, full set and knee."""
    front, knee = data["front"], data["knee"]
    series = []
    for key, look, shape, what in (
        ("plain", "paper", "square", "plain selection"),
        ("accuracy", "ours", "disc", "cost-aware choice"),
    ):
        said = tuple(
            _estimate_point(p["budget_ms"], p[key], f"{what}, {digits(p['budget_ms'])} ms") for p in front
        )
        series.append(Series(look, said, shape, band=key == "accuracy"))
    lows = [100 * p[key][end] for p in front for key, end in (("accuracy", "low"), ("plain", "mean"))]
    at = (knee["budget_ms"], 100 * knee["accuracy"]["mean"])
    return Figure(
        "Accuracy against the cost of features",
        f"From {percent(front[0]['accuracy']['mean'])} % for {digits(front[0]['budget_ms'])} ms to "
        f"{percent(front[-1]['accuracy']['mean'])} % for {digits(front[-1]['budget_ms'])} ms; knee: "
        f"{percent(knee['accuracy']['mean'])} % for {digits(knee['budget_ms'])} ms.",
        xy_plot(
            series,
            Scale(0.0, 1.04 * max(data["total_ms"], front[-1]["budget_ms"])),
            per_cent_scale(lows),
            "features of one recording, ms",
            level=(100 * data["full"]["mean"], f"full set, {percent(data['full']['mean'])} %"),
            note=(*at, f"knee: {percent(knee['accuracy']['mean'])} %, {digits(knee['budget_ms'])} ms"),
        ),
        _front_table(data),
        (
            ("ours", "disc", "cost-aware choice, 95 % interval"),
            ("paper", "square", "plain sequential selection"),
        ),
        axis="accuracy, %",
    )


def _front_table(data: dict[str, Any]) -> Table:
    titles = (
        "Budget, ms",
        "Used, ms",
        "Features",
        "Columns",
        "Accuracy, % [95 %]",
        "Plain, % [95 %]",
        "Mark",
    )
    rows = []
    for p in data["front"]:
        marks = [
            name for name, key in (("knee", "knee"), ("half the cost", "at_half_cost")) if p == data[key]
        ]
        cells = (
            heading(digits(p["budget_ms"])), number(digits(p["ms"])), number(digits(p["n_features"])),
            number(digits(p["n_columns"])), number(percent(p["accuracy"]["mean"]), interval(p["accuracy"])),
            number(percent(p["plain"]["mean"]), interval(p["plain"])), number(", ".join(marks)),
        )  # fmt: skip
        rows.append(Row(cells, strong="knee" in marks))
    return Table("The front", (tuple(map(Head, titles)),), tuple(rows), caption_hidden=True)


def _notes(data: dict[str, Any]) -> Iterator[str]:
    chosen = data["chosen"]
    saved = f"; saved as {chosen['file']}" if chosen.get("file") else ""
    yield (
        f"Chosen pipeline ({chosen['why']}): {len(chosen['columns'])} columns of "
        f"{', '.join(chosen['features'])}; {digits(chosen['predicted_ms'])} ms by the cost model, "
        f"{digits(chosen['measured_ms'])} ms measured when pruned; {percent(chosen['accuracy']['mean'])} % "
        f"{interval(chosen['accuracy'])}{saved}."
    )
    yield f"Finding the phases takes {digits(data['segmentation_ms'])} ms more, whatever is chosen."
    if rule := data.get("knee_rule"):
        yield sentence(f"Knee: {rule}")
    yield from map(sentence, data.get("notes", ()))


def fewest_table(data: dict[str, Any]) -> Table:
    """Return the accuracy of the best so many columns for the materials of a scene."""
    scene = ", ".join(data["dataset"].get("materials") or ())
    rows = ((str(n), f"{percent(a['mean'])} {interval(a)}") for n, a in data["fewest"])
    caption = f"Accuracy of the best columns, chosen inside each training part, for {scene or 'this scene'}"
    return simple_table(caption, ("Columns", "% [95 %]"), rows, hidden=False)


def curve_figures(curves: list[dict[str, Any]]) -> Iterator[Figure]:
    """Yield one small figure for each thing that is varied."""
    panels: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for curve in curves:
        panels.setdefault((curve["name"], curve["unit"]), []).append(curve)
    for (name, unit), members in panels.items():
        yield _panel(f"{name}, {unit}" if unit else name, members)


def _panel(title: str, curves: list[dict[str, Any]]) -> Figure:
    places = {x: label for c in curves for x, label in zip(c["x"], _labels(c), strict=True)}
    scale = around(places, log=min(places) > 0 and max(places) / min(places) >= LOG_FROM)
    series, texts, said = [], [], []
    for (look, shape), curve in zip(LOOKS * len(curves), curves, strict=False):
        three = list(zip(curve["x"], _labels(curve), curve["accuracy"], strict=True))
        made = tuple(_estimate_point(x, a, f"{curve['series']}, {label}") for x, label, a in three)
        series.append(Series(look, made, shape))
        texts += [(curve["series"], label, f"{percent(a['mean'])} {interval(a)}") for _, label, a in three]
        (_, first, low), (_, last, high) = three[0], three[-1]
        said.append(
            f"{curve['series']}: {percent(low['mean'])} % at {first}, {percent(high['mean'])} % at {last}"
        )
    notes = [sentence(c["note"]) for c in curves if c.get("note")]
    lows = [100 * a["low"] for c in curves for a in c["accuracy"]]
    legend = [(*look, c["series"]) for look, c in zip(LOOKS * len(curves), curves, strict=False)]
    return Figure(
        title[0].upper() + title[1:],
        " ".join([f"{'; '.join(said)}.", *dict.fromkeys(notes)]),
        xy_plot(
            series, scale, per_cent_scale(lows), title, height=PANEL_HEIGHT, labels=_thinned(places, scale)
        ),
        simple_table(f"Accuracy against {title}", ("Curve", title, "% [95 %]"), texts, n_text=1),
        tuple(legend),
        axis="accuracy, %",
    )


def _labels(curve: dict[str, Any]) -> list[str]:
    return curve.get("labels") or [f"{x:g}" for x in curve["x"]]


def _thinned(places: dict[float, str], scale: Scale) -> list[tuple[float, str]]:
    """Return the labels that have room, from the right: the last is the one to compare with."""
    kept: list[tuple[float, str]] = []
    for x in sorted(places, reverse=True):
        if not kept or scale(kept[-1][0]) - scale(x) > 0.025 * (len(places[x]) + len(kept[-1][1])):
            kept.append((x, places[x]))
    return kept[::-1]


def _estimate_point(x: float, found: dict[str, Any], what: str) -> Point:
    says = f"{what}: {percent(found['mean'])} % {interval(found)}"
    return Point(x, 100 * found["mean"], says, 100 * found["low"], 100 * found["high"])


def cost_figure(data: dict[str, Any]) -> Figure:
    """Return a bar for each feature: alone, and its share of the full set."""
    rows, texts = [], []
    for c in sorted(data["costs"], key=lambda c: -c["share"]):
        name = c["feature"]
        spots = [
            Spot(c["alone"], "faint", f"{name}: {digits(c['alone'])} ms alone"),
            Spot(c["share"], "ours", f"{name}: {digits(c['share'])} ms as its share of the full set"),
        ]
        rows.append((name, spots))
        texts.append((name, digits(c["share"]), digits(c["alone"]), digits(c["last"])))
    first, dearest = texts[0], max(max(c["alone"], c["share"]) for c in data["costs"])
    return Figure(
        "Cost of features, one recording",
        f"The full set takes {digits(data['total_ms'])} ms; the dearest of {len(texts)} features is "
        f"{first[0]} with a share of {first[1]} ms.",
        row_plot(rows, Scale(0.0, 1.05 * max(dearest, 1e-9)), "ms", bars=True),
        simple_table(
            "Costs, ms per recording",
            ("Feature", "Share of the full set", "Alone", "Saved when left out"), texts,
        ),
        (("ours", "bar", "share of the full set"), ("faint", "bar", "alone")),
        gutter=True,
    )  # fmt: skip
