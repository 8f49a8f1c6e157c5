"""Simulate nine surfaces whose true spectrum is known at every direction, speed and force.

The recordings of `abdulali2016` are not public. These surfaces replace its surfaces S1 to S9. The vibration
is an autoregressive process whose resonances, bandwidths and level vary smoothly with velocity and force. All
surfaces except S4 also vary with the direction (with period pi, like a grain). Frequencies and levels are our
choice, because the paper states none. Fabric (S4-S6) is broadband and quiet. Wood (S7-S9) has lower and
narrower resonances. Plastic (S1-S3) has one more resonance, and S1 has the widest range of frequencies.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.vibration import LatticeSynthesis
from texclass.vibration.autoregressive import Autoregression, from_direct_form

SPEED_MM_S, FORCE_N = 90.0, 1.0
"""Nominal speed and force, at which resonances and level have their nominal values (our choice)."""
SLOW_MM_S = 20.0
"""Speed in mm/s below which the effects of direction and speed vanish gradually."""
LIGHT_N = 0.1
"""Force in N below which the effect of the force vanishes gradually."""
GROWTH = (0.8, 0.5)
"""Exponents of speed and force in the level law."""


@dataclass(frozen=True)
class ResonantSurface:
    """A simulated surface with known resonances.

    Parameters
    ----------
    name : str
        Name of the surface in the paper.
    kind : str
        Material group: plastic, fabric or wood.
    resonances : tuple of tuple of float
        For each resonance: frequency and half-power bandwidth (Hz) at nominal speed and force, exponents of
        speed and force in the frequency, and amplitude of the variation of ln(frequency) with direction.
    grain_rad : float
        Direction of the grain in rad.
    level : float
        RMS at nominal speed and force in m/s^2.
    level_anisotropy : float
        Amplitude of the variation of ln(level) with direction.

    Examples
    --------
    >>> frequency, bandwidth, level = get_surface("S4").true_spectrum([[90.0, 0.0]], [1.0])
    >>> frequency.tolist(), level.tolist()
    ([[70.0, 220.0]], [1.0])
    """

    name: str
    kind: str
    resonances: tuple[tuple[float, float, float, float, float], ...]
    grain_rad: float
    level: float
    level_anisotropy: float

    @property
    def is_anisotropic(self) -> bool:
        """Whether the spectrum or the level depends on the direction."""
        return any(exponents[-1] for exponents in self.resonances) or self.level_anisotropy != 0

    def true_spectrum(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples, Samples]:
        """Return true frequencies and bandwidths (n, n_resonances) in Hz, and levels (n,) in m/s^2.

        Parameters
        ----------
        velocity : array_like of shape (n, 2)
            Velocity in mm/s.
        force : array_like of shape (n,)
            Normal force in N.
        """
        vx, vy = np.asarray(velocity, dtype=np.float64).T
        f, v = np.maximum(np.asarray(force, dtype=np.float64), 0.0), np.hypot(vx, vy)
        ln_speed = np.log((v + SLOW_MM_S) / (SPEED_MM_S + SLOW_MM_S))
        ln_force = np.log((f + LIGHT_N) / (FORCE_N + LIGHT_N))
        direction = np.cos(2 * (np.arctan2(vy, vx) - self.grain_rad)) * v / (v + SLOW_MM_S)
        frequency, width, *exponents = np.array(self.resonances).T
        change = np.exp(np.stack([ln_speed, ln_force, direction], axis=-1) @ np.array(exponents))
        level = self.level * (v / SPEED_MM_S) ** GROWTH[0] * (f / FORCE_N) ** GROWTH[1]
        level = level * np.exp(self.level_anisotropy * direction)
        return frequency * change, width * np.sqrt(change), level

    def models(self, velocity: ArrayLike, force: ArrayLike, fs: float) -> tuple[Samples, Samples]:
        """Return the true reflection coefficients (n, p) and levels (n,) at a sampling rate `fs` in Hz."""
        frequency, width, level = self.true_spectrum(velocity, force)
        theta = 2 * np.pi * np.minimum(frequency, 0.45 * fs) / fs
        radius = np.exp(-np.pi * width / fs)
        a = np.zeros((len(theta), 2 * theta.shape[1] + 1))
        a[:, 0] = 1.0
        for i in range(theta.shape[1]):
            previous = a.copy()
            a[:, 1:] -= 2 * (radius[:, i] * np.cos(theta[:, i]))[:, np.newaxis] * previous[:, :-1]
            a[:, 2:] += (radius[:, i] ** 2)[:, np.newaxis] * previous[:, :-2]
        return from_direct_form(a, np.ones(len(a))).reflection, level

    def vibration(
        self, velocity: ArrayLike, force: ArrayLike, fs: float, rng: np.random.Generator
    ) -> Samples:
        """Simulate the vibration (n,) in m/s^2 along a path. The sensor noise is 1 % of the nominal level."""
        v, f = np.asarray(velocity, dtype=np.float64), np.asarray(force, dtype=np.float64)
        n = 1 if np.all(v == v[0]) and np.all(f == f[0]) else len(f)  # a constant stroke has one model
        k, level = self.models(v[:n], f[:n], fs)
        k, level = np.repeat(k, len(f) // n, axis=0), np.repeat(level, len(f) // n)
        lattice = LatticeSynthesis(Autoregression(k[0], np.ones(())), level=float(level[0])).settle(rng)
        noise = rng.standard_normal((2, len(level)))
        return np.asarray(lattice.process_varying(noise[0], k, level) + 0.01 * self.level * noise[1])


SURFACES = (
    ResonantSurface("S1", "plastic", (
        (60, 22, 0.35, -0.05, 0.3), (170, 45, 0.3, 0.05, -0.25), (330, 70, 0.2, 0.1, 0.15),
    ), 0.4, 3.0, 0.35),
    ResonantSurface("S2", "plastic", (
        (75, 25, 0.3, 0.05, -0.2), (210, 50, 0.2, 0.08, 0.15), (300, 60, 0.15, 0.0, 0.1),
    ), 1.2, 2.5, 0.3),
    ResonantSurface("S3", "plastic", (
        (90, 25, 0.25, 0.08, 0.15), (160, 40, 0.2, 0.0, 0.2), (270, 60, 0.1, 0.05, -0.1),
    ), 0.0, 4.0, 0.25),
    ResonantSurface("S4", "fabric", ((70, 45, 0.25, 0.08, 0.0), (220, 90, 0.15, 0.05, 0.0)), 0.0, 1.0, 0.0),
    ResonantSurface("S5", "fabric", ((55, 40, 0.3, 0.0, 0.25), (180, 80, 0.2, 0.08, -0.15)), 0.8, 0.8, 0.3),
    ResonantSurface("S6", "fabric", ((85, 50, 0.2, 0.05, -0.25), (250, 90, 0.15, -0.05, 0.1)), 2.2, 1.2, 0.2),
    ResonantSurface("S7", "wood", ((45, 18, 0.3, 0.08, 0.3), (130, 40, 0.2, 0.05, 0.2)), 0.3, 2.0, 0.5),
    ResonantSurface("S8", "wood", ((60, 22, 0.25, 0.0, -0.3), (150, 40, 0.15, 0.08, 0.2)), 1.6, 1.8, 0.4),
    ResonantSurface("S9", "wood", ((50, 20, 0.2, 0.05, 0.2), (180, 50, 0.25, 0.0, -0.25)), 2.6, 2.2, 0.45),
)  # fmt: skip
"""Surfaces S1 to S9; only S4 is isotropic."""


def get_surface(name: str) -> ResonantSurface:
    """Return the simulated surface with the given name, S1 to S9."""
    surfaces = {surface.name: surface for surface in SURFACES}
    if name not in surfaces:
        raise ValueError(f"unknown surface {name!r}. Expected one of {', '.join(surfaces)}")
    return surfaces[name]
