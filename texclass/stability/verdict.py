"""One cell of the battery: what a subject made of an input, judged by one rule for ours and for theirs."""

import re
import time
import traceback
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from texclass.stability.signals import Case

_FLOATING_POINT = re.compile(
    r"(invalid value|divide by zero|overflow|underflow) encountered|Mean of empty slice|Degrees of freedom"
)
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_ABSOLUTE = re.compile(r"(?:\.{1,2}/|/)(?:[\w.+-]+/)+(?=[\w.+-])")
"""Folders before a file's name, which differ from machine to machine."""
_CUT = 300


class Mark(StrEnum):
    """What became of a cell, from best to worst."""

    EXACT = "exact"
    DOCUMENTED = "documented"
    REFUSED = "error"
    UNCHECKED = "not checked"
    WARNED = "warned"
    SILENT = "silent NaN"
    WRONG = "WRONG"
    CRASH = "crash"
    HANG = "hang"


BAD = (Mark.SILENT, Mark.WRONG, Mark.CRASH, Mark.HANG)
"""NaN or infinity without a word, a wrong result handed over as right, an accident, no answer at all."""


@dataclass(frozen=True)
class Check:
    """One invariant or reference: what it says, the error measured, and the largest that is exact enough."""

    what: str
    error: float
    limit: float

    @property
    def holds(self) -> bool:
        """Whether the error is a number within the limit."""
        return bool(self.error <= self.limit)


@dataclass(frozen=True)
class Documented:
    """The subject says itself, by a reason or a flag it documents, that this input has no proper answer."""

    reason: str


@dataclass(frozen=True)
class Unchecked:
    """A reference that could not be computed here, and why."""

    reason: str


Finding = Check | Documented | Unchecked


@dataclass(frozen=True)
class Subject:
    """Something that is tried: how it runs on an input, and what "right" means for it.

    Attributes
    ----------
    name
        Unique within its library.
    group
        "models", "filters", "transforms", "features" or "peers".
    library
        Package it comes from: "texclass", or the name of a public library.
    cases
        Inputs of the battery it is given; the argument says whether the run is a quick one.
    run
        Takes the signal and the case, returns a result.
    checks
        Takes signal, case and result, yields findings.
    """

    name: str
    group: str
    library: str
    cases: Callable[[bool], Iterable[Case]]
    run: Callable[[Any, Case], Any]
    checks: Callable[[Any, Case, Any], Iterable[Finding]]


@dataclass(frozen=True)
class Cell:
    """The judgement of one subject on one input.

    Attributes
    ----------
    error, limit
        Of the check that comes nearest to its limit (or exceeds it most); None where nothing was measured.
    what
        That check in words.
    reason
        Why it is documented, refused, wrong, ...
    """

    library: str
    group: str
    subject: str
    family: str
    case: str
    mark: Mark
    error: float | None = None
    limit: float | None = None
    what: str = ""
    reason: str = ""
    seconds: float = 0.0


def judge(subject: Subject, case: Case) -> Cell:
    """Run a subject on an input and say what came out.

    - An exception raised on purpose (`is_clear`) is a clear error; `UndefinedFeatureError` a documented NaN
      with its reason. Either is wrong on an input marked `required`, which every subject must answer.
    - Any other exception is a crash.
    - A result is wrong if one of its checks fails, or if the input was written to. If its numbers are not
      finite it is a silent NaN, unless the library itself said why (by a warning or a reason).
    - A right result with a floating-point warning of NumPy is `WARNED`.
    """
    x = case.signal()
    before = _bytes_of(x)
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = subject.run(x, case)
        except Exception as error:
            mark, reason = _refusal(error, subject.library, case)
            return _cell(subject, case, mark, reason=reason, seconds=time.perf_counter() - start)
    seconds = time.perf_counter() - start
    if _bytes_of(x) != before:
        return _cell(subject, case, Mark.WRONG, reason="the input was written to", seconds=seconds)
    noisy = [str(w.message) for w in caught if _FLOATING_POINT.search(str(w.message))]
    said = [str(w.message) for w in caught if not _FLOATING_POINT.search(str(w.message))]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        findings = list(_findings(subject, x, case, result))
    return _weigh(subject, case, findings, noisy, said, seconds)


