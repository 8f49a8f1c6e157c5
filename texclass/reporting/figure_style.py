"""How figures look: one palette, which a page can exchange for a dark one, and rows of names."""

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
from texclass.reporting.blocks import Heat

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from texclass.reporting import blocks

PALETTE = {
    "ink": "#1a1e23", "muted": "#565f69", "grid": "#e7eaed", "paper": "#ffffff",
    "ours": "#0b5fae", "other": "#b3480c", "third": "#1b7a4b", "fourth": "#7a4a94", "faint": "#c6ced6",
    "d1": "#dfebf7", "d2": "#b5d2ec", "d3": "#82b3de", "d4": "#1f6fb8", "d5": "#0a4a86",
    "e1": "#fde3cf", "e2": "#fac29a", "e3": "#f39a5c", "e4": "#b54a0c", "e5": "#8a3206",
}  # fmt: skip
"""Name of a colour -> its value; a page shows whatever its variable of that name holds."""
INK, MUTED, GRID, PAPER, FAINT = (PALETTE[name] for name in ("ink", "muted", "grid", "paper", "faint"))
OURS, OTHER, THIRD, FOURTH = (PALETTE[name] for name in ("ours", "other", "third", "fourth"))
LOOKS = ((OURS, "o"), (OTHER, "s"), (THIRD, "D"), (FOURTH, "^"))
"""Colour and shape of each series."""
WIDTH, NARROW = 9.2, 4.4
"""Inches of a figure in a report and on a wide page; on a narrow one."""
ROW = 0.31
"""Inches of a row of `row_axes`."""
LONGEST = 54
"""Characters of a name in a figure; its table has all of it."""
DPI = 150
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
    """Return a figure of so many inches and its only axes."""
    figure = Drawing(figsize=(width, height), layout="constrained")
    return figure, figure.add_subplot()


def row_axes(width: float, names: Sequence[str], x_title: str, *, n_marks: int = 1) -> tuple[Drawing, "Axes"]:
    """Return a figure with a row for each name, the first at the top: row i is at y = i.

    A row is high enough for `n_marks` one below the other.
    The names stand at the left or, where the figure is narrow, each above its row.
    """
    narrow = width < WIDTH / 2
    height = ((1.4 if narrow else 1.0) + 0.3 * (n_marks - 1)) * ROW
    figure, axes = new_figure(width, 0.7 + 0.2 * n_marks + height * max(len(names), 1))
    shown = [shorten_middle(name, LONGEST) for name in names]
    axes.set_yticks(range(len(names)), [""] * len(names) if narrow else shown)
    axes.set_ylim(max(len(names), 1) - 0.5, -0.7 if narrow else -0.5)
    axes.set_xlabel(x_title)
    for y, name in enumerate(shown if narrow else ()):
        axes.text(0, y - 0.42, name, transform=axes.get_yaxis_transform(), fontsize=8, va="center")
    return figure, axes


def legend_above(figure: Drawing, axes: "Axes") -> None:
    """Draw the legend of one of the axes above all of them; of equal labels the last."""
    named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    per_row = int(13 * figure.get_figwidth() / (6 + max(map(len, named), default=0)))
    figure.legend(named.values(), named.keys(), loc="outside upper left", ncols=max(1, min(4, per_row)))


def per_cent_limits(lows: Sequence[float]) -> tuple[float, float]:
    """Return limits of an axis in per cent: from the ten below the least value to a little above 100."""
    low = min(90.0, 10 * float(np.floor(min(lows, default=0.0) / 10)))
    return low - (100 - low) / 50, 100 + (100 - low) / 50


def chance_line(draw: Callable[..., object], chance: float, low: float) -> None:
    """Draw the line of chance, in per cent, across axes that begin at `low`; out of sight, name it."""
    if low <= chance:
        draw(chance, color=MUTED, linewidth=1, linestyle=":", label=f"chance, {chance:.1f} %")
    else:
        draw(low, color="none", label=f"chance, {chance:.1f} %, is below")


def log_x(axes: "Axes") -> None:
    """Make the horizontal axis logarithmic, with round numbers at its ticks."""
    axes.set_xscale("log")
    _round_numbers(axes.xaxis, *axes.get_xlim())


def _round_numbers(axis: Any, low: float, high: float) -> None:
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def shorten_middle(name: str, longest: int) -> str:
    """Return a name that is not longer than `longest`, cut before its end, which tells names apart."""
    return name if len(name) <= longest else f"{name[: longest - 6]}\N{HORIZONTAL ELLIPSIS}{name[-5:]}"


def drawn(block: "blocks.Figure | Heat", width: float = WIDTH) -> Drawing:
    """Return the picture of a figure or of a heat map."""
    with mpl.rc_context(STYLE):
        return draw_heat(block) if isinstance(block, Heat) else block.draw(width)


def save_figure(figure: Drawing, path: str | Path, title: str = "") -> None:
    """Write a figure as PNG; its title, if it is given, stands above it, clear of any legend there."""
    with mpl.rc_context(STYLE):
        parts = [_pixels(figure)]
        if title:
            width = figure.get_figwidth()
            lines = fill(title, int(11 * width))
            strip = Drawing(figsize=(width, 0.12 + 0.19 * (1 + lines.count("\n"))))
            strip.text(0.01, 0.0, lines, va="bottom", fontsize=10, weight="bold")
            parts.insert(0, _pixels(strip))
    made = io.BytesIO()
    # In 256 colours, chosen so that none is far off: less than half the bytes.
    picture = Image.fromarray(np.vstack(parts)).convert("RGB")
    picture = picture.quantize(method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    picture.save(made, format="png", optimize=True, dpi=(DPI, DPI))
    write_atomic(path, made.getvalue())


def _pixels(figure: Drawing) -> Any:
    for axes in figure.axes:
        for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            # Left to itself it writes formulas, which stand as $...$ where names may hold a dollar.
            if isinstance(axis.get_major_formatter(), LogFormatter):
                _round_numbers(axis, *sorted(limits))
    figure.set_dpi(DPI)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def draw_heat(heat: Heat) -> Drawing:
    """Draw a heat map; its names are readable up to some hundred."""
    n, m = len(heat.rows), len(heat.columns)
    font = 7 if n <= 84 else 5
    figure, axes = new_figure(2.6 + max(0.2 * m, 2.4), 1.8 + max(0.2 * n, 1.2))
    colours = {look: mpl.colors.to_rgb(PALETTE.get(look, "white")) for look in ("", *PALETTE)}
    axes.imshow([[colours[shade.look] for shade in row] for row in heat.rows.values()], aspect="auto")
    axes.set_xticks(range(m), list(heat.columns), rotation=90, fontsize=font)
    axes.set_yticks(range(n), [shorten_middle(name, LONGEST) for name in heat.rows], fontsize=font)
    axes.set_xticks(np.arange(m + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(n + 1) - 0.5, minor=True)
    axes.grid(visible=False, which="major")
    axes.grid(which="minor")
    for i, row in enumerate(heat.rows.values()):
        for j, shade in enumerate(row):
            if not shade.sign:
                continue
            colour = "white" if shade.look[1:] in {"4", "5"} else INK
            axes.text(j, i, shade.sign, ha="center", va="center", fontsize=font, color=colour)
    axes.xaxis.tick_top()
    return figure
