"""A comparison with peers on the page."""

from collections.abc import Iterator
from typing import Any

from texclass.reporting.page.blocks import (
    Block,
    Cell,
    Figure,
    Finding,
    Folded,
    Head,
    Heading,
    Notes,
    Row,
    Section,
    Table,
    heading,
    number,
    simple_table,
)  # fmt: skip
from texclass.reporting.page.scales import around, per_cent_scale
from texclass.reporting.page.svg import Point, Series, xy_plot
from texclass.reporting.page.wording import (
    column,
    digits,
    interval,
    p_value,
    percent,
    points,
    points_interval,
    protocol,
    sentence,
    size,
    title_of,
)  # fmt: skip

TIMES = ("feature_ms", "fit_s", "total_s", "memory_mb")


def peers_section(data: dict[str, Any]) -> Section:
    """Return the section of a comparison with peers."""
    return Section(
        f"{data['dataset']['name']}, beside other tools",
        f"Pipeline {data['pipeline']}, {protocol(data['protocol'])}: {size(data['dataset'])}",
        _finding(data),
        tuple(_blocks(data)),
    )


def _finding(data: dict[str, Any]) -> Finding:
    ours = data["contestants"][0]
    finished = [
        c for c in data["contestants"] if not c["ours"] and c["accuracy"] and c["n_folds"] == data["n_folds"]
    ]
    best = max(finished, key=lambda c: c["accuracy"]["mean"], default=None)
    if best is None or best["difference"] is None or not ours["accuracy"]:
        return Finding("none", "", "", "of the peers finished every fold.")
    low, high = best["difference"]["low"], best["difference"]["high"]
    clear = "ours is ahead" if low > 0 else "ours is behind" if high < 0 else "the two cannot be told apart"
    cost = ""
    if best["cost"] and ours["cost"] and best["cost"]["total_s"] > 0 and best["cost"]["feature_ms"] > 0:
        whole, part = (ours["cost"][key] / best["cost"][key] for key in ("total_s", "feature_ms"))
        cost = (
            f"Ours takes {digits(whole)} times its total time and {digits(part)} times its time for features."
        )
    return Finding(
        points(best["difference"]["difference"]),
        "points",
        points_interval(best["difference"]),
        f"for ours ({ours['title']}, {title_of(ours['classifier'])}: {percent(ours['accuracy']['mean'])} %) "
        f"minus the best peer ({best['title']}, {title_of(best['classifier'])}: "
        f"{percent(best['accuracy']['mean'])} %), on the same tests: {clear}. p "
        f"{p_value(best['difference']['p_value'])} by {best['difference']['test']}. Protocol: "
        f"{data['protocol_description']}.",
        beside=cost,
        brief=f"Ours minus the best peer, {best['title']} with {title_of(best['classifier'])}, on the same "
        f"tests: {clear}. {cost}",
    )


def _blocks(data: dict[str, Any]) -> Iterator[Block]:
    if any(_placed(c) for c in data["contestants"]):
        yield Heading("Accuracy against time")
        yield time_figure(data)
    yield Heading("Every tool and classifier")
    yield every_table(data)
    yield Notes(
        (
            f"Signals of the peers: {data['signals']}; scaling is fitted inside each fold.",
            f"A peer may take {digits(data['time_limit_s'])} s. Times are CPU seconds of one thread, "
            "compilation left out.",
            *map(sentence, data.get("notes", ())),
        )
    )
    settings = {(c["title"], c.get("reference", "")): None for c in data["contestants"] if not c["ours"]}
    yield Folded("Settings of the peers", simple_table("Settings", ("Tool", "Setting"), settings, n_text=2))
    versions = data["peer_versions"].items()
    yield Folded(
        "Versions of the peers", simple_table("Versions", ("Package", "Version"), versions, n_text=2)
    )


def _placed(c: dict[str, Any]) -> bool:
    return bool(c["accuracy"] and c["cost"] and c["cost"]["feature_ms"] > 0)


