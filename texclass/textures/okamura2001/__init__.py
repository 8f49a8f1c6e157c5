"""Taps: a library of decaying sinusoids, scaled into a device, felt on a virtual wall, and judged."""

from texclass.textures.okamura2001.device import Device, scale_into
from texclass.textures.okamura2001.factorial import FactorialResult, analyse, normalized_ratings
from texclass.textures.okamura2001.identification import IdentificationTest, simulate_test
from texclass.textures.okamura2001.library import TapLibrary, fit_library
from texclass.textures.okamura2001.onset import AlignedTaps, find_onset, fit_aligned
from texclass.textures.okamura2001.wall import VirtualWall, WallRenderer

__all__ = [
    "AlignedTaps",
    "Device",
    "FactorialResult",
    "IdentificationTest",
    "TapLibrary",
    "VirtualWall",
    "WallRenderer",
    "analyse",
    "find_onset",
    "fit_aligned",
    "fit_library",
    "normalized_ratings",
    "scale_into",
    "simulate_test",
]
