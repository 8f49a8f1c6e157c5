"""Building blocks of documents: headings, tables, figures, heat maps and notes, independent of the output.

A function builds a document from the values of a result, which are also saved as JSON. The terminal, Markdown
and HTML show the same document:

>>> import pandas as pd
>>> from texclass.reporting import Document, Finding, Heading, Table, render_markdown
>>> rows = pd.DataFrame({"Surface": ["oak", "felt"], "%": ["90.0 [82.6, 94.5]", ""], "ms": [1.5, None]})
>>> document = Document(
...     "toy, folds over recordings",
...     [Heading("Every surface"), Table(rows, "Accuracy.", bold_rows=[0], messages={1: "no taps"})],
...     finding=Finding("90.0", "%", "[82.6, 94.5]", "of the recordings are classified correctly."),
... )
>>> print(render_markdown(document))
# toy, folds over recordings
<BLANKLINE>
**90.0 %** [82.6, 94.5] of the recordings are classified correctly.
<BLANKLINE>
## Every surface
<BLANKLINE>
| Surface | % | ms |
|---|---:|---:|
| **oak** | **90.0** [82.6, 94.5] | **1.5** |
| felt | no taps |  |
<BLANKLINE>
Accuracy.
<BLANKLINE>

`print_document(document)` prints it on the terminal, `write_document(document, folder, stem)` writes Markdown
and figures, and `render_page([document, ...])` returns one HTML page without external files.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd


class Heading(str):
    """Heading of a section of a document.

    Examples
    --------
    >>> Heading("Confusion matrix")
    'Confusion matrix'
    """

    __slots__ = ()


@dataclass(frozen=True, eq=False)
class Table:
    """Table of text and numbers.

    Attributes
    ----------
    frame : DataFrame, or mapping of str to sequence
        Cells: strings, numbers (shown with three digits; pass strings to align decimal points), or None for
        an empty cell. The first column contains the row headers. Two-level columns are shown with two header
        lines. In a column of numbers, text in brackets after a number is its interval, which is shown in
        smaller type, and below the number on a narrow terminal.
    caption : str
        Explanation of the columns, shown below the table.
    n_words : int
        Number of text columns on the left (default 1). The remaining columns contain numbers.
    bold_rows : collection of int
        Indices of the rows in bold.
    messages : mapping of int to str
        Messages shown instead of values, by row index, for rows without values.
    n_narrow : int, optional
        Number of columns shown on a narrow terminal (default: all).

    Examples
    --------
    >>> Table({"Surface": ["oak", "cork"], "ms": [1.5, 2.0]}, "Latency.").caption
    'Latency.'
    """

    frame: "pd.DataFrame | Mapping[str, Sequence[Any]]"
    caption: str = ""
    n_words: int = 1
    bold_rows: Collection[int] = ()
    messages: Mapping[int, str] = field(default_factory=dict)
    n_narrow: int | None = None


@dataclass(frozen=True, eq=False)
class Figure:
    """Figure with a one-sentence summary, and optionally a table of the plotted values.

    Attributes
    ----------
    name : str
        Suffix of the file name.
    title : str
        Title of the figure.
    summary : str
        Sentence that states what the figure shows. It is the alternative text of the figure, and replaces it
        on a terminal.
    draw : callable
        Function that takes a width in inches and returns a new figure; see `figure_style`. It is
        called with two widths for an HTML page. If the gid of an artist is a sentence, the page shows the
        sentence when the artist is selected by keyboard or pointer.
    table : Table, optional
        The plotted values.

    Examples
    --------
    >>> from texclass.reporting import new_figure
    >>> figure = Figure("cost", "Latency", "Latency grows.", lambda width: new_figure(width, 2.0)[0])
    >>> float(figure.draw(4.0).get_figwidth())
    4.0
    """

    name: str
    title: str
    summary: str
    draw: "Callable[[float], matplotlib.figure.Figure]"
    table: Table | None = None


class Shade(NamedTuple):
    """Cell of a heat map.

    Attributes
    ----------
    colour : str
        "d1" to "d5" for good results, "e1" to "e5" for bad results, "" for no colour.
    text : str
        Text in the cell.
    description : str
        Text of the tooltip.

    Examples
    --------
    >>> Shade("d5", "9", "9 of 9 recordings").text
    '9'
    """

    colour: str = ""
    text: str = ""
    description: str = ""


@dataclass(frozen=True, eq=False)
class HeatMap:
    """Table of coloured cells, for example a confusion matrix.

    Attributes
    ----------
    name, title, summary, table
        See `Figure`.
    columns : mapping of str to str
        Explanation of each column (may be empty) by column title.
    rows : mapping of str to sequence of Shade
        Cells of each row, one per column, by row name.
    legend : mapping of str to str
        Meaning of colours. Each key contains the names of one or more colours, separated by spaces.
    empty_label : str
        Meaning of an empty cell.
    corner : str
        Title of the corner cell, for screen readers.
    separator : str
        Text between row name and column title in a tooltip.
    row_label, column_label : str
        Axis labels of the figure.

    Examples
    --------
    >>> heat = HeatMap("toy", "Toy", "One of two is correct.", {"oak": ""}, {"oak": [Shade("d5", "1")]})
    >>> heat.empty_label
    'none'
    """

    name: str
    title: str
    summary: str
    columns: Mapping[str, str]
    rows: Mapping[str, Sequence[Shade]]
    legend: Mapping[str, str] = field(default_factory=dict)
    empty_label: str = "none"
    corner: str = "Name"
    separator: str = ", "
    table: Table | None = None
    row_label: str = ""
    column_label: str = ""


@dataclass(frozen=True, eq=False)
class Details:
    """Collapsed blocks that open when their title is clicked. They are omitted on a terminal.

    Examples
    --------
    >>> Details("Versions", ["numpy 2.0"]).title
    'Versions'
    """

    title: str
    blocks: "Sequence[Block]"


Block = Heading | str | Sequence[str] | Mapping[str, str] | Table | Figure | HeatMap | Details
"""Block of a document: a string (paragraph), a sequence of strings (bullets), a mapping (list of facts), or
an instance of a class above.

