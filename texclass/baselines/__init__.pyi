from .baseline_worker.baselines import BASELINES as BASELINES
from .baseline_worker.baselines import Baseline as Baseline
from .comparison import BaselineComparison as BaselineComparison
from .comparison import BaselineSettings as BaselineSettings
from .comparison import compare_with_baselines as compare_with_baselines
from .comparison import whole_surfaces as whole_surfaces
