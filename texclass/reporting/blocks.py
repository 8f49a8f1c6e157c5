"""What a document is made of: whoever has a result builds these, and knows nothing of how they are shown.

A document is built beside its result, from the same dict that is saved as JSON, and shown anywhere:

>>> import pandas as pd
>>> from texclass.reporting import Document, Finding, Heading, Table, render_markdown
>>> rows = pd.DataFrame({"Surface": ["oak", "felt"], "%": ["90.0 [82.6, 94.5]", ""], "ms": [1.5, None]})
>>> document = Document(
...     "toy, folds over recordings",
...     [Heading("Every surface"), Table(rows, "Accuracy.", strong=[0], instead={1: "no taps"})],
...     finding=Finding("90.0", "%", "[82.6, 94.5]", "of the recordings are recognised."),
... )
>>> print(render_markdown(document))
# toy, folds over recordings
<BLANKLINE>
**90.0 %** [82.6, 94.5] of the recordings are recognised.
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

`print_document(document)` shows it on the terminal, `write_document(document, folder, stem)` writes Markdown
and pictures, `render_page([document, ...])` returns an HTML page that holds all it shows.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas as pd


class Heading(str):
    """The title of what follows within a document."""

    __slots__ = ()


@dataclass(frozen=True, eq=False)
class Table:
    """A table.

    Attributes
    ----------
    frame : DataFrame, or mapping of str to sequence
        The cells: texts, numbers (shown to three digits; give texts where points are to stand in line), None
        for an empty one. The first column heads its rows. Columns of two levels are titled in two lines. In a
        column of numbers, what follows a number in brackets is its interval, which is set smaller, and
        below it on a narrow terminal.
    caption : str
        What the columns mean; below the table.
    n_words : int
        Columns of words, at the left; the others are numbers.
    strong : collection of int
        Rows that stand out.
    instead : mapping of int to str
        Row -> what is said in place of its values, of which there are none.
    n_kept : int, optional
        Columns that a narrow terminal shows; all by default.
    """

    frame: "pd.DataFrame | Mapping[str, Sequence[Any]]"
    caption: str = ""
    n_words: int = 1
    strong: Collection[int] = ()
    instead: Mapping[int, str] = field(default_factory=dict)
    n_kept: int | None = None


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture, and the same as numbers.

    Attributes
    ----------
    name : str
        Ends the name of its file.
    title : str
        What it shows.
    says : str
        What it says, in a sentence: to who does not see it, and where no picture can be shown.
    draw : callable
        Draws it on a new figure of the given width in inches; see `figure_style`. A page asks for two widths.
        An artist whose gid is a sentence can be reached by keys and pointer, and says it.
    table : Table, optional
        The same as numbers.
    """

    name: str
    title: str
    says: str
    draw: "Callable[[float], matplotlib.figure.Figure]"
    table: Table | None = None


class Shade(NamedTuple):
    """A cell of a heat map: its colour ("d1" to "d5" good, "e1" to "e5" bad), its sign, and what it says."""

    look: str = ""
    sign: str = ""
    says: str = ""


@dataclass(frozen=True, eq=False)
class Heat:
    """A table of colours, as a confusion matrix.

    Attributes
    ----------
    name, title, says, table
        As those of a `Figure`.
    columns : mapping of str to str
        Title -> what it stands for, if that has to be said.
    rows : mapping of str to sequence of Shade
        Name -> one shade for each column.
    legend : mapping of str to str
        Looks, separated by spaces -> what they mean.
    empty : str
        What an empty shade means.
    corner : str
        What the rows are.
    between : str
        Joins the names of row and column, before what their shade says.
    """

    name: str
    title: str
    says: str
    columns: Mapping[str, str]
    rows: Mapping[str, Sequence[Shade]]
    legend: Mapping[str, str] = field(default_factory=dict)
    empty: str = "none"
    corner: str = "Name"
    between: str = ", "
    table: Table | None = None


@dataclass(frozen=True, eq=False)
class Folded:
    """Blocks behind a title, for those who look for them; a terminal leaves them out."""

    title: str
    blocks: "Sequence[Block]"


Block = Heading | str | Sequence[str] | Mapping[str, str] | Table | Figure | Heat | Folded
"""A heading; a text (a paragraph); a sequence of texts (notes); a mapping (facts); or one of the above.

Texts are plain, with names of code between backticks.
"""


@dataclass(frozen=True)
class Finding:
    """The key message.

    Attributes
    ----------
    value, unit, interval : str
        The number.
    sentence : str
        Goes on from it: of what, by what, under which protocol.
    beside : str
        What it is compared with, in sentences of its own.
    brief : str
        The sentence for an overview of many results; all of it by default.
    """

    value: str
    unit: str
    interval: str
    sentence: str
    beside: str = ""
    brief: str = ""

    @property
    def number(self) -> str:
        """The number with its unit."""
        return f"{self.value} {self.unit}".strip()

    @property
    def rest(self) -> str:
        """All that follows the number."""
        return " ".join(filter(None, (self.interval, self.sentence, self.beside)))


@dataclass(frozen=True, eq=False)
class Document:
    """A result that can be shown.

    Attributes
    ----------
    title, subtitle : str
        What was measured; how.
    blocks : sequence of blocks
        What it rests on, in the order of reading.
    finding : Finding, optional
        The key message.
    data : tuple of str and mapping, optional
        Name and facts of what was measured on; a page tells it once for all results that share it.
    again : mapping of str to str
        What is needed to compute it again.
    versions : mapping of str to str
        Package -> version that computed it.
    """

    title: str
    blocks: Sequence[Block]
    subtitle: str = ""
    finding: Finding | None = None
    data: tuple[str, Mapping[str, str]] | None = None
    again: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
