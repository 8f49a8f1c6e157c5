"""A virtual wall that is felt to be of a material, and the device that displays it.

`scale_into` brings a tap library into what the device can display; a `VirtualWall` adds the vibration of a
tap to the force of a spring, sample by sample.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.signals import positive
from texclass.textures.okamura2001.library import TapLibrary, tap_peak
from texclass.vibration import TapModel

RELEASE_S = 0.002
"""Time constant with which a vibration that still rings ends when the wall is left: ours."""
_RE, _IM, _GATE, _INSIDE = range(4)


@dataclass(frozen=True)
class ForceDevice:
    """A force-feedback device that taps are displayed on.

    Attributes
    ----------
    band_hz : (float, float)
        Frequencies it shall display: felt well, and not yet swallowed by its inertia.
    force_n : (float, float)
        Least peak force that is felt, and the largest for the vibration.
    limit_n : float
        Largest force of its motors, wall and vibration together.
    mass_kg : float
        What the motors have to shake: force = mass * acceleration.
    cutoff_hz : float
        Where its response has fallen by 3 dB.
    rate_hz : float
        Of its loop.

    Notes
    -----
    `okamura2001`, section III: the response of the 3GM is printed as a curve only (figure 6), its force limit
    not at all. The defaults are ours: a band from 30 Hz to a little above the peak of human sensitivity at
    250 Hz, as its Table II, and forces of a desktop device.
    """

    band_hz: tuple[float, float] = (30.0, 300.0)
    force_n: tuple[float, float] = (0.5, 4.0)
    limit_n: float = 8.0
    mass_kg: float = 0.05
    cutoff_hz: float = 100.0
    rate_hz: float = 10_000.0

    def __post_init__(self) -> None:
        for name in ("limit_n", "mass_kg", "cutoff_hz", "rate_hz"):
            positive(getattr(self, name), name)
        for name in ("band_hz", "force_n"):
            low, high = getattr(self, name)
            if not 0 < low < high < np.inf:
                raise ValueError(f"{name} is {(low, high)}; the rule is 0 < low < high")
        if self.band_hz[1] >= self.rate_hz / 2 or self.force_n[1] > self.limit_n:
            raise ValueError(
                f"{self}; the rule is a band below half the rate, and a vibration within the limit"
            )

    def response(self, frequency_hz: ArrayLike) -> Samples:
        """Return the magnitude of its response, 1 at low frequencies: that of a second-order low pass.

        |H| = 1 / sqrt(1 + (f / f_c)^4), Butterworth: the force that accelerates the mass at the end of an
        elastic drive. In the place of figure 6.
        """
        f = np.asarray(frequency_hz, dtype=np.float64)
        return np.asarray(1 / np.sqrt(1 + (f / self.cutoff_hz) ** 4))

    def peak_force(self, model: TapModel, velocity: float) -> float:
        """Return the largest force (N) that a tap at this velocity (m/s) asks for, before the response."""
        return float(self.mass_kg * abs(model.amplitude_slope * velocity) * tap_peak(model))


def scale_into(library: TapLibrary, device: ForceDevice, largest_velocity: float) -> TapLibrary:
    """Return the library with frequencies, decay rates and slopes that the device can display.

    - Frequencies: the smallest and the largest are put on the band's bounds if they lie outside; those
      between keep their places on a logarithmic scale, so that materials stay apart and in order.
    - Decay rates go with the frequency, B' = B w'/w: as many oscillations are left, the shape stays.
    - Slopes: the peak forces at the largest velocity are brought between the device's least and largest in
      the same way; signs stay.

    Parameters
    ----------
    library : TapLibrary
        As measured, m/s^2.
    device : ForceDevice
        What displays it.
    largest_velocity : float
        m/s, above 0.

    Returns
    -------
    TapLibrary
        Itself where it fits already.

    Notes
    -----
    The paper scales by the judgement of expert users, each material by another factor, "while maintaining a
    difference between materials"; this is a rule with the same aims, a start for such judgements.

    References
    ----------
    `okamura2001`, section III-A and Table II.
    """
    v = positive(largest_velocity, "largest_velocity")
    f = _into([m.frequency_hz for m in library.models], device.band_hz)
    shaped = [
        TapModel(m.amplitude_slope, float(m.decay_per_s * to / m.frequency_hz), float(to))
        for m, to in zip(library.models, f, strict=True)
    ]
    forces = [device.peak_force(m, v) for m in shaped]
    if min(forces) == 0:
        raise ValueError(f"peak forces are {forces} N; the rule is amplitude slopes other than 0")
    gains = _into(forces, device.force_n) / forces
    models = [
        TapModel(float(m.amplitude_slope * g), m.decay_per_s, m.frequency_hz)
        for m, g in zip(shaped, gains, strict=True)
    ]
    return TapLibrary(library.materials, tuple(models), library.unit)


def _into(values: ArrayLike, bounds: tuple[float, float]) -> Samples:
    """Return ln y = a + b ln x with the extremes of x clipped to the bounds; x itself if none is outside."""
    x = np.log(np.asarray(values, dtype=np.float64))
    low, high = np.clip([x.min(), x.max()], *np.log(bounds))
    if low == x.min() and high == x.max():
        return np.asarray(np.exp(x))
    if x.max() == x.min():
        return np.full(x.shape, np.exp(low))
    return np.asarray(np.exp(low + (x - x.min()) * (high - low) / (x.max() - x.min())))


@dataclass(frozen=True)
class VirtualWall:
    """A wall of a stiffness, with the tap of a material on top.

    Parameters
    ----------
    tap : TapModel
        In the device's range, see `scale_into`.
    device : ForceDevice
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
    device: ForceDevice
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
        fits = np.ndim(depth_mm) == 1 and x.shape == v.shape
        if not (fits and np.isfinite([x, v]).all()):
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
