"""What both methods share: recordings at rising speeds, and the place of any speed among them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.signals import one_channel

STILL = 0.25
"""Below this part of the slowest recorded speed a texture fades linearly to silence at rest."""
GLIDE_S = 0.01
"""Time constant with which place and loudness follow speed and contact."""
PEAK_FACTOR = 3.0
"""No rendered sample exceeds this times the largest recorded one: ours, to bound Gaussian noise."""


def rising_speeds(speeds: ArrayLike) -> Samples:
    """Return the recorded speeds, shape (n_speeds,), or say which rule they break.

    Raises
    ------
    ValueError
        If there are fewer than two, one is not above 0 and finite, or they do not rise.
    """
    v = np.array(one_channel(speeds, "speeds"))
    if v.size < 2 or v[0] <= 0 or np.any(np.diff(v) <= 0):
        raise ValueError(f"speeds are {v}; the rule is two or more, above 0 and rising")
    v.setflags(write=False)
    return v


def checked_signals(signals: Sequence[ArrayLike], speeds: ArrayLike) -> tuple[list[Samples], Samples]:
    """Return the recordings without their means, and their speeds.

    Raises
    ------
    ValueError
        If there is not one recording for each speed, one holds NaN, infinity or no change, or the speeds
        break their rule.
    """
    v = rising_speeds(speeds)
    if len(signals) != v.size:
        raise ValueError(f"there are {len(signals)} recordings and {v.size} speeds; the rule is one for each")
    found = [one_channel(x, f"recording at speed {u:g}", at_least=3) for x, u in zip(signals, v, strict=True)]
    found = [x - x.mean() for x in found]
    for x, u in zip(found, v, strict=True):
        if not np.any(x):
            raise ValueError(f"the recording at speed {u:g} is constant; the rule is a vibration")
    return found, v


def place_of(speed: float, speeds: Samples) -> float:
    """Return where a speed lies among the recorded ones, 0 ... n_speeds - 1, held at both ends.

    Raises
    ------
    ValueError
        If the speed is negative, NaN or infinite.
    """
    if not (np.isfinite(speed) and speed >= 0):
        raise ValueError(f"speed is {speed}; the rule is finite and at least 0")
    return float(np.interp(speed, speeds, np.arange(speeds.size)))
