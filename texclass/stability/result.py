"""What the battery found: all cells, what they were found with, and their summary for JSON."""

import json
import math
import platform
from collections import Counter
from dataclasses import dataclass
from typing import Any

import pandas as pd

from texclass.experiment.result import COMPUTED_BY
from texclass.provenance import made_by
from texclass.stability.inputs import SEED
from texclass.stability.judging import BAD, Mark

OURS = "texclass"
FAULTY = (*BAD, Mark.WARNED)
ENDS = ("library", "subject", "family", "mark")


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
        limit = self.cells["limit"].astype(float)
        share = self.cells["error"].astype(float) / limit.where(limit > 0)
        over = share.where(~self.cells["mark"].isin(BAD)).fillna(0.0)  # of what is right and was measured
        theirs = self.cells[self.cells["library"] != OURS]
        refused = (Mark.DOCUMENTED, Mark.REFUSED, Mark.UNCHECKED)
        near = self.ours.assign(over=over).query("over > 0 or error == 0 and limit > 0")
        near = near.loc[near.groupby("subject", sort=False)["over"].idxmax()]
        faulty = _records(self.ours[self.ours["mark"].isin(FAULTY)])
        return {
            "versions": self.versions,
            "machine": platform.platform(),
            "seed": self.seed,
            **made_by(*COMPUTED_BY, "stability"),
            "battery": self.battery,
            "quick": self.quick,
            "seconds": round(self.seconds, 1),
            "left_out": list(self.left_out),
            "tallies": [
                key
                | {
                    "cells": len(cells),
                    "worst_over_limit": float(over[cells.index].max()),
                    "marks": dict(Counter(map(str, cells["mark"]))),
                }
                for key, cells in _by(self.cells, "library", "group", "subject", "family")
            ],
            "ours_wrong": [  # an infinite error becomes a word
                {k: repr(v) if v in (math.inf, -math.inf) else v for k, v in cell.items()} for cell in faulty
            ],
            "theirs_wrong": [
                key
                | {"cases": "; ".join(cells["case"]), "reason": cells["reason"].iloc[0], "cells": len(cells)}
                for key, cells in _by(theirs[theirs["mark"].isin(FAULTY)], *ENDS)
            ],
            "reasons": [
                key | {"cells": len(cells), "first": cells["case"].iloc[0], "reason": cells["reason"].iloc[0]}
                for key, cells in _by(self.cells[self.cells["mark"].isin(refused)], *ENDS)
            ],
            "nearest": _records(near[["subject", "what", "error", "limit", "case"]]),
        }

    def to_json(self) -> str:
        """Return `to_dict` as JSON."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _records(cells: pd.DataFrame) -> list[dict[str, Any]]:
    return cells.astype(object).where(cells.notna(), None).to_dict("records")  # type: ignore[return-value]


def _by(cells: pd.DataFrame, *names: str) -> list[tuple[dict[str, Any], pd.DataFrame]]:
    """Return the cells of each combination of some columns, in the order of their first."""
    groups = cells.groupby(list(names), sort=False)
    return [(dict(zip(names, map(str, key), strict=True)), group) for key, group in groups]
