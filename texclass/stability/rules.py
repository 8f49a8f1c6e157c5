"""What "right" means: how one cell is judged, a subject on an input, by one rule for ours and for theirs.

A subject yields findings about its result; the checks it shares with others stand below.
"""

import re
import time
import traceback
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from enum import StrEnum
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from texclass import vibration
from texclass.recording import Samples
from texclass.stability import exact
from texclass.stability.inputs import Case

_FLOATING_POINT = re.compile(
    r"(invalid value|divide by zero|overflow|underflow) encountered|Mean of empty slice|Degrees of freedom"
)
_UNDEFINED = re.compile(r"\bnan\b|undefined|constant|too short|singular|not converge|ill.condition", re.I)
"""Words of a warning by which a library says that its result is undefined."""
_COLOURS_AND_FOLDERS = re.compile(r"\x1b\[[0-9;]*m|(?:\.{1,2}/|/)(?:[\w.+-]+/)+(?=[\w.+-])")
"""Colours, and folders before a file's name, which differ from machine to machine."""
OMEGA: Samples = (np.arange(256) + 0.5) * np.pi / 256
EXCESS = 1e-6
"""Residual energy above the optimum of the method, relative to it."""
RESPONSE = 1e-9
"""Error of a response over its largest magnitude."""


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


OURS = "texclass"
"""Library of our own subjects."""
BAD = (Mark.SILENT, Mark.WRONG, Mark.CRASH, Mark.HANG)
"""NaN or infinity without a word, a wrong result handed over as right, an accident, no answer at all."""


class Check(NamedTuple):
    """One invariant or reference: what it says, the error measured, and the largest that is exact enough."""

    what: str
    error: float
    limit: float

    @property
    def excess(self) -> float:
        """Error over limit; infinite where nothing was measured, or a limit of 0 is not kept."""
        if self.error == 0:
            return 0.0
        return self.error / self.limit if np.isfinite(self.error) and self.limit > 0 else np.inf


Given = Callable[[bool], Iterable[Case]]
"""Inputs of the battery that a subject is given; the argument says whether the run is a quick one."""
Attempt = Generator[Any, None, Any]
"""Findings about a result, one after another: a `Check`, or a reason (str) by which the subject itself says
that this input has no proper answer; anything else is passed over. What stands before the first `yield` is
tried, and judged if it raises."""
Trial = Callable[[Any, Case], Attempt]


class Subject(NamedTuple):
    """Something that is tried: how it runs on an input, and what "right" means for it.

    Attributes
    ----------
    name
        Unique within its library.
    group
        "models", "filters", "transforms", "features" or "baselines".
    cases
        What it is given.
    trial
        Generator over (signal, case) that yields findings about the result.
    library
        Package it comes from: "texclass", or the name of a public library.
    """

    name: str
    group: str
    cases: Given
    trial: Trial
    library: str = OURS


def tried(
    subjects: list[Subject], group: str, named: str | Mapping[str, Mapping[str, Any]], cases: Given
) -> Callable[[Callable[..., Attempt]], Callable[..., Attempt]]:
    """Return a decorator that adds a trial to `subjects`: once, or by name with further arguments."""

    def add(trial: Callable[..., Attempt]) -> Callable[..., Attempt]:
        for name, given in ({named: {}} if isinstance(named, str) else named).items():
            subjects.append(Subject(name, group, cases, partial(trial, **given)))
        return trial

    return add


def judge(subject: Subject, case: Case) -> dict[str, Any]:
    """Run a subject on an input and return the outcome.

    - An exception raised on purpose (`is_clear`) is a clear error; `UndefinedFeatureError` a documented NaN
      with its reason. Either is wrong on an input marked `required`, which every subject must answer.
    - Any other exception is a crash.
    - A result is wrong if one of its checks fails, or if the input was written to. If its numbers are not
      finite it is a silent NaN, unless the library itself gave the reason (by a warning or a reason).
    - A right result with a floating-point warning of NumPy is `WARNED`.

    Returns
    -------
    dict
        What `outcome` returns; error, limit and what are those of the check that comes nearest to its limit
        (or exceeds it most).
    """
    names, before, start = names_of(subject, case), case.x.tobytes(), time.perf_counter()
    attempt = subject.trial(case.x, case)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            findings, refusal = [next(attempt)], None
        except Exception as error:
            findings, refusal = [], error
    seconds = time.perf_counter() - start
    if refusal:
        return outcome(names, *judge_refusal(refusal, subject, case), seconds=seconds)
    if case.x.tobytes() != before:
        return outcome(names, Mark.WRONG, "the input was written to", seconds=seconds)
    unchecked = ""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            findings.extend(attempt)
        except exact.NoReferenceError as error:
            unchecked = str(error)
        except Exception as error:
            findings.append(holds(f"a result of the expected form ({type(error).__name__}: {error})", False))
    checks = [finding for finding in findings if isinstance(finding, Check)]
    worst = max(checks, key=lambda check: check.excess, default=None)  # of equals the first: finite numbers
    reasons = [finding for finding in findings if isinstance(finding, str)]
    texts = [str(warning.message) for warning in caught]
    mark, reason = judge_result(worst, reasons, texts, unchecked, required=case.required)
    return outcome(names, mark, reason, **worst._asdict() if worst else {}, seconds=seconds)


