"""Subjects judged in a process of their own: a crash or a hang is an outcome, not the end of the run.

The process imports no more than this and what it tries, as it is started anew after each crash.
"""

import importlib
import multiprocessing
import os
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TextIO

from texclass.stability.rules import Mark, Subject, judge, names_of, outcome

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Limits:
    """When a subject is given up.

    Attributes
    ----------
    cell_s
        Time limit of one subject on one input, in s: some libraries are called up to ten times in it.
    start_s
        Time limit of the imports, and of the first input of each subject, which may compile, in s.
    stream_s
        Least time limit of a stream of 10^8 samples, in s.
    failures
        Crashes and hangs of one subject after which the rest of its inputs is left out.
    """

    cell_s: float = 180.0
    start_s: float = 600.0
    stream_s: float = 900.0
    failures: int = 3


DEFAULT_LIMITS = Limits()


def supervise(
    place: str,
    group: str,
    *,
    quick: bool,
    limits: Limits = DEFAULT_LIMITS,
    progress: Progress | None = None,
    left_out: list[str] | None = None,
) -> list[dict[str, Any]]:
    """Judge subjects in a process of their own, and start it anew when it dies or hangs.

    Parameters
    ----------
    place : str
        "module:name" of a list of subjects, or of a function that returns one.
    group : str
        Only the subjects of this group are tried.
    quick : bool
        As in `run_stability`.
    limits : Limits
        Time limits, and when a subject is given up.
    progress, left_out
        As in `run_stability`; `left_out` receives a line for each subject that was given up.

    Returns
    -------
    list of dict
        One outcome for each subject and input, as `judge` returns it.
    """
    outcomes: list[dict[str, Any]] = []
    failures: Counter[str] = Counter()
    with (  # a named temporary file cannot be opened a second time on Windows
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        (Path(folder) / "printed").open("w+", encoding="utf-8", errors="replace") as printed,
        Worker(place, group, quick, printed) as worker,
    ):
        try:
            cells = worker.start(limits.start_s)
        except (TimeoutError, EOFError) as error:
            raise ValueError(f"{place}: {worker.end(error)}. Expected that it can be imported") from error
        warm = ""
        for number, names in enumerate(cells):
            subject = names["subject"]
            if failures[subject] >= limits.failures:
                continue
            if progress:
                progress(number + 1, len(cells), f"{names['library']} {group}")
            limit_s = limits.cell_s if subject == warm else limits.start_s
            if names["family"] == "stream":
                limit_s = max(limit_s, limits.stream_s)
            warm = subject
            try:
                outcomes.append(worker.judge(number, limit_s))
                continue
            except (TimeoutError, EOFError) as error:
                mark = Mark.HANG if isinstance(error, TimeoutError) else Mark.CRASH
                outcomes.append(outcome(names, mark, worker.end(error)))
            failures[subject] += 1
            if failures[subject] == limits.failures and left_out is not None:
                times = f"{limits.failures} crashes or hangs"
                left_out.append(f"{names['library']} {subject}: given up after {times}")
            worker.start(limits.start_s)
            warm = ""
    return outcomes


class Worker:
    """A process of one thread that judges on demand; what is printed in it goes to a file."""

    def __init__(self, place: str, group: str, quick: bool, printed: TextIO) -> None:
        self._task, self._printed = (place, group, quick), printed

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()

    def start(self, limit_s: float) -> list[dict[str, str]]:
        """Start the process and return the names of all subjects and inputs, as `names_of` gives them."""
        context = multiprocessing.get_context("spawn")
        self._pipe, other_end = context.Pipe()
        self._process = context.Process(target=serve, args=(other_end, self._printed.name, *self._task))
        self._process.start()
        other_end.close()  # the process alone holds it, so that its death is the end of the pipe
        cells: list[dict[str, str]] = self._receive(limit_s)
        return cells

    def judge(self, number: int, limit_s: float) -> dict[str, Any]:
        """Return the outcome of one subject on one input."""
        self._pipe.send(number)
        row: dict[str, Any] = self._receive(limit_s)
        return row

    def _receive(self, limit_s: float) -> Any:
        """Return what the process sends; TimeoutError if it takes longer, EOFError if the process dies."""
        if not self._pipe.poll(limit_s):
            raise TimeoutError(f"no answer within {limit_s:g} s")
        return self._pipe.recv()

    def end(self, error: Exception) -> str:
        """End the process after an error; return what happened, with the last line it printed."""
        self._process.kill()
        self._process.join()
        lines = self._printed.read().strip().splitlines()
        if isinstance(error, TimeoutError):
            return str(error)
        return f"the process ended with {self._process.exitcode}: {lines[-1] if lines else 'no message'}"


def serve(pipe: Any, printed: str, place: str, group: str, quick: bool) -> None:
    """Judge what the other end of the pipe asks for, in one thread, until that end is closed."""
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    file = os.open(printed, os.O_WRONLY | os.O_APPEND)
    os.dup2(file, 1)
    os.dup2(file, 2)
    threadpool_limits(1)
    module, name = place.split(":")
    members = getattr(importlib.import_module(module), name)
    subjects: list[Subject] = members() if callable(members) else members
    pairs = [
        (subject, case) for subject in subjects if subject.group == group for case in subject.cases(quick)
    ]
    pipe.send([names_of(*pair) for pair in pairs])
    with suppress(EOFError):
        while True:
            pipe.send(judge(*pairs[pipe.recv()]))
