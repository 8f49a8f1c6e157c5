"""The table of a benchmark, ours beside the published figures: on the terminal and as Markdown."""

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from texclass.experiment.nested_choice import NestedChoice
from texclass.experiment.result import BenchmarkResult
from texclass.reporting.beside import beside_markdown, beside_table, beside_title
from texclass.reporting.cells import cells, header, paper_cell, paper_order, published
from texclass.reporting.gains import gain_markdown, gain_table
from texclass.reporting.terminal import Fitting, accuracy_column, ms_column, name_cell, table_of
from texclass.reporting.words import line_of, short_title_of, title_of

if TYPE_CHECKING:
    from rich.console import RenderableType

MOST_LISTED = 4
"""Recordings, flags or features that a note lists one by one; the JSON holds all of them."""


def headline(result: BenchmarkResult) -> str:
    """Return one line: dataset, protocol, pipeline."""
    facts = result.dataset
    folds = f", {result.n_folds} folds" if result.n_folds > 1 else ""
    windows = f"{facts['n_windows']} windows of " if "n_windows" in facts else ""
    return (
        f"{facts['name']}: {windows}{facts['n_recordings']} recordings of {facts['n_materials']} materials, "
        f"protocol `{result.protocol}`{folds}, pipeline `{result.pipeline}`"
    )


def notes(result: BenchmarkResult) -> Iterator[str]:
    """Yield what a reader of the table must know, one sentence a note."""
    yield f"Protocol `{result.protocol}`: {result.protocol_description}."
    if any(accuracy.bounds for row in result.rows for accuracy in row.accuracy.values()):
        yield (
            f"Accuracy is the share of {result.tested}; its interval is a bootstrap over {result.unit}s, as "
            f"those of one {result.unit} are no independent tests."
        )
    for row in result.rows:
        if row.accuracy and row.missing:
            yield f"{row.name}: without features the dataset lacks: {row.missing}."
    agreement = {name: result.rank_agreement(name) for name in published(result)}
    if known := [f"{title_of(n)} {value:.2f}" for n, value in agreement.items() if value is not None]:
        yield f"Rank agreement of the rows with the published figures (Spearman): {', '.join(known)}."
    if (best := result.best) is not None and (columns := best[0].selected.get(best[1])):
        chosen = sorted(columns.items(), key=lambda item: -item[1])
        listed = ", ".join(f"{column} {share:.0%}" for column, share in chosen)
        yield f"Best row: {best[0].name}, {title_of(best[1])}. Selected, by share of folds: {listed}."
    if result.choice is not None:
        yield _chosen(result.choice)
    yield from _problems(result)
    yield from result.dataset.get("notes", ())


def benchmark_table(result: BenchmarkResult) -> "RenderableType":
    """Return the table for a terminal, with its notes below; a narrow one goes without intervals."""
    from rich.console import Group
    from rich.text import Text

    paper = f"; paper: {paper_order(result)}" if published(result) else ""
    above = Text(f"{headline(result)}; accuracy in %, its 95 % interval beside it{paper}", style="bold")
    ways = [
        partial(_row_table, result, title, intervals=shown)
        for shown in (True, False)
        for title in (title_of, short_title_of)
    ]
    below = [Text(f"- {note}", style="dim") for note in (*notes(result), _cost_note())]
    beside = [] if beside_title(result) is None else [Text(""), beside_table(result)]
    gains = [] if result.gains is None else [Text(""), gain_table(result.gains, result.seed)]
    return Group(above, Fitting(tuple(ways)), *beside, *below, *gains)


def _row_table(result: BenchmarkResult, title: Callable[[str], str], *, intervals: bool) -> "RenderableType":
    """Return the rows for a terminal."""
    # In brief: what a row lacks, without the features that this concerns.
    lacks = [re.sub(r" \(.*?\)", "", "" if row.accuracy else row.missing or "") for row in result.rows]
    names = [name_cell(row.name, missing) for row, missing in zip(result.rows, lacks, strict=True)]
    ours = [
        accuracy_column([row.accuracy.get(name) for row in result.rows], intervals=intervals)
        for name in result.classifiers
    ]
    times = ms_column([row.ms_per_recording for row in result.rows])
    rows = [
        (name, str(row.n_features), *values, *paper_cell(result, row, "/"), ms)
        for name, row, *values, ms in zip(names, result.rows, *ours, times, strict=True)
    ]
    best = result.best and result.best[0]
    styles = ["bold" if row is best else "" if row.accuracy else "dim" for row in result.rows]
    paper = ["Paper"] * bool(published(result))
    return table_of(("Row", "Dim", *map(title, result.classifiers), *paper, "ms"), rows, styles)


def markdown(result: BenchmarkResult) -> str:
    """Return the table as Markdown, with everything that is needed to compute it again."""
    titles = header(result).texts
    lines = [f"# {headline(result)}", "", line_of(titles), "|---|" + "---:|" * (len(titles) - 1)]
    lines += [line_of(cells(result, row).texts) for row in result.rows]
    if beside_title(result) is not None:
        lines += ["", *beside_markdown(result)]
    lines += ["", "## Notes", "", *(f"- {note}" for note in (*notes(result), _cost_note()))]
    if result.gains is not None:
        lines += ["", *gain_markdown(result.gains, result.seed)]
    lines += ["", "## To compute it again", ""]
    lines += [
        f"- dataset `{result.dataset['name']}`, input hash `{result.input_hash}`",
        f"- pipeline `{result.pipeline}` (hash `{result.pipeline_hash}`), features `{result.feature_set}`, "
        f"seed {result.seed}",
        "- versions: " + ", ".join(f"{name} {version}" for name, version in result.versions.items()),
    ]
    return "\n".join(lines) + "\n"


def _chosen(choice: NestedChoice) -> str:
    """Return what choosing inside the training parts gave, in a sentence."""
    low, high = choice.accuracy.interval
    balanced = choice.accuracy.balanced
    told = "" if balanced is None else f", balanced {100 * balanced:.1f} %"
    picked = "; ".join(
        f"{row}, {title_of(name)}"
        + (f" in {n} of {len(choice.chosen)} folds" if len(choice.chosen) > 1 else "")
        for (row, name), n in choice.favourites
    )
    return (
        f"Row and classifier chosen inside each training part (by `{choice.protocol}`), where tests have no "
        f"say: {100 * choice.accuracy.mean:.1f} % [{100 * low:.1f}, {100 * high:.1f}]{told}; "
        f"chosen: {picked}."
    )


def _problems(result: BenchmarkResult) -> Iterator[str]:
    """Yield recordings left out, flags and undefined features, each list cut to a readable length."""
    n = result.dataset.get("n_windows", result.dataset["n_recordings"])
    partly = [u for u in result.undefined if u.n_recordings < n]
    for what, lines in (
        ("recordings left out", [str(item) for item in result.left_out]),
        ("recordings flagged by the loader", [f"{item.recording_id}: {item.flag}" for item in result.flags]),
        (
            "features without a value in some recordings (where the training median stands in)",
            [f"{u.feature} in {u.n_recordings} of {n}: {u.reason}" for u in partly],
        ),
    ):
        if lines:
            more = f"; and {len(lines) - MOST_LISTED} more, in the JSON" if len(lines) > MOST_LISTED else ""
            yield f"{what.capitalize()}, {len(lines)}: {'; '.join(lines[:MOST_LISTED])}{more}."


def _cost_note() -> str:
    return (
        "ms: features of one recording (or window), one thread, shared transforms counted once, without "
        "segmentation."
    )
