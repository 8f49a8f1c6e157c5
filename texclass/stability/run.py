"""Run the battery: one process a library, with a time limit for every cell, and gather the cells."""

import importlib.util
import json
import os
import platform
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from typing import IO, Any, Literal

from texclass._version import __version__
from texclass.stability import signals
from texclass.stability.result import StabilityResult
from texclass.stability.verdict import Cell, Mark

Group = Literal["models", "filters", "transforms", "features", "peers"]
CELL_S = 180.0
"""Time limit of one cell in s: some libraries are called up to ten times in it."""
START_S = 600.0
"""Time limit of the imports, and of the first cell of each subject, which may compile."""
STREAM_S = 900.0
GIVE_UP = 3
"""Crashes and hangs of one subject after which the rest of its cells is left out."""
OURS: dict[str, tuple[str, ...]] = {
    "models": ("subjects_fits", "subjects_autoregression", "subjects_modes"),
    "filters": ("subjects_filters",),
    "transforms": ("subjects_transforms",),
    "features": ("subjects_features",),
}
LIBRARIES = {
    "librosa": "librosa",
    "scipy": "scipy",
    "spectrum": "spectrum",
    "statsmodels": "statsmodels",
    "pysptk": "pysptk",
    "tsfel": "tsfel",
    "tsfresh": "tsfresh",
    "pycatch22": "pycatch22",
}
"""Public libraries that are tried where they are installed, and their packages."""
CORE = ("librosa", "scipy")
"""Those that come with texclass: a quick run tries no others, whose import alone takes seconds."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
Progress = Callable[[int, int, str], None]


def run_stability(
    *, quick: bool = False, only: Group | None = None, jobs: int = 2, progress: Progress | None = None
) -> StabilityResult:
    """Try ours and every public library that is installed.

    Parameters
    ----------
    quick : bool
        A small part of the battery.
    only : {"models", "filters", "transforms", "features", "peers"}, optional
        One group alone.
    jobs : int
        Processes at a time, of one thread each.
    progress : callable, optional
        Called with (done, total, what), from several threads.

    Returns
    -------
    StabilityResult
    """
    start = time.monotonic()
    tasks = [_tasks_of(ms) for group, ms in OURS.items() if only in (None, group)]
    left_out: list[str] = []
    if only in (None, "peers"):
        tasks += _peer_tasks(quick, left_out)

    def cells_of(task: str) -> list[Cell]:
        return supervise(task, quick=quick, progress=progress, left_out=left_out)

    with ThreadPoolExecutor(max_workers=jobs) as pool:
        cells = tuple(cell for found in pool.map(cells_of, tasks) for cell in found)
    seconds = time.monotonic() - start
    return StabilityResult(
        cells, quick, _versions(), signals.battery_hash(), seconds, left_out=tuple(left_out)
    )


def _tasks_of(modules: tuple[str, ...]) -> str:
    return " ".join(f"texclass.stability.{module}:subjects" for module in modules)


def _peer_tasks(quick: bool, left_out: list[str]) -> list[str]:
    """Return a task for each library that is tried, and say which are not."""
    installed = [name for name, package in LIBRARIES.items() if importlib.util.find_spec(package)]
    left_out += [f"{name}: not installed" for name in LIBRARIES if name not in installed]
    if not quick:
        return [_peer_task(name) for name in installed]
    left_out += [f"{name}: not in a quick run" for name in installed if name not in CORE]
    return [" ".join(_peer_task(name) for name in CORE)]


def _peer_task(library: str) -> str:
    module = "features" if library in ("tsfel", "tsfresh", "pycatch22") else "models"
    return f"texclass.stability.peers_{module}:{library}"


def supervise(
    subjects: str,
    *,
    quick: bool,
    cell_s: float = CELL_S,
    progress: Progress | None = None,
    left_out: list[str] | None = None,
) -> list[Cell]:
    """Judge subjects in a process of their own, and start it anew when it dies.

    Parameters
    ----------
    subjects : str
        "module:function", where the function returns them; several of these with blanks between.
    quick : bool
        As in `run_stability`.
    cell_s : float
        Time limit of a cell in s.
    progress, left_out
        As in `run_stability`; `left_out` receives a line for each subject that was given up.
    """
    cells: list[Cell] = []
    failures: dict[str, int] = {}
    done: int | None = 0
    while done is not None:
        given_up = [name for name, times in failures.items() if times >= GIVE_UP]
        task = {"subjects": subjects, "quick": quick, "done": done, "given_up": given_up}
        done, failed = _one_process(task, cell_s, cells, progress)
        if failed is not None:
            cells.append(failed)
            failures[failed.subject] = failures.get(failed.subject, 0) + 1
            if failures[failed.subject] == GIVE_UP and left_out is not None:
                left_out.append(
                    f"{failed.library} {failed.subject}: given up after {GIVE_UP} crashes or hangs"
                )
    return cells


def _one_process(
    task: dict[str, Any], cell_s: float, cells: list[Cell], progress: Progress | None
) -> tuple[int | None, Cell | None]:
    """Read the cells of one process; return where to go on (None: all done) and the cell it died in."""
    environment = os.environ | {name: "1" for name in THREADS}
    command = [sys.executable, "-m", "texclass.stability.worker", json.dumps(task)]
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment)
        assert process.stdout is not None
        lines = _lines_of(process.stdout)
        begun: dict[str, Any] | None = None
        limit = START_S
        try:
            while (line := lines.get(timeout=limit)) is not None:
                message = json.loads(line)
                if "end" in message:
                    return None, None
                if "begin" in message:
                    first = begun is None or begun["subject"] != message["subject"]
                    limit = max(START_S if first else cell_s, STREAM_S * (message["family"] == "stream"))
                    begun = message
                    if progress:
                        what = f"{message['library']} {message['group']}"
                        progress(message["begin"] + 1, message["of"], what)
                else:
                    cells.append(Cell(**{**message["cell"], "mark": Mark(message["cell"]["mark"])}))
        except queue.Empty:
            if begun is None:
                raise ValueError(f"{task['subjects']} did not start within {limit:g} s") from None
            return begun["begin"] + 1, _died(begun, Mark.HANG, f"no answer within {limit:g} s")
        finally:
            process.kill()
            process.wait()
            process.stdout.close()
        errors.seek(0)
        said = errors.read().strip().splitlines()
        reason = f"the process ended with {process.returncode}: {said[-1] if said else 'no message'}"
        if begun is None:
            raise ValueError(f"{task['subjects']}: {reason}; the rule is that it can be imported")
        return begun["begin"] + 1, _died(begun, Mark.CRASH, reason)


def _lines_of(stream: IO[str]) -> "queue.Queue[str | None]":
    """Return a queue of the lines, which a thread fills; None at the end."""
    lines: queue.Queue[str | None] = queue.Queue()

    def read() -> None:
        try:
            for line in stream:
                lines.put(line)
        except ValueError:  # closed while reading: the process was killed
            pass
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    return lines


def _died(begun: dict[str, Any], mark: Mark, reason: str) -> Cell:
    about = {name: begun[name] for name in ("library", "group", "subject", "family", "case")}
    return Cell(**about, mark=mark, reason=reason)


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "texclass": __version__}
    for name in ("numpy", "pandas", "numba", "mpmath", *LIBRARIES.values()):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found