def names_of(subject: Subject, case: Case) -> dict[str, str]:
    """Return the names of a subject and an input: library, group, subject, family and case."""
    names = (subject.library, subject.group, subject.name, case.family, case.name)
    return dict(zip(("library", "group", "subject", "family", "case"), names, strict=True))


def outcome(names: Mapping[str, str], mark: Mark, reason: str, **measured: Any) -> dict[str, Any]:
    """Return a row of the table of outcomes.

    Parameters
    ----------
    names : mapping
        As `names_of` returns them.
    mark : Mark
        What became of the subject on the input.
    reason : str
        Why it is documented, refused, wrong, ...; colours and folders, which differ from machine to machine,
        are removed.
    **measured
        what, error and limit of the decisive check ("" and None where nothing was measured), and seconds, the
        time that the subject took.
    """
    reason = " ".join(_COLOURS_AND_FOLDERS.sub("", reason).split())[:300]
    row = {**names, "mark": mark, "reason": reason, "error": None, "limit": None, "what": "", "seconds": 0.0}
    return row | measured


def judge_refusal(error: Exception, subject: Subject, case: Case) -> tuple[Mark, str]:
    """Return mark and reason of an exception."""
    text = f"{type(error).__name__}: {error}"
    if not is_clear(error, subject.library):
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({frames[-1].filename.rsplit('/', 1)[-1]}:{frames[-1].lineno})" if frames else ""
        return Mark.CRASH, text + where
    if case.required:
        return Mark.WRONG, f"refuses an ordinary input: {text}"
    undefined = type(error).__name__ == "UndefinedFeatureError"  # by name: its import takes a second
    return (Mark.DOCUMENTED if undefined else Mark.REFUSED), text


def is_clear(error: Exception, library: str) -> bool:
    """Whether an exception was raised on purpose: by a `raise`, of a kind that can say what is wrong.

    A `ValueError`, `TypeError`, `NotImplementedError`, `RuntimeError`, `ArithmeticError` or `AssertionError`,
    or an exception of the library's own, whose innermost frame is a `raise` or `assert` (of the library or of
    one it calls; in compiled code that cannot be seen and is believed), or that says that a type is not
    supported; with a message of ten characters or more.
    """
    accidents = (ZeroDivisionError, OverflowError, RecursionError)
    kinds = (ValueError, TypeError, NotImplementedError, RuntimeError, ArithmeticError, AssertionError)
    own = type(error).__module__.split(".")[0] == library
    frames = traceback.extract_tb(error.__traceback__)
    line = frames[-1].line or "" if frames else ""
    compiled = bool(frames) and frames[-1].filename.endswith((".pyx", ".pxd", ".pxi"))
    statement = "assert" if isinstance(error, AssertionError) else "raise"
    on_purpose = line.startswith(statement) or compiled or "not supported" in str(error)
    kind = isinstance(error, kinds) and not isinstance(error, accidents)
    return (kind or own) and on_purpose and len(str(error)) >= 10


def judge_result(
    worst: Check | None, reasons: list[str], texts: list[str], unchecked: str, *, required: bool
) -> tuple[Mark, str]:
    """Return mark and reason of a result, from its worst check, its reasons and the texts of its warnings."""
    noisy = [text for text in texts if _FLOATING_POINT.search(text)]
    reasons = [*reasons, *(text for text in texts if text not in noisy and _UNDEFINED.search(text))]
    if worst is not None and worst.excess > 1:
        if np.isfinite(worst.error):
            return Mark.WRONG, f"{worst.what}: {worst.error:.3g}; the limit is {worst.limit:.3g}"
        is_no_number = worst.what.startswith("finite")
        if is_no_number and reasons:
            return (Mark.WRONG if required else Mark.DOCUMENTED), reasons[0]
        return (Mark.SILENT if is_no_number else Mark.WRONG), f"not so: {worst.what}"
    if noisy:
        return Mark.WARNED, noisy[0]
    if reasons:
        return Mark.DOCUMENTED, reasons[0]
    return (Mark.UNCHECKED if unchecked and worst is None else Mark.EXACT), unchecked


