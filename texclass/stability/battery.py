"""The battery: every subject on every hard input, judged by one rule; the outcomes are one table."""

import math
import platform
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Literal

import pandas as pd

from texclass.evaluation.result import COMPUTED_BY
from texclass.provenance import code_provenance, versions
from texclass.reporting import Document
from texclass.reporting.result_files import Result
from texclass.stability.inputs import SEED, battery_hash
from texclass.stability.processes import Progress, supervise
from texclass.stability.rules import BAD, OURS, Mark
from texclass.stability.stability_document import stability_document

Group = Literal["models", "filters", "transforms", "features", "baselines"]
PLACES = {
    "models": "texclass.stability.subjects_models:SUBJECTS",
    "filters": "texclass.stability.subjects_signals:SUBJECTS",
    "transforms": "texclass.stability.subjects_signals:SUBJECTS",
    "features": "texclass.stability.subjects_features:subjects",
}
"""Group of subjects -> "module:name" of the list that holds them, or of a function that returns it."""


@dataclass(frozen=True, eq=False, repr=False)
class StabilityResult(Result, kind="stability"):
    """Outcomes of the battery; see `run_stability`.

    `data` holds `versions` of Python, texclass and every library that was tried, the `seed` of every random
    input, the hash of the `battery` of inputs, whether it was a `quick` one, the `seconds` it took, what was
    `left_out` and why, and the `summary` of the outcomes.

    Attributes
    ----------
    cells : DataFrame
        One row for each subject and input, with the columns that `texclass.stability.judge` returns; empty if
        the result was read from a file.
    """

    cells: pd.DataFrame = field(default_factory=pd.DataFrame)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.wrong)} of {len(self.ours)} cells wrong>"

    @property
    def stem(self) -> str:
        """What the names of its files begin with."""
        return "stability"

    @property
    def ours(self) -> pd.DataFrame:
        """Outcomes of texclass."""
        return self.cells[self.cells["library"] == OURS]

    @property
    def wrong(self) -> pd.DataFrame:
        """Outcomes of texclass that are wrong: a wrong number, a crash, a hang."""
        return self.ours[self.ours["mark"].isin(BAD)]

    def document(self) -> Document:
        """Return the result as a document."""
        return stability_document(self.data)


def run_stability(
    *,
    quick: bool = False,
    only: Group | None = None,
    baselines: Mapping[str, str] | None = None,
    left_out: Sequence[str] = (),
    jobs: int = 2,
    progress: Progress | None = None,
) -> StabilityResult:
    """Try every subject of texclass, and the public libraries that are handed over.

    Parameters
    ----------
    quick : bool
        A small part of the battery.
    only : {"models", "filters", "transforms", "features", "baselines"}, optional
        One group alone.
    baselines : mapping of str to str, optional
        Public library -> place of its subjects, "module:function".
    left_out : sequence of str
        Which public libraries are not tried, and why.
    jobs : int
        Processes at a time, of one thread each (default 2).
    progress : callable, optional
        Called with (done, total, what), from several threads.
    """
    start, libraries = time.monotonic(), baselines or {}
    tasks = [(place, group) for group, place in PLACES.items() if only in (None, group)]
    not_tried: list[str] = []
    if only in (None, "baselines"):
        tasks += [(place, "baselines") for place in libraries.values()]
        not_tried += left_out

    def outcomes_of(task: tuple[str, str]) -> list[dict[str, Any]]:
        return supervise(*task, quick=quick, progress=progress, left_out=not_tried)

    with ThreadPoolExecutor(max_workers=jobs) as pool:
        cells = pd.DataFrame([cell for cells in pool.map(outcomes_of, tasks) for cell in cells])
    return StabilityResult(
        {
            "versions": versions("numpy", "pandas", "numba", "mpmath", *libraries),
            "machine": platform.platform(),
            "seed": SEED,
            **code_provenance(*COMPUTED_BY, "stability"),
            "battery": battery_hash(),
            "quick": quick,
            "seconds": round(time.monotonic() - start, 1),
            "left_out": not_tried,
            **summary(cells),
        },
        cells,
    )


def summary(cells: pd.DataFrame) -> dict[str, Any]:
    """Return tallies by subject and family, and every outcome that is a finding, as plain JSON values."""
    limit = cells["limit"].astype(float)
    share = cells["error"].astype(float) / limit.where(limit > 0)
    share = share.where(~cells["mark"].isin(BAD))
    cells = cells.assign(mark=cells["mark"].map(str), share=share)
    is_ours = cells["library"] == OURS
    is_faulty = cells["mark"].isin([*BAD, Mark.WARNED])
    is_refused = cells["mark"].isin([Mark.DOCUMENTED, Mark.REFUSED, Mark.UNCHECKED])
    nearest = cells.loc[cells[is_ours & share.notna()].groupby("subject", sort=False)["share"].idxmax()]
    by_mark = ["library", "subject", "family", "mark"]
    return {
        "tallies": [
            names
            | {
                "cells": len(part),
                "worst_over_limit": float(part["share"].fillna(0.0).max()),
                "marks": dict(Counter(part["mark"])),
            }
            for names, part in _groups(cells, ["library", "group", "subject", "family"])
        ],
        "ours_wrong": _records(cells[is_ours & is_faulty].drop(columns="share")),
        "theirs_wrong": [
            names | {"cases": "; ".join(part["case"]), "reason": part["reason"].iloc[0], "cells": len(part)}
            for names, part in _groups(cells[~is_ours & is_faulty], by_mark)
        ],
        "reasons": [
            names | {"cells": len(part), "first": part["case"].iloc[0], "reason": part["reason"].iloc[0]}
            for names, part in _groups(cells[is_refused], by_mark)
        ],
        "nearest": _records(nearest[["subject", "what", "error", "limit", "case"]]),
    }


def _groups(cells: pd.DataFrame, columns: list[str]) -> list[tuple[dict[str, Any], pd.DataFrame]]:
    """Return the values of some columns and the rows that have them, in the order of the first of each."""
    groups = cells.groupby(columns, sort=False)
    return [(dict(zip(columns, key, strict=True)), part) for key, part in groups]


def _records(cells: pd.DataFrame) -> list[dict[str, Any]]:
    """Return one dict a row, in which a missing value is None and an infinite error a word."""
    plain = cells.astype(object).where(cells.notna(), None).replace([math.inf, -math.inf], ["inf", "-inf"])
    return plain.to_dict("records")  # type: ignore[return-value]
