"""The battery: subjects in processes of their own, a time limit for each cell; its result, as a document."""

import math
import multiprocessing
import os
import platform
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from texclass.evaluation.result import COMPUTED_BY
from texclass.provenance import made_by, versions
from texclass.reporting import Document, Finding, Folded, Heading, Heat, Shade, Table
from texclass.reporting.result_files import Result
from texclass.stability.inputs import FAMILIES, SEED, battery_hash
from texclass.stability.rules import BAD, Mark, cells_at, quiet_thread

OURS = "texclass"
REFUSALS = (Mark.DOCUMENTED, Mark.REFUSED)
CHECK, DOT = "\N{CHECK MARK}", "\N{MIDDLE DOT}"
LEGEND = {
    "d3": f"{CHECK} every result is exact enough",
    "d2": f"{CHECK}{DOT} so are all results, and some inputs are refused with a reason",
    "d1": f"{DOT} all are refused so, or ? the reference was not computed",
    "e1 e2 e3 e4 e5": "so many are wrong (colour: which share), or w: right, but NumPy warned",
}
RULE = (
    "Both sides are judged by one rule (`texclass.stability.rules`). A cell is one subject on one input (and "
    "at one order). It is right if the result meets its reference (60-digit arithmetic, exact integer sums, "
    "or 80-bit floats) and its invariants within the limits, or if the input is refused by an exception "
    "raised on purpose or by a reason that comes with the result; plain noise in float64 or float32 may not "
    "be refused. Public libraries declare no gain laws: they are held to one only where they follow it from "
    "1e-6 to 1e6."
)


@dataclass(frozen=True, eq=False, repr=False)
class StabilityResult(Result, kind="stability"):
    """What the battery found; see `run_stability`.

    `data` holds `versions` of Python, texclass and every library that was tried, the `seed` of every random
    input, the hash of the `battery` of inputs, whether it was a `quick` one, the `seconds` it took, what was
    `left_out` and why, and what `summed_up` says of the cells.

    Attributes
    ----------
    cells : DataFrame
        One line for each subject and input, with the columns that `texclass.stability.judge` returns; none
        where the result was read from a file.
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
        """Cells of texclass."""
        return self.cells[self.cells["library"] == OURS]

    @property
    def wrong(self) -> pd.DataFrame:
        """Our cells that are wrong: a wrong number, a crash, a hang."""
        return self.ours[self.ours["mark"].isin(BAD)]

    def document(self) -> Document:
        """Return the result as a document."""
        return stability_document(self.data)


def summed_up(cells: pd.DataFrame) -> dict[str, Any]:
    """Return tallies by subject and family, and every cell that is a finding, as plain JSON values."""
    limit = cells["limit"].astype(float)
    share = cells["error"].astype(float) / limit.where(limit > 0)
    right = ~cells["mark"].isin(BAD)
    cells = cells.assign(mark=cells["mark"].map(str), share=share.where(right))
    is_ours, is_faulty = cells["library"] == OURS, cells["mark"].isin([*BAD, Mark.WARNED])
    is_refused = cells["mark"].isin([Mark.DOCUMENTED, Mark.REFUSED, Mark.UNCHECKED])
    measured = cells[is_ours & cells["share"].notna()]
    near = measured.loc[measured.groupby("subject", sort=False)["share"].idxmax()]
    return {
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


def _records(cells: pd.DataFrame) -> list[dict[str, Any]]:
    """Return one dict a cell: what was not measured is None, and an infinite error a word."""
    plain = cells.astype(object).where(cells.notna(), None).replace([math.inf, -math.inf], ["inf", "-inf"])
    return plain.to_dict("records")  # type: ignore[return-value]


def _by(cells: pd.DataFrame, *names: str) -> list[tuple[dict[str, Any], pd.DataFrame]]:
    """Return the cells of each combination of some columns, in the order of their first."""
    groups = cells.groupby(list(names), sort=False)
    return [(dict(zip(names, key, strict=True)), part) for key, part in groups]


# As a document --------------------------------------------------------------------------------------------


def stability_document(data: Mapping[str, Any]) -> Document:
    """Return what the battery found, from the `data` of a `StabilityResult` or the JSON it was saved as."""
    tallies = pd.DataFrame(data["tallies"])
    marks = pd.DataFrame(list(tallies["marks"]), index=tallies.index).reindex(columns=list(Mark))
    tallies = tallies.drop(columns="marks").join(marks.fillna(0).astype(int))
    tallies["bad"] = tallies[list(BAD)].sum(axis=1)
    ours, theirs = tallies[tallies["library"] == OURS], tallies[tallies["library"] != OURS]
    n_subjects = len(ours[["library", "subject"]].drop_duplicates())
    quick = ", a small part of the battery" if data["quick"] else ""
    beside = (
        f"Public libraries on the same inputs, by the same rule: {theirs['bad'].sum():,} of "
        f"{theirs['cells'].sum():,}."
    )
    said = f"of {ours['cells'].sum():,} pairs of subject and input are wrong in texclass"
    finding = Finding(
        f"{ours['bad'].sum():,}",
        "",
        "",
        f"{said}: a wrong number handed over as right, NaN without a word, a crash, or no answer.",
        beside=beside if len(theirs) else "",
        brief=f"{said}. {beside if len(theirs) else ''}".strip(),
    )
    return Document(
        "At the extremes",
        list(_blocks(data, tallies, ours, theirs)),
        subtitle=f"{n_subjects} models, filters, transforms and features{quick}",
        finding=finding,
        again={"command": "texclass stability", "seed": str(data["seed"]), "battery": data["battery"]},
        versions=data["versions"],
    )


def _blocks(
    data: Mapping[str, Any], tallies: pd.DataFrame, ours: pd.DataFrame, theirs: pd.DataFrame
) -> Iterator[Any]:
    yield Heading("How many of each kind")
    yield _counted(tallies, "library")
    for name, title, part in (
        ("models", "Models, filters and transforms of texclass", ours[ours["group"] != "features"]),
        ("features", "Features of texclass", ours[ours["group"] == "features"]),
        ("libraries", "Public libraries", theirs),
    ):
        if len(part):
            yield heat_map(part, name, title)
    yield Heading("Every subject")
    yield _counted(tallies.assign(subject=_named(tallies)), "subject")
    wrong = [*data["ours_wrong"], *data["theirs_wrong"]]
    if wrong:
        names = ["library", "subject", "family", "mark", "reason"]
        found = pd.DataFrame(wrong).reindex(columns=[*names, "cells"]).fillna({"cells": 1})
        found.columns = pd.Index(["Library", "Subject", "Inputs", "What", "Reason of the first", "Cells"])
        yield Folded("What is wrong, with an example of each", [Table(found, n_words=5)])
    if data.get("nearest"):
        near = pd.DataFrame(data["nearest"])[["subject", "what", "case", "error", "limit"]]
        near[["error", "limit"]] = near[["error", "limit"]].map("{:.1e}".format)
        near.columns = pd.Index(["Subject", "Nearest to its limit", "On", "Error", "Limit"])
        yield Folded("How exact texclass is", [Table(near, n_words=3)])
    yield Heading("Notes")
    yield [RULE, *data["left_out"]]


def _named(tallies: pd.DataFrame) -> pd.Series:
    """Return the names of subjects, those of public libraries after the library's."""
    foreign = tallies["library"] != OURS
    return tallies["subject"].where(~foreign, tallies["library"] + ": " + tallies["subject"])


