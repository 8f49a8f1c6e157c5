"""Scans of nine simulated surfaces whose vibration is known at every direction, speed and force.

The recordings of `abdulali2016` are not public. These surfaces stand in for S1 ... S9: each vibrates as an
autoregressive process whose resonances, widths and level vary smoothly with the tool's velocity and force;
all but S4 with the direction too (period pi, as a grain has). Frequencies and levels are ours: the paper
prints none. Fabric (S4-S6) is broad and quiet, wood (S7-S9) lower and narrower, plastic (S1-S3) has one
resonance more; S1 has the widest range of frequencies.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from texclass.recording import Samples
from texclass.textures.abdulali2016.preprocessing import condition
from texclass.textures.scan import Scan
from texclass.vibration import LatticeSynthesis
from texclass.vibration.autoregressive import Autoregression, from_direct_form

SPEED_MM_S, FORCE_N = 90.0, 1.0
"""Where the resonances have their nominal frequencies and the level is nominal."""
SPEEDS_MM_S, FORCES_N = (25.0, 200.0), (0.3, 2.5)
"""What a hand does; drawn geometrically."""
SLOW_MM_S = 20.0
"""Below about this speed direction and speed matter less and less."""
LIGHT_N = 0.1
"""Below about this force, force does."""
GROWTH = (0.8, 0.5)
"""Exponents of speed and force in the level."""
PLATE_MM = 100.0


class Resonance(NamedTuple):
    """Where a surface vibrates, and what moves that.

    Parameters
    ----------
    frequency_hz, width_hz : float
        Centre and half-power width at nominal speed and force.
    with_speed, with_force, with_direction : float
        Change of the logarithm of the frequency per e-fold of speed and of force, and its amplitude over
        directions.
    """

    frequency_hz: float
    width_hz: float
    with_speed: float
    with_force: float
    with_direction: float


@dataclass(frozen=True)
class Surface:
    """A surface and what its vibration does.

    Parameters
    ----------
    name : str
        As in the paper.
    kind : str
        Its group.
    resonances : tuple of Resonance
    grain_rad : float
        Direction of the grain.
    level : float
        RMS at nominal speed and force, m/s^2.
    level_with_direction : float
        Amplitude of the logarithm of the level over directions.
    """

    name: str
    kind: str
    resonances: tuple[Resonance, ...]
    grain_rad: float
    level: float
    level_with_direction: float

    @property
    def anisotropic(self) -> bool:
        """Whether the direction matters."""
        return any(each.with_direction for each in self.resonances) or self.level_with_direction != 0

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
    Surface("S1", "plastic", (
        Resonance(60, 22, 0.35, -0.05, 0.3),
        Resonance(170, 45, 0.3, 0.05, -0.25),
        Resonance(330, 70, 0.2, 0.1, 0.15),
    ), 0.4, 3.0, 0.35),
    Surface("S2", "plastic", (
        Resonance(75, 25, 0.3, 0.05, -0.2),
        Resonance(210, 50, 0.2, 0.08, 0.15),
        Resonance(300, 60, 0.15, 0.0, 0.1),
    ), 1.2, 2.5, 0.3),
    Surface("S3", "plastic", (
        Resonance(90, 25, 0.25, 0.08, 0.15),
        Resonance(160, 40, 0.2, 0.0, 0.2),
        Resonance(270, 60, 0.1, 0.05, -0.1),
    ), 0.0, 4.0, 0.25),
    Surface("S4", "fabric", (
        Resonance(70, 45, 0.25, 0.08, 0.0),
        Resonance(220, 90, 0.15, 0.05, 0.0),
    ), 0.0, 1.0, 0.0),
    Surface("S5", "fabric", (
        Resonance(55, 40, 0.3, 0.0, 0.25),
        Resonance(180, 80, 0.2, 0.08, -0.15),
    ), 0.8, 0.8, 0.3),
    Surface("S6", "fabric", (
        Resonance(85, 50, 0.2, 0.05, -0.25),
        Resonance(250, 90, 0.15, -0.05, 0.1),
    ), 2.2, 1.2, 0.2),
    Surface("S7", "wood", (
        Resonance(45, 18, 0.3, 0.08, 0.3),
        Resonance(130, 40, 0.2, 0.05, 0.2),
    ), 0.3, 2.0, 0.5),
    Surface("S8", "wood", (
        Resonance(60, 22, 0.25, 0.0, -0.3),
        Resonance(150, 40, 0.15, 0.08, 0.2),
    ), 1.6, 1.8, 0.4),
    Surface("S9", "wood", (
        Resonance(50, 20, 0.2, 0.05, 0.2),
        Resonance(180, 50, 0.25, 0.0, -0.25),
    ), 2.6, 2.2, 0.45),
)  # fmt: skip
"""S1 ... S9; S4 alone is isotropic."""


def surface(name: str) -> Surface:
    """Return the surface of a name, S1 ... S9."""
    for each in SURFACES:
        if each.name == name:
            return each
    raise ValueError(f"surface is {name!r}; the rule is one of {', '.join(s.name for s in SURFACES)}")


def hand_motion(duration_s: float, fs: float, rng: np.random.Generator) -> tuple[Samples, Samples, Samples]:
    """Return position (n, 2), velocity (n, 2) and force (n,) of unconstrained stroking on a plate.

    Straight strokes in random directions, 0.25 to 0.8 s long, each at a speed and force of its own, which
    wander by some 15 % meanwhile; velocity and force follow with the bandwidth of a hand (6 and 3 Hz). Both
    fade in and out at the ends.
    """
    n = round(duration_s * fs)
    wished, position, start = np.empty((n, 3)), np.full(2, PLATE_MM / 2), 0
    while start < n:
        stop = min(start + round(rng.uniform(0.25, 0.8) * fs), n)
        speed, force = (np.exp(rng.uniform(*np.log(between))) for between in (SPEEDS_MM_S, FORCES_N))
        velocity = speed * _direction(position, rng)
        wished[start:stop] = *velocity, force
        position = position + velocity * (stop - start) / fs
        start = stop
    wander = signal.sosfilt(_hand(3.0, fs), rng.standard_normal((n, 2)) * np.sqrt(fs / 6), axis=0)
    wished *= np.exp(0.15 * wander[:, [0, 0, 1]])
    return _carried_out(wished, fs)


def _direction(position: Samples, rng: np.random.Generator) -> Samples:
    """Return a random direction, homewards where the edge of the plate is near."""
    home = PLATE_MM / 2 - position
    far = np.hypot(*home) > PLATE_MM / 4
    angle = np.arctan2(home[1], home[0]) + rng.uniform(-1.2, 1.2) if far else rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _carried_out(wished: Samples, fs: float) -> tuple[Samples, Samples, Samples]:
    """Return what a hand makes of the velocities and the force it wishes, (n, 3)."""
    fade = min(round(0.1 * fs), len(wished) // 4)
    wished[:fade] = wished[len(wished) - fade :] = 0.0
    velocity = signal.sosfilt(_hand(6.0, fs), wished[:, :2], axis=0)
    force = signal.sosfilt(_hand(3.0, fs), wished[:, 2])
    return PLATE_MM / 2 + np.cumsum(velocity, axis=0) / fs, velocity, np.maximum(force, 0.0)


def _hand(hz: float, fs: float) -> Samples:
    return np.asarray(signal.bessel(2, hz, fs=fs, norm="mag", output="sos"))


def simulate_scan(
    what: Surface, duration_s: float, fs: float, rng: np.random.Generator, *, conditioned: bool = True
) -> Scan:
    """Return a freehand scan of a surface, conditioned as a recorded one would be.

    Parameters
    ----------
    what : Surface
    duration_s : float
        s; 20 for training and 10 for validation in the paper.
    fs : float
        Hz.
    rng : numpy.random.Generator
        Draws the motion and the vibration.
    conditioned : bool
        Whether the filters of `condition` are applied.
    """
    return _scan(what, hand_motion(duration_s, fs, rng), fs, rng, conditioned)


def simulate_constant(
    what: Surface,
    duration_s: float,
    fs: float,
    rng: np.random.Generator,
    *,
    speed: float | None = None,
    force: float | None = None,
    direction: float | None = None,
) -> Scan:
    """Return a conditioned scan in which what is given (mm/s, N, rad) stays; the rest wanders slowly."""
    n = round(duration_s * fs)
    t = np.arange(n) / fs
    phase, rate = rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.15, 0.3, 3)
    swing = 0.7 * np.sin(2 * np.pi * rate[:, np.newaxis] * t + phase[:, np.newaxis])
    middle = [np.sqrt(low * high) for low, high in (SPEEDS_MM_S, FORCES_N)]
    v = np.full(n, speed) if speed is not None else middle[0] * np.exp(swing[0])
    f = np.full(n, force) if force is not None else middle[1] * np.exp(swing[1])
    angle = np.full(n, direction) if direction is not None else phase[2] + 2 * np.pi * rate[2] * t
    velocity = v[:, np.newaxis] * np.column_stack([np.cos(angle), np.sin(angle)])
    return _scan(what, (np.cumsum(velocity, axis=0) / fs, velocity, f), fs, rng, conditioned=True)


def _scan(
    what: Surface,
    motion: tuple[Samples, Samples, Samples],
    fs: float,
    rng: np.random.Generator,
    conditioned: bool,
) -> Scan:
    position, velocity, force = motion
    scan = Scan(what.vibration(velocity, force, fs, rng), position, velocity, force, fs, what.name)
    return condition(scan) if conditioned else scan
