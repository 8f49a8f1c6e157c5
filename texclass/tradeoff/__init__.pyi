from .cost_selection import CostAwareSelector as CostAwareSelector
from .pareto_front import Limits as Limits
from .recogniser import fit_recogniser as fit_recogniser
from .recogniser import load_recogniser as load_recogniser
from .recogniser import prune as prune
from .recogniser import save_recogniser as save_recogniser
from .study import Tradeoff as Tradeoff
from .study import trade_off as trade_off
