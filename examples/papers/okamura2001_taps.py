"""Define the published tap models of `okamura2001`, and simulate taps with these models as ground truth."""

import numpy as np
from numpy.typing import NDArray

from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import TapModel

MATERIALS = ("rubber", "wood", "aluminum")
TABLE_I = TapLibrary(
    MATERIALS,
    (
        TapModel(-116.7, 40.0, 18.0),
        TapModel(-1500.0, 600.0, 592.0),
        TapModel(-100_000.0, 1500.0, 1153.0),
    ),
)
"""Measured models. B is printed as 40,000 ... 1,500,000 1/s, which contradicts figure 3: we use 40 ...
1500 1/s."""
TABLE_II = TapLibrary(
    MATERIALS, (TapModel(-240.0, 60.0, 30.0), TapModel(-150.0, 80.0, 100.0), TapModel(-300.0, 90.0, 300.0))
)
"""Most realistic models on the 3GM, with B corrected as in Table I. Our copy lacks the sign of A (rubber)."""
FS = {"rubber": 2500.0, "wood": 25_000.0, "aluminum": 25_000.0}
"""Sampling rates in Hz. The paper uses about 25 kHz; a tenth of this rate is sufficient for 18 Hz."""
VELOCITIES_M_S = (0.05, 0.4)
"""Range of velocities in figure 4 in m/s."""
Samples = NDArray[np.float64]


def simulate_taps(
    model: TapModel,
    rng: np.random.Generator,
    fs: float,
    *,
    noise: float = 0.01,
    velocity_error: float = 0.02,
    n_taps: int = 12,
) -> tuple[list[Samples], Samples]:
    """Simulate taps of one material at the velocities of figure 4.

    Parameters
    ----------
    model : TapModel
        Ground truth.
    rng : numpy.random.Generator
        Random generator for onsets, noise and velocity errors.
    fs : float
        Sampling rate in Hz.
    noise : float
        Standard deviation of white noise, relative to the largest amplitude of the taps.
    velocity_error : float
        Relative standard deviation of the measured velocities.
    n_taps : int
        Number of taps, whose velocities are equally spaced.

    Returns
    -------
    taps : list of ndarray
        Taps of 5 decay times, preceded by 1 to 3 ms of noise; the impact is between two samples.
    velocity : ndarray of shape (n_taps,)
        Measured velocities in m/s.
    """
    v = np.linspace(*VELOCITIES_M_S, n_taps)
    strongest = abs(model.amplitude_slope) * v.max()
    taps = []
    for u in v:
        rest = rng.uniform(1e-3, 3e-3)
        t = np.arange(round((rest + 5 / model.decay_per_s) * fs)) / fs - rest
        w = 2 * np.pi * model.frequency_hz
        x = model.amplitude_slope * u * np.exp(-model.decay_per_s * np.maximum(t, 0)) * np.sin(w * t)
        taps.append(np.where(t >= 0, x, 0.0) + noise * strongest * rng.standard_normal(t.size))
    return taps, v * (1 + velocity_error * rng.standard_normal(v.size))
