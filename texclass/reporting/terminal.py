"""Output of documents on a terminal. Tables fit its width; text wraps between words, but numbers do not."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from rich import box
from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text

from texclass.reporting.blocks import Block, Details, Document, Figure, Heading, HeatMap, Table
from texclass.reporting.wording import cell_texts, column_titles, split_interval


def print_document(document: Document) -> None:
    """Print a document on standard output.

    Examples
    --------
    >>> from texclass.reporting import Document
    >>> print_document(Document("Latency", ["Below 1 ms."]))
    Latency
    Below 1 ms.
    """
    Console().print(render_terminal(document))


def render_terminal(document: Document) -> Group:
    """Return a document for rich to print, with summaries instead of figures and without `Details`.

    Examples
    --------
    >>> from texclass.reporting import Document
    >>> len(render_terminal(Document("Latency", ["Below 1 ms."])).renderables)
    2
    """
    parts: list[RenderableType] = [Text(document.title, style="bold")]
    if document.subtitle:
        parts.append(Text(document.subtitle))
    if finding := document.finding:
        parts.append(Text.assemble((finding.number, "bold"), f" {finding.rest}"))
    return Group(*parts, *(part for block in document.blocks for part in _block(block)))


def _block(block: Block) -> Iterator[RenderableType]:
    match block:
        case Heading():
            yield from (Text(""), Text(block, style="bold"))
        case str():
            yield Text(block)
        case Table():
            yield _FittingTable(block)
            if block.caption:
                yield Text(block.caption, style="dim")
        case Figure() | HeatMap():
            yield Text(f"- {block.title}: {block.summary}", style="dim")
        case Details():
            return
        case Mapping():
            facts = RichTable(box=None, show_header=False, padding=(0, 2, 0, 0), pad_edge=False)
            facts.add_column(no_wrap=True, style="bold")
            facts.add_column(overflow="fold")
            for name, value in block.items():
                facts.add_row(Text(name), Text(value))
            yield facts
        case _:
            yield from (Text(f"- {note}", style="dim") for note in block)


@dataclass(frozen=True)
class _FittingTable:
    """Table in the widest layout that fits the terminal, or split into several tables if no layout fits."""

    table: Table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        n_words, n_columns = self.table.n_words, len(column_titles(self.table.frame))
        narrow = partial(_rich_table, self.table, intervals_below=True, break_titles=True)
        layouts: list[Callable[[], RichTable]] = [
            partial(_rich_table, self.table),
            partial(_rich_table, self.table, break_titles=True),
            narrow,
        ]
        unlimited = options.update(max_width=1000)
        for layout in layouts:
            rich_table = layout()
            if Measurement.get(console, unlimited, rich_table).minimum <= options.max_width:
                yield rich_table
                return

        # Split into several tables: each has all text columns and as many number columns as fit.
        def fits(part: RichTable) -> bool:
            return sum((column.min_width or 0) + 2 for column in part.columns) - 2 <= options.max_width

        words, rest = list(range(n_words)), list(range(n_words, self.table.n_narrow or n_columns))
        if not rest:
            yield narrow(min_words=1)
        while rest:
            n = next((n for n in range(len(rest), 1, -1) if fits(narrow(columns=words + rest[:n]))), 1)
            yield narrow(columns=words + rest[:n])
            rest = rest[n:]


def _rich_table(
    table: Table,
    *,
    intervals_below: bool = False,
    break_titles: bool = False,
    columns: Sequence[int] = (),
    min_words: int = 16,
) -> RichTable:
    rich_table = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    cells: list[list[Any]] = []
    columns = columns or range(len(column_titles(table.frame)))
    all_titles = column_titles(table.frame)
    pairs = [all_titles[i] for i in columns]
    previous_groups = ["", *(group for group, _ in pairs)]  # a group title is only above its first column
    titles = [
        part if group == previous and part else f"{group}\n{part}".strip()
        for (group, part), previous in zip(pairs, previous_groups, strict=False)
    ]
    rows = [[row[i] for i in columns] for row in cell_texts(table.frame)]
    for i, message in table.messages.items():
        brief = re.sub(r" \([^)]*\)", "", message)
        rows[i] = [f"{rows[i][0]}\n  {brief}", *[""] * (len(titles) - 1)]
    for i, title in enumerate(titles):
        column = [row[i] for row in rows]
        title_lines = title.replace(" [", "\n[") if intervals_below else title
        title_lines = re.sub(r"(?<!\d) (?!%)", "\n", title_lines) if break_titles else title_lines
        if i < table.n_words:
            # Row names get at least 16 characters, other text columns at least 10.
            min_width = min(10 if i else 16, min_words, _width((title, *column)))
            rich_table.add_column(title, min_width=min_width, overflow="fold")
            cells.append([Text(text) for text in column])
        else:
            numbers = _align_numbers(column, intervals_below)
            width = _width((title_lines, *map(str, numbers)))
            rich_table.add_column(title_lines, justify="right", no_wrap=True, min_width=width)
            cells.append(numbers)
    for i, row in enumerate(zip(*cells, strict=True)):
        style = "bold" if i in table.bold_rows else "dim" if i in table.messages else ""
        rich_table.add_row(*row, style=style)
    return rich_table


def _width(texts: Iterable[str]) -> int:
    return max(len(line) for text in texts for line in text.split("\n"))


def _align_numbers(column: list[str], intervals_below: bool) -> list[Text]:
    """Return numbers with aligned decimal points, each with its dimmed interval after or below it."""
    pairs = [split_interval(text) for text in column]
    intervals = [interval for _, interval in pairs]
    for i, interval in enumerate(intervals):  # round intervals to save width: [82.6, 94.5] becomes 83–95
        if ends := re.fullmatch(r"\[(\d+\.\d), (\d+\.\d)\]", interval):
            intervals[i] = "{:.0f}–{:.0f}".format(*map(float, ends.groups()))
    width = max(map(len, intervals), default=0)
    separator = "\n" if intervals_below else " "
    return [
        Text.assemble(
            number,
            (separator + f"{interval:>{width}}" if width and number else "", "not bold dim"),
        )
        for (number, _), interval in zip(pairs, intervals, strict=True)
    ]
