"""The table of a benchmark, ours beside the published figures: on the terminal and as Markdown."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.result import BenchmarkResult, RowResult
from texclass.reporting.beside import beside_markdown, beside_table, beside_title
from texclass.reporting.gains import gain_markdown, gain_table
from texclass.reporting.words import line_of, title_of

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


def header(result: BenchmarkResult) -> tuple[str, ...]:
    """Return the column titles of the table."""
    ours = tuple(f"{title_of(name)} % [95 %]" for name in result.classifiers)
    return ("Row", "Dim", *ours, f"Paper % ({' / '.join(map(_short, published(result)))})", "ms")


def published(result: BenchmarkResult) -> tuple[str, ...]:
    """Return the classifiers of which some row has a published figure."""
    return tuple(name for name in result.classifiers if any(name in row.published for row in result.rows))


def cells(result: BenchmarkResult, row: RowResult, *, brief: bool = False) -> tuple[str, ...]:
    """Return one row of the table as text, in the order of `header`; a missing row says what it lacks.

    Brief cells fit a terminal: whole per cents as interval, reasons without the features they hit.
    """
    ours = [_accuracy(row.accuracy.get(name), 0 if brief else 1) for name in result.classifiers]
    if not row.accuracy:
        missing = row.missing or ""
        ours[0] = re.sub(r" \(.*?\)", "", missing) if brief else missing
    theirs = [f"{row.published[n]:.0f}" if n in row.published else "-" for n in published(result)]
    ms = "" if row.ms_per_recording is None else f"{row.ms_per_recording:.3g}"
    paper = ("/" if brief else " / ").join(theirs) if row.published else ""
    return (row.name, str(row.n_features), *ours, paper, ms)


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
    yield from _problems(result)
    yield from result.dataset.get("notes", ())


def benchmark_table(result: BenchmarkResult) -> "RenderableType":
    """Return the table for a terminal, with its notes below."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    table.add_column("Row", overflow="fold")
    table.add_column("Dim", justify="right")
    for name in result.classifiers:
        table.add_column(title_of(name), justify="right", min_width=len("95.1 [93, 97]"))
    table.add_column("Paper", justify="right", no_wrap=True)
    table.add_column("ms", justify="right", no_wrap=True)
    best = result.best
    for row in result.rows:
        style = "bold" if best is not None and row is best[0] else "" if row.accuracy else "dim"
        table.add_row(*(Text(cell) for cell in cells(result, row, brief=True)), style=style)
    order = " / ".join(map(_short, published(result)))
    above = Text(f"{headline(result)}; accuracy in % [95 % interval]; paper: {order}", style="bold")
    below = [Text(f"- {note}", style="dim") for note in (*notes(result), _cost_note())]
    beside = [] if beside_title(result) is None else [Text(""), beside_table(result)]
    gains = [] if result.gains is None else [Text(""), gain_table(result.gains, result.seed)]
    return Group(above, table, *beside, *below, *gains)


def markdown(result: BenchmarkResult) -> str:
    """Return the table as Markdown, with everything that is needed to compute it again."""
    lines = [
        f"# {headline(result)}",
        "",
        line_of(header(result)),
        "|---|" + "---:|" * (len(header(result)) - 1),
    ]
    lines += [line_of(cells(result, row)) for row in result.rows]
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


def _accuracy(accuracy: Accuracy | None, digits: int) -> str:
    if accuracy is None:
        return ""
    low, high = accuracy.interval
    return f"{100 * accuracy.mean:.1f} [{100 * low:.{digits}f}, {100 * high:.{digits}f}]"


def _short(classifier: str) -> str:
    return {"naive_bayes": "NB", "lda": "LDA", "euclidean": "Eu"}.get(classifier, classifier)
