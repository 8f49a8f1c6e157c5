from .battery import StabilityResult as StabilityResult
from .battery import run_stability as run_stability
from .battery import supervise as supervise
from .judging import BAD as BAD
from .judging import Check as Check
from .judging import Mark as Mark
from .judging import Subject as Subject
from .judging import judge as judge
