"""Run the battery of extreme inputs: test every subject on every input, and collect a table of outcomes."""

import math
import platform
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Literal

import pandas as pd

from texclass.evaluation.result_facts import CODE_DEPENDENCIES
from texclass.provenance import code_provenance, versions
from texclass.reporting import Document
from texclass.reporting.result_files import Result
from texclass.stability.checks import FAILURES, OURS, Mark
from texclass.stability.inputs import SEED, battery_hash
from texclass.stability.processes import Progress, supervise
from texclass.stability.stability_document import stability_document

Group = Literal["models", "filters", "transforms", "features", "baselines"]
PLACES = {
    "models": "texclass.stability.subjects_models:SUBJECTS",
    "filters": "texclass.stability.subjects_signals:SUBJECTS",
    "transforms": "texclass.stability.subjects_signals:SUBJECTS",
    "features": "texclass.stability.subjects_features:subjects",
}
"""Group of subjects -> "module:name" of a list of subjects, or of a function that returns it."""


@dataclass(frozen=True, eq=False, repr=False)
class StabilityResult(Result, kind="stability"):
    """Outcomes of the battery of extreme inputs; returned by `run_stability`.

    `data` contains the `versions` of Python, texclass and every tested library, the `seed` of the random
    inputs, the hash of the inputs (`battery`), whether the run was `quick`, the run time in `seconds`, the
    `skipped` subjects with reasons, and the `summary` of the outcomes.

    Attributes
    ----------
    cells : DataFrame
        One row per subject and input, with the keys of `texclass.stability.evaluate` as columns; empty if the
        result was read from a file.

    Examples
    --------
    >>> StabilityResult({"kind": "stability", "quick": True}).stem
    'stability'
    """

    cells: pd.DataFrame = field(default_factory=pd.DataFrame)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.failures)} of {len(self.ours)} cells wrong>"

    @property
    def stem(self) -> str:
        """Prefix of the file names."""
        return "stability"

    @property
    def ours(self) -> pd.DataFrame:
        """Outcomes of texclass."""
        return self.cells[self.cells["library"] == OURS]

    @property
    def failures(self) -> pd.DataFrame:
        """Failures of texclass: wrong numbers, crashes and hangs."""
        return self.ours[self.ours["mark"].isin(FAILURES)]

    def document(self) -> Document:
        """Return the outcomes as a document."""
        return stability_document(self.data)


def run_stability(
    *,
    quick: bool = False,
    only: Group | None = None,
    baselines: Mapping[str, str] | None = None,
    skipped: Sequence[str] = (),
    jobs: int = 2,
    progress: Progress | None = None,
) -> StabilityResult:
    """Test every subject of texclass and of other libraries on the battery of extreme inputs.

    Parameters
    ----------
    quick : bool
        Whether to use only a small part of the inputs (default False).
    only : {"models", "filters", "transforms", "features", "baselines"}, optional
        Group of subjects to test (default: all groups).
    baselines : mapping of str to str, optional
        Other libraries to test: name -> "module:function", where the function returns its subjects.
    skipped : sequence of str
        Libraries that are not tested, with reasons, for the result.
    jobs : int
        Number of processes with one thread each (default 2).
    progress : callable, optional
        Function called with (done, total, name) from several threads; `name` is the library and group under
        test.

    Returns
    -------
    StabilityResult
        Outcomes; `save(folder)` writes JSON and Markdown.

    Examples
    --------
    The quick battery takes half a minute::

        result = run_stability(quick=True)
        result.failures
    """
    start, libraries = time.monotonic(), baselines or {}
    tasks = [(place, group) for group, place in PLACES.items() if only in (None, group)]
    all_skipped: list[str] = []
    if only in (None, "baselines"):
        tasks += [(place, "baselines") for place in libraries.values()]
        all_skipped += skipped

    def run_task(task: tuple[str, str]) -> list[dict[str, Any]]:
        return supervise(*task, quick=quick, progress=progress, skipped=all_skipped)

    with ThreadPoolExecutor(max_workers=jobs) as pool:
        cells = pd.DataFrame([cell for cells in pool.map(run_task, tasks) for cell in cells])
    return StabilityResult(
        {
            "versions": versions("numpy", "pandas", "numba", "mpmath", *libraries),
            "machine": platform.platform(),
            "seed": SEED,
            **code_provenance(*CODE_DEPENDENCIES, "stability"),
            "battery": battery_hash(),
            "quick": quick,
            "seconds": round(time.monotonic() - start, 1),
            "skipped": all_skipped,
            **summary(cells),
        },
        cells,
    )


def summary(cells: pd.DataFrame) -> dict[str, Any]:
    """Return counts of outcomes by subject and family, and all notable outcomes, as plain JSON values."""
    limit = cells["limit"].astype(float)
    share = cells["error"].astype(float) / limit.where(limit > 0)
    share = share.where(~cells["mark"].isin(FAILURES))
    cells = cells.assign(mark=cells["mark"].map(str), share=share)
    is_ours = cells["library"] == OURS
    is_failure = cells["mark"].isin([*FAILURES, Mark.WARNED])
    is_refused = cells["mark"].isin([Mark.DOCUMENTED, Mark.REFUSED, Mark.UNCHECKED])
    nearest = cells.loc[cells[is_ours & share.notna()].groupby("subject", sort=False)["share"].idxmax()]
    by_mark = ["library", "subject", "family", "mark"]
    return {
        "tallies": [
            names
            | {
                "cells": len(group),
                "worst_over_limit": float(group["share"].fillna(0.0).max()),
                "marks": dict(Counter(group["mark"])),
            }
            for names, group in _groups(cells, ["library", "group", "subject", "family"])
        ],
        "failures": _records(cells[is_ours & is_failure].drop(columns="share")),
        "library_failures": [
            names
            | {"cases": "; ".join(group["case"]), "reason": group["reason"].iloc[0], "cells": len(group)}
            for names, group in _groups(cells[~is_ours & is_failure], by_mark)
        ],
        "reasons": [
            names | {"cells": len(group), "first": group["case"].iloc[0], "reason": group["reason"].iloc[0]}
            for names, group in _groups(cells[is_refused], by_mark)
        ],
        "closest_to_limit": _records(nearest[["subject", "what", "error", "limit", "case"]]),
    }


def _groups(cells: pd.DataFrame, columns: list[str]) -> list[tuple[dict[str, Any], pd.DataFrame]]:
    """Group rows by their values in some columns; return (values, rows) in order of appearance."""
    groups = cells.groupby(columns, sort=False)
    return [(dict(zip(columns, key, strict=True)), group) for key, group in groups]


def _records(cells: pd.DataFrame) -> list[dict[str, Any]]:
    """Return one dict per row, with None for missing values and a string for infinite errors."""
    plain = cells.astype(object).where(cells.notna(), None).replace([math.inf, -math.inf], ["inf", "-inf"])
    return plain.to_dict("records")  # type: ignore[return-value]
