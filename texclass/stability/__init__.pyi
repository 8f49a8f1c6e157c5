from .battery import StabilityResult as StabilityResult
from .battery import run_stability as run_stability
from .battery import supervise as supervise
from .rules import BAD as BAD
from .rules import Check as Check
from .rules import Mark as Mark
from .rules import Subject as Subject
from .rules import judge as judge
