"""Models of a vibration: fit -> parameters -> synthesize -> score."""

from typing import TYPE_CHECKING

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["interpolation", "line_spectrum", "scores"],
    submod_attrs={
        "autoregressive": ["Autoregression", "fit"],
        "decaying_modes": ["DecayingModes", "fit_matrix_pencil"],
        "decaying_sinusoid": ["TapModel", "fit_okamura", "fit_tap_model"],
        "interpolation": ["ModelBlend"],
        "lattice": ["LatticeInverse", "LatticeSynthesis", "synthesize", "whiten"],
        "major_frequencies": ["MajorFrequencies", "fit_major_frequencies"],
        "order": ["OrderSelection", "select_order"],
        "prony": ["PronyFilter", "fit_prony"],
        "rising_peaks": ["Segmentation", "VibrationBand", "segment_rising_peaks", "vibration_band"],
    },
)

if TYPE_CHECKING:
    from texclass.vibration.autoregressive import Autoregression as Autoregression
    from texclass.vibration.autoregressive import fit as fit
    from texclass.vibration.decaying_modes import DecayingModes as DecayingModes
    from texclass.vibration.decaying_modes import fit_matrix_pencil as fit_matrix_pencil
    from texclass.vibration.decaying_sinusoid import TapModel as TapModel
    from texclass.vibration.decaying_sinusoid import fit_okamura as fit_okamura
    from texclass.vibration.decaying_sinusoid import fit_tap_model as fit_tap_model
    from texclass.vibration.interpolation import ModelBlend as ModelBlend
    from texclass.vibration.lattice import LatticeInverse as LatticeInverse
    from texclass.vibration.lattice import LatticeSynthesis as LatticeSynthesis
    from texclass.vibration.lattice import synthesize as synthesize
    from texclass.vibration.lattice import whiten as whiten
    from texclass.vibration.major_frequencies import MajorFrequencies as MajorFrequencies
    from texclass.vibration.major_frequencies import fit_major_frequencies as fit_major_frequencies
    from texclass.vibration.order import OrderSelection as OrderSelection
    from texclass.vibration.order import select_order as select_order
    from texclass.vibration.prony import PronyFilter as PronyFilter
    from texclass.vibration.prony import fit_prony as fit_prony
    from texclass.vibration.rising_peaks import Segmentation as Segmentation
    from texclass.vibration.rising_peaks import VibrationBand as VibrationBand
    from texclass.vibration.rising_peaks import segment_rising_peaks as segment_rising_peaks
    from texclass.vibration.rising_peaks import vibration_band as vibration_band
