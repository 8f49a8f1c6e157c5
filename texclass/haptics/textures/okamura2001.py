"""Taps of okamura2001: a library of tap models by material, and the virtual wall that makes them felt.

Taps that do not begin at their first sample are fitted together; `scale_into` brings a library into what a
device can display; a `VirtualWall` adds the vibration of a tap to the force of a spring, sample by sample.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy import optimize

from texclass.haptics.textures.contract import Stored
from texclass.recording import Samples
from texclass.signals import one_channel, positive, to_unit_scale
from texclass.vibration.decaying_sinusoid import (
    TapModel,
    TapShapes,
    checked_taps,
    fit_okamura,
    fit_tap_model,
)

LOW, HIGH = 0.1, 0.3
"""Parts of the largest magnitude through which the first rise is followed back to zero."""
LEAST_DECAY, LARGEST_DECAY = 1e-6, 3.0
"""Bounds of B / fs."""


@dataclass(frozen=True, eq=False)
class AlignedTaps:
    """Taps of one material fitted together.

    Attributes
    ----------
    model : TapModel
        Amplitude slope, decay rate and frequency.
    amplitude : ndarray of shape (n_taps,)
        A v of each tap by itself, in the unit of the taps.
    onset : ndarray of shape (n_taps,)
        Where each tap strikes, in samples, with fractions; below 0 if the recording begins later.
    r_squared : float
        Of the regression of the amplitudes on the velocities through the origin (figure 4); NaN for one
        velocity.
    explained : float
        Part of the energy of the taps that the decaying sinusoids account for, at most 1.
    """

    model: TapModel
    amplitude: Samples
    onset: Samples
    r_squared: float
    explained: float


def find_onset(tap: ArrayLike) -> float:
    """Return where a tap leaves rest, in samples: the line through its first rise, followed back to zero.

    Parameters
    ----------
    tap : array_like of shape (n_samples,)
        At rest (noise about 0) or in the tap at its beginning.

    Raises
    ------
    ValueError
        If the tap has fewer than 4 samples, is all zero, or holds NaN or infinity.
    """
    x, _ = to_unit_scale(one_channel(tap, "tap", at_least=4))
    peak = int(np.argmax(np.abs(x)))
    if x[peak] == 0:
        raise ValueError("tap is all zero. Expected at least one sample that is not")
    magnitude = np.abs(x[: peak + 1])
    noise = np.median(magnitude[: max(peak // 2, 1)])
    clear = 8.0 * noise  # 5.4 deviations of Gaussian noise
    low = max(LOW * magnitude[peak], min(clear, 0.5 * magnitude[peak]))
    high = min(low * HIGH / LOW, 0.9 * magnitude[peak])
    first, later = _crossing(magnitude, low), _crossing(magnitude, high)
    return float(first - (later - first) * low / (high - low))


def fit_aligned(taps: Sequence[ArrayLike], velocity: ArrayLike, fs: float) -> AlignedTaps:
    """Fit A, B, w to taps of one material that strike at different, unknown samples.

    Minimises sum_i |x_i(t) - a_i h(t - t_i)|^2, h(t) = exp(-B t) sin(w t) for t >= 0 and 0 before, over B, w
    and the onsets t_i, with the amplitudes a_i eliminated (variable projection); A is the regression of the
    a_i on the velocities through the origin. It starts from `find_onset` and `fit_okamura`.

    Parameters
    ----------
    taps : sequence of array_like, each of shape (n_samples,)
        Without offset, each with rest before the impact or not; lengths may differ. Any one unit.
    velocity : array_like of shape (n_taps,)
        Impact velocities, m/s, not all zero; ones, if they are unknown.
    fs : float
        Sampling rate, Hz.

    Raises
    ------
    ValueError
        As `find_onset` and `fit_tap_model`.

    References
    ----------
    `okamura2001`, section II-B, which takes amplitude, decay and frequency one after the other.
    """
    positive(fs, "fs")
    x, v, exponent = checked_taps(taps, velocity, at_least=4)
    start = [find_onset(one) for one in x]
    cut = [one[min(max(round(t), 0), one.size - 4) :] for one, t in zip(x, start, strict=True)]
    try:
        first = fit_okamura(cut, v, fs)
    except ValueError:  # no peaks are seen: the strongest tap's beginning
        strongest = max(cut, key=lambda tap: float(tap @ tap))
        first = fit_tap_model([strongest[:400]], [1.0], fs)
    problem = TapShapes(x)
    beta, omega = first.decay_per_s / fs, 2 * np.pi * first.frequency_hz / fs
    reach = max(2.0, np.pi / (2 * omega))
    p = np.array([np.clip(beta, 2 * LEAST_DECAY, LARGEST_DECAY / 2), min(omega, 3.1), *start])
    lower = np.array([LEAST_DECAY, p[1] / 3, *(np.array(start) - reach)])
    upper = np.array([LARGEST_DECAY, min(3 * p[1], np.pi), *(np.array(start) + reach)])
    end = optimize.least_squares(
        problem.residual,
        p,
        problem.jacobian,
        bounds=(lower, upper),
        x_scale="jac",
        xtol=1e-8,
        ftol=1e-10,
        max_nfev=60,
    )
    a, rest = problem.amplitudes(problem.shapes(end.x)[1]), problem.residual(end.x)
    A, r_squared = slope_through_origin(v, a)
    return AlignedTaps(
        TapModel(float(np.ldexp(A, exponent)), float(end.x[0] * fs), float(end.x[1] * fs / (2 * np.pi))),
        np.ldexp(a, exponent),
        end.x[2:].copy(),
        r_squared,
        float(1 - rest @ rest / (problem.x @ problem.x)),
    )


def slope_through_origin(velocity: Samples, amplitude: Samples) -> tuple[float, float]:
    """Return A = v a / v v and the R^2 of a = A v; NaN where all velocities or amplitudes are equal."""
    A = float(velocity @ amplitude / (velocity @ velocity))
    spread = float(np.sum((amplitude - amplitude.mean()) ** 2))
    left = float(np.sum((amplitude - A * velocity) ** 2))
    return A, 1 - left / spread if spread > 0 and np.ptp(velocity) > 0 else float("nan")


def _crossing(magnitude: Samples, level: float) -> float:
    """Return where the magnitude first reaches the level, between samples."""
    i = int(np.argmax(magnitude >= level))
    if i == 0:
        return 0.0
    below, above = magnitude[i - 1], magnitude[i]
    return i - 1 + float((level - below) / (above - below))


# The library -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TapLibrary(Stored, Mapping[str, TapModel]):
    """Tap models by material: a(t) = A v exp(-B t) sin(w t) at impact velocity v.

    It is written and read like a `Texture`, but is none: a tap is not a stroke, it has a velocity once and
    then runs by itself. A `VirtualWall` makes one of its materials felt.

    Parameters
    ----------
    materials : sequence of str
        Different names.
    models : sequence of TapModel
        One for each.
    unit : str
        Of the accelerations per velocity times m/s; "m/s^2" unless the sensor's scale is unknown.

    Raises
    ------
    ValueError
        If there is no material, names repeat, or there is not one model for each.
    """

    family: ClassVar[str] = "okamura2001"
    materials: tuple[str, ...]
    models: tuple[TapModel, ...]
    unit: str = "m/s^2"

    def __post_init__(self) -> None:
        object.__setattr__(self, "materials", tuple(self.materials))
        object.__setattr__(self, "models", tuple(self.models))
        n = len(self.materials)
        if not n or len(set(self.materials)) != n or len(self.models) != n:
            raise ValueError(
                f"{len(self.models)} models for materials {self.materials}. Expected one for each name, "
                "names that differ, one at least"
            )

    def __getitem__(self, material: str) -> TapModel:
        return dict(zip(self.materials, self.models, strict=True))[material]

    def __iter__(self) -> Iterator[str]:
        return iter(self.materials)

    def __len__(self) -> int:
        return len(self.materials)

    @property
    def table(self) -> Samples:
        """A (1/s), B (1/s) and w (Hz) of each material, shape (n_materials, 3)."""
        return np.array([(m.amplitude_slope, m.decay_per_s, m.frequency_hz) for m in self.models])


def fit_library(
    taps: Mapping[str, Sequence[ArrayLike]],
    velocity: Mapping[str, ArrayLike],
    fs: float,
    *,
    unit: str = "m/s^2",
) -> tuple[TapLibrary, dict[str, AlignedTaps]]:
    """Fit one tap model per material, and return what was found beside it.

    Parameters
    ----------
    taps : mapping of str to sequence of array_like, each of shape (n_samples,)
        Taps of each material at several velocities; they need not begin with the impact.
    velocity : mapping of str to array_like of shape (n_taps,)
        Impact velocities, m/s.
    fs : float
        Sampling rate, Hz.
    unit : str
        Of the accelerations.

    Raises
    ------
    ValueError
        If the materials differ between the two mappings, or as `fit_aligned`.
    """
    if set(taps) != set(velocity):
        raise ValueError(f"materials are {sorted(taps)} and {sorted(velocity)}. Expected the same ones")
    found = {material: fit_aligned(taps[material], velocity[material], fs) for material in taps}
    return TapLibrary(tuple(found), tuple(one.model for one in found.values()), unit), found


def tap_peak(model: TapModel) -> Samples:
    """Return max_t exp(-B t) sin(w t): at t = arctan(w / B) / w, sin is w / sqrt(w^2 + B^2)."""
    w, B = 2 * np.pi * model.frequency_hz, model.decay_per_s
    return np.asarray(np.exp(-B * np.arctan2(w, B) / w) * w / np.hypot(w, B))


# A wall that is felt to be of a material --------------------------------------------------------------------


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
    rate_hz: float = 10_000.0

    def __post_init__(self) -> None:
        for name in ("limit_n", "mass_kg", "rate_hz"):
            positive(getattr(self, name), name)
        for name in ("band_hz", "force_n"):
            low, high = getattr(self, name)
            if not 0 < low < high < np.inf:
                raise ValueError(f"{name} is {(low, high)}. Expected 0 < low < high")
        if self.band_hz[1] >= self.rate_hz / 2 or self.force_n[1] > self.limit_n:
            raise ValueError(f"{self}. Expected a band below half the rate, and a vibration within the limit")

    def peak_force(self, model: TapModel, velocity: float) -> float:
        """Return the largest force (N) that a tap at this velocity (m/s) asks for."""
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
        raise ValueError(f"peak forces are {forces} N. Expected amplitude slopes other than 0")
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
    Outside the wall the force is 0 but for what fades in 2 ms (ours); inside it is
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
                f"frequency is {self.tap.frequency_hz} Hz. Expected below half of {self.device.rate_hz} Hz"
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
        self._release = float(np.exp(-1 / (0.002 * self.fs)))
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
            raise ValueError(f"depth {x.shape} and velocity {v.shape}. Expected (n,) finite values each")
        out = np.empty(x.size)
        p = self._pole
        _press(x, v, self._push, p.real, p.imag, self._release, self._k, self._limit, self._state, out)
        return out


@njit(cache=True, error_model="numpy")
def _press(x, v, push, re, im, release, k, limit, state, out):  # type: ignore[no-untyped-def]
    """Turn the phasor z by its pole at each sample; Im z is the vibration, and does not jump at an impact.

    state: z, the gate that closes outside the wall, and whether the tip is inside.
    """
    z_re, z_im, gate, was_inside = state
    for t in range(x.size):
        inside = x[t] > 0.0
        if inside and was_inside == 0.0:
            z_re = z_re * gate + push * max(v[t], 0.0)
            z_im *= gate
            gate = 1.0
        elif not inside:
            gate *= release
        was_inside = 1.0 if inside else 0.0
        force = k * max(x[t], 0.0) + gate * z_im
        out[t] = min(max(force, -limit), limit)
        z_re, z_im = re * z_re - im * z_im, im * z_re + re * z_im
    state[0], state[1], state[2], state[3] = z_re, z_im, gate, was_inside
