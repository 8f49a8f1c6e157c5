"""Create the report of the invariance study: how features depend on speed, force and impact."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import pandas as pd

from texclass.reporting import Document, Figure, Finding, Heading, Table
from texclass.reporting.blocks import Block
from texclass.reporting.figure_style import LOOKS, MUTED, legend_above, log_x, row_axes
from texclass.reporting.result_files import Result
from texclass.reporting.wording import digits

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


class InvarianceStudy(Result, kind="invariance"):
    """Result of `benchmarks/invariance_study.py`: how features depend on speed, force and impact."""

    def document(self) -> Document:
        """Return the study as a document."""
        return invariance_document(self.data)


def invariance_document(data: Mapping[str, Any]) -> Document:
    """Return the study as a document.

    Parameters
    ----------
    data : mapping
        JSON of the study: `rows` with feature, set, origin, condition, ratio (standard deviation between
        surfaces divided by that within a surface; None if undefined) and trend.
    """
    rows = pd.DataFrame(
        list(data["rows"]), columns=["feature", "set", "origin", "condition", "ratio", "trend"]
    )
    rows["set"] = rows["set"].fillna("")
    rows["origin"] = rows["origin"].fillna(rows["set"]).replace("", "features")
    rows = rows.astype({"ratio": float, "trend": float})
    defined = rows[rows["ratio"] > 0]
    medians = defined.groupby("origin")["ratio"].median()
    ours, *others = sorted(set(rows["origin"]), key=lambda origin: (origin != "texclass", origin))
    other_medians = "; ".join(
        f"{origin}: {digits(medians[origin])}" for origin in others if origin in medians
    )
    value = digits(medians[ours]) if ours in medians else "none"
    conditions = ", ".join(dict.fromkeys(rows["condition"]))
    blocks: list[Block] = [Heading("Every feature under every condition")]
    if len(defined):
        table = defined.pivot_table("ratio", "origin", "condition", "median", sort=False).reindex(
            [ours, *others]
        )
        table.columns = table.columns.astype(str)
        blocks.append(_ratios(rows, defined, [ours, *others]))
        blocks.append(Table(table.rename_axis("From").reset_index(), "Median ratio of the features."))
    blocks.append(
        [
            "Ratio: standard deviation between the means of surfaces, divided by the standard "
            "deviation of one "
            "surface over the condition.",
            "Trend: mean absolute Spearman correlation with the condition (0: independent of the "
            "condition, 1: "
            "monotonic function of it).",
        ]
    )
    return Document(
        "Invariance to speed, force and impact",
        blocks,
        f"{len(rows[['set', 'feature']].drop_duplicates())} features under {conditions}",
        Finding(
            value,
            "times" if value != "none" else "",
            "",
            "as much variation between surfaces as within one surface over speeds, forces and "
            "impacts: median over "
            f"the conditions and the features of {ours} (above 1, a feature depends more on the "
            "surface than on "
            "the condition).",
            f"Medians for other libraries: {other_medians}." if other_medians else "",
            "Median ratio of the standard deviation between surfaces to the one within a surface "
            f"({'; '.join(filter(None, (ours, other_medians)))}).",
        ),
        reproduction={"Seed": str(data.get("seed", ""))},
        versions=data.get("versions", {}),
    )


def _ratios(rows: pd.DataFrame, defined: pd.DataFrame, origins: Sequence[str]) -> Figure:
    """Return a figure of the ratios of all features, sorted by the ratio of each in its worst condition."""
    worst = defined.groupby(["origin", "set", "feature"], sort=False)["ratio"].min()
    order = list(worst.sort_values(ascending=False, kind="stable").index)
    table = rows[["feature", "set", "origin", "condition"]].assign(
        ratio=[digits(ratio) or "undefined" for ratio in rows["ratio"]],
        trend=list(map(digits, rows["trend"])),
    )
    return Figure(
        "ratios",
        "Standard deviation between surfaces over the one within a surface (higher is better)",
        f"In its worst condition, the best feature is {_name(*order[0])}, and the worst is "
        f"{_name(*order[-1])}.",
        lambda width: _draw(defined, order, origins, width),
        Table(table.rename(columns=str.capitalize), n_words=4),
    )


def _draw(defined: pd.DataFrame, order: list[Any], origins: Sequence[str], width: float) -> "Drawing":
    """Draw the ratios with one marker per condition and one colour per origin."""
    figure, axes = row_axes(width, [_name(*key) for key in order], "ratio (log scale)")
    colours = {origin: LOOKS[i % len(LOOKS)][0] for i, origin in enumerate(origins)}
    shapes = {name: LOOKS[i % len(LOOKS)][1] for i, name in enumerate(dict.fromkeys(defined["condition"]))}
    at = {key: y for y, key in enumerate(order)}
    for row in defined.to_dict("records"):
        key = row["origin"], row["set"], row["feature"]
        label = f"{_name(*key)}, {row['condition']}: {digits(row['ratio'])}"
        shape = shapes[row["condition"]]
        axes.plot(row["ratio"], at[key], shape, markersize=5, color=colours[row["origin"]], gid=label)
    for origin, colour in colours.items():
        axes.plot([], [], "o", color=colour, label=origin)
    for condition, shape in shapes.items():
        axes.plot([], [], shape, color=MUTED, label=condition)
    axes.axvline(1.0, color=MUTED, linewidth=1)
    log_x(axes)
    legend_above(figure, axes)
    return figure


def _name(_origin: str, feature_set: str, feature: str) -> str:
    return f"{feature} ({feature_set})" if feature_set else feature