def _counted(tallies: pd.DataFrame, what: str) -> Table:
    """Return how many inputs came to which end, one row a library or subject."""
    counts = tallies.groupby(what, sort=False)[["cells", *Mark, "bad"]].sum()
    wrong = (100 * counts.pop("bad") / counts["cells"]).map("{:.1f}".format)
    counts = counts.loc[:, counts.any()].map(lambda n: f"{n:,}" if n else None)
    frame = counts.assign(**{"% wrong in all": wrong}).rename_axis(what.capitalize()).reset_index()
    return Table(frame, "Inputs, by what became of them.")


def heat_map(tallies: pd.DataFrame, name: str, title: str) -> Heat:
    """Return subjects by families of inputs."""
    present: set[str] = set(tallies["family"])
    families = [name for name in FAMILIES if name in present] + sorted(present - set(FAMILIES))
    rows: dict[str, list[Shade]] = {}
    for subject, part in tallies.groupby(_named(tallies), sort=False):
        by_family = {tally["family"]: tally for tally in part.to_dict("records")}
        rows[str(subject)] = [shade(by_family.get(family)) for family in families]
    columns: dict[str, str] = {family: FAMILIES.get(family, family) for family in families}
    says = f"{tallies['bad'].sum():,} of {tallies['cells'].sum():,} cells are wrong."
    return Heat(name, f"{title}, by family of inputs", says, columns, rows, LEGEND, "not tried", "Subject")


def shade(tally: Mapping[Any, Any] | None) -> Shade:
    """Return how the cells of a subject and a family are shown."""
    if tally is None:
        return Shade(says="not tried")
    n = tally["cells"]
    says = ", ".join(f"{tally[mark]} {mark}" for mark in Mark if tally[mark]) + f" of {n}"
    if bad := tally["bad"]:
        return Shade(f"e{max(1, -(-5 * bad // n))}", str(bad), says)
    if tally[Mark.WARNED]:
        return Shade("e1", "w", says)
    if not tally[Mark.EXACT]:
        return Shade("d1", "?" if tally[Mark.UNCHECKED] else DOT, says)
    mixed = any(tally[mark] for mark in REFUSALS)
    return Shade("d2" if mixed else "d3", CHECK + DOT * mixed, says)


Group = Literal["models", "filters", "transforms", "features", "baselines"]
CELL_S = 180.0
"""Time limit of one cell in s: some libraries are called up to ten times in it."""
START_S = 600.0
"""Time limit of the imports, and of the first cell of each subject, which may compile."""
STREAM_S = 900.0
GIVE_UP = 3
"""Crashes and hangs of one subject after which the rest of its cells is left out."""
PLACES = {
    "models": "texclass.stability.subjects_models:SUBJECTS",
    "filters": "texclass.stability.subjects_signals:SUBJECTS",
    "transforms": "texclass.stability.subjects_signals:SUBJECTS",
    "features": "texclass.stability.subjects_signals:subjects",
}
"""Where the subjects of each group stand."""
Progress = Callable[[int, int, str], None]


