"""At the extremes: hard inputs for every model, filter, transform and feature, ours and public ones."""

from typing import TYPE_CHECKING

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "judging": ["BAD", "Check", "Documented", "Mark", "Subject", "judge"],
        "result": ["StabilityResult"],
        "run": ["run_stability", "supervise"],
    },
)

if TYPE_CHECKING:
    from texclass.stability.judging import BAD as BAD
    from texclass.stability.judging import Check as Check
    from texclass.stability.judging import Documented as Documented
    from texclass.stability.judging import Mark as Mark
    from texclass.stability.judging import Subject as Subject
    from texclass.stability.judging import judge as judge
    from texclass.stability.result import StabilityResult as StabilityResult
    from texclass.stability.run import run_stability as run_stability
    from texclass.stability.run import supervise as supervise
