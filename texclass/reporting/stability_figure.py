"""The battery of extreme inputs as one picture: subjects by families, what is wrong standing out."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from texclass.reporting.figures import INCHES_PER_ROW, INK
from texclass.stability.result import StabilityResult
from texclass.stability.signals import FAMILIES
from texclass.stability.verdict import BAD, Mark

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#ffffff", "#e4ebf2", "#b9d3ec", "#7fb0dc", "#d2691e")
MEANINGS = ("not tried", "refused with a reason", "right, some refused", "all right", "wrong (how many)")


def draw_stability(result: StabilityResult) -> "Figure":
    """Draw what became of every subject on every family of inputs, ours first."""
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    names, families, level, bad = _levels(result)
    figure = Figure(figsize=(10.5, 2.2 + 0.6 * INCHES_PER_ROW * len(names)), layout="constrained")
    axes = figure.add_subplot()
    axes.pcolormesh(level, cmap=ListedColormap(COLOURS), vmin=-0.5, vmax=4.5, edgecolors="white", linewidth=1)
    for i, j in np.argwhere(bad > 0):
        axes.text(j + 0.5, i + 0.5, str(bad[i, j]), ha="center", va="center", fontsize=6.5, color="white")
    axes.set_xticks(np.arange(len(families)) + 0.5, families, rotation=90, fontsize=8)
    axes.set_yticks(np.arange(len(names)) + 0.5, names, fontsize=7)
    axes.xaxis.tick_top()
    axes.invert_yaxis()
    axes.tick_params(length=0, colors=INK)
    axes.spines[:].set_visible(False)
    handles = [
        Patch(facecolor=c, edgecolor="#888888", label=m) for c, m in zip(COLOURS, MEANINGS, strict=True)
    ]
    figure.legend(handles=handles, loc="outside lower left", ncols=len(handles), fontsize=8, frameon=False)
    title = f"texclass: {len(result.wrong)} of {len(result.ours):,} cells wrong"
    figure.suptitle(title, fontsize=10, x=0.01, ha="left", weight="bold")
    return figure


def _levels(result: StabilityResult) -> tuple[list[str], list[str], NDArray[np.intp], NDArray[np.intp]]:
    """Return subjects, families, the index into `COLOURS` of each pair, and how many are wrong."""
    marks: dict[tuple[str, str], list[Mark]] = {}
    for cell in result.cells:
        name = cell.subject if cell.library == "texclass" else f"{cell.library}: {cell.subject}"
        marks.setdefault((name, cell.family), []).append(cell.mark)
    names = list(dict.fromkeys(name for name, _ in marks))
    families = [family for family in FAMILIES if any(known == family for _, known in marks)]
    found = [[marks.get((name, family), []) for family in families] for name in names]
    level = np.array([[_level(cells) for cells in row] for row in found])
    bad = np.array([[sum(mark in BAD for mark in cells) for cells in row] for row in found])
    return names, families, level, bad


def _level(marks: list[Mark]) -> int:
    if not marks:
        return 0
    if any(mark in BAD for mark in marks):
        return 4
    refused = sum(mark in (Mark.DOCUMENTED, Mark.REFUSED) for mark in marks)
    return 3 if not refused else 1 if refused == len(marks) else 2