def is_clear(error: Exception, library: str) -> bool:
    """Whether an exception was raised on purpose: by a `raise`, of a kind that can say what is wrong.

    A `ValueError`, `TypeError`, `NotImplementedError`, `RuntimeError`, `ArithmeticError` or `AssertionError`,
    or an exception of the library's own, whose innermost frame is a `raise` or `assert` (of the library or of
    one it calls; in compiled code that cannot be seen and is believed), or that says that a type is not
    supported; with a message of ten characters or more.
    """
    kinds = (ValueError, TypeError, NotImplementedError, RuntimeError, ArithmeticError, AssertionError)
    own = type(error).__module__.split(".")[0] == library
    frames = traceback.extract_tb(error.__traceback__)
    line = frames[-1].line or "" if frames else ""
    compiled = bool(frames) and frames[-1].filename.endswith((".pyx", ".pxd", ".pxi"))
    kind = isinstance(error, kinds) and not isinstance(
        error, (ZeroDivisionError, OverflowError, RecursionError)
    )
    statement = "assert" if isinstance(error, AssertionError) else "raise"
    on_purpose = line.startswith(statement) or compiled or "not supported" in str(error)
    return (kind or own) and on_purpose and len(str(error)) >= 10


def _refusal(error: Exception, library: str, case: Case) -> tuple[Mark, str]:
    text = f"{type(error).__name__}: {error}"
    clear = is_clear(error, library)
    if not clear:
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({frames[-1].filename.rsplit('/', 1)[-1]}:{frames[-1].lineno})" if frames else ""
        return Mark.CRASH, text + where
    if case.required:
        return Mark.WRONG, f"refuses an ordinary input: {text}"
    undefined = type(error).__name__ == "UndefinedFeatureError"  # by name: its import takes a second
    return (Mark.DOCUMENTED if undefined else Mark.REFUSED), text


def _findings(subject: Subject, x: Any, case: Case, result: Any) -> Iterable[Finding]:
    try:
        yield from subject.checks(x, case, result)
    except Exception as error:
        yield Check(f"a result of the expected form ({type(error).__name__}: {error})", np.inf, 0.0)


def _weigh(
    subject: Subject, case: Case, findings: list[Finding], noisy: list[str], said: list[str], seconds: float
) -> Cell:
    checks = [f for f in findings if isinstance(f, Check)]
    reasons = [f.reason for f in findings if isinstance(f, Documented)] + _documenting(said)
    skipped = [f.reason for f in findings if isinstance(f, Unchecked)]
    worst = max(checks, key=_excess, default=None)  # of equals the first: that the numbers are finite
    found = {"error": worst.error, "limit": worst.limit, "what": worst.what} if worst else {}
    if worst is not None and not worst.holds:
        no_number = not np.isfinite(worst.error) and worst.what.startswith("finite")
        explained = no_number and bool(reasons)
        mark = Mark.SILENT if no_number else Mark.WRONG
        if explained:
            mark = Mark.WRONG if case.required else Mark.DOCUMENTED
        told = reasons[0] if explained else _told(worst)
    elif noisy:
        mark, told = Mark.WARNED, noisy[0]
    elif reasons:
        mark, told = Mark.DOCUMENTED, reasons[0]
    elif skipped and not checks:
        mark, told = Mark.UNCHECKED, skipped[0]
    else:
        mark, told = Mark.EXACT, skipped[0] if skipped else ""
    return _cell(subject, case, mark, reason=told, seconds=seconds, **found)


def _told(check: Check) -> str:
    if not np.isfinite(check.error):
        return f"not so: {check.what}"
    return f"{check.what}: {check.error:.3g}; the limit is {check.limit:.3g}"


def _documenting(said: list[str]) -> list[str]:
    """Return the warnings by which a library says that its result is undefined."""
    about_result = re.compile(
        r"\bnan\b|undefined|constant|too short|singular|not converge|ill.condition", re.I
    )
    return [text for text in said if about_result.search(text)]


def _excess(check: Check) -> float:
    if not np.isfinite(check.error):
        return np.inf
    return check.error / check.limit if check.limit > 0 else (np.inf if check.error > 0 else 0.0)


def _cell(subject: Subject, case: Case, mark: Mark, *, reason: str = "", **found: Any) -> Cell:
    text = " ".join(_ABSOLUTE.sub("", _COLOUR.sub("", reason)).split())[:_CUT]
    return Cell(
        subject.library, subject.group, subject.name, case.family, case.name, mark, reason=text, **found
    )


def _bytes_of(x: Any) -> bytes:
    return np.asarray(x).tobytes() if isinstance(x, np.ndarray) else repr(x).encode()
