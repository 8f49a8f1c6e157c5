"""What the battery found: all cells, what they were found with, and their summary for JSON."""

import json
import math
import platform
from collections import Counter
from dataclasses import dataclass
from typing import Any

import pandas as pd

from texclass.stability.inputs import SEED
from texclass.stability.judging import BAD, Mark

OURS = "texclass"
FAULTY = (*BAD, Mark.WARNED)


@dataclass(frozen=True, eq=False)
class StabilityResult:
    """What the battery found.

    Attributes
    ----------
    cells : DataFrame
        One line for each subject and input, with the columns that `texclass.stability.judge` returns.
    quick
        Whether it was the short battery.
    versions
        Of Python, texclass and every library that was tried; "not installed" otherwise.
    battery
        Hash of all inputs.
    seconds
        The run took.
    seed
        Of every random input.
    left_out
        Libraries that were not tried, and subjects that were given up, each with the reason.
    """

    cells: pd.DataFrame
    quick: bool
    versions: dict[str, str]
    battery: str
    seconds: float
    seed: int = SEED
    left_out: tuple[str, ...] = ()

    @property
    def ours(self) -> pd.DataFrame:
        """Cells of texclass."""
        return self.cells[self.cells["library"] == OURS]

    @property
    def wrong(self) -> pd.DataFrame:
        """Our cells that are wrong: a wrong number, a crash, a hang."""
        return self.ours[self.ours["mark"].isin(BAD)]

    def to_dict(self) -> dict[str, Any]:
        """Return versions, tallies by subject and family, and every cell that is a finding, for JSON."""
        theirs = self.cells[self.cells["library"] != OURS]
        refused = (Mark.DOCUMENTED, Mark.REFUSED, Mark.UNCHECKED)
        return {
            "versions": self.versions,
            "machine": platform.platform(),
            "seed": self.seed,
            "battery": self.battery,
            "quick": self.quick,
            "seconds": round(self.seconds, 1),
            "left_out": list(self.left_out),
            "tallies": _tallies(self.cells),
            "ours_wrong": [_finite(cell) for cell in _records(self.ours[self.ours["mark"].isin(FAULTY)])],
            "theirs_wrong": [
                key
                | {"cases": "; ".join(cells["case"]), "reason": cells["reason"].iloc[0], "cells": len(cells)}
                for key, cells in _by(theirs[theirs["mark"].isin(FAULTY)], "mark")
            ],
            "reasons": [
                key | {"cells": len(cells), "first": cells["case"].iloc[0], "reason": cells["reason"].iloc[0]}
                for key, cells in _by(self.cells[self.cells["mark"].isin(refused)], "mark")
            ],
            "nearest": _nearest(self.ours),
        }

    def to_json(self) -> str:
        """Return `to_dict` as JSON."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _records(cells: pd.DataFrame) -> list[dict[str, Any]]:
    return cells.astype(object).where(cells.notna(), None).to_dict("records")  # type: ignore[return-value]


def _by(cells: pd.DataFrame, last: str) -> list[tuple[dict[str, Any], pd.DataFrame]]:
    """Return the cells of each subject and family by another column, in the order of their first."""
    names = ["library", "subject", "family", last]
    return [
        (dict(zip(names, map(str, key), strict=True)), group)
        for key, group in cells.groupby(names, sort=False)
    ]


def _tallies(cells: pd.DataFrame) -> list[dict[str, Any]]:
    names = ["library", "group", "subject", "family"]
    found = []
    for key, group in cells.groupby(names, sort=False):
        tally = {
            "cells": len(group),
            "worst_over_limit": float(_over_limit(group).max()),
            "marks": dict(Counter(map(str, group["mark"]))),
        }
        found.append(dict(zip(names, key, strict=True)) | tally)
    return found


def _nearest(cells: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the right cell of each subject that comes nearest to its limit."""
    near = cells.assign(over=_over_limit(cells)).query("over > 0 or error == 0 and limit > 0")
    first = near.loc[near.groupby("subject", sort=False)["over"].idxmax()]
    return _records(first[["subject", "what", "error", "limit", "case"]])


def _over_limit(cells: pd.DataFrame) -> pd.Series:
    """Return error over limit of what is right and was measured, 0 elsewhere."""
    limit = cells["limit"].astype(float)
    share = cells["error"].astype(float) / limit.where(limit > 0)
    return share.where(~cells["mark"].isin(BAD)).fillna(0.0)


def _finite(cell: dict[str, Any]) -> dict[str, Any]:
    """Return a cell that JSON can hold: an infinite error becomes a word."""
    return {k: repr(v) if isinstance(v, float) and not math.isfinite(v) else v for k, v in cell.items()}
