"""A table beside the accuracies: balanced over materials, and by vote of a recording's (or run's) windows."""

from functools import partial
from typing import TYPE_CHECKING

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.result import BenchmarkResult
from texclass.reporting.terminal import Fitting, table_of
from texclass.reporting.words import line_of, title_of

if TYPE_CHECKING:
    from rich.console import RenderableType


def beside_title(result: BenchmarkResult) -> str | None:
    """Return what the table holds; None when the accuracies say it all."""
    found = [accuracy for row in result.rows for accuracy in row.accuracy.values()]
    balanced = any(accuracy.balanced is not None for accuracy in found)
    voted = any(accuracy.voted is not None for accuracy in found)
    vote = f"per {result.unit}, by majority of its {result.tested}"
    parts = ["balanced accuracy"] * balanced + [vote] * voted
    title = f"{' / '.join(parts)}, in %"
    return title[0].upper() + title[1:] if parts else None


def beside_table(result: BenchmarkResult) -> "RenderableType":
    """Return the table for a terminal."""
    from rich.console import Group
    from rich.text import Text

    return Group(
        Text(beside_title(result) or "", style="bold"),
        Fitting(tuple(partial(_table, result, brief=brief) for brief in (False, True))),
    )


def _table(result: BenchmarkResult, *, brief: bool) -> "RenderableType":
    rows = _rows(result, brief=brief)
    best = result.best and result.best[0].name
    styles = ["bold" if name == best else "" for name, *_ in rows]
    return table_of(("Row", *map(title_of, result.classifiers)), rows, styles)


def beside_markdown(result: BenchmarkResult) -> list[str]:
    """Return the table as lines of Markdown."""
    header = ("Row", *map(title_of, result.classifiers))
    rule = "|---|" + "---:|" * len(result.classifiers)
    rows = map(line_of, _rows(result, brief=False))
    return [f"## {beside_title(result)} [95 %]", "", line_of(header), rule, *rows]


def _rows(result: BenchmarkResult, *, brief: bool) -> list[tuple[str, ...]]:
    """Return the name and the cells of every row that could be computed."""
    return [
        (row.name, *(_cell(row.accuracy.get(name), brief) for name in result.classifiers))
        for row in result.rows
        if row.accuracy
    ]


def _cell(accuracy: Accuracy | None, brief: bool) -> str:
    if accuracy is None:
        return ""
    texts = [] if accuracy.balanced is None else [f"{100 * accuracy.balanced:.1f}"]
    if (voted := accuracy.voted) is not None:
        low, high = voted.interval
        interval = "" if brief else f" [{100 * low:.1f}, {100 * high:.1f}]"
        texts.append(f"{100 * voted.mean:.1f}{interval}")
    return " / ".join(texts)
