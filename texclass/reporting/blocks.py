"""Building blocks of documents: headings, tables, figures, heat maps and notes, independent of the output.

A function builds a document from the values of a result, the same values that are saved as JSON. The
terminal, Markdown and HTML show the same document:

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
    """Table of texts and numbers.

    Attributes
    ----------
    frame : DataFrame, or mapping of str to sequence
        Cells: texts, numbers (shown with three digits; pass texts to align decimal points), None for an empty
        cell. The first column contains the row headers. Two-level columns get two header lines. In a column
        of numbers, text in brackets after a number is its interval: it is set smaller, and below the number
        on a narrow terminal.
    caption : str
        Meaning of the columns; shown below the table.
    n_words : int
        Number of text columns, at the left (default 1). The others contain numbers.
    bold_rows : collection of int
        Indices of the rows in bold.
    messages : mapping of int to str
        Row index -> message shown instead of the values, where a row has none.
    n_narrow : int, optional
        Number of columns shown on a narrow terminal; all by default.

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
    """Figure, with its statement in one sentence and its values as a table.

    Attributes
    ----------
    name : str
        End of the file name.
    title : str
        Title of the figure.
    summary : str
        What the figure shows, in one sentence: the alternative text, and its replacement on a terminal.
    draw : callable
        Function that takes a width in inches and returns a new figure; see `figure_style`. An HTML page asks
        for two widths. An artist whose gid is a sentence can be selected by keyboard and pointer, and shows
        that sentence.
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
        "d1" to "d5" for good, "e1" to "e5" for bad; "" for none.
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
        As in `Figure`.
    columns : mapping of str to str
        Column title -> its meaning, or "".
    rows : mapping of str to sequence of Shade
        Row name -> one cell per column.
    legend : mapping of str to str
        Colours, separated by spaces -> their meaning.
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
    """Blocks behind a title that opens on a click; the terminal omits them.

    Examples
    --------
    >>> Details("Versions", ["numpy 2.0"]).title
    'Versions'
    """

    title: str
    blocks: "Sequence[Block]"


Block = Heading | str | Sequence[str] | Mapping[str, str] | Table | Figure | HeatMap | Details
"""A heading, a text (paragraph), a sequence of texts (bullets), a mapping (list of facts), or a class above.

Texts are plain; names of code are between backticks.
"""


@dataclass(frozen=True)
class Finding:
    """Main number of a result, with the sentence that explains it.

    Attributes
    ----------
    value, unit, interval : str
        The number, its unit and its confidence interval.
    sentence : str
        Sentence that continues after the number.
    comparison : str
        Sentences that compare the number with others.
    brief : str
        Short sentence for an overview of many results; `sentence` by default.

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
        """Number with unit."""
        return f"{self.value} {self.unit}".strip()

    @property
    def rest(self) -> str:
        """Interval, sentence and comparison."""
        return " ".join(filter(None, (self.interval, self.sentence, self.comparison)))


@dataclass(frozen=True, eq=False)
class Document:
    """Document that shows one result.

    Attributes
    ----------
    title, subtitle : str
        What was measured, and how.
    blocks : sequence of blocks
        Content, in reading order.
    finding : Finding, optional
        Main number.
    dataset : tuple of str and mapping, optional
        Name and facts of the dataset. A page shows them once for all results on the same dataset.
    reproduction : mapping of str to str
        What is needed to reproduce the result: pipeline, protocol, seed, hashes.
    versions : mapping of str to str
        Package -> version that computed the result.

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