def run_stability(
    *,
    quick: bool = False,
    only: Group | None = None,
    baselines: Mapping[str, str] | None = None,
    left_out: Sequence[str] = (),
    jobs: int = 2,
    progress: Progress | None = None,
) -> StabilityResult:
    """Try ours, and the public libraries that are handed over.

    Parameters
    ----------
    quick : bool
        A small part of the battery.
    only : {"models", "filters", "transforms", "features", "baselines"}, optional
        One group alone.
    baselines : mapping of str to str, optional
        Of each public library to be tried the place of its subjects, "module:function".
    left_out : sequence of str
        Which public libraries are not tried, and why.
    jobs : int
        Processes at a time, of one thread each.
    progress : callable, optional
        Called with (done, total, what), from several threads.
    """
    start, foreign = time.monotonic(), baselines or {}
    tasks = [(place, group) for group, place in PLACES.items() if only in (None, group)]
    given_up: list[str] = []
    if only in (None, "baselines"):
        tasks += [(place, "baselines") for place in foreign.values()]
        given_up += left_out

    def cells_of(task: tuple[str, str]) -> list[dict[str, Any]]:
        return supervise(*task, quick=quick, progress=progress, left_out=given_up)

    with ThreadPoolExecutor(max_workers=jobs) as pool:
        cells = [cell for found in pool.map(cells_of, tasks) for cell in found]
    found = pd.DataFrame(cells)
    return StabilityResult(
        {
            "versions": versions("numpy", "pandas", "numba", "mpmath", *foreign),
            "machine": platform.platform(),
            "seed": SEED,
            **made_by(*COMPUTED_BY, "stability"),
            "battery": battery_hash(),
            "quick": quick,
            "seconds": round(time.monotonic() - start, 1),
            "left_out": given_up,
            **summed_up(found),
        },
        found,
    )


def supervise(
    place: str,
    group: str,
    *,
    quick: bool,
    cell_s: float = CELL_S,
    progress: Progress | None = None,
    left_out: list[str] | None = None,
) -> list[dict[str, Any]]:
    """Judge subjects in a process of their own, and start it anew when it dies.

    Parameters
    ----------
    place : str
        "module:name" of a list of subjects, or of a function that returns one.
    group : str
        Only the subjects of this group are tried.
    quick : bool
        As in `run_stability`.
    cell_s : float
        Time limit of a cell in s.
    progress, left_out
        As in `run_stability`; `left_out` receives a line for each subject that was given up.
    """
    task = (place, group, quick)
    cells: list[dict[str, Any]] = []
    failures: Counter[str] = Counter()
    with (  # a named temporary file cannot be opened a second time on Windows
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        (Path(folder) / "said").open("w+", encoding="utf-8", errors="replace") as said,
    ):
        worker, known = _Worker(said), ""
        try:
            begun = worker.ask(START_S, cells_at, *task)
        except Exception as error:
            ended = f"the process {worker.end()}"
            told = ended if isinstance(error, BrokenExecutor) else error
            raise ValueError(f"{place}: {told}; the rule is that it can be imported") from error
        for number, cell in enumerate(begun):
            name = cell["subject"]
            if failures[name] >= GIVE_UP:
                continue
            if progress:
                progress(number + 1, len(begun), f"{cell['library']} {group}")
            limit = max(cell_s if name == known else START_S, STREAM_S * (cell["family"] == "stream"))
            known = name
            try:
                cells.append(worker.ask(limit, cells_at, *task, number))
                continue
            except TimeoutError:
                found = {"mark": Mark.HANG, "reason": f"no answer within {limit:g} s"}
                worker.end()
            except BrokenExecutor:
                found = {"mark": Mark.CRASH, "reason": f"the process {worker.end()}"}
            cells.append(cell | found)
            worker, known = _Worker(said), ""
            failures[name] += 1
            if failures[name] == GIVE_UP and left_out is not None:
                left_out.append(f"{cell['library']} {name}: given up after {GIVE_UP} crashes or hangs")
        worker.end()
    return cells


class _Worker:
    """A process of one thread that is asked; what is printed in it is read from a file."""

    def __init__(self, said: Any) -> None:
        self._said = said
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, context, quiet_thread, (said.name,))
        pid = self._pool.submit(os.getpid).result()
        (self._process,) = (child for child in multiprocessing.active_children() if child.pid == pid)

    def ask(self, limit_s: float, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return what a function gives there; TimeoutError if it takes longer, BrokenExecutor if it dies."""
        return self._pool.submit(function, *arguments).result(limit_s)

    def end(self) -> str:
        """Kill the process if it still runs; return its exit code and the last line it printed."""
        self._process.kill()
        self._pool.shutdown()
        last = self._said.read().strip().splitlines()
        return f"ended with {self._process.exitcode}: {last[-1] if last else 'no message'}"
