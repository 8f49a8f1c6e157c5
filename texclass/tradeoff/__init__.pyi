from .cost_selection import CostAwareSelector as CostAwareSelector
from .front import Limits as Limits
from .recogniser import Recogniser as Recogniser
from .recogniser import load_recogniser as load_recogniser
from .trading import Tradeoff as Tradeoff
from .trading import trade_off as trade_off
