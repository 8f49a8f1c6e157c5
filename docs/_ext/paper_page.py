"""Generate the page on the equations, tables and figures of the five papers, from `docs/papers.csv`."""

from collections import Counter
from pathlib import Path

import pandas as pd
from feature_pages import heading, list_table

CONTENTS = Path(__file__).parents[1] / "papers.csv"
TITLES = {
    "strese2015": "Strese, Schuwerk, Steinbach: Surface classification using acceleration signals recorded "
    "during human freehand movement, 2015",
    "guruswamy2011": "Guruswamy, Lang, Lee: IIR filter models of haptic vibration textures, 2011",
    "abdulali2016": "Abdulali, Jeon: Data-driven modeling of anisotropic haptic textures, 2016",
    "oeztuerk2018": "Öztürk: Refined methods for creating tactile signals considering speed dependency, 2018",
    "okamura2001": "Okamura, Cutkosky, Dennerlein: Reality-based models for vibration feedback in virtual "
    "environments, 2001",
}
STATUSES = {
    "as printed": "the code computes the printed formula, or the figure shows what it shows in the paper",
    "corrected": "the printed formula has an error or a gap; the reason states the difference",
    "deviates": "another method or other data, such as simulated recordings",
    "not available": "photographs, drawings and data that are not public",
}


def read_contents():
    """Return the contents of the papers, one row per equation, table or figure."""
    return pd.read_csv(CONTENTS, dtype=str, keep_default_na=False)


def write_paper_page(folder):
    """Write the page with one table per paper."""
    folder.mkdir()
    (folder / "index.rst").write_text(paper_page(read_contents()), encoding="utf-8")


def paper_page(contents):
    """Return the page."""
    lines = [
        *heading("What is in the papers", "="),
        "texclass implements five papers. The tables list their numbered equations, figures and tables, with",
        "the code that computes them and the figure of the chapter that reproduces them. For references, see",
        ":doc:`/cite`.",
        "",
        *list_table([("Status", "Meaning"), *STATUSES.items()], widths="20 80", header=True),
    ]
    for paper, rows in contents.groupby("paper", sort=False):
        counts = Counter(rows["status"])
        summary = ", ".join(f"{counts[status]} {status}" for status in STATUSES if counts[status])
        table = [
            (row.item, content_cell(row), figure_cell(paper, row.figure), status_cell(row))
            for row in rows.itertuples()
        ]
        lines += [
            *heading(paper, "-"),
            f"{TITLES[paper]}. Chapter: :doc:`{paper} </reports/papers/{paper}>`.",
            f"{len(rows)} entries: {summary}.",
            "",
            *list_table([("Item", "Content", "Figure", "Status"), *table], widths="10 42 8 40", header=True),
        ]
    return "\n".join(lines)


def content_cell(row):
    """Return the content, with links to its code; paths of the repository are shown as code."""
    code = (f"``{name}``" if "/" in name else f":py:obj:`~{name}`" for name in row.code.split())
    return ": ".join(filter(None, (row.content, ", ".join(code))))


def figure_cell(paper, figure):
    """Return a link to the chapter that contains the figure."""
    return f":doc:`{figure} </reports/papers/{paper}>`" if figure else ""


def status_cell(row):
    """Return the status, followed by the reason."""
    reason = row.reason.replace("`", "``")
    return f"**{row.status}**: {reason}" if reason else f"**{row.status}**"
