"""What the table of a benchmark says in each place, for whoever draws it."""

from typing import NamedTuple

from texclass.experiment.accuracy import Accuracy
from texclass.experiment.result import BenchmarkResult, RowResult
from texclass.reporting.words import short_title_of, title_of


class Line(NamedTuple):
    """A line of the table: its titles, or a row.

    Attributes
    ----------
    name, n_features
        The row and its columns at the classifier.
    ours
        One text a classifier.
    paper
        The published figures as one text; empty where the table publishes nothing, so that it has no such
        column.
    ms
        Time of the features.
    """

    name: str
    n_features: str
    ours: tuple[str, ...]
    paper: tuple[str, ...]
    ms: str

    @property
    def texts(self) -> tuple[str, ...]:
        """All cells in the order of the columns."""
        return (self.name, self.n_features, *self.ours, *self.paper, self.ms)


def header(result: BenchmarkResult) -> Line:
    """Return the titles of the columns."""
    ours = tuple(f"{title_of(name)} % [95 %]" for name in result.classifiers)
    paper = (f"Paper % ({paper_order(result)})",) if published(result) else ()
    return Line("Row", "Dim", ours, paper, "ms")


def cells(result: BenchmarkResult, row: RowResult) -> Line:
    """Return one row; in place of the first accuracy, a missing row says what it lacks."""
    ours = tuple(accuracy_cell(row.accuracy.get(name)) for name in result.classifiers)
    if not row.accuracy:
        ours = (row.missing or "", *ours[1:])
    return Line(row.name, str(row.n_features), ours, paper_cell(result, row, " / "), ms_cell(row))


def published(result: BenchmarkResult) -> tuple[str, ...]:
    """Return the classifiers of which some row has a published figure."""
    return tuple(name for name in result.classifiers if any(name in row.published for row in result.rows))


def paper_order(result: BenchmarkResult) -> str:
    """Return whose figures stand in the column of the paper, in its order."""
    return " / ".join(map(short_title_of, published(result)))


def paper_cell(result: BenchmarkResult, row: RowResult, between: str) -> tuple[str, ...]:
    """Return the published figures of a row as one text; no text where the table has no such column."""
    names = published(result)
    if not names:
        return ()
    figures = (f"{row.published[name]:.0f}" if name in row.published else "-" for name in names)
    return (between.join(figures) if row.published else "",)


def accuracy_cell(accuracy: Accuracy | None) -> str:
    """Return an accuracy with its interval, in per cent."""
    if accuracy is None:
        return ""
    low, high = accuracy.interval
    return f"{100 * accuracy.mean:.1f} [{100 * low:.1f}, {100 * high:.1f}]"


def ms_cell(row: RowResult) -> str:
    """Return the milliseconds of a row's features."""
    return "" if row.ms_per_recording is None else f"{row.ms_per_recording:.3g}"