# Checks that ours and public libraries share ----------------------------------------------------------------


def largest(x: ArrayLike) -> float:
    """Return the largest magnitude."""
    return float(np.max(np.abs(x)))


def holds(what: str, condition: object) -> Check:
    """Check what has no size: it holds, or it does not."""
    return Check(what, 0.0 if condition else np.inf, 0.0)


def finite(what: str, values: ArrayLike) -> Check:
    """Check that every number is finite."""
    return holds(f"finite {what}", np.all(np.isfinite(np.asarray(values, dtype=np.float64))))


def close(what: str, value: ArrayLike, reference: ArrayLike, limit: float, *, scale: float = 0.0) -> Check:
    """Check the largest difference over the largest reference (or `scale`, if that is larger)."""
    given, right = np.asarray(value, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    if given.shape != right.shape:
        return Check(f"{what}: shape {given.shape} for {right.shape}", np.inf, limit)
    difference = float(np.max(np.abs(given - right), initial=0.0))
    size = max(float(np.max(np.abs(right), initial=0.0)), scale)
    return Check(what, difference and (difference / size if size > 0 else np.inf), limit)


def stable(k: Samples) -> Check:
    """Check that every |k| is below 1: a stable filter."""
    return holds("every |k| below 1 (stable)", np.all(np.abs(k) < 1))


def stable_coefficients(a: Samples) -> Iterator[Check]:
    """Check that 1, a_1 ... a_p are finite and, by a 60-digit step-down, a stable filter.

    An order above 128 is not stepped down: in 60 digits that takes minutes for all inputs.
    """
    yield finite("coefficients", a)
    if a.size <= 129 and np.all(np.isfinite(a)):
        yield stable(exact.step_down(a))


def stable_sections(denominators: Samples) -> Check:
    """Check second-order sections by their last two coefficients, those of 1 + a_1 z^-1 + a_2 z^-2."""
    a_1, a_2 = denominators[:, -2], denominators[:, -1]
    inside = (np.abs(a_2) < 1) & (np.abs(a_1) < 1 + a_2)
    return Check("sections that are not stable", float(np.sum(~inside)), 0.0)


def excess(whose: str, energy: float, least: float, limit: float = EXCESS) -> Check:
    """Check the residual energy of a predictor against the least one, relative to it.

    Both are relative to the energy of the signal, of which less than 1e-20 counts as 0: times the limit, it
    is the rounding of the samples.
    """
    error = max((energy - least) / (least + 1e-20), 0.0) if np.isfinite(energy) else np.inf
    return Check(f"residual energy above {whose}", float(error), limit)


def line_spectrum(k: Samples, lsf: Samples, back: Samples | None) -> Iterator[Check]:
    """Check that frequencies increase in (0, pi), and that the way back is stable and has the same spectrum.

    `back` are reflection coefficients; None, if the way back has none (an unstable filter).
    """
    yield finite("frequencies", lsf)
    edges = np.concatenate([[0.0], lsf, [np.pi]])
    yield holds("frequencies strictly increasing in (0, pi)", np.all(np.diff(edges) > 0))
    if back is None or not np.all(np.isfinite(back)):
        yield holds("the way back is a stable filter", False)
        return
    yield stable(back)
    if np.all(np.abs(back) < 1):
        difference = spectrum_db(back) - spectrum_db(k)
        limit = 1e-8 if k.size <= 128 else 1e-6 if k.size <= 400 else 1e-3
        yield Check("round trip, dB RMS of the spectrum", float(np.sqrt(np.mean(difference**2))), limit)


def spectrum_db(k: Samples) -> Samples:
    """Return the power spectrum of a model at unit gain at the frequencies `OMEGA`, in dB."""
    return vibration.Autoregression(k, np.asarray(1.0)).log_spectrum_db(OMEGA)


def response(what: str, out: Samples, k: Samples, excitation: Samples) -> Check:
    """Check the sound of a model against that of 60-digit arithmetic."""
    return close(f"{what}, against 60 digits", out, exact.all_pole_response(k, excitation), RESPONSE)
