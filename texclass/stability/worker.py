"""One library in a process of its own: it judges cells one after the other and writes each as a line of JSON.

Started by `texclass.stability.run`, so that a crash or a hang of what is tried is a cell, not the end.
"""

import importlib
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from texclass.stability.signals import Case
from texclass.stability.verdict import Subject, judge


def find(where: str) -> list[Subject]:
    """Return the subjects of "module:function", or of several with blanks between."""
    subjects: list[Subject] = []
    for part in where.split():
        module, function = part.split(":")
        subjects += getattr(importlib.import_module(module), function)()
    return subjects


def cells_of(where: str, quick: bool) -> Iterator[tuple[Subject, Case]]:
    """Yield what is to be judged, always in the same order."""
    for subject in find(where):
        for case in subject.cases(quick):
            yield subject, case


def work(where: str, quick: bool, done: int, given_up: list[str], out: Any) -> None:
    """Judge all cells from number `done` on, but for those of subjects that were given up.

    Before each cell its number and name are written, so that whoever reads knows what did not come back.
    """
    pairs = list(cells_of(where, quick))
    for number, (subject, case) in enumerate(pairs):
        if number < done or subject.name in given_up:
            continue
        about = {"library": subject.library, "group": subject.group, "subject": subject.name}
        begin = {"begin": number, "of": len(pairs), **about, "family": case.family, "case": case.name}
        _say(out, begin)
        _say(out, {"cell": asdict(judge(subject, case))})
    _say(out, {"end": len(pairs)})


def _say(out: Any, message: dict[str, Any]) -> None:
    out.write(json.dumps(message) + "\n")
    out.flush()


def main() -> None:
    """Read the task from the command line; keep the protocol's pipe away from what a library prints."""
    task = json.loads(sys.argv[1])
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    work(task["subjects"], task["quick"], task["done"], task["given_up"], out)


if __name__ == "__main__":
    main()
