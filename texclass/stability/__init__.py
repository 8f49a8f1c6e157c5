"""At the extremes: hard inputs for every model, filter, transform and feature, ours and public ones."""

from texclass.stability.result import StabilityResult
from texclass.stability.run import run_stability, supervise
from texclass.stability.verdict import BAD, Cell, Check, Documented, Mark, Subject, Unchecked, judge

__all__ = [
    "BAD",
    "Cell",
    "Check",
    "Documented",
    "Mark",
    "StabilityResult",
    "Subject",
    "Unchecked",
    "judge",
    "run_stability",
    "supervise",
]
