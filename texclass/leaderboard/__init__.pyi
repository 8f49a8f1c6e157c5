from .leaderboard import Leaderboard as Leaderboard
from .leaderboard import load_leaderboard as load_leaderboard
from .statistics import leakage as leakage
from .statistics import mean_ranks as mean_ranks
from .statistics import summarize as summarize
