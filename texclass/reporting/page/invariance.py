"""The study of scan-time invariance on the page."""

from statistics import median
from typing import Any

from texclass.reporting.page.blocks import (
    Block,
    Figure,
    Finding,
    Heading,
    Notes,
    Section,
    Table,
    simple_table,
)
from texclass.reporting.page.scales import around
from texclass.reporting.page.svg import Spot, row_plot
from texclass.reporting.page.wording import digits

LOOKS = ("ours", "paper", "third", "fourth")
SHAPES = ("disc", "square", "triangle", "diamond")
Rows = list[dict[str, Any]]


def invariance_section(data: dict[str, Any]) -> Section:
    """Return the section of the study."""
    rows: Rows = data["rows"]
    known = [row for row in rows if row["ratio"] is not None and row["ratio"] > 0]
    origins = _origins(rows)
    first = [row["ratio"] for row in known if _origin(row) == origins[0]]
    others = "; ".join(
        f"{origin}: {digits(median(ratios))}"
        for origin in origins[1:]
        if (ratios := [row["ratio"] for row in known if _origin(row) == origin])
    )
    finding = Finding(
        digits(median(first)) if first else "none",
        "times" if first else "",
        "",
        "as far apart are surfaces as one surface under other speeds, forces and impacts: the median over "
        f"the features of {origins[0]} and conditions (above 1, surfaces differ more than conditions change "
        "the value).",
        beside=f"The same median for {others}." if others else "",
        brief="Median ratio of the deviation between surfaces to that within one"
        f" ({origins[0]}){f'; {others}' if others else ''}.",
    )
    blocks: tuple[Block, ...] = (
        Heading("Every feature under every condition"),
        *((ratio_figure(rows, origins),) if known else ()),
        median_table(known, origins),
        Notes(
            (
                "Ratio: deviation between the surfaces' means over the deviation within a surface along its "
                "run.",
                "Trend: mean |Spearman| with the condition (0: none, 1: follows it).",
            )
        ),
    )
    return Section(
        "Invariance to speed, force and impact",
        f"{len({(r.get('set'), r['feature']) for r in rows})} features under {', '.join(_conditions(rows))}",
        finding,
        blocks,
    )


def ratio_figure(rows: Rows, origins: list[str]) -> Figure:
    """Return the ratio of every feature, the best at the top: a mark a condition, a colour an origin."""
    look = dict(zip(origins, LOOKS * len(origins), strict=False))
    conditions = _conditions(rows)
    shape = dict(zip(conditions, SHAPES * len(conditions), strict=False))
    grouped: dict[tuple[str, str, str], Rows] = {}
    for row in rows:
        if row["ratio"] is not None and row["ratio"] > 0:
            grouped.setdefault((_origin(row), row.get("set", ""), row["feature"]), []).append(row)
    order = sorted(grouped.items(), key=lambda item: -min(row["ratio"] for row in item[1]))
    drawn = []
    for (origin, of_set, feature), members in order:
        name = f"{feature} ({of_set})" if of_set else feature
        says = [f"{name}, {r['condition']}: {digits(r['ratio'])}" for r in members]
        spots = [
            Spot(r["ratio"], look[origin], text, shape=shape[r["condition"]])
            for r, text in zip(members, says, strict=True)
        ]
        drawn.append((name, spots))
    texts = [
        (r["feature"], r.get("set", ""), _origin(r), r["condition"], digits(r["ratio"]) or "undefined",
         digits(r.get("trend")))
        for r in rows
    ]  # fmt: skip
    ratios = [row["ratio"] for row in rows if row["ratio"]]
    legend = [(look[o], "disc", o) for o in origins] + [("ink", shape[c], c) for c in conditions]
    return Figure(
        "Between-surface over within-surface deviation; right is better",
        f"By its worst condition the best feature is {drawn[0][0]}, the last {drawn[-1][0]}.",
        row_plot(drawn, around([*ratios, 1.0], log=True), "ratio (log scale)", zero=1.0),
        simple_table(
            "Ratio and trend", ("Feature", "Set", "From", "Condition", "Ratio", "Trend"), texts, n_text=4
        ),
        tuple(legend),
        gutter=True,
    )


def median_table(known: Rows, origins: list[str]) -> Table:
    """Return the median ratio by origin and condition."""
    conditions = _conditions(known)
    rows = []
    for origin in origins:
        cells = [
            [r["ratio"] for r in known if (_origin(r), r["condition"]) == (origin, c)] for c in conditions
        ]
        rows.append((origin, *(digits(median(values)) if values else "" for values in cells)))
    return simple_table("Median ratio of the features", ("From", *conditions), rows, hidden=False)


def _origin(row: dict[str, Any]) -> str:
    return str(row.get("origin") or row.get("set") or "features")


def _origins(rows: Rows) -> list[str]:
    """Return the origins, ours first."""
    return sorted({_origin(row) for row in rows}, key=lambda name: (name != "texclass", name))


def _conditions(rows: Rows) -> list[str]:
    return list(dict.fromkeys(row["condition"] for row in rows))
