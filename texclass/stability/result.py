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
        right = ~self.cells["mark"].isin(BAD)
        cells = self.cells.assign(mark=self.cells["mark"].map(str), share=share.where(right))
        is_ours, is_faulty = cells["library"] == OURS, cells["mark"].isin([*BAD, Mark.WARNED])
        is_refused = cells["mark"].isin([Mark.DOCUMENTED, Mark.REFUSED, Mark.UNCHECKED])
        measured = cells[is_ours & cells["share"].notna()]
        near = measured.loc[measured.groupby("subject", sort=False)["share"].idxmax()]
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
                    "cells": len(part),
                    "worst_over_limit": float(part["share"].fillna(0.0).max()),
                    "marks": dict(Counter(part["mark"])),
                }
                for key, part in _by(cells, "library", "group", "subject", "family")
            ],
            "ours_wrong": _records(cells[is_ours & is_faulty].drop(columns="share")),
            "theirs_wrong": [
                key | {"cases": "; ".join(part["case"]), "reason": part["reason"].iloc[0], "cells": len(part)}
                for key, part in _by(cells[~is_ours & is_faulty], "library", "subject", "family", "mark")
            ],
            "reasons": [
                key | {"cells": len(part), "first": part["case"].iloc[0], "reason": part["reason"].iloc[0]}
                for key, part in _by(cells[is_refused], "library", "subject", "family", "mark")
            ],
            "nearest": _records(near[["subject", "what", "error", "limit", "case"]]),
        }

    def to_json(self) -> str:
        """Return `to_dict` as JSON."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _records(cells: pd.DataFrame) -> list[dict[str, Any]]:
    """Return one dict a cell: what was not measured is None, and an infinite error a word."""
    plain = cells.astype(object).where(cells.notna(), None).replace([math.inf, -math.inf], ["inf", "-inf"])
    return plain.to_dict("records")  # type: ignore[return-value]


def _by(cells: pd.DataFrame, *names: str) -> list[tuple[dict[str, Any], pd.DataFrame]]:
    """Return the cells of each combination of some columns, in the order of their first."""
    groups = cells.groupby(list(names), sort=False)
    return [(dict(zip(names, key, strict=True)), part) for key, part in groups]
