"""A document on a terminal: tables fit its width, words wrap between words, numbers never do."""

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

from texclass.reporting.blocks import Block, Document, Figure, Folded, Heading, Heat, Table
from texclass.reporting.wording import split_interval, texts_of, titles_of


def print_document(document: Document) -> None:
    """Print a document on standard output."""
    Console().print(render_terminal(document))


def render_terminal(document: Document) -> Group:
    """Return a document for a console; a figure is its sentence there, and what is folded is left out."""
    parts: list[RenderableType] = [Text(document.title, style="bold")]
    if document.subtitle:
        parts.append(Text(document.subtitle))
    if found := document.finding:
        parts.append(Text.assemble((found.number, "bold"), f" {found.rest}"))
    return Group(*parts, *(part for block in document.blocks for part in _block(block)))


def _block(block: Block) -> Iterator[RenderableType]:
    match block:
        case Heading():
            yield from (Text(""), Text(block, style="bold"))
        case str():
            yield Text(block)
        case Table():
            yield _Fitting(block)
            if block.caption:
                yield Text(block.caption, style="dim")
        case Figure() | Heat():
            yield Text(f"- {block.title}: {block.says}", style="dim")
        case Folded():
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
class _Fitting:
    """The widest of several ways to draw a table that a terminal has room for; in parts if there is none."""

    table: Table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        n_words, n_columns = self.table.n_words, len(titles_of(self.table.frame))
        narrow = partial(_drawn, self.table, below=True, break_titles=True)
        ways: list[Callable[[], RichTable]] = [
            partial(_drawn, self.table),
            partial(_drawn, self.table, break_titles=True),
            narrow,
        ]
        unlimited = options.update(max_width=1000)
        for way in ways:
            made = way()
            if Measurement.get(console, unlimited, made).minimum <= options.max_width:
                yield made
                return
        # Words at the left of every part, then as many columns as there is room for.

        def fits(made: RichTable) -> bool:
            return sum((column.min_width or 0) + 2 for column in made.columns) - 2 <= options.max_width

        words, left = list(range(n_words)), list(range(n_words, self.table.n_kept or n_columns))
        if not left:
            yield narrow()
        while left:
            n = next((n for n in range(len(left), 1, -1) if fits(narrow(columns=words + left[:n]))), 1)
            yield narrow(columns=words + left[:n])
            left = left[n:]


def _drawn(
    table: Table, *, below: bool = False, break_titles: bool = False, columns: Sequence[int] = ()
) -> RichTable:
    drawn = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    cells: list[list[Any]] = []
    columns = columns or range(len(titles_of(table.frame)))
    every = titles_of(table.frame)
    named = [every[i] for i in columns]
    before = ["", *(group for group, _ in named)]  # a group is named over the first of its columns
    titles = [
        part if group == last and part else f"{group}\n{part}".strip()
        for (group, part), last in zip(named, before, strict=False)
    ]
    rows = [[row[i] for i in columns] for row in texts_of(table.frame)]
    for i, why in table.instead.items():
        brief = re.sub(r" \([^)]*\)", "", why)
        rows[i] = [f"{rows[i][0]}\n  {brief}", *[""] * (len(titles) - 1)]
    for i, title in enumerate(titles):
        column = [row[i] for row in rows]
        broken = title.replace(" [", "\n[") if below else title
        broken = re.sub(r"(?<!\d) (?!%)", "\n", broken) if break_titles else broken
        if i < table.n_words:
            # Names keep 16 characters at least, other columns of words 10.
            drawn.add_column(title, min_width=min(10 if i else 16, _width((title, *column))))
            cells.append([Text(text) for text in column])
        else:
            numbers = _numbers(column, below)
            width = _width((broken, *map(str, numbers)))
            drawn.add_column(broken, justify="right", no_wrap=True, min_width=width)
            cells.append(numbers)
    for i, row in enumerate(zip(*cells, strict=True)):
        style = "bold" if i in table.strong else "dim" if i in table.instead else ""
        drawn.add_row(*row, style=style)
    return drawn


def _width(texts: Iterable[str]) -> int:
    return max(len(line) for text in texts for line in text.split("\n"))


def _numbers(column: list[str], below: bool) -> list[Text]:
    """Return numbers, each with its interval faint beside or below it, their points in line."""
    parted = [split_interval(text) for text in column]
    beside = [found for _, found in parted]
    for i, found in enumerate(beside):  # in whole numbers: [82.6, 94.5] is 83–95
        if ends := re.fullmatch(r"\[(\d+\.\d), (\d+\.\d)\]", found):
            beside[i] = "{:.0f}–{:.0f}".format(*map(float, ends.groups()))
    width = max(map(len, beside), default=0)
    return [
        Text.assemble(
            number,
            (("\n" if below else " ") + f"{found:>{width}}" if width and number else "", "not bold dim"),
        )
        for (number, _), found in zip(parted, beside, strict=True)
    ]
