"""Signals at any speed from recordings at a few: LPC and major frequencies."""

from texclass.textures.oeztuerk2018.displayed import DisplayedSignals, displayed_signals
from texclass.textures.oeztuerk2018.frequencies import FrequencyTexture, fit_frequencies
from texclass.textures.oeztuerk2018.intervals import SpeedIntervals, intervals_from_speeds, speed_intervals
from texclass.textures.oeztuerk2018.lpc import LpcTexture, fit_lpc
from texclass.textures.oeztuerk2018.seamless import mirrored, seamless, write_wav

__all__ = [
    "DisplayedSignals",
    "FrequencyTexture",
    "LpcTexture",
    "SpeedIntervals",
    "displayed_signals",
    "fit_frequencies",
    "fit_lpc",
    "intervals_from_speeds",
    "mirrored",
    "seamless",
    "speed_intervals",
    "write_wav",
]
