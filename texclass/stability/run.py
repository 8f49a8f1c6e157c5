"""Run the battery: subjects in processes of their own, with a time limit for every cell."""

import importlib
import multiprocessing
import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any, Literal

import pandas as pd

from texclass.provenance import versions
from texclass.stability.inputs import battery_hash
from texclass.stability.judging import Mark, Subject, judge
from texclass.stability.result import StabilityResult

Group = Literal["models", "filters", "transforms", "features", "peers"]
CELL_S = 180.0
"""Time limit of one cell in s: some libraries are called up to ten times in it."""
START_S = 600.0
"""Time limit of the imports, and of the first cell of each subject, which may compile."""
STREAM_S = 900.0
GIVE_UP = 3
"""Crashes and hangs of one subject after which the rest of its cells is left out."""
OURS = {
    "models": "autoregression:SUBJECTS modes:SUBJECTS",
    "filters": "signals:SUBJECTS",
    "transforms": "signals:SUBJECTS",
    "features": "features:subjects",
}
"""Where the subjects of each group stand."""
LIBRARIES = ("numpy", "pandas", "numba", "mpmath")
Progress = Callable[[int, int, str], None]


def run_stability(
    *,
    quick: bool = False,
    only: Group | None = None,
    peers: Mapping[str, str] | None = None,
    left_out: Sequence[str] = (),
    jobs: int = 2,
    progress: Progress | None = None,
) -> StabilityResult:
    """Try ours, and the public libraries that are handed over.

    Parameters
    ----------
    quick : bool
        A small part of the battery.
    only : {"models", "filters", "transforms", "features", "peers"}, optional
        One group alone.
    peers : mapping of str to str, optional
        Of each public library to be tried the place of its subjects, "module:function".
    left_out : sequence of str
        Which public libraries are not tried, and why.
    jobs : int
        Processes at a time, of one thread each.
    progress : callable, optional
        Called with (done, total, what), from several threads.
    """
    start = time.monotonic()
    ours = [group for group in OURS if only in (None, group)]
    tasks = [
        (" ".join(f"texclass.stability.subjects_{where}" for where in OURS[group].split()), group)
        for group in ours
    ]
    if only in (None, "peers"):
        tasks += [(place, "peers") for place in (peers or {}).values()]
    given_up = list(left_out) if only in (None, "peers") else []

    def cells_of(task: tuple[str, str]) -> list[dict[str, Any]]:
        return supervise(*task, quick=quick, progress=progress, left_out=given_up)

    with ThreadPoolExecutor(max_workers=jobs) as pool:
        cells = [cell for found in pool.map(cells_of, tasks) for cell in found]
    return StabilityResult(
        pd.DataFrame(cells),
        quick,
        versions(*LIBRARIES, *(peers or {})),
        battery_hash(),
        time.monotonic() - start,
        left_out=tuple(given_up),
    )


def supervise(
    places: str,
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
    places : str
        "module:name" of a list of subjects, or of a function that returns one; several with blanks between.
    group : str
        Only the subjects of this group are tried.
    quick : bool
        As in `run_stability`.
    cell_s : float
        Time limit of a cell in s.
    progress, left_out
        As in `run_stability`; `left_out` receives a line for each subject that was given up.
    """
    cells: list[dict[str, Any]] = []
    failures: Counter[str] = Counter()
    done: int | None = 0
    while done is not None:
        given_up = [name for name, times in failures.items() if times >= GIVE_UP]
        done, died = _one_process((places, group, quick, done, given_up), cell_s, cells, progress)
        if died is not None:
            cells.append(died)
            failures[died["subject"]] += 1
            if failures[died["subject"]] == GIVE_UP and left_out is not None:
                about = f"{died['library']} {died['subject']}"
                left_out.append(f"{about}: given up after {GIVE_UP} crashes or hangs")
    return cells


def _one_process(
    task: tuple[Any, ...], cell_s: float, cells: list[dict[str, Any]], progress: Progress | None
) -> tuple[int | None, dict[str, Any] | None]:
    """Read the cells of one process; return where to go on (None: all done) and the cell it died in."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    with tempfile.NamedTemporaryFile("r", encoding="utf-8", errors="replace") as said:
        process = context.Process(target=_work, args=(task, there, said.name), daemon=True)
        process.start()
        there.close()
        number, begun, limit = -1, None, START_S
        try:
            while here.poll(limit):
                message = here.recv()
                if message is None:
                    return None, None
                if "mark" in message:
                    cells.append(message)
                    continue
                first = begun is None or begun["subject"] != message["about"]["subject"]
                number, begun = message["number"], message["about"]
                limit = max(START_S if first else cell_s, STREAM_S * (begun["family"] == "stream"))
                if progress:
                    progress(number + 1, message["of"], f"{begun['library']} {begun['group']}")
            mark, reason = Mark.HANG, f"no answer within {limit:g} s"
        except EOFError:
            process.join()
            last = said.read().strip().splitlines()
            mark = Mark.CRASH
            reason = f"the process ended with {process.exitcode}: {last[-1] if last else 'no message'}"
        finally:
            process.kill()
            process.join()
            here.close()
    if begun is None:
        raise ValueError(f"{task[0]}: {reason}; the rule is that it can be imported")
    unmeasured = {"error": None, "limit": None, "what": "", "seconds": 0.0}
    return number + 1, begun | {"mark": mark, "reason": reason} | unmeasured


def _work(task: tuple[Any, ...], out: Connection, said: str) -> None:
    """Judge all cells of a group from number `done` on, but for those of subjects that were given up.

    Before each cell its number and name are sent, so that whoever reads knows what did not come back. What a
    library prints goes to the file `said`.
    """
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    places, group, quick, done, given_up = task
    printed = os.open(said, os.O_WRONLY | os.O_APPEND)
    os.dup2(printed, 1)
    os.dup2(printed, 2)
    with threadpool_limits(1):
        subjects = [subject for place in places.split() for subject in _subjects_at(place)]
        pairs = [(s, case) for s in subjects if s.group == group for case in s.cases(quick)]
        for number, (subject, case) in enumerate(pairs):
            if number < done or subject.name in given_up:
                continue
            about = {
                "library": subject.library,
                "group": subject.group,
                "subject": subject.name,
                "family": case.family,
                "case": case.name,
            }
            out.send({"number": number, "of": len(pairs), "about": about})
            out.send(judge(subject, case))
    out.send(None)


def _subjects_at(place: str) -> list[Subject]:
    module, name = place.split(":")
    found = getattr(importlib.import_module(module), name)
    subjects: list[Subject] = found() if callable(found) else found
    return subjects
