"""Models of a vibration: fit -> parameters -> synthesize -> score."""

from texclass.vibration import interpolation, line_spectrum, scores
from texclass.vibration.autoregressive import Autoregression, fit
from texclass.vibration.decaying_modes import DecayingModes
from texclass.vibration.decaying_sinusoid import TapModel, fit_okamura, fit_tap_model
from texclass.vibration.interpolation import ModelBlend
from texclass.vibration.lattice import LatticeInverse, LatticeSynthesis, synthesize, whiten
from texclass.vibration.major_frequencies import MajorFrequencies, fit_major_frequencies
from texclass.vibration.matrix_pencil import fit_matrix_pencil
from texclass.vibration.order import OrderSelection, select_order
from texclass.vibration.prony import PronyFilter, fit_prony
from texclass.vibration.segmentation import (
    Segmentation,
    VibrationBand,
    segment_rising_peaks,
    vibration_band,
)

__all__ = [
    "Autoregression",
    "DecayingModes",
    "LatticeInverse",
    "LatticeSynthesis",
    "MajorFrequencies",
    "ModelBlend",
    "OrderSelection",
    "PronyFilter",
    "Segmentation",
    "TapModel",
    "VibrationBand",
    "fit",
    "fit_major_frequencies",
    "fit_matrix_pencil",
    "fit_okamura",
    "fit_prony",
    "fit_tap_model",
    "interpolation",
    "line_spectrum",
    "scores",
    "segment_rising_peaks",
    "select_order",
    "synthesize",
    "vibration_band",
    "whiten",
]
