"""What a section of the page is made of: tables, figures, a confusion matrix, a heat map, facts and notes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from texclass.reporting.page.svg import Picture


@dataclass(frozen=True)
class Cell:
    """A cell of a table: text, what stands small beside it, and how it is set.

    Attributes
    ----------
    text, beside
        The value; its interval.
    is_number
        Aligned right, with figures of one width.
    is_heading
        Heads its row.
    span
        Columns it covers.
    link
        Id of the part of the page it leads to.
    """

    text: str
    beside: str = ""
    is_number: bool = False
    is_heading: bool = False
    span: int = 1
    link: str = ""


@dataclass(frozen=True)
class Row:
    """A row of a table; a strong one is the best, a faint one has no values."""

    cells: tuple[Cell, ...]
    strong: bool = False
    faint: bool = False


@dataclass(frozen=True)
class Head:
    """The title of a column, or of the columns of a group."""

    text: str
    span: int = 1
    is_number: bool = True
    rows: int = 1


@dataclass(frozen=True)
class Table:
    """A table with its caption; `heads` are one or two lines of titles."""

    caption: str
    heads: tuple[tuple[Head, ...], ...]
    rows: tuple[Row, ...]
    caption_hidden: bool = False
    kind: str = "table"


@dataclass(frozen=True)
class Figure:
    """A picture.

    Attributes
    ----------
    title
        What it shows.
    alternative
        What it says, in words.
    picture
        It.
    legend
        (class, shape, meaning) of each kind of mark.
    axis
        Title of the vertical axis, written above it.
    table
        The same as numbers.
    gutter
        Whether row labels stand at the left.
    """

    title: str
    alternative: str
    picture: Picture
    table: Table
    legend: tuple[tuple[str, str, str], ...] = ()
    axis: str = ""
    gutter: bool = False
    kind: str = "figure"


@dataclass(frozen=True)
class Panels:
    """Small figures side by side."""

    figures: tuple[Figure, ...]
    kind: str = "panels"


@dataclass(frozen=True)
class Matrix:
    """A confusion matrix.

    Attributes
    ----------
    title, alternative, names, counts
        Row i: tests of material i; column j: taken for material j.
    tested
        What is counted: "recordings" or "windows".
    table
        The confusions as a list.
    """

    title: str
    alternative: str
    names: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]
    tested: str
    table: Table
    kind: str = "matrix"

    def tint(self, i: int, j: int) -> str:
        """Return the class of a cell: d or e (right or wrong) and a fifth of its row; "" where empty."""
        count, total = self.counts[i][j], sum(self.counts[i])
        if count == 0:
            return ""
        return f"{'d' if i == j else 'e'}{max(1, -(-5 * count // total))}"


@dataclass(frozen=True)
class Shade:
    """A cell of a heat map: its class (colour), what it shows, and what that means in words."""

    look: str = ""
    sign: str = ""
    says: str = ""


@dataclass(frozen=True)
class Heat:
    """A heat map, which is a table: one row a name, one shade a column.

    Attributes
    ----------
    caption
        What it shows, and what its signs mean.
    columns : tuple of (str, str)
        Title, and what it stands for.
    rows : tuple of (str, tuple of Shade)
        Name, and one shade for each column.
    """

    caption: str
    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, tuple[Shade, ...]], ...]
    kind: str = "heat"


@dataclass(frozen=True)
class Notes:
    """What a reader must know, one sentence a note."""

    lines: tuple[str, ...]
    kind: str = "notes"


@dataclass(frozen=True)
class Heading:
    """The title of what follows within a section."""

    text: str
    kind: str = "heading"


@dataclass(frozen=True)
class Folded:
    """A table behind its title, for those who look for it."""

    title: str
    table: Table
    kind: str = "folded"


Block = Table | Figure | Panels | Matrix | Heat | Notes | Heading | Folded


@dataclass(frozen=True)
class Finding:
    """The key message of a section.

    Attributes
    ----------
    value, unit, interval
        The number.
    sentence
        Goes on from it: of what, by what, under which protocol.
    beside
        What it is compared with.
    brief
        A line for the overview of all results.
    """

    value: str
    unit: str
    interval: str
    sentence: str
    beside: str = ""
    brief: str = ""


@dataclass(frozen=True)
class Section:
    """One result on the page.

    Attributes
    ----------
    title, subtitle
        What was measured; how.
    finding
        The key message.
    blocks
        What it rests on.
    """

    title: str
    subtitle: str
    finding: Finding
    blocks: tuple[Block, ...] = field(default=())


def number(text: str, beside: str = "") -> Cell:
    """Return a cell with a number."""
    return Cell(text, beside, is_number=True)


def heading(text: str, link: str = "") -> Cell:
    """Return a cell that heads its row."""
    return Cell(text, is_heading=True, link=link)


def simple_table(
    caption: str,
    titles: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    n_text: int = 1,
    hidden: bool = True,
) -> Table:
    """Return a table of texts: the first `n_text` columns are words, the others numbers."""
    heads = tuple(Head(title, is_number=i >= n_text) for i, title in enumerate(titles))
    body = tuple(
        Row(
            (heading(row[0]), *(Cell(text, is_number=i >= n_text) for i, text in enumerate(row[1:], start=1)))
        )
        for row in rows
    )
    return Table(caption, (heads,), body, caption_hidden=hidden)
