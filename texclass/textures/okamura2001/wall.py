"""A virtual wall that is felt to be of a material: a penalty force, and a vibration at each impact."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.signals import positive
from texclass.textures.okamura2001.device import Device
from texclass.vibration import TapModel

RELEASE_S = 0.002
"""Time constant with which a vibration that still rings ends when the wall is left: ours."""
_RE, _IM, _GATE, _INSIDE = range(4)


@dataclass(frozen=True)
class VirtualWall:
    """A wall of a stiffness, with the tap of a material on top.

    Parameters
    ----------
    tap : TapModel
        In the device's range, see `scale_into`.
    device : Device
        Gives rate, mass and force limit.
    stiffness_n_mm : float
        k, N/mm; the paper takes one for all materials.

    Notes
    -----
    Outside the wall the force is 0 but for what fades in `RELEASE_S`; inside it is
    k x - m A v exp(-B t) sin(w t), positive out of the wall: x is the depth, v the velocity at the last
    impact and t the time since; a negative A first pushes outwards, as an impact does. The sum is cut at the
    device's limit. An impact before the last vibration has died away adds to it.

    References
    ----------
    `okamura2001`, section II-B and figure 5.
    """

    tap: TapModel
    device: Device
    stiffness_n_mm: float = 0.5

    def __post_init__(self) -> None:
        positive(self.stiffness_n_mm, "stiffness_n_mm")
        if self.tap.frequency_hz >= self.device.rate_hz / 2:
            raise ValueError(
                f"frequency is {self.tap.frequency_hz} Hz; the rule is below half of {self.device.rate_hz} Hz"
            )

    @property
    def operations(self) -> float:
        """Multiplications and additions per sample: one complex product, the spring, gate and sum."""
        return 12.0

    def renderer(self) -> "WallRenderer":
        """Return a renderer at rest outside the wall."""
        return WallRenderer(self)


class WallRenderer:
    """A virtual wall being tapped; it keeps its state between calls, however a path is cut into them.

    Attributes
    ----------
    fs : float
        Rate of the samples, Hz.
    """

    def __init__(self, wall: VirtualWall) -> None:
        self.fs = wall.device.rate_hz
        decay, turn = wall.tap.decay_per_s / self.fs, 2 * np.pi * wall.tap.frequency_hz / self.fs
        self._pole = np.exp(-decay + 1j * turn)
        self._release = float(np.exp(-1 / (RELEASE_S * self.fs)))
        self._push = -wall.device.mass_kg * wall.tap.amplitude_slope * 1e-3  # N per mm/s
        self._k, self._limit = wall.stiffness_n_mm, wall.device.limit_n
        self._state = np.zeros(4)

    def reset(self) -> None:
        """Return to rest outside the wall."""
        self._state[:] = 0.0

    def process(self, depth_mm: ArrayLike, velocity_mm_s: ArrayLike) -> Samples:
        """Return the force for the next samples of a path.

        Parameters
        ----------
        depth_mm : array_like of shape (n,)
            Depth of the tip below the wall's surface, mm; 0 and less is outside.
        velocity_mm_s : array_like of shape (n,)
            Its rate, mm/s, positive into the wall; counts at the first sample inside, where a negative one is
            taken for 0.

        Returns
        -------
        ndarray of shape (n,)
            N, positive out of the wall, never beyond the device's limit.

        Raises
        ------
        ValueError
            If the shapes differ or a value is NaN or infinite.
        """
        x = np.ascontiguousarray(depth_mm, dtype=np.float64)
        v = np.ascontiguousarray(velocity_mm_s, dtype=np.float64)
        if (
            np.ndim(depth_mm) != 1
            or x.shape != v.shape
            or not (np.isfinite(x).all() and np.isfinite(v).all())
        ):
            raise ValueError(f"depth {x.shape} and velocity {v.shape}; the rule is (n,) finite values each")
        out = np.empty(x.size)
        p = self._pole
        _press(x, v, self._push, p.real, p.imag, self._release, self._k, self._limit, self._state, out)
        return out


@njit(cache=True, error_model="numpy")
def _press(x, v, push, re, im, release, k, limit, state, out):  # type: ignore[no-untyped-def]
    """Turn the phasor z by its pole at each sample; Im z is the vibration, and does not jump at an impact."""
    for t in range(x.size):
        inside = x[t] > 0.0
        if inside and state[_INSIDE] == 0.0:
            state[_RE] = state[_RE] * state[_GATE] + push * max(v[t], 0.0)
            state[_IM] *= state[_GATE]
            state[_GATE] = 1.0
        elif not inside:
            state[_GATE] *= release
        state[_INSIDE] = 1.0 if inside else 0.0
        force = k * max(x[t], 0.0) + state[_GATE] * state[_IM]
        out[t] = min(max(force, -limit), limit)
        state[_RE], state[_IM] = re * state[_RE] - im * state[_IM], im * state[_RE] + re * state[_IM]