Strings are plain text, with names of code between backticks.
"""


@dataclass(frozen=True)
class Finding:
    """Main number of a result, with the sentence that explains it.

    Attributes
    ----------
    value, unit, interval : str
        The number, its unit and its confidence interval.
    sentence : str
        Rest of the sentence that begins with the number.
    comparison : str
        Sentences that compare the number with other results.
    brief : str
        Short sentence for an overview of many results (default: `sentence`).

    Examples
    --------
    >>> finding = Finding("90.0", "%", "[82.6, 94.5]", "of the recordings are classified correctly.")
    >>> finding.number
    '90.0 %'
    """

    value: str
    unit: str
    interval: str
    sentence: str
    comparison: str = ""
    brief: str = ""

    @property
    def number(self) -> str:
        """Number with its unit."""
        return f"{self.value} {self.unit}".strip()

    @property
    def rest(self) -> str:
        """Text after the number: interval, sentence and comparison."""
        return " ".join(filter(None, (self.interval, self.sentence, self.comparison)))


@dataclass(frozen=True, eq=False)
class Document:
    """Document that shows one result.

    Attributes
    ----------
    title, subtitle : str
        Title, which states what was measured, and subtitle, which states how it was measured.
    blocks : sequence of blocks
        Content, in reading order.
    finding : Finding, optional
        Main number of the result.
    dataset : tuple of str and mapping, optional
        Name of the dataset, and facts about it. A page shows them once for all results on the same dataset.
    reproduction : mapping of str to str
        Facts that are needed to reproduce the result: pipeline, protocol, seed, hashes.
    versions : mapping of str to str
        Version of each package with which the result was computed.

    Examples
    --------
    >>> from texclass.reporting import render_markdown
    >>> print(render_markdown(Document("Latency", ["All rows take less than 1 ms."])))
    # Latency
    <BLANKLINE>
    All rows take less than 1 ms.
    <BLANKLINE>
    """

    title: str
    blocks: Sequence[Block]
    subtitle: str = ""
    finding: Finding | None = None
    dataset: tuple[str, Mapping[str, str]] | None = None
    reproduction: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
