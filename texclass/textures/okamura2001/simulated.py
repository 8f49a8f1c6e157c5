"""What the paper recorded and asked, simulated with its published parameters as truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.textures.okamura2001.factorial import DESIGN, FACTORS
from texclass.textures.okamura2001.library import TapLibrary
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
"""Measured. B is printed as 40,000 ... 1,500,000 1/s, which contradicts figure 3: read as 40 ... 1500 1/s."""
TABLE_II = TapLibrary(
    MATERIALS, (TapModel(-240.0, 60.0, 30.0), TapModel(-150.0, 80.0, 100.0), TapModel(-300.0, 90.0, 300.0))
)
"""Most realistic on the 3GM. B read as in Table I; the sign of rubber's A is lost in our copy."""
MOST_SENSITIVE = {"rubber": "decay", "wood": "frequency", "aluminum": "amplitude"}
"""Published, section III-B."""
FS = {"rubber": 2500.0, "wood": 25_000.0, "aluminum": 25_000.0}
"""Hz; the paper records at about 25 kHz, of which 18 Hz need a tenth."""
VELOCITIES_M_S = (0.05, 0.4)
"""Range of figure 4."""


@dataclass(frozen=True, eq=False)
class SimulatedTaps:
    """Taps with rest before the impact, and the velocities as they were measured."""

    taps: tuple[Samples, ...]
    velocity: Samples


def simulate_taps(
    model: TapModel,
    rng: np.random.Generator,
    fs: float,
    *,
    noise: float = 0.01,
    velocity_error: float = 0.02,
    n_taps: int = 12,
) -> SimulatedTaps:
    """Simulate taps of one material at the velocities of figure 4.

    Parameters
    ----------
    model : TapModel
        The truth.
    rng : numpy.random.Generator
        Of onsets, noise and velocity errors.
    fs : float
        Sampling rate, Hz.
    noise : float
        Deviation of white noise, of the largest amplitude among the taps.
    velocity_error : float
        Relative deviation of the measured velocities.
    n_taps : int
        How many, evenly from slow to fast.

    Returns
    -------
    SimulatedTaps
        Each with 1 to 3 ms of rest and then 5 decay times; the impact falls between two samples.
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
    return SimulatedTaps(tuple(taps), v * (1 + velocity_error * rng.standard_normal(v.size)))


def simulate_ratings(
    most_sensitive: str,
    rng: np.random.Generator,
    *,
    n_users: int = 10,
    strong: float = 1.0,
    weak: float = 0.4,
    noise: float = 1.0,
) -> NDArray[np.float64]:
    """Simulate ratings from 1 to 10 of the eight runs, shape (n_users, 8).

    Each user has a mean (4 to 7) and a spread (0.8 to 1.6) of ratings. A factor moves them by the spread
    times `strong` or `weak` from low to middle and again to high, with a sign of its own; noise of the same
    measure is added, and the result rounded and cut to 1 ... 10. The number of users is not printed; 10 is
    ours.
    """
    size = np.array([strong if name == most_sensitive else weak for name in FACTORS])
    utility = DESIGN @ (size * rng.choice([-1.0, 1.0], 3))
    spread, mean = rng.uniform(0.8, 1.6, (n_users, 1)), rng.uniform(4.0, 7.0, (n_users, 1))
    felt = mean + spread * (utility + noise * rng.standard_normal((n_users, len(DESIGN))))
    return np.asarray(np.clip(np.round(felt), 1.0, 10.0))
