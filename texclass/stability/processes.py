"""Evaluate subjects in a separate process, so that a crash or a hang does not end the run.

The process is restarted after each crash. To start quickly, it imports only this module and the subjects.
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

from texclass.stability.checks import Mark, Subject, cell_names, evaluate, outcome_row

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Limits:
    """Limits of the run time and of the number of crashes of a subject.

    Attributes
    ----------
    cell_s
        Time limit in s for one subject on one input. Some libraries are called up to ten times within it.
    start_s
        Time limit in s for the imports, and for the first input of each subject, which may compile code.
    stream_s
        Minimum time limit in s for a stream of 10^8 samples.
    failures
        Number of crashes and hangs of a subject after which its remaining inputs are skipped.

    Examples
    --------
    >>> Limits(cell_s=10.0).failures
    3
    """

    cell_s: float = 180.0
    start_s: float = 600.0
    stream_s: float = 900.0
    failures: int = 3


DEFAULT_LIMITS = Limits()


def supervise(
    location: str,
    group: str,
    *,
    quick: bool,
    limits: Limits = DEFAULT_LIMITS,
    progress: Progress | None = None,
    skipped: list[str] | None = None,
) -> list[dict[str, Any]]:
    """Evaluate subjects in a separate process, which is restarted when it crashes or hangs.

    Parameters
    ----------
    location : str
        "module:name" of a list of subjects, or of a function that returns one.
    group : str
        Group of the subjects to evaluate.
    quick : bool
        Whether to use only a small part of the inputs.
    limits : Limits
        Limits of the run time and of the number of crashes.
    progress : callable, optional
        Callback `progress(n_done, n_total, name)`; `name` is the library and group under test.
    skipped : list of str, optional
        List to which a line is appended for each subject whose remaining inputs are skipped.

    Returns
    -------
    list of dict
        One outcome of `evaluate` for each subject and input.

    Examples
    --------
    This starts a process::

        supervise("texclass.stability.subjects_models:SUBJECTS", "models", quick=True)
    """
    outcomes: list[dict[str, Any]] = []
    failures: Counter[str] = Counter()
    with (  # a named temporary file cannot be opened a second time on Windows
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        (Path(folder) / "output").open("w+", encoding="utf-8", errors="replace") as output,
        Worker(location, group, quick, output) as worker,
    ):
        try:
            cells = worker.start(limits.start_s)
        except (TimeoutError, EOFError) as error:
            raise ValueError(
                f"{location} cannot be imported: {worker.end(error)}. Expected the 'module:name' of a list "
                "of subjects, or of a function that returns one"
            ) from error
        previous = ""
        for number, names in enumerate(cells):
            subject = names["subject"]
            if failures[subject] >= limits.failures:
                continue
            if progress:
                progress(number + 1, len(cells), f"{names['library']} {group}")
            limit_s = limits.cell_s if subject == previous else limits.start_s
            if names["family"] == "stream":
                limit_s = max(limit_s, limits.stream_s)
            previous = subject
            try:
                outcomes.append(worker.evaluate(number, limit_s))
                continue
            except (TimeoutError, EOFError) as error:
                mark = Mark.HANG if isinstance(error, TimeoutError) else Mark.CRASH
                outcomes.append(outcome_row(names, mark, worker.end(error)))
            failures[subject] += 1
            if failures[subject] == limits.failures and skipped is not None:
                reason = f"abandoned after {limits.failures} crashes or hangs"
                skipped.append(f"{names['library']} {subject}: {reason}")
            worker.start(limits.start_s)
            previous = ""
    return outcomes


class Worker:
    """Process with one thread that evaluates subjects on demand. Its printed output goes to a file."""

    def __init__(self, location: str, group: str, quick: bool, output: TextIO) -> None:
        self._task, self._printed = (location, group, quick), output

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()

    def start(self, limit_s: float) -> list[dict[str, str]]:
        """Start the process and return the `cell_names` of all subjects and inputs."""
        context = multiprocessing.get_context("spawn")
        self._pipe, other_end = context.Pipe()
        self._process = context.Process(target=serve, args=(other_end, self._printed.name, *self._task))
        self._process.start()
        other_end.close()  # only the process keeps this end open, so the pipe closes when the process ends
        cells: list[dict[str, str]] = self._receive(limit_s)
        return cells

    def evaluate(self, number: int, limit_s: float) -> dict[str, Any]:
        """Return the outcome of one subject on one input."""
        self._pipe.send(number)
        row: dict[str, Any] = self._receive(limit_s)
        return row

    def _receive(self, limit_s: float) -> Any:
        """Return the next message of the process.

        Raise TimeoutError if there is none within the limit, and EOFError if the process has ended.
        """
        if not self._pipe.poll(limit_s):
            raise TimeoutError(f"no answer within {limit_s:g} s")
        return self._pipe.recv()

    def end(self, error: Exception) -> str:
        """End the process after an error, and return a description with the last line of its output."""
        self._process.kill()
        self._process.join()
        lines = self._printed.read().strip().splitlines()
        if isinstance(error, TimeoutError):
            return str(error)
        return f"the process ended with {self._process.exitcode}: {lines[-1] if lines else 'no message'}"


def serve(pipe: Any, output: str, location: str, group: str, quick: bool) -> None:
    """Evaluate pairs of subject and input, whose numbers arrive through the pipe, until the pipe closes."""
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    file = os.open(output, os.O_WRONLY | os.O_APPEND)
    os.dup2(file, 1)
    os.dup2(file, 2)
    threadpool_limits(1)
    module, name = location.split(":")
    members = getattr(importlib.import_module(module), name)
    subjects: list[Subject] = members() if callable(members) else members
    pairs = [
        (subject, case) for subject in subjects if subject.group == group for case in subject.cases(quick)
    ]
    pipe.send([cell_names(*pair) for pair in pairs])
    with suppress(EOFError):
        while True:
            pipe.send(evaluate(*pairs[pipe.recv()]))
