"""Run the battery: subjects in processes of their own, with a time limit for every cell."""

import multiprocessing
import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from texclass.provenance import versions
from texclass.stability.inputs import battery_hash
from texclass.stability.judging import Mark, cells_at, quiet_thread
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
    "models": "texclass.stability.subjects_models:SUBJECTS",
    "filters": "texclass.stability.subjects_signals:SUBJECTS",
    "transforms": "texclass.stability.subjects_signals:SUBJECTS",
    "features": "texclass.stability.subjects_features:subjects",
}
"""Where the subjects of each group stand."""
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
    start, foreign = time.monotonic(), peers or {}
    tasks = [(place, group) for group, place in OURS.items() if only in (None, group)]
    given_up: list[str] = []
    if only in (None, "peers"):
        tasks += [(place, "peers") for place in foreign.values()]
        given_up += left_out

    def cells_of(task: tuple[str, str]) -> list[dict[str, Any]]:
        return supervise(*task, quick=quick, progress=progress, left_out=given_up)

    with ThreadPoolExecutor(max_workers=jobs) as pool:
        cells = [cell for found in pool.map(cells_of, tasks) for cell in found]
    return StabilityResult(
        pd.DataFrame(cells),
        quick,
        versions("numpy", "pandas", "numba", "mpmath", *foreign),
        battery_hash(),
        time.monotonic() - start,
        left_out=tuple(given_up),
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
