"""Style of all figures: palette, sizes, axes with named rows, and PNG output."""

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import LogFormatter, LogLocator, NullLocator
from PIL import Image

from texclass.atomic_write import write_atomic
from texclass.reporting.blocks import HeatMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from texclass.reporting import blocks

PALETTE = {
    "ink": "#1a1e23", "muted": "#565f69", "grid": "#e7eaed", "paper": "#ffffff",
    "ours": "#0b5fae", "other": "#b3480c", "third": "#1b7a4b", "fourth": "#7a4a94", "faint": "#c6ced6",
    "d1": "#dfebf7", "d2": "#b5d2ec", "d3": "#82b3de", "d4": "#1f6fb8", "d5": "#0a4a86",
    "e1": "#fde3cf", "e2": "#fac29a", "e3": "#f39a5c", "e4": "#b54a0c", "e5": "#8a3206",
}  # fmt: skip
"""Colour values by name. HTML pages replace them with CSS variables of these names for the dark theme."""
INK, MUTED, GRID, PAPER, FAINT = (PALETTE[name] for name in ("ink", "muted", "grid", "paper", "faint"))
OURS, OTHER, THIRD, FOURTH = (PALETTE[name] for name in ("ours", "other", "third", "fourth"))
LOOKS = ((OURS, "o"), (OTHER, "s"), (THIRD, "D"), (FOURTH, "^"))
"""Colour and marker of each series."""
WIDTH, NARROW = 9.2, 4.4
"""Figure width in inches in reports and on wide pages, and on narrow pages."""
ROW = 0.31
"""Height of a row of `row_axes` in inches."""
MAX_NAME_LENGTH = 54
"""Largest number of characters of a name in a figure; longer names are shortened."""
DPI = 150
"""Resolution of PNG files in dots per inch."""
STYLE: Any = {
    "font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9, "legend.fontsize": 9,
    "xtick.labelsize": 9, "ytick.labelsize": 9, "figure.titlesize": 10,
    "text.color": INK, "axes.labelcolor": MUTED, "xtick.labelcolor": INK, "ytick.labelcolor": INK,
    "axes.edgecolor": GRID, "xtick.color": GRID, "ytick.color": GRID, "figure.titleweight": "bold",
    "axes.facecolor": "none", "axes.grid": True, "axes.axisbelow": True,
    "grid.color": GRID, "grid.linewidth": 0.8,
    "axes.spines.top": False, "axes.spines.right": False, "axes.spines.left": False,
    "axes.spines.bottom": False,
    "xtick.major.size": 0, "ytick.major.size": 0, "xtick.minor.size": 0, "ytick.minor.size": 0,
    "legend.frameon": False, "legend.handletextpad": 0.4, "axes.titlelocation": "left",
    "lines.linewidth": 1.5,
    "text.parse_math": False, "svg.fonttype": "none", "svg.hashsalt": "texclass", "axes.unicode_minus": True,
}  # fmt: skip


def new_figure(width: float, height: float) -> tuple[Drawing, "Axes"]:
    """Return a new figure and its axes.

    Parameters
    ----------
    width, height : float
        Size in inches.

    Examples
    --------
    >>> figure, axes = new_figure(4.0, 3.0)
    >>> float(figure.get_figwidth())
    4.0
    """
    figure = Drawing(figsize=(width, height), layout="constrained")
    return figure, figure.add_subplot()


def row_axes(width: float, names: Sequence[str], x_title: str, *, n_marks: int = 1) -> tuple[Drawing, "Axes"]:
    """Return a figure with one row per name, from top to bottom, and its axes. Row i is at y = i.

    Parameters
    ----------
    width : float
        Width in inches. In a narrow figure, each name is above its row; otherwise, it is on the left.
    names : sequence of str
        Names of the rows.
    x_title : str
        Label of the x axis.
    n_marks : int
        Number of marks that are drawn one above the other in each row (default 1).
    """
    is_narrow = width < WIDTH / 2
    height = ((1.4 if is_narrow else 1.0) + 0.3 * (n_marks - 1)) * ROW
    figure, axes = new_figure(width, 0.7 + 0.2 * n_marks + height * max(len(names), 1))
    label_rows(axes, names, x_title, above=is_narrow)
    return figure, axes


def label_rows(axes: "Axes", names: Sequence[str], x_title: str, *, above: bool = False) -> None:
    """Label the rows at y = 0, 1, ... with names, from top to bottom.

    Parameters
    ----------
    axes : Axes
        Axes to label.
    names : sequence of str
        Names of the rows.
    x_title : str
        Label of the x axis.
    above : bool
        Whether to write each name above its row instead of on the left (default False).
    """
    labels = [shorten_middle(name, MAX_NAME_LENGTH) for name in names]
    axes.set_yticks(range(len(names)), [""] * len(names) if above else labels)
    axes.set_ylim(max(len(names), 1) - 0.5, -0.7 if above else -0.5)
    axes.set_xlabel(x_title)
    for y, name in enumerate(labels if above else ()):
        axes.text(0, y - 0.42, name, transform=axes.get_yaxis_transform(), fontsize=8, va="center")


