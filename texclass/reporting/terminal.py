"""Tables for a terminal: words wrap between words, numbers never do."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from texclass.experiment.accuracy import Accuracy

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.table import Table
    from rich.text import Text

LEAST_NAME, LEAST_WORDS = 18, 10
"""Characters that names, and other columns of words, keep at least, or their longest text if that is less."""


@dataclass(frozen=True)
class Fitting:
    """The first of several renderables, from wide to narrow, that the terminal has room for.

    Attributes
    ----------
    choices
        Each makes one of them; the last is taken if none fits.
    """

    choices: tuple[Callable[[], "RenderableType"], ...]

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "Iterator[RenderableType]":
        """Yield the widest that fits."""
        from rich.measure import Measurement

        unlimited = options.update(max_width=1000)
        *wide, narrowest = self.choices
        for made in (choice() for choice in wide):
            if Measurement.get(console, unlimited, made).minimum <= options.max_width:
                yield made
                return
        yield narrowest()


def table_of(
    titles: Sequence[str],
    rows: Sequence[Sequence["str | Text"]],
    styles: Sequence[str] = (),
    *,
    n_text: int = 1,
) -> "Table":
    """Return a table: the first columns are words, all others numbers that stay on one line.

    Parameters
    ----------
    titles : sequence of str
        Of the columns; a title may have several lines.
    rows : sequence of sequences of str or Text
        The cells.
    styles : sequence of str
        One a row; plain by default.
    n_text : int
        Columns of words, at the left.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    texts = [[Text(cell) if isinstance(cell, str) else cell for cell in row] for row in rows]
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for i, (title, column) in enumerate(zip(titles, zip(*texts, strict=True), strict=True)):
        width = max(len(line) for cell in (title, *column) for line in str(cell).splitlines() or [""])
        if i < n_text:
            table.add_column(title, min_width=min(LEAST_WORDS if i else LEAST_NAME, width))
        else:
            table.add_column(title, justify="right", no_wrap=True, min_width=width)
    for i, row in enumerate(texts):
        table.add_row(*row, style=styles[i] if styles else "")
    return table


def name_cell(name: str, missing: str | None = None) -> str:
    """Return the name of a row; below it what a row without values lacks."""
    return f"{name}\n  {missing}" if missing else name


def accuracy_column(found: Sequence[Accuracy | None], *, intervals: bool = True) -> "list[Text]":
    """Return accuracies in per cent, each with its interval faint beside it, their points in line."""
    from rich.text import Text

    beside = ["" if a is None else "{:.0f}–{:.0f}".format(*(100 * end for end in a.interval)) for a in found]
    width = max(map(len, beside), default=0)
    return [
        Text()
        if accuracy is None
        else Text.assemble(f"{100 * accuracy.mean:.1f}", (f" {ends:>{width}}" * intervals, "not bold dim"))
        for accuracy, ends in zip(found, beside, strict=True)
    ]


def ms_column(found: Sequence[float | None]) -> list[str]:
    """Return milliseconds with as many decimals each, so that their points stand in line."""
    decimals = 2 if max((ms for ms in found if ms is not None), default=0.0) < 10 else 1
    return ["" if ms is None else f"{ms:.{decimals}f}" for ms in found]
