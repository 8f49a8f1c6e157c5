"""The rows of a benchmark on the page: the table beside the paper's, the picture of it, the confusions."""

from typing import Any, NamedTuple

from texclass.reporting.page.blocks import (
    Cell,
    Figure,
    Head,
    Matrix,
    Row,
    Table,
    heading,
    number,
    simple_table,
)  # fmt: skip
from texclass.reporting.page.scales import per_cent_scale
from texclass.reporting.page.svg import Spot, row_plot
from texclass.reporting.page.wording import column, interval, percent, points, title_of

OURS, PAPER = "%\N{NO-BREAK SPACE}[95\N{NO-BREAK SPACE}%]", "Paper\N{NO-BREAK SPACE}%"


class Best(NamedTuple):
    """A row, a classifier, and its accuracy."""

    row: dict[str, Any]
    classifier: str
    accuracy: dict[str, Any]


def best_of(data: dict[str, Any]) -> Best | None:
    """Return row and classifier of the highest accuracy; the first of equals."""
    pairs = [Best(row, name, found) for row in data["rows"] for name, found in row["accuracy"].items()]
    return max(pairs, key=lambda best: best.accuracy["mean"], default=None)


def tested(data: dict[str, Any]) -> str:
    """Return what was classified."""
    return "windows" if "n_windows" in data["dataset"] else "recordings"


def classifiers(data: dict[str, Any]) -> list[str]:
    """Return the classifiers in the order of the rows."""
    return list(dict.fromkeys(name for row in data["rows"] for name in row["accuracy"]))


def row_table(data: dict[str, Any], best: Best | None) -> Table:
    """Return the table: each classifier's accuracy, and the published one beside it."""
    names = classifiers(data) or ["accuracy"]
    published = [n for n in names if any(n in row.get("paper", {}) for row in data["rows"])]
    first = [Head("Row", is_number=False, rows=2), Head("Columns", rows=2)]
    first += [Head(title_of(n), span=1 + (n in published)) for n in names]
    second = [Head(title) for n in names for title in (OURS, *[PAPER] * (n in published))]
    times = column(row["ms_per_recording"] for row in data["rows"])
    rows = [
        Row(
            (
                heading(row["name"]),
                number(str(row["n_features"])),
                *_cells(row, names, published),
                number(ms),
            ),
            best is not None and row is best.row,
            not row["accuracy"],
        )
        for row, ms in zip(data["rows"], times, strict=True)
    ]
    theirs = ", and the published one" if published else ""
    caption = (
        f"Accuracy over {tested(data)} in % with its 95 % interval{theirs}; ms: features of one "
        f"{tested(data)[:-1]}, one thread. The best row is bold."
    )
    return Table(caption, ((*first, Head("ms", rows=2)), tuple(second)), tuple(rows))


def _cells(row: dict[str, Any], names: list[str], published: list[str]) -> list[Cell]:
    """Return the accuracies of a row, ours and the published one; if there are none, the reason."""
    if not row["accuracy"]:
        why = row["missing"] or "no reason given"
        return [Cell(f"not computed: {why}", span=len(names) + len(published))]
    cells = []
    for name in names:
        found, theirs = row["accuracy"].get(name), row.get("paper", {}).get(name)
        cells.append(number(percent(found["mean"]), interval(found)) if found else number(""))
        if name in published:
            cells.append(number("" if theirs is None else f"{100 * theirs:.0f}"))
    return cells


def beside_table(data: dict[str, Any]) -> Table | None:
    """Return balanced accuracies and votes of a recording's (or run's) windows; None if they add nothing."""
    every = [found for row in data["rows"] for found in row["accuracy"].values()]
    unit = next((u for u in ("recording", "run") if any(f"per_{u}" in found for found in every)), None)
    balanced = any(abs(found.get("balanced", found["mean"]) - found["mean"]) > 1e-9 for found in every)
    titles = ["balanced"] * balanced + [f"per {unit}"] * (unit is not None)
    if not titles:
        return None
    names = classifiers(data)
    first = (Head("Row", is_number=False, rows=2), *(Head(title_of(n), span=len(titles)) for n in names))
    rows = []
    for row in data["rows"]:
        cells = [heading(row["name"])]
        for name in names:
            found = row["accuracy"].get(name, {})
            if balanced:
                value = found.get("balanced", found.get("mean"))
                cells.append(number("" if value is None else percent(value)))
            if unit is not None:
                vote = found.get(f"per_{unit}")
                cells.append(number(percent(vote["mean"]), interval(vote)) if vote else number(""))
        if row["accuracy"]:
            rows.append(Row(tuple(cells)))
    caption = "The same in other terms, in %. " + "balanced: mean over materials. " * balanced
    caption += f"per {unit}: by majority of its {tested(data)} [95 %]." if unit else ""
    return Table(caption, (first, tuple(Head(t) for _ in names for t in titles)), tuple(rows))


