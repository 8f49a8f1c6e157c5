"""Define the published tables of `guruswamy2011`, and simulate objects with these values as ground truth.

Feature density, major frequency, speed, force and k_c are from Table I and section III. For the rubber mat
and SP80, k_v and a_0 are from section V-B; the other objects have similar values. Values that are not
published (decay rates, modes above the major frequency, differences between features) are our choice.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from texclass.haptics.textures.guruswamy2011 import LevelLaw
from texclass.haptics.textures.scan import Scan

Samples = NDArray[np.float64]
ROW = (
    "f_max_hz",
    "f_major_hz",
    "segments_per_mm",
    "order",
    "sad_bandpass",
    "sad_original",
    "speed",
    "force",
)
"""Values of a scan in Tables I and III: upper cut-off and major frequency (Hz), segments per mm, mean order +
1, mean absolute difference of the filters from the band-passed and the recorded profile (mm/s^2), mean speed
(mm/s) and force (N).
"""
TABLE_1 = {
    "Jewel-case": (322.8, 69.5, 1.548, 29.5, 51.7, 84.0, 8.2, 0.874),
    "Tire tread": (133.2, 20.6, 0.317, 35.5, 88.9, 110.2, 20.7, 0.511),
    "Rubber mat": (78.6, 17.8, 0.316, 29.4, 103.9, 133.2, 21.4, 0.443),
    "SP 120 grit": (285.5, 12.6, 1.325, 12.3, 56.3, 167.4, 23.3, 0.636),
    "SP 80 grit": (208.0, 42.3, 1.011, 16.7, 84.4, 110.7, 19.9, 0.353),
}
"""Table I. The text of section V-A gives 158 Hz for the tire tread, the table 133.2 Hz."""

TABLE_2 = {
    "Jewel-case": ((1.637, 0.270), (23.31, 5.39)),
    "Tire tread": ((0.359, 0.098), (39.41, 2.81)),
    "Rubber mat": ((0.345, 0.031), (31.06, 6.14)),
    "SP 120 grit": ((1.181, 0.132), (14.43, 2.72)),
    "SP 80 grit": ((1.030, 0.066), (17.71, 3.63)),
}
"""Mean and standard deviation over five scans, of segments per mm and of order + 1."""

TABLE_3 = {
    "Rubber mat": (
        (91.4, 18.7, 0.373, 33.2, 91.7, 138.0, 19.1, 0.439),
        (79.5, 18.6, 0.365, 24.9, 105.0, 134.7, 21.4, 0.624),
        (78.6, 17.8, 0.316, 29.4, 103.9, 133.2, 21.4, 0.443),
        (79.0, 17.2, 0.307, 27.2, 105.8, 139.3, 25.3, 0.477),
        (86.9, 17.5, 0.366, 40.6, 92.9, 147.9, 17.5, 0.525),
    ),
    "SP 80 grit": (
        (190.6, 25.9, 0.992, 13.5, 89.9, 168.1, 22.6, 0.187),
        (208.0, 42.3, 1.011, 16.7, 84.4, 110.7, 19.9, 0.353),
        (286.7, 49.4, 1.146, 20.1, 76.9, 112.9, 15.1, 0.385),
        (197.3, 32.9, 0.985, 22.6, 75.2, 95.8, 15.1, 0.344),
        (217.5, 24.4, 1.014, 15.7, 82.3, 125.5, 21.1, 0.143),
    ),
}

LAWS = {
    "Rubber mat": LevelLaw(k_v=18.5, k_c=0.117, a_0=0.435),
    "SP 80 grit": LevelLaw(k_v=19.4, k_c=1.0, a_0=0.287),
}


# Simulation -------------------------------------------------------------------------------------------------

FS = 500.0
"""Sampling rate of the sensor in Hz."""
BIT = 0.153
"""One bit of the sensor in m/s^2."""
RANGE = 128 * BIT
"""Range of the sensor in m/s^2: 2 g with 8 bits."""


@dataclass(frozen=True)
class SimulatedObject:
    """A surface with features, each of which excites decaying vibrations of the tool.

    Attributes
    ----------
    name : str
        Name in the paper.
    pattern : str
        "regular" or "stochastic", as in the paper.
    density_per_mm : float
        Features per mm of path.
    spread : float
        Standard deviation of the distance between neighbouring features, relative to its mean.
    modes : tuple of (float, float, float)
        Frequency (Hz), decay rate (1/s) and amplitude of each mode; the first mode has the major frequency.
    law : LevelLaw
        Level law.
    speed, force : float
        Speed (mm/s) and force (N) of the published scan.
    undulation_per_mm : float
        Spatial frequency of the sign of the features; 0 (default): random signs.
    phase : float
        Phase of the first mode at the onset in rad (0: a sine); the other modes are sines.
    """

    name: str
    pattern: str
    density_per_mm: float
    spread: float
    modes: tuple[tuple[float, float, float], ...]
    law: LevelLaw
    speed: float
    force: float
    undulation_per_mm: float = 0.0
    phase: float = np.pi / 2


class Section(NamedTuple):
    """A section of a surface, whose features are the same in all its scans.

    Attributes
    ----------
    position_mm : ndarray of shape (n_features,)
        Positions of the features in mm.
    mark : ndarray of shape (n_features, n_modes)
        Signed height of each mode at each feature.
    length_mm : float
        Length of the section in mm.
    """

    position_mm: Samples
    mark: Samples
    length_mm: float


OBJECTS = (
    SimulatedObject("Jewel-case", "regular", 1.548, 0.05, ((69.5, 30.0, 1.0), (235.0, 150.0, 1.8)),
                    LevelLaw(19.0, 1.0, 0.35), 8.2, 0.874, phase=0.35 * np.pi),
    SimulatedObject("Tire tread", "regular", 0.317, 0.05, ((20.6, 24.0, 1.0), (112.0, 150.0, 2.9)),
                    LevelLaw(19.0, 0.526, 0.40), 20.7, 0.511),
    SimulatedObject("Rubber mat", "regular", 0.316, 0.05, ((17.8, 24.0, 1.0), (57.0, 180.0, 3.6)),
                    LevelLaw(18.5, 0.117, 0.435), 21.4, 0.443),
    SimulatedObject("SP 120 grit", "stochastic", 1.325, 0.3, ((0.0, 100.0, 1.0), (250.0, 200.0, 1.5)),
                    LevelLaw(19.0, 1.0, 0.30), 23.3, 0.636, undulation_per_mm=12.6 / 23.3),
    SimulatedObject("SP 80 grit", "stochastic", 1.011, 0.3, ((42.3, 30.6, 1.0), (163.0, 212.0, 3.8)),
                    LevelLaw(19.4, 1.0, 0.287), 19.9, 0.353, phase=0.39 * np.pi),
)  # fmt: skip
"""Objects of Table I."""


def lay_out(thing: SimulatedObject, length_mm: float, rng: np.random.Generator) -> Section:
    """Draw a random section of a surface with a positive length in mm.

    Distances between neighbouring features follow a gamma distribution, so they are positive. Heights spread
    by 20 %; signs are random or follow the undulation.
    """
    n = int(np.ceil(1.5 * length_mm * thing.density_per_mm)) + 10
    shape = thing.spread**-2
    place = np.cumsum(rng.gamma(shape, 1 / (shape * thing.density_per_mm), n))
    place = place[place < length_mm]
    height = np.exp(0.2 * rng.standard_normal(place.size))
    if thing.undulation_per_mm:
        phase = 2 * np.pi * thing.undulation_per_mm * place + rng.uniform(0, 2 * np.pi)
        sign = np.where(np.cos(phase) >= 0, 1.0, -1.0)
    else:
        sign = rng.choice([-1.0, 1.0], place.size)
    share = np.exp(0.2 * rng.standard_normal((place.size, len(thing.modes))))
    return Section(place, (sign * height)[:, np.newaxis] * share, length_mm)


def simulate_scan(
    thing: SimulatedObject,
    section: Section,
    rng: np.random.Generator,
    *,
    speed: float | None = None,
    force: float | None = None,
    fs: float = FS,
    repeatability: float = 0.01,
    quantised: bool = True,
) -> Scan:
    """Simulate one stroke along a section, from end to end.

    Speed and force vary by 10 %. The vibration is scaled: its RMS satisfies the level law of the object at
    every speed and force, except for a factor that varies by `repeatability` between scans. Finally, drift,
    noise of a third of a bit, and the 8-bit quantization of the sensor are added.

    Parameters
    ----------
    thing : SimulatedObject
        Object.
    section : Section
        Section of the object, from `lay_out`.
    rng : numpy.random.Generator
        Random generator for the hand and the sensor.
    speed, force : float, optional
        Positive mean speed (mm/s) and force (N) (default: values of the object).
    fs : float
        Sampling rate in Hz.
    repeatability : float
        Standard deviation of the logarithm of the factor (default 0.01; not published).
    quantised : bool
        Whether to simulate the sensor and its drift.

    Returns
    -------
    Scan
        Simulated scan.
    """
    v_0, f_0 = thing.speed if speed is None else speed, thing.force if force is None else force
    n = int(section.length_mm / v_0 * fs)
    t = np.arange(n) / fs
    v, f = v_0 * _slow_variation(t, rng), f_0 * _slow_variation(t, rng)
    x = np.concatenate([[0.0], np.cumsum((v[:-1] + v[1:]) / 2)]) / fs
    u = _responses(thing, section, t, x, fs)
    level = thing.law.rms(v, f)
    u *= level * np.sqrt(np.mean(level**2) / np.mean((level * u) ** 2))
    u *= np.exp(repeatability * rng.standard_normal())
    if quantised:
        drift = 0.05 * np.sin(2 * np.pi * (0.04 * t + rng.uniform()))
        noisy = u + drift + BIT / 3 * rng.standard_normal(n)
        u = np.clip(np.round(noisy / BIT) * BIT, -RANGE, RANGE - BIT)
    zero = np.zeros(n)
    return Scan(u, np.column_stack([x, zero]), np.column_stack([v, zero]), f, fs, thing.name)


def _slow_variation(t: Samples, rng: np.random.Generator) -> Samples:
    """Return a factor that varies slowly around 1, as in hand motion."""
    course = np.zeros_like(t)
    for f in (0.17, 0.41, 0.93):
        course += np.sin(2 * np.pi * (f * t + rng.uniform()))
    return np.asarray(1 + 0.1 * course / np.sqrt(1.5))


def _responses(thing: SimulatedObject, section: Section, t: Samples, x: Samples, fs: float) -> Samples:
    """Return sum_k m_k h(t - t_k), where t_k are the times (between samples) at which features are passed."""
    onset = np.interp(section.position_mm, x, t)
    is_passed = section.position_mm <= x[-1]
    onset, mark = onset[is_passed], section.mark[is_passed]
    u = np.zeros(t.size + 1)
    phases = (thing.phase, *(0.0,) * (len(thing.modes) - 1))
    for (f, B, amplitude), phi, m in zip(thing.modes, phases, mark.T, strict=True):
        first = np.ceil(onset * fs).astype(np.int64)
        index = first[:, np.newaxis] + np.arange(int(np.ceil(9.0 / B * fs)) + 1)
        elapsed = index / fs - onset[:, np.newaxis]
        h = amplitude * m[:, np.newaxis] * np.exp(-B * elapsed) * np.sin(2 * np.pi * f * elapsed + phi)
        u += np.bincount(np.minimum(index, t.size).ravel(), h.ravel(), t.size + 1)
    return u[:-1]
