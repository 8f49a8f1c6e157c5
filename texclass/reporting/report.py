"""Write what a benchmark found into a folder: JSON, Markdown and pictures."""

from pathlib import Path
from typing import TYPE_CHECKING

from texclass.experiment.result import BenchmarkResult
from texclass.reporting.figures import draw_confusion, draw_ranking, draw_table
from texclass.reporting.gains import draw_gains
from texclass.reporting.tables import markdown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 150


def stem_of(result: BenchmarkResult) -> str:
    """Return what the names of a report's files begin with."""
    return f"{result.dataset['name']}-{result.pipeline}-{result.protocol}"


def write_report(result: BenchmarkResult, folder: str | Path) -> tuple[Path, ...]:
    """Write a benchmark's report.

    Parameters
    ----------
    result : BenchmarkResult
        What was found.
    folder : str or path
        Made if it does not exist. Files are named dataset-pipeline-protocol, so reports lie side by side.

    Returns
    -------
    tuple of Path
        The files: JSON, Markdown, the table and the ranking as PNG, and, if any row could be computed, the
        confusion matrix of the best one and what the pipeline's additions add.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    stem = stem_of(result)
    texts = {f"{stem}.json": result.to_json(), f"{stem}.md": markdown(result)}
    figures = {f"{stem}-table.png": draw_table(result), f"{stem}-ranking.png": draw_ranking(result)}
    if result.confusion is not None:
        figures[f"{stem}-confusion.png"] = draw_confusion(result.confusion)
    if result.gains is not None:
        figures[f"{stem}-gains.png"] = draw_gains(result.gains)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name, figure in figures.items():
        save_figure(figure, folder / name)
    return tuple(folder / name for name in (*texts, *figures))


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure as PNG."""
    # Without the library's version in it, an unchanged picture is an unchanged file.
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