def ranking(data: dict[str, Any], best: Best) -> Figure:
    """Return all rows as a picture, for the classifier of the best one: ours and the published figure."""
    name = best.classifier
    rows = [row for row in data["rows"] if name in row["accuracy"]]
    three = [(row["name"], row["accuracy"][name], row.get("paper", {}).get(name)) for row in rows]
    drawn = [(row_name, _spots(row_name, *found)) for row_name, *found in three]
    gaps = [found["mean"] - theirs for _, found, theirs in three if theirs is not None]
    reached = f"; {sum(gap >= 0 for gap in gaps)} of {len(gaps)} rows reach their published figure"
    best_one = f"{best.row['name']} with {percent(best.accuracy['mean'])} %"
    legend = [("ours", "disc", "ours, 95 % interval"), ("paper", "diamond", "published")]
    lows = [spot.x if spot.low is None else spot.low for _, spots in drawn for spot in spots]
    return Figure(
        f"Every row with {title_of(name)}",
        f"The best of {len(rows)} rows is {best_one}{reached if gaps else ''}.",
        row_plot(drawn, per_cent_scale(lows), "accuracy, %"),
        simple_table(
            f"Accuracy with {title_of(name)}",
            ("Row", "Ours, % [95 %]", "Published, %", "Points"),
            [_numbers(*found) for found in three],
        ),
        tuple(legend[: 1 + bool(gaps)]),
        gutter=True,
    )


def _spots(name: str, found: dict[str, Any], theirs: float | None) -> list[Spot]:
    mean, low, high = (100 * found[key] for key in ("mean", "low", "high"))
    ours = Spot(mean, "ours", f"{name}: ours {percent(found['mean'])} % {interval(found)}", low, high)
    if theirs is None:
        return [ours]
    return [Spot(100 * theirs, "paper", f"{name}: published {100 * theirs:.0f} %", shape="diamond"), ours]


def _numbers(name: str, found: dict[str, Any], theirs: float | None) -> tuple[str, ...]:
    paper = ("", "") if theirs is None else (f"{100 * theirs:.0f}", points(found["mean"] - theirs))
    return (name, f"{percent(found['mean'])} {interval(found)}", *paper)


def confusion(data: dict[str, Any]) -> Matrix:
    """Return the confusion matrix of the best row."""
    found = data["confusion"]
    names, counts = found["materials"], found["counts"]
    wrong = sorted(
        (
            (counts[i][j], i, j)
            for i in range(len(names))
            for j in range(len(names))
            if i != j and counts[i][j]
        ),
        key=lambda item: (-item[0], item[1], item[2]),
    )
    total = sum(map(sum, counts))
    n_wrong = sum(count for count, *_ in wrong)
    alternative = f"{n_wrong} of {total} {tested(data)} are taken for another material"
    if wrong:
        most, i, j = wrong[0]
        alternative += f"; the most frequent: {names[i]} taken for {names[j]}, {most} of {sum(counts[i])}"
    listed = [
        (names[i], names[j], str(count), f"{100 * count / sum(counts[i]):.0f}") for count, i, j in wrong
    ]
    return Matrix(
        f"Confusion matrix of {found['row']}, {title_of(found['classifier'])}",
        f"{alternative}.",
        tuple(names),
        tuple(map(tuple, counts)),
        tested(data),
        simple_table(
            "Confusions, the most frequent first",
            ("Material", "taken for", "times", "% of its tests"), listed, n_text=2,
        ),
    )  # fmt: skip
