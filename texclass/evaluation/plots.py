"""Plots on matplotlib axes: phases, feature values, confusion matrix and reliability.

Every function draws on `ax`, or on the axes of a new figure, and returns the axes. matplotlib is imported on
first use.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Phases, Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from texclass.evaluation.feature_table import FeatureTable


def axes_or_new(ax: "Axes | None", width: float = 8.0, height: float = 4.0) -> "Axes":
    """Return `ax`, or the axes of a new pyplot figure with this size in inches if `ax` is None."""
    if ax is not None:
        return ax
    from matplotlib import pyplot as plt

    return plt.subplots(figsize=(width, height), layout="constrained")[1]


def plot_phases(recording: Recording, phases: Phases | None = None, ax: "Axes | None" = None) -> "Axes":
    """Plot a recording with its taps and its movement.

    Parameters
    ----------
    recording : Recording
        Recording to plot. If it has several axes, they are projected on the direction of the largest changes.
    phases : Phases, optional
        Phases of the recording (default: `recording.phases`, or the result of `find_phases` if it is None).
    ax : matplotlib.axes.Axes, optional
        Axes to draw on (default: axes of a new figure).

    Returns
    -------
    matplotlib.axes.Axes
        The axes, with time in s and acceleration in the unit of the recording.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> recording = Recording(np.sin(np.arange(500.0)), fs=1000.0, unit="m/s^2")
    >>> ax = plot_phases(recording, Phases(movement=(100, 400)), Figure().add_subplot())
    >>> ax.get_xlabel()
    'time (s)'
    """
    from texclass.evaluation.inspection import draw_signal
    from texclass.evaluation.result_facts import main_direction
    from texclass.phases import find_phases

    ax = axes_or_new(ax, height=3.0)
    phases = phases or recording.phases or find_phases(recording)
    draw_signal(ax, main_direction(recording), recording, phases)
    return ax


def plot_features(table: "FeatureTable", column: str, ax: "Axes | None" = None) -> "Axes":
    """Plot the values of a feature column as one row of points per surface, with the median of each surface.

    Parameters
    ----------
    table : FeatureTable
        Feature table.
    column : str
        Name of a feature column.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on (default: axes of a new figure).

    Returns
    -------
    matplotlib.axes.Axes
        The axes. The surfaces are at y = 0, 1, ..., from top to bottom. Undefined values are omitted.

    Raises
    ------
    ValueError
        If the table has no such column.

    Examples
    --------
    >>> import pandas as pd
    >>> from matplotlib.figure import Figure
    >>> from texclass.evaluation import FeatureTable
    >>> frame = pd.DataFrame({"recording_id": ["a", "b"], "surface": ["oak", "cork"], "rms": [1.0, 2.0]})
    >>> ax = plot_features(FeatureTable(frame, ("rms",), np.zeros(2)), "rms", Figure().add_subplot())
    >>> [label.get_text() for label in ax.get_yticklabels()]
    ['cork', 'oak']
    """
    from texclass.reporting.figure_style import INK, OURS, label_rows

    if column not in table.columns:
        raise ValueError(
            f"unknown column {column!r}. Expected a feature column of the table, for example "
            f"{', '.join(table.columns[:5])}"
        )
    surfaces = np.unique(table.surfaces)
    ax = axes_or_new(ax, height=1.0 + 0.3 * len(surfaces))
    values = table.select([column])[:, 0]
    for y, surface in enumerate(surfaces):
        row = values[(table.surfaces == surface) & np.isfinite(values)]
        ax.plot(row, np.full(row.size, y), "o", color=OURS, alpha=0.5, label="recording")
        if row.size:
            ax.plot(np.median(row), y, "|", color=INK, markersize=14, label="median")
    label_rows(ax, surfaces.tolist(), column)
    return ax


def plot_confusion_matrix(confusion: Mapping[str, Any], ax: "Axes | None" = None) -> "Axes":
    """Plot a confusion matrix: true labels in rows, predicted labels in columns.

    Parameters
    ----------
    confusion : mapping
        `row`, `classifier`, `surfaces` and `counts` (rows: true labels), as in `BenchmarkResult.data`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on (default: axes of a new figure).

    Returns
    -------
    matplotlib.axes.Axes
        The axes. Each cell with a count above 0 contains the count as text.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> facts = {"row": "MFCC", "classifier": "lda", "surfaces": ["oak", "cork"]}
    >>> ax = plot_confusion_matrix(facts | {"counts": [[9, 1], [0, 10]]}, Figure().add_subplot())
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('Predicted label', 'True label')
    """
    from texclass.evaluation.benchmark_document import confusion_heat_map
    from texclass.reporting.figure_style import draw_cells

    n = len(confusion["surfaces"])
    ax = axes_or_new(ax, 2.6 + max(0.2 * n, 2.4), 1.8 + max(0.2 * n, 1.2))
    draw_cells(confusion_heat_map(confusion), ax)
    return ax


def plot_reliability(
    confidence: ArrayLike, hits: ArrayLike, n_bins: int = 10, ax: "Axes | None" = None
) -> "Axes":
    """Plot a reliability diagram: fraction of correct predictions against mean confidence in each bin.

    Parameters
    ----------
    confidence : array_like of shape (n_predictions,)
        Probability of each predicted class.
    hits : array_like of bool, shape (n_predictions,)
        Whether each prediction is correct.
    n_bins : int
        Number of bins of equal width (default 10). Empty bins are omitted.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on (default: axes of a new figure).

    Returns
    -------
    matplotlib.axes.Axes
        The axes. Points on the diagonal show perfect calibration, and points below it show overconfidence.

    Raises
    ------
    ValueError
        If the arrays are empty or have different lengths.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> ax = plot_reliability([0.75, 0.75, 0.75, 0.75], [1, 1, 1, 0], ax=Figure().add_subplot())
    >>> ax.lines[-1].get_xydata().tolist()
    [[0.75, 0.75]]
    """
    from texclass.reporting.figure_style import MUTED, OURS

    p, is_hit = np.asarray(confidence, dtype=np.float64), np.asarray(hits, dtype=np.float64)
    if p.size == 0 or p.shape != is_hit.shape:
        raise ValueError(
            "confidence and hits must have the same length and must not be empty, got shapes "
            f"{p.shape} and {is_hit.shape}"
        )
    bins = np.minimum((p * n_bins).astype(int), n_bins - 1)
    counts = np.bincount(bins, minlength=n_bins)
    is_filled = counts > 0
    means, rates = (
        np.bincount(bins, weights=values, minlength=n_bins)[is_filled] / counts[is_filled]
        for values in (p, is_hit)
    )
    ax = axes_or_new(ax, 4.5, 4.5)
    ax.plot([0, 1], [0, 1], ":", color=MUTED, label="perfect calibration")
    ax.plot(means, rates, "o-", color=OURS, label="predictions")
    ax.set(xlim=(0, 1), ylim=(0, 1), xlabel="Mean confidence", ylabel="Share of correct predictions")
    ax.set_aspect("equal")
    ax.legend(frameon=False)
    return ax
