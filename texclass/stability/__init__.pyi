from .judging import BAD as BAD
from .judging import Check as Check
from .judging import Mark as Mark
from .judging import Subject as Subject
from .judging import judge as judge
from .result import StabilityResult as StabilityResult
from .run import run_stability as run_stability
from .run import supervise as supervise
