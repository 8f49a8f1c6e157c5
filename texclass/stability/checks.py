"""Evaluate one subject on one input, by the same rules for texclass and other libraries.

The trial of a subject is a generator of findings about its result. The second half of this module contains
checks that several subjects share.
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
from texclass.stability import references
from texclass.stability.inputs import Case

_FLOATING_POINT = re.compile(
    r"(invalid value|divide by zero|overflow|underflow) encountered|Mean of empty slice|Degrees of freedom"
)
_UNDEFINED = re.compile(r"\bnan\b|undefined|constant|too short|singular|not converge|ill.condition", re.I)
"""Words in a warning by which a library states that its result is undefined."""
_COLOURS_AND_FOLDERS = re.compile(r"\x1b\[[0-9;]*m|(?:\.{1,2}/|/)(?:[\w.+-]+/)+(?=[\w.+-])")
"""Escape codes of colours, and folders of file names. Both differ between machines."""
OMEGA: Samples = (np.arange(256) + 0.5) * np.pi / 256
"""Angular frequencies in rad per sample at which spectra are compared."""
MAX_EXCESS_ENERGY = 1e-6
"""Largest accepted excess of the residual energy over the optimum of a method, relative to the optimum."""
MAX_RESPONSE_ERROR = 1e-9
"""Largest accepted error of a response, relative to its largest magnitude."""


class Mark(StrEnum):
    """Outcome of a subject on an input, from best to worst.

    Examples
    --------
    >>> Mark.EXACT in FAILURES, Mark.CRASH in FAILURES
    (False, True)
    """

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
"""Library of the subjects of texclass."""
FAILURES = (Mark.SILENT, Mark.WRONG, Mark.CRASH, Mark.HANG)
"""Failures: NaN or infinity without a reason, a wrong result, a crash, or no result within the time limit."""


class Check(NamedTuple):
    """Check of one invariant, or comparison with one reference: description, error and limit of the error.

    Examples
    --------
    >>> Check("mean of the samples", error=2e-12, limit=1e-12).ratio_to_limit
    2.0
    """

    what: str
    error: float
    limit: float

    @property
    def ratio_to_limit(self) -> float:
        """Ratio of error to limit. It is infinite if the error is not finite, or exceeds a limit of 0."""
        if self.error == 0:
            return 0.0
        return self.error / self.limit if np.isfinite(self.error) and self.limit > 0 else np.inf


CaseSource = Callable[[bool], Iterable[Case]]
"""Function that returns the inputs of a subject. Its argument is True for a quick run."""
Findings = Generator[Any, None, Any]
"""Findings about a result: `Check` objects, and reasons (str) why the subject has no result for this input.
Values of other types are ignored. The code before the first `yield` is the code under test, so its exceptions
count as outcomes."""
Trial = Callable[[Any, Case], Findings]


class Subject(NamedTuple):
    """Function under test with its inputs and its checks.

    Attributes
    ----------
    name
        Name, unique within its library.
    group
        "models", "filters", "transforms", "features" or "baselines".
    cases
        Function that returns the inputs.
    trial
        Generator function that takes (signal, case) and yields findings about the result.
    library
        Package of the function: "texclass", or the name of another library.

    Examples
    --------
    >>> from texclass.stability.inputs import cases_of
    >>> def trial(x, case):
    ...     mean = x.mean()
    ...     yield close("mean, against exact sums", mean, references.moving_average(x, 2 * x.size)[0], 1e-12)
    >>> subject = Subject("mean", "transforms", lambda quick: cases_of("plain"), trial, library="numpy")
    >>> [str(evaluate(subject, case)["mark"]) for case in subject.cases(True)]
    ['exact', 'exact']
    """

    name: str
    group: str
    cases: CaseSource
    trial: Trial
    library: str = OURS


def register(
    subjects: list[Subject], group: str, variants: str | Mapping[str, Mapping[str, Any]], cases: CaseSource
) -> Callable[[Callable[..., Findings]], Callable[..., Findings]]:
    """Return a decorator that adds a trial to `subjects`: once, or once for each variant of its arguments."""

    def add(trial: Callable[..., Findings]) -> Callable[..., Findings]:
        for name, arguments in ({variants: {}} if isinstance(variants, str) else variants).items():
            subjects.append(Subject(name, group, cases, partial(trial, **arguments)))
        return trial

    return add


def evaluate(subject: Subject, case: Case) -> dict[str, Any]:
    """Run a subject on an input and return the outcome.

    - A deliberate exception (`is_deliberate`) counts as a clear error, and `UndefinedFeatureError` as a
      documented NaN with a reason. Both count as wrong if the input is `required`.
    - Any other exception counts as a crash.
    - A result is wrong if one of its checks fails, or if the subject modified the input. A result that is not
      finite is a silent NaN, unless the library gives a reason or a warning.
    - A correct result with a floating-point warning of NumPy gets the mark `WARNED`.

    Parameters
    ----------
    subject : Subject
        Function under test.
    case : Case
        Input.

    Returns
    -------
    dict
        Row of `outcome_row`, with the check that has the largest ratio of error to limit.

    Examples
    --------
    See `Subject`.
    """
    names, original, start = cell_names(subject, case), case.x.tobytes(), time.perf_counter()
    attempt = subject.trial(case.x, case)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            findings, refusal = [next(attempt)], None
        except Exception as error:
            findings, refusal = [], error
    seconds = time.perf_counter() - start
    if refusal:
        return outcome_row(names, *exception_outcome(refusal, subject, case), seconds=seconds)
    if case.x.tobytes() != original:
        return outcome_row(names, Mark.WRONG, "the input was modified", seconds=seconds)
    unchecked = ""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            findings.extend(attempt)
        except references.NoReferenceError as error:
            unchecked = str(error)
        except Exception as error:
            findings.append(
                condition(f"a result of the expected form ({type(error).__name__}: {error})", False)
            )
    checks = [finding for finding in findings if isinstance(finding, Check)]
    # `max` returns the first of several equal checks, which is the check for finite numbers.
    worst = max(checks, key=lambda check: check.ratio_to_limit, default=None)
    reasons = [finding for finding in findings if isinstance(finding, str)]
    texts = [str(warning.message) for warning in caught]
    mark, reason = result_outcome(worst, reasons, texts, unchecked, required=case.required)
    return outcome_row(names, mark, reason, **worst._asdict() if worst else {}, seconds=seconds)


def cell_names(subject: Subject, case: Case) -> dict[str, str]:
    """Return the names that identify a subject and an input: library, group, subject, family and case."""
    names = (subject.library, subject.group, subject.name, case.family, case.name)
    return dict(zip(("library", "group", "subject", "family", "case"), names, strict=True))


def outcome_row(names: Mapping[str, str], mark: Mark, reason: str, **measured: Any) -> dict[str, Any]:
    """Return a row of the table of outcomes.

    Parameters
    ----------
    names : mapping
        Names from `cell_names`.
    mark : Mark
        Outcome of the subject on the input.
    reason : str
        Reason of the outcome. Colour codes and folders are removed, because they differ between machines.
    **measured
        Description (`what`), `error` and `limit` of the decisive check, and run time of the subject
        (`seconds`). Without a check, the description is "", and error and limit are None.
    """
    reason = " ".join(_COLOURS_AND_FOLDERS.sub("", reason).split())[:300]
    row = {**names, "mark": mark, "reason": reason, "error": None, "limit": None, "what": "", "seconds": 0.0}
    return row | measured


def exception_outcome(error: Exception, subject: Subject, case: Case) -> tuple[Mark, str]:
    """Return the mark and the reason of an exception."""
    text = f"{type(error).__name__}: {error}"
    if not is_deliberate(error, subject.library):
        frames = traceback.extract_tb(error.__traceback__)
        where = f" ({frames[-1].filename.rsplit('/', 1)[-1]}:{frames[-1].lineno})" if frames else ""
        return Mark.CRASH, text + where
    if case.required:
        return Mark.WRONG, f"rejects an ordinary input: {text}"
    undefined = type(error).__name__ == "UndefinedFeatureError"  # by name: its import takes a second
    return (Mark.DOCUMENTED if undefined else Mark.REFUSED), text


def is_deliberate(error: Exception, library: str) -> bool:
    """Return whether an exception was raised deliberately, with a message that explains the problem.

    The exception must be a `ValueError`, `TypeError`, `NotImplementedError`, `RuntimeError`,
    `ArithmeticError`, `AssertionError` or a class of the library. Its innermost frame must be a `raise` or
    `assert` statement, or its message must contain "not supported". Compiled code is assumed to raise
    deliberately, because its statements are not visible. The message must have at least ten characters.
    """
    accidents = (ZeroDivisionError, OverflowError, RecursionError)
    kinds = (ValueError, TypeError, NotImplementedError, RuntimeError, ArithmeticError, AssertionError)
    is_own = type(error).__module__.split(".")[0] == library
    frames = traceback.extract_tb(error.__traceback__)
    line = frames[-1].line or "" if frames else ""
    is_compiled = bool(frames) and frames[-1].filename.endswith((".pyx", ".pxd", ".pxi"))
    statement = "assert" if isinstance(error, AssertionError) else "raise"
    has_raise = line.startswith(statement) or is_compiled or "not supported" in str(error)
    is_kind = isinstance(error, kinds) and not isinstance(error, accidents)
    return (is_kind or is_own) and has_raise and len(str(error)) >= 10


def result_outcome(
    worst: Check | None, reasons: list[str], texts: list[str], unchecked: str, *, required: bool
) -> tuple[Mark, str]:
    """Return the mark and the reason of a result, given its worst check, its reasons and its warnings."""
    numeric = [text for text in texts if _FLOATING_POINT.search(text)]
    reasons = [*reasons, *(text for text in texts if text not in numeric and _UNDEFINED.search(text))]
    if worst is not None and worst.ratio_to_limit > 1:
        if np.isfinite(worst.error):
            return Mark.WRONG, f"{worst.what}: {worst.error:.3g}; the limit is {worst.limit:.3g}"
        is_not_finite = worst.what.startswith("finite")
        if is_not_finite and reasons:
            return (Mark.WRONG if required else Mark.DOCUMENTED), reasons[0]
        return (Mark.SILENT if is_not_finite else Mark.WRONG), f"failed: {worst.what}"
    if numeric:
        return Mark.WARNED, numeric[0]
    if reasons:
        return Mark.DOCUMENTED, reasons[0]
    return (Mark.UNCHECKED if unchecked and worst is None else Mark.EXACT), unchecked


# Checks that several subjects share
# --------------------------------------------------------------------------


def largest(x: ArrayLike) -> float:
    """Return the largest magnitude."""
    return float(np.max(np.abs(x)))


def condition(what: str, is_met: object) -> Check:
    """Check a condition that is either met or not met."""
    return Check(what, 0.0 if is_met else np.inf, 0.0)


def finite(what: str, values: ArrayLike) -> Check:
    """Check that every number is finite."""
    return condition(f"finite {what}", np.all(np.isfinite(np.asarray(values, dtype=np.float64))))


def close(what: str, value: ArrayLike, reference: ArrayLike, limit: float, *, scale: float = 0.0) -> Check:
    """Check the largest difference, relative to the largest reference (or to `scale`, if it is larger)."""
    actual, expected = np.asarray(value, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    if actual.shape != expected.shape:
        return Check(f"{what}: shape {actual.shape} for {expected.shape}", np.inf, limit)
    difference = float(np.max(np.abs(actual - expected), initial=0.0))
    size = max(float(np.max(np.abs(expected), initial=0.0)), scale)
    return Check(what, difference and (difference / size if size > 0 else np.inf), limit)


def stable(k: Samples) -> Check:
    """Check that every |k| is below 1, so that the filter is stable."""
    return condition("every |k| below 1 (stable)", np.all(np.abs(k) < 1))


def stable_coefficients(a: Samples) -> Iterator[Check]:
    """Check that the coefficients 1, a_1 ... a_p are finite and the filter is stable.

    Stability is checked by a step-down recursion with 60 digits. Above order 128, this would take minutes, so
    only finite numbers are checked.
    """
    yield finite("coefficients", a)
    if a.size <= 129 and np.all(np.isfinite(a)):
        yield stable(references.step_down(a))


def stable_sections(denominators: Samples) -> Check:
    """Check that second-order sections with denominators 1 + a_1 z^-1 + a_2 z^-2 are stable."""
    a_1, a_2 = denominators[:, -2], denominators[:, -1]
    is_stable = (np.abs(a_2) < 1) & (np.abs(a_1) < 1 + a_2)
    return Check("sections that are not stable", float(np.sum(~is_stable)), 0.0)


def excess_energy(method: str, energy: float, optimum: float, limit: float = MAX_EXCESS_ENERGY) -> Check:
    """Check the excess of a predictor's residual energy over the optimum, relative to the optimum.

    Both energies are relative to the energy of the signal. An excess of 1e-20 times the limit is accepted as
    rounding of the samples.
    """
    error = max((energy - optimum) / (optimum + 1e-20), 0.0) if np.isfinite(energy) else np.inf
    return Check(f"residual energy above {method}", float(error), limit)


def line_spectrum(k: Samples, lsf: Samples, back: Samples | None) -> Iterator[Check]:
    """Check that frequencies increase in (0, pi), and that the inverse conversion gives a stable model.

    The model from the inverse conversion must also have the same spectrum. `back` contains its reflection
    coefficients, or None if its filter is unstable.
    """
    yield finite("frequencies", lsf)
    edges = np.concatenate([[0.0], lsf, [np.pi]])
    yield condition("frequencies strictly increasing in (0, pi)", np.all(np.diff(edges) > 0))
    if back is None or not np.all(np.isfinite(back)):
        yield condition("the conversion back gives a stable filter", False)
        return
    yield stable(back)
    if np.all(np.abs(back) < 1):
        difference = spectrum_db(back) - spectrum_db(k)
        limit = 1e-8 if k.size <= 128 else 1e-6 if k.size <= 400 else 1e-3
        yield Check("round trip, dB RMS of the spectrum", float(np.sqrt(np.mean(difference**2))), limit)


def spectrum_db(k: Samples) -> Samples:
    """Return the power spectrum of a model with unit gain at the frequencies `OMEGA`, in dB."""
    return vibration.Autoregression(k, np.asarray(1.0)).log_spectrum_db(OMEGA)


def response(what: str, out: Samples, k: Samples, excitation: Samples) -> Check:
    """Check the output of a model filter against 60-digit arithmetic."""
    return close(
        f"{what}, against 60 digits", out, references.all_pole_response(k, excitation), MAX_RESPONSE_ERROR
    )
