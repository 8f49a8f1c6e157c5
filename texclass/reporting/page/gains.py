"""What groups of features add to a row, on the page."""

from collections.abc import Iterator
from typing import Any

from texclass.reporting.page.blocks import Block, Cell, Figure, Head, Notes, Row, Table, heading, number
from texclass.reporting.page.scales import around
from texclass.reporting.page.svg import Spot, row_plot
from texclass.reporting.page.wording import digits, p_value, percent, points, points_interval, title_of

LEVEL = 0.05


def gain_blocks(gains: dict[str, Any]) -> Iterator[Block]:
    """Yield figure and notes of what each group adds."""
    measured = [group for group in gains["groups"] if group["paired"] is not None]
    if measured:
        yield gain_figure(gains, measured)
    else:
        yield gain_table(gains)
    tests = sorted({group["paired"]["test"] for group in measured})
    added = f"Added to {gains['row']}, {title_of(gains['classifier'])} ({gains['chosen']})"
    yield Notes(
        (
            f"{added}: {percent(gains['without']['accuracy'])} % without any group, on the same splits.",
            f"{_folds(gains)}Interval and p: {', '.join(tests) or 'none'}; "
            "Holm: corrected for the number of groups.",
        )
    )


def gain_figure(gains: dict[str, Any], measured: list[dict[str, Any]]) -> Figure:
    """Return the gains as a picture: filled where significant after correction."""
    rows, values = [], [0.0]
    for group in measured:
        paired = group["paired"]
        sure = group["p_corrected"] is not None and group["p_corrected"] < LEVEL
        gain = f"{points(paired['difference'])} points {points_interval(paired)}"
        says = f"{group['name']}: {gain}, p {p_value(group['p_corrected'])}"
        spot = Spot(
            100 * paired["difference"],
            "ours" if sure else "ours open",
            says,
            100 * paired["low"],
            100 * paired["high"],
        )
        rows.append((f"+ {group['name']}", [spot]))
        values += [100 * paired["low"], 100 * paired["high"]]
    sure_of = [g for g in measured if g["p_corrected"] is not None and g["p_corrected"] < LEVEL]
    named = ", ".join(f"{g['name']} {points(g['paired']['difference'])} points" for g in sure_of)
    alternative = f"{len(sure_of)} of {len(measured)} groups change the accuracy significantly"
    alternative += f" (corrected p below {LEVEL})"
    return Figure(
        f"Gain over {gains['row']}",
        f"{alternative}{f': {named}' if named else ''}.",
        row_plot(rows, around(values, zero=True), "gain, points", zero=0.0),
        gain_table(gains),
        (("ours", "disc", "significant, 95 % interval"), ("ours open", "disc", "not significant")),
        gutter=True,
    )


def _folds(gains: dict[str, Any]) -> str:
    if gains["n_folds"] <= 1:
        return ""
    repeats = f"{gains['n_repeats']} x " if gains["n_repeats"] > 1 else ""
    return f"{repeats}{gains['n_folds']} folds. "


def gain_table(gains: dict[str, Any]) -> Table:
    """Return the gains as a table."""
    titles = ("With", "Columns", "%", "Points [95 %]", "Folds better/worse", "p", "p, Holm", "ms")
    without = gains["without"]
    first = Row(
        (
            heading(gains["row"]), number(str(without["n_features"])), number(percent(without["accuracy"])),
            *[number("")] * 4, number(digits(without["ms_per_recording"])),
        )
    )  # fmt: skip
    return Table(
        "What each group adds",
        (tuple(Head(title, is_number=i > 0) for i, title in enumerate(titles)),),
        (first, *map(_row, gains["groups"])),
        caption_hidden=True,
    )


def _row(group: dict[str, Any]) -> Row:
    joined, paired, name = group["joined"], group["paired"], heading(f"+ {group['name']}")
    if joined is None or paired is None:
        return Row((name, Cell(f"not computed: {group['missing'] or 'no reason given'}", span=7)), faint=True)
    folds = [difference for repeat in paired["folds"] for difference in repeat]
    return Row(
        (
            name, number(str(joined["n_features"])), number(percent(joined["accuracy"])),
            number(points(paired["difference"]), points_interval(paired)),
            number(f"{sum(d > 0 for d in folds)}/{sum(d < 0 for d in folds)}"),
            number(p_value(paired["p_value"])), number(p_value(group["p_corrected"])),
            number(digits(joined["ms_per_recording"])),
        )
    )  # fmt: skip
