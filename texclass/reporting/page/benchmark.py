"""A benchmark on the page: the table beside the paper's, every row as a picture, the confusion matrix."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

from texclass.reporting.page.blocks import Block, Finding, Heading, Notes, Section
from texclass.reporting.page.gains import gain_blocks
from texclass.reporting.page.rows import Best, beside_table, best_of, confusion, ranking, row_table, tested
from texclass.reporting.page.wording import (
    digits,
    interval,
    percent,
    points,
    protocol,
    sentence,
    size,
    title_of,
)  # fmt: skip

MOST_LISTED = 6
"""Flags and undefined features that a note lists."""


def benchmark_section(data: dict[str, Any]) -> Section:
    """Return the section of a benchmark."""
    best = best_of(data)
    if best is None:
        sentence_ = "No row could be computed; the table says what the dataset lacks."
        finding = Finding("none", "", "", sentence_)
    else:
        finding = Finding(
            percent(best.accuracy["mean"]), "%", interval(best.accuracy), message(data, best),
            beside=beside_paper(data, best), brief=brief(data, best),
        )  # fmt: skip
    return Section(
        f"{data['dataset']['name']}, {protocol(data['protocol'])}",
        f"Pipeline {data['pipeline']['name']}: {size(data['dataset'])}",
        finding,
        tuple(benchmark_blocks(data, best)),
    )


def message(data: dict[str, Any], best: Best) -> str:
    """Return the key message in words: what is recognised, by what, under which protocol."""
    n_pairs = sum(len(row["accuracy"]) for row in data["rows"])
    folds = f", {data['n_folds']} folds" if data["n_folds"] > 1 else ""
    chosen = (
        f" It is the highest of {n_pairs} pairs of row and classifier on the same tests, so it is a little "
        "optimistic."
        if n_pairs > 1
        else ""
    )
    if choice := data.get("choice"):
        chosen += (
            f" Chosen inside each training part, where tests have no say: {_figure(choice['accuracy'])}."
        )
    return (
        f"of the {tested(data)} recognised among {data['dataset']['n_materials']} materials, by "
        f"{best.row['name']} with {title_of(best.classifier)} (95 % interval). Protocol: "
        f"{data['protocol_description']}{folds}.{chosen}"
    )


def published_beside(data: dict[str, Any], best: Best) -> tuple[float, Best] | None:
    """Return the published figure of the best row; if it has none, the highest published one and our row."""
    theirs = best.row.get("paper", {}).get(best.classifier)
    if theirs is not None:
        return theirs, best
    pairs = [
        (figure, Best(row, name, row["accuracy"][name]))
        for row in data["rows"]
        for name, figure in row.get("paper", {}).items()
        if name in row["accuracy"]
    ]
    return max(pairs, key=lambda pair: pair[0], default=None)


def beside_paper(data: dict[str, Any], best: Best) -> str:
    """Return the difference to the published figure in words."""
    found = published_beside(data, best)
    if found is None:
        return "No row of this table has a published figure."
    theirs, row = found
    low, high = (points(row.accuracy[end] - theirs) for end in ("low", "high"))
    what = "for this row with this classifier"
    if row is not best:
        what = (
            f"for {row.row['name']} with {title_of(row.classifier)}, the best published row here, where ours "
            f"is {percent(row.accuracy['mean'])} %"
        )
    return (
        f"{points(row.accuracy['mean'] - theirs)} points [{low}, {high}] against the {100 * theirs:.0f} % "
        f"published {what}. The published figure has no interval and comes from other recordings."
    )


def brief(data: dict[str, Any], best: Best) -> str:
    """Return the line for the overview."""
    said = f"{best.row['name']} with {title_of(best.classifier)}"
    found = published_beside(data, best)
    if found is None:
        return f"{said}; no published figure."
    theirs, row = found
    which = "" if row is best else f" of {row.row['name']}, for that row"
    difference = points(row.accuracy["mean"] - theirs)
    return f"{said}; {difference} points against the published {100 * theirs:.0f} %{which}."


def benchmark_blocks(data: dict[str, Any], best: Best | None) -> Iterator[Block]:
    """Yield the blocks of a benchmark."""
    has_paper = any(row.get("paper") for row in data["rows"])
    yield Heading("Every row beside the paper's" if has_paper else "Every row")
    yield row_table(data, best)
    beside = beside_table(data)
    if beside is not None:
        yield beside
    if best is not None:
        yield ranking(data, best)
    if data["confusion"] is not None:
        yield Heading("Which materials are taken for which")
        yield confusion(data)
    if data.get("gains"):
        yield Heading("What each group of features adds")
        yield from gain_blocks(data["gains"])
    lines = tuple(notes(data))
    if lines:
        yield Heading("Notes")
        yield Notes(lines)


def notes(data: dict[str, Any]) -> Iterator[str]:
    """Yield what a reader of the table must know."""
    agreement = {n: v for n, v in data.get("rank_agreement", {}).items() if v is not None}
    if agreement:
        listed = ", ".join(f"{title_of(n)} {digits(round(v, 2))}" for n, v in agreement.items())
        yield f"Rank agreement of the rows with the published figures (Spearman): {listed}."
    best = best_of(data)
    if best is not None and (columns := best.row.get("selected", {}).get(best.classifier)):
        chosen = sorted(columns.items(), key=lambda item: -item[1])
        listed = ", ".join(f"{column} {share:.0%}" for column, share in chosen)
        yield f"Columns that {best.row['name']} selects, by share of folds: {listed}."
    if choice := data.get("choice"):
        yield _choice(choice)
    for row in data["rows"]:
        if row["accuracy"] and row["missing"]:
            yield f"{row['name']}: without features the dataset lacks: {row['missing']}."
    problems = {
        "Recordings left out": [": ".join(item) for item in data.get("left_out", [])],
        "Recordings flagged by the loader": [": ".join(item) for item in data.get("flags", [])],
        "Features without a value": [
            f"{u['feature']} in {u['n_recordings']}: {u['reason']}" for u in data.get("undefined", [])
        ],
    }
    for what, lines in problems.items():
        if lines:
            more = f"; and {len(lines) - MOST_LISTED} more, in the JSON" if len(lines) > MOST_LISTED else ""
            yield sentence(f"{what}, {len(lines)}: {'; '.join(lines[:MOST_LISTED])}{more}")


def _choice(choice: dict[str, Any]) -> str:
    """Return what choosing inside the training parts gave, in a sentence."""
    folds = Counter(f"{row}, {title_of(name)}" for row, name in choice["chosen"]).most_common()
    listed = "; ".join(f"{what} ({n} of {len(choice['chosen'])} folds)" for what, n in folds)
    return (
        f"Row and classifier chosen inside each training part (by {protocol(choice['protocol'])}): "
        f"{_figure(choice['accuracy'])}; chosen: {listed}."
    )


def _figure(accuracy: dict[str, Any]) -> str:
    mean, low, high = (digits(round(100 * accuracy[key], 1)) for key in ("mean", "low", "high"))
    return f"{mean} % [{low}, {high}]"
