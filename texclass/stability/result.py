"""What the battery found: all cells, what they were found with, and their summary for JSON."""

import json
import math
import platform
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from texclass.stability.signals import SEED
from texclass.stability.verdict import BAD, Cell, Mark


@dataclass(frozen=True)
class StabilityResult:
    """What the battery found.

    Attributes
    ----------
    cells
        One for each subject and input.
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

    cells: tuple[Cell, ...]
    quick: bool
    versions: dict[str, str]
    battery: str
    seconds: float
    seed: int = SEED
    left_out: tuple[str, ...] = ()

    @property
    def ours(self) -> tuple[Cell, ...]:
        """Cells of texclass."""
        return tuple(cell for cell in self.cells if cell.library == "texclass")

    @property
    def wrong(self) -> tuple[Cell, ...]:
        """Our cells that are wrong: a wrong number, a crash, a hang."""
        return tuple(cell for cell in self.ours if cell.mark in BAD)

    def to_dict(self) -> dict[str, Any]:
        """Return versions, tallies by subject and family, and every cell that is a finding, for JSON."""
        tallies: dict[tuple[str, ...], dict[str, Any]] = {}
        for cell in self.cells:
            key = cell.library, cell.group, cell.subject, cell.family
            tally = tallies.setdefault(key, {"cells": 0, "worst_over_limit": 0.0, "marks": {}})
            tally["cells"] += 1
            tally["marks"][cell.mark.value] = tally["marks"].get(cell.mark.value, 0) + 1
            if cell.error is not None and cell.limit and cell.mark not in BAD:
                tally["worst_over_limit"] = max(tally["worst_over_limit"], cell.error / cell.limit)
        names = ("library", "group", "subject", "family")
        return {
            "versions": self.versions,
            "machine": platform.platform(),
            "seed": self.seed,
            "battery": self.battery,
            "quick": self.quick,
            "seconds": round(self.seconds, 1),
            "left_out": list(self.left_out),
            "tallies": [dict(zip(names, key, strict=True)) | tally for key, tally in tallies.items()],
            "ours_wrong": [_finite(asdict(c)) for c in self.ours if c.mark in (*BAD, Mark.WARNED)],
            "theirs_wrong": _theirs(c for c in self.cells if c.library != "texclass"),
            "reasons": _reasons(self.cells),
        }

    def to_json(self) -> str:
        """Return `to_dict` as JSON."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _reasons(cells: Iterable[Cell]) -> list[dict[str, Any]]:
    """Return what is documented, refused or unchecked: how often and one reason, by subject and family."""
    marks = (Mark.DOCUMENTED, Mark.REFUSED, Mark.UNCHECKED)
    found: dict[tuple[str, ...], dict[str, Any]] = {}
    for cell in cells:
        if cell.mark in marks:
            key = cell.library, cell.subject, cell.family, cell.mark.value
            found.setdefault(key, {"cells": 0, "first": cell.case, "reason": cell.reason})["cells"] += 1
    names = ("library", "subject", "family", "mark")
    return [dict(zip(names, key, strict=True)) | rest for key, rest in found.items()]


def _theirs(cells: Iterable[Cell]) -> list[dict[str, Any]]:
    """Return what is wrong with public libraries: inputs and one reason by subject, family and kind."""
    found: dict[tuple[str, ...], dict[str, Any]] = {}
    for cell in cells:
        if cell.mark in (*BAD, Mark.WARNED):
            key = cell.library, cell.subject, cell.family, cell.mark.value
            found.setdefault(key, {"cases": [], "reason": cell.reason})["cases"].append(cell.case)
    names = ("library", "subject", "family", "mark")
    rows = [dict(zip(names, key, strict=True)) | rest for key, rest in found.items()]
    return [row | {"cells": len(row["cases"]), "cases": "; ".join(row["cases"])} for row in rows]


def _finite(cell: dict[str, Any]) -> dict[str, Any]:
    """Return a cell that JSON can hold: an infinite error becomes a word."""
    return {k: repr(v) if isinstance(v, float) and not math.isfinite(v) else v for k, v in cell.items()}