def legend_above(figure: Drawing, axes: "Axes") -> None:
    """Draw a legend above the axes, in which each label occurs only once."""
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    n_columns = int(13 * figure.get_figwidth() / (6 + max(map(len, handles), default=0)))
    figure.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=max(1, min(4, n_columns)))


def per_cent_limits(lows: Sequence[float]) -> tuple[float, float]:
    """Return axis limits in per cent, from a multiple of 10 below the smallest value to just above 100."""
    low = min(90.0, 10 * float(np.floor(min(lows, default=0.0) / 10)))
    return low - (100 - low) / 50, 100 + (100 - low) / 50


def chance_line(draw: Callable[..., object], chance: float, low: float) -> None:
    """Draw the chance level (in per cent). If it is below the axis limit `low`, add only a legend entry."""
    if low <= chance:
        draw(chance, color=MUTED, linewidth=1, linestyle=":", label=f"chance, {chance:.1f} %")
    else:
        draw(low, color="none", label=f"chance, {chance:.1f} %, is below")


def log_x(axes: "Axes") -> None:
    """Make the x axis logarithmic, with round numbers as tick labels."""
    axes.set_xscale("log")
    _round_numbers(axes.xaxis, *axes.get_xlim())


def _round_numbers(axis: Any, low: float, high: float) -> None:
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def shorten_middle(name: str, max_length: int) -> str:
    """Shorten a name to `max_length` characters. Keep its last five, because names often differ there."""
    return name if len(name) <= max_length else f"{name[: max_length - 6]}\N{HORIZONTAL ELLIPSIS}{name[-5:]}"


def draw_block(block: "blocks.Figure | HeatMap", width: float = WIDTH) -> Drawing:
    """Draw a figure or a heat map block in the style of the reports."""
    with mpl.rc_context(STYLE):
        return draw_heat(block) if isinstance(block, HeatMap) else block.draw(width)


def save_figure(figure: Drawing, path: str | Path, title: str = "") -> None:
    """Write a figure as PNG.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure to write.
    path : str or path
        PNG file.
    title : str
        Title above the figure and its legend (default: no title).

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_figure(new_figure(1.0, 1.0)[0], Path(folder, "empty.png"))
    ...     print(Path(folder, "empty.png").stat().st_size > 0)
    True
    """
    with mpl.rc_context(STYLE):
        parts = [_pixels(figure)]
        if title:
            width = figure.get_figwidth()
            lines = fill(title, int(11 * width))
            strip = Drawing(figsize=(width, 0.12 + 0.19 * (1 + lines.count("\n"))))
            strip.text(0.01, 0.0, lines, va="bottom", fontsize=10, weight="bold")
            parts.insert(0, _pixels(strip))
    buffer = io.BytesIO()
    # A palette of 256 colours halves the file size.
    picture = Image.fromarray(np.vstack(parts)).convert("RGB")
    picture = picture.quantize(method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    picture.save(buffer, format="png", optimize=True, dpi=(DPI, DPI))
    write_atomic(path, buffer.getvalue())


def _pixels(figure: Drawing) -> Any:
    for axes in figure.axes:
        for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            # The default formatter writes math text between dollar signs, which `STYLE` disables.
            if isinstance(axis.get_major_formatter(), LogFormatter):
                _round_numbers(axis, *sorted(limits))
    figure.set_dpi(DPI)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def draw_heat(heat: HeatMap) -> Drawing:
    """Draw a heat map. The names of its rows are readable up to about 100 rows."""
    n, m = len(heat.rows), len(heat.columns)
    font = 7 if n <= 84 else 5
    figure, axes = new_figure(2.6 + max(0.2 * m, 2.4), 1.8 + max(0.2 * n, 1.2))
    draw_cells(heat, axes, font)
    return figure


def draw_cells(heat: HeatMap, axes: "Axes", font: float = 7) -> None:
    """Draw the cells, names and axis labels of a heat map on axes. The font size is `font` points."""
    n, m = len(heat.rows), len(heat.columns)
    colours = {name: mpl.colors.to_rgb(PALETTE.get(name, "white")) for name in ("", *PALETTE)}
    axes.imshow([[colours[shade.colour] for shade in row] for row in heat.rows.values()], aspect="auto")
    axes.set_xticks(range(m), list(heat.columns), rotation=90, fontsize=font)
    axes.set_yticks(range(n), [shorten_middle(name, MAX_NAME_LENGTH) for name in heat.rows], fontsize=font)
    axes.set_xticks(np.arange(m + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(n + 1) - 0.5, minor=True)
    axes.grid(visible=False, which="major")
    axes.grid(which="minor")
    for i, row in enumerate(heat.rows.values()):
        for j, shade in enumerate(row):
            if not shade.text:
                continue
            colour = "white" if shade.colour[1:] in {"4", "5"} else INK
            axes.text(j, i, shade.text, ha="center", va="center", fontsize=font, color=colour)
    axes.xaxis.tick_top()
    axes.xaxis.set_label_position("top")
    axes.set(xlabel=heat.column_label, ylabel=heat.row_label)
