"""Models of a vibration: fit -> parameters -> synthesize -> score."""

from texclass.vibration import line_spectrum, scores
from texclass.vibration.autoregressive import Autoregression, fit
from texclass.vibration.decaying_modes import DecayingModes
from texclass.vibration.decaying_sinusoid import TapModel, fit_okamura, fit_tap_model
from texclass.vibration.lattice import LatticeInverse, LatticeSynthesis, synthesize, whiten
from texclass.vibration.major_frequencies import MajorFrequencies, fit_major_frequencies
from texclass.vibration.matrix_pencil import fit_matrix_pencil
from texclass.vibration.order import OrderSelection, select_order
from texclass.vibration.prony import PronyFilter, fit_prony

__all__ = [
    "Autoregression",
    "DecayingModes",
    "LatticeInverse",
    "LatticeSynthesis",
    "MajorFrequencies",
    "OrderSelection",
    "PronyFilter",
    "TapModel",
    "fit",
    "fit_major_frequencies",
    "fit_matrix_pencil",
    "fit_okamura",
    "fit_prony",
    "fit_tap_model",
    "line_spectrum",
    "scores",
    "select_order",
    "synthesize",
    "whiten",
]
