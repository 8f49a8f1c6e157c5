"""Leaderboard: the table of the suite as a DataFrame, a report and an interactive page."""

import hashlib
import json
from collections.abc import Mapping
from importlib.resources import files
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from texclass import shipped
from texclass.atomic_write import write_atomic
from texclass.leaderboard.statistics import KEYS, by_question, leakage, mean_ranks, records, summarize
from texclass.provenance import versions
from texclass.reporting import Document
from texclass.reporting.page import templates
from texclass.reporting.result_files import Result
from texclass.suite.cells import CODE_OF, LIBRARIES
from texclass.suite.runner import read_table
from texclass.suite.stored_folds import SEED

TABLE_NAME = "leaderboard.csv"
"""File of the published table."""


def load_leaderboard(path: str | Path | None = None) -> pd.DataFrame:
    """Return the leaderboard: one row per dataset, protocol, method and fold.

    Parameters
    ----------
    path : str or Path, optional
        Table written by `texclass suite` (default: the published table of this version).

    Returns
    -------
    DataFrame
        Among others, the columns `dataset`, `question`, `protocol`, `method`, `fold`, `accuracy`,
        `balanced_accuracy`, `macro_f1`, `auroc_unknown`, `ece`, `coverage`, `ms`, `kb`, `status`, `licence`,
        `dataset_hash`, `versions` and `author`. `texclass.leaderboard.summarize` adds intervals and paired
        differences.

    Raises
    ------
    ValueError
        If the file is not a table of the suite.
    FileNotFoundError
        If the file does not exist.

    Examples
    --------
    >>> table = load_leaderboard()
    >>> bool((table["accuracy"].dropna() <= 1).all())
    True
    """
    return read_table(shipped.leaderboard_folder() / TABLE_NAME if path is None else path)


class Leaderboard(Result, kind="leaderboard"):
    """Summary of a table of the suite.

    `data` contains `rows` (one per dataset, protocol and method, see `summarize`), `leakage`, `questions`
    (mean accuracy by question) and `ranks`, each for real and for simulated recordings, and the hash of the
    table.
    """

    stem = "leaderboard"

    @classmethod
    def from_table(cls, table: pd.DataFrame) -> "Leaderboard":
        """Return the summary of a table of the suite."""
        summary = summarize(table)
        questions, ranks = dict[str, Any](), dict[str, Any]()
        for is_simulated, rows in summary.groupby("is_simulated"):
            kind = "simulated" if is_simulated else "real"
            questions[kind] = records(by_question(rows).reset_index())
            ranking = mean_ranks(rows)
            (facts,) = records(pd.DataFrame([ranking.attrs]))
            ranks[kind] = {"rows": records(ranking), **facts}
        data = {
            "dataset": {"name": f"{summary['dataset'].nunique()} datasets"},
            "rows": records(summary),
            "leakage": records(leakage(table)),
            "questions": questions,
            "ranks": ranks,
            "table_hash": hashlib.sha256(table.to_csv(index=False).encode()).hexdigest()[:16],
            "input_hash": hashlib.sha256("".join(sorted(set(table["dataset_hash"]))).encode()).hexdigest(),
            "seed": SEED,
            "versions": versions(*LIBRARIES),
            "code_of": sorted(CODE_OF),
            # Rows of several versions have several hashes, so that the result counts as out of date.
            "code_hash": ", ".join(sorted(set(table["code_hash"]))),
        }
        return cls(json.loads(json.dumps(data, default=lambda scalar: scalar.item())))

    def document(self) -> Document:
        """Return the report on real recordings, or on simulated ones if there are no others."""
        return next(iter(self.documents.values()))

    @property
    def documents(self) -> Mapping[str, Document]:
        """Report on real recordings and, if there are any, report on simulated recordings, by file stem."""
        from texclass.leaderboard.leaderboard_document import leaderboard_document

        stems = {False: self.stem, True: f"{self.stem}-simulated"}
        kinds = sorted({row["is_simulated"] for row in self.data["rows"]})
        return {stems[kind]: leaderboard_document(self.data, is_simulated=kind) for kind in kinds}

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write JSON, Markdown and the interactive pages into a folder."""
        from texclass.reporting.markdown import write_document

        written: list[Path] = []
        for stem, document in self.documents.items():
            json_text = {"json": self.to_json()} if stem == self.stem else {}
            written += write_document(document, folder, stem, pictures=False, **json_text)
            page = Path(folder) / f"{stem}.html"
            write_atomic(page, render_leaderboard(self.data, is_simulated=stem != self.stem))
            written.append(page)
        return tuple(written)


def render_leaderboard(data: Mapping[str, Any], *, is_simulated: bool) -> str:
    """Return one HTML page with a table that can be sorted and filtered, without external files.

    Initially, the rows of each protocol are sorted by accuracy, and methods that failed are last.

    Parameters
    ----------
    data : mapping
        Data of a `Leaderboard`.
    is_simulated : bool
        Show simulated instead of real recordings.
    """
    package = files("texclass")
    style = package.joinpath("reporting/templates/page.css").read_text(encoding="utf-8").strip()
    own_style, script = (
        package.joinpath(f"leaderboard/templates/{name}").read_text(encoding="utf-8").strip()
        for name in ("leaderboard.css", "leaderboard.js")
    )
    rows = [
        row
        for _, protocol_rows in groupby(data["rows"], key=itemgetter(*KEYS))
        for row in sorted(protocol_rows, key=lambda row: -(row["accuracy"] or 0))
        if row["is_simulated"] == is_simulated
    ]
    return templates("texclass.leaderboard", "templates").get_template("leaderboard.html").render(
        title="Leaderboard of surface classification" + ", simulated recordings" * is_simulated,
        is_simulated=is_simulated,
        rows=rows,
        datasets=sorted({row["dataset"] for row in rows}),
        questions=list(dict.fromkeys(row["question"] for row in rows)),
        methods=list(dict.fromkeys((row["method"], row["title"]) for row in rows)),
        facts=data,
        scripts={"page": Markup(script)},
        style=Markup(f"{style}\n{own_style}"),
    )  # fmt: skip