def time_figure(data: dict[str, Any]) -> Figure:
    """Return accuracy against milliseconds: the best classifier of each tool, numbered by accuracy."""
    best: dict[str, dict[str, Any]] = {}
    for c in filter(_placed, data["contestants"]):
        known = best.get(c["name"])
        if known is None or c["accuracy"]["mean"] > known["accuracy"]["mean"]:
            best[c["name"]] = c
    ranked = sorted(best.values(), key=lambda c: -c["accuracy"]["mean"])
    series, texts = [], []
    for rank, c in enumerate(ranked, start=1):
        a, ms = c["accuracy"], c["cost"]["feature_ms"]
        name = f"{_title(c)}, {title_of(c['classifier'])}"
        says = f"{rank}. {name}: {percent(a['mean'])} % {interval(a)}, {digits(ms)} ms"
        point = Point(ms, 100 * a["mean"], says, 100 * a["low"], 100 * a["high"], mark=str(rank))
        series.append(Series("ours" if c["ours"] else "paper", (point,), line=False))
        texts.append((f"{rank}. {name}", f"{percent(a['mean'])} {interval(a)}", digits(ms)))
    at = next((i for i, c in enumerate(ranked, start=1) if c["ours"]), None)
    fastest = min(ranked, key=lambda c: c["cost"]["feature_ms"])
    ours = "" if at is None else f"; the first of ours is number {at} of {len(ranked)}"
    return Figure(
        "Accuracy against the time of features; up and left is better",
        f"The most accurate is {_title(ranked[0])}, the fastest {_title(fastest)}{ours}. With 95 % "
        "intervals; the best classifier of each tool, numbered by accuracy.",
        xy_plot(
            series, around([c["cost"]["feature_ms"] for c in ranked], log=True),
            per_cent_scale(100 * c["accuracy"]["low"] for c in ranked),
            "CPU ms of features, one recording (log scale)", height=320,
        ),
        simple_table("The best classifier of each tool", ("Tool", "% [95 %]", "ms"), texts),
        tuple((s.look, "disc", f"{name}: {a.split()[0]} %, {ms} ms")
              for s, (name, a, ms) in zip(series, texts, strict=True)),
        axis="accuracy, %",
    )  # fmt: skip


def _title(c: dict[str, Any]) -> str:
    return f"ours: {c['title']}" if c["ours"] else str(c["title"])


def every_table(data: dict[str, Any]) -> Table:
    """Return all lines of the comparison; where nothing ran it says why."""
    titles = (
        "Tool", "Classifier", "Columns", "% [95 %]", "Ours ahead by, points [95 %]", "p", "Features, ms",
        "Fit, s", "Total, s", "MB",
    )  # fmt: skip
    heads = tuple(Head(title, is_number=i > 1) for i, title in enumerate(titles))
    known = [c["cost"] if c["accuracy"] else None for c in data["contestants"]]
    times = zip(*(column(cost and cost[key] for cost in known) for key in TIMES), strict=True)
    rows = tuple(_row(c, data["n_folds"], ms) for c, ms in zip(data["contestants"], times, strict=True))
    caption = (
        "Ours and peers on the same folds. Features: one recording; Fit: all that learns, one fold; Total: "
        "one fold from signals to answers; MB: growth of the process. p is not corrected for the number of "
        "lines."
    )
    return Table(caption, (heads,), rows)


def _row(c: dict[str, Any], n_folds: int, times: tuple[str, ...]) -> Row:
    a, cost, d = c["accuracy"], c["cost"], c["difference"]
    if a is None or cost is None:
        why = f"{c['status']}: {c['message']}" if c["message"] else c["status"]
        return Row((heading(_title(c)), Cell(why, span=9)), faint=True)
    part = f" ({c['n_folds']} of {n_folds} folds)" if c["n_folds"] != n_folds else ""
    ahead = (number("reference"), number(""))
    if d is not None:
        ahead = (number(points(d["difference"]), points_interval(d)), number(p_value(d["p_value"])))
    return Row(
        (
            heading(_title(c)), Cell(title_of(c["classifier"]) + part), number(str(c["n_columns"])),
            number(percent(a["mean"]), interval(a)), *ahead,
            *map(number, times),
        ),
        strong=c["ours"],
    )  # fmt: skip
