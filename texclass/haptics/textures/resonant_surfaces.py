"""Nine simulated surfaces whose vibration is known at every direction, speed and force.

The recordings of `abdulali2016` are not public. These surfaces stand in for S1 ... S9: each vibrates as an
autoregressive process whose resonances, widths and level vary smoothly with the tool's velocity and force;
all but S4 with the direction too (period pi, as a grain has). Frequencies and levels are ours: the paper
prints none. Fabric (S4-S6) is broad and quiet, wood (S7-S9) lower and narrower, plastic (S1-S3) has one
resonance more; S1 has the widest range of frequencies.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.vibration import LatticeSynthesis
from texclass.vibration.autoregressive import Autoregression, from_direct_form

SPEED_MM_S, FORCE_N = 90.0, 1.0
"""Where the resonances have their nominal frequencies and the level is nominal."""
SLOW_MM_S = 20.0
"""Below about this speed direction and speed matter less and less."""
LIGHT_N = 0.1
"""Below about this force, force does."""
GROWTH = (0.8, 0.5)
"""Exponents of speed and force in the level."""


@dataclass(frozen=True)
class ResonantSurface:
    """A surface and what its vibration does.

    Parameters
    ----------
    name : str
        As in the paper.
    kind : str
        Its group.
    resonances : tuple of tuple of float
        Of each: frequency and half-power width (Hz) at nominal speed and force; change of the logarithm of
        the frequency per e-fold of speed and of force, and its amplitude over directions.
    grain_rad : float
        Direction of the grain.
    level : float
        RMS at nominal speed and force, m/s^2.
    level_with_direction : float
        Amplitude of the logarithm of the level over directions.
    """

    name: str
    kind: str
    resonances: tuple[tuple[float, float, float, float, float], ...]
    grain_rad: float
    level: float
    level_with_direction: float

    @property
    def anisotropic(self) -> bool:
        """Whether the direction matters."""
        return any(moves[-1] for moves in self.resonances) or self.level_with_direction != 0

    def truth(self, velocity: ArrayLike, force: ArrayLike) -> tuple[Samples, Samples, Samples]:
        """Return frequencies and widths (n, n_resonances), Hz, and levels (n,), at velocities and forces.

        Parameters
        ----------
        velocity : array_like of shape (n, 2)
            mm/s.
        force : array_like of shape (n,)
            N.
        """
        vx, vy = np.asarray(velocity, dtype=np.float64).T
        f, v = np.maximum(np.asarray(force, dtype=np.float64), 0.0), np.hypot(vx, vy)
        faster = np.log((v + SLOW_MM_S) / (SPEED_MM_S + SLOW_MM_S))
        harder = np.log((f + LIGHT_N) / (FORCE_N + LIGHT_N))
        across = np.cos(2 * (np.arctan2(vy, vx) - self.grain_rad)) * v / (v + SLOW_MM_S)
        frequency, width, *moves = np.array(self.resonances).T
        change = np.exp(np.stack([faster, harder, across], axis=-1) @ np.array(moves))
        level = self.level * (v / SPEED_MM_S) ** GROWTH[0] * (f / FORCE_N) ** GROWTH[1]
        level = level * np.exp(self.level_with_direction * across)
        return frequency * change, width * np.sqrt(change), level

    def models(self, velocity: ArrayLike, force: ArrayLike, fs: float) -> tuple[Samples, Samples]:
        """Return the true reflection coefficients (n, p) and levels (n,) at a rate in Hz."""
        frequency, width, level = self.truth(velocity, force)
        theta = 2 * np.pi * np.minimum(frequency, 0.45 * fs) / fs
        radius = np.exp(-np.pi * width / fs)
        a = np.zeros((len(theta), 2 * theta.shape[1] + 1))
        a[:, 0] = 1.0
        for i in range(theta.shape[1]):
            before = a.copy()
            a[:, 1:] -= 2 * (radius[:, i] * np.cos(theta[:, i]))[:, np.newaxis] * before[:, :-1]
            a[:, 2:] += (radius[:, i] ** 2)[:, np.newaxis] * before[:, :-2]
        return from_direct_form(a, np.ones(len(a))).reflection, level

    def vibration(
        self, velocity: ArrayLike, force: ArrayLike, fs: float, rng: np.random.Generator
    ) -> Samples:
        """Return the vibration (n,) along a motion, m/s^2, with sensor noise of 1 % of the nominal level."""
        k, level = self.models(velocity, force, fs)
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
"""S1 ... S9; S4 alone is isotropic."""


def surface(name: str) -> ResonantSurface:
    """Return the surface of a name, S1 ... S9."""
    known = {each.name: each for each in SURFACES}
    if name not in known:
        raise ValueError(f"surface is {name!r}. Expected one of {', '.join(known)}")
    return known[name]
