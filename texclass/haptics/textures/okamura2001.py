"""Fit tap models of `okamura2001`, scale them to a device, and render them in a virtual wall.

The onsets of taps are fitted together with their shape. `scale_to_device` scales a library of taps to the
range of a device. A `VirtualWall` adds the vibration of a tap to the force of a spring, sample by sample.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

from texclass.compilation import njit
from texclass.haptics.textures.contract import Serializable
from texclass.haptics.textures.motion_renderer import MAX_INPUT
from texclass.recording import Samples
from texclass.signals import one_channel, positive, to_unit_scale
from texclass.vibration.decaying_sinusoid import (
    TapModel,
    TapShapes,
    checked_taps,
    fit_okamura,
    fit_tap_model,
)

RISE_START, RISE_END = 0.1, 0.3
"""Fractions of the peak that define the line through the first rise, see `find_onset` (our choice)."""
MIN_DECAY, MAX_DECAY = 1e-6, 3.0
"""Bounds of B / fs in the fit."""


@dataclass(frozen=True, eq=False)
class AlignedTaps:
    """Result of a joint fit to the taps of one material.

    Attributes
    ----------
    model : TapModel
        Amplitude slope, decay rate and frequency.
    amplitude : ndarray of shape (n_taps,)
        Amplitude A v of each tap, in the unit of the taps.
    onset : ndarray of shape (n_taps,)
        Onset of each tap in fractional samples; negative if the recording begins after the onset.
    r_squared : float
        R^2 of the regression through the origin of the amplitudes on the velocities (figure 4); NaN if all
        velocities are equal.
    explained_energy : float
        Fraction of the energy of the taps that the fitted decaying sinusoids explain, at most 1.
    """

    model: TapModel
    amplitude: Samples
    onset: Samples
    r_squared: float
    explained_energy: float


def find_onset(tap: ArrayLike) -> float:
    """Return the onset of a tap in samples, where the line through its first rise crosses zero.

    Parameters
    ----------
    tap : array_like of shape (n_samples,)
        Tap, with or without zero-mean noise before the impact.

    Raises
    ------
    ValueError
        If the tap has fewer than 4 samples, contains only zeros, or contains NaN or infinity.

    Examples
    --------
    >>> round(find_onset([0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 2.0, 1.0]), 3)
    2.0
    """
    x, _ = to_unit_scale(one_channel(tap, "tap", at_least=4))
    peak = int(np.argmax(np.abs(x)))
    if x[peak] == 0:
        raise ValueError("tap must contain a nonzero sample, got only zeros")
    magnitude = np.abs(x[: peak + 1])
    noise = np.median(magnitude[: max(peak // 2, 1)])
    clear = 8.0 * noise  # 5.4 standard deviations of Gaussian noise
    low = max(RISE_START * magnitude[peak], min(clear, 0.5 * magnitude[peak]))
    high = min(low * RISE_END / RISE_START, 0.9 * magnitude[peak])
    first, later = _crossing(magnitude, low), _crossing(magnitude, high)
    return float(first - (later - first) * low / (high - low))


def fit_aligned(taps: Sequence[ArrayLike], velocity: ArrayLike, fs: float) -> AlignedTaps:
    """Fit A, B and w jointly to taps of one material with unknown onsets.

    The fit minimises sum_i |x_i(t) - a_i h(t - t_i)|^2 over B, w and the onsets t_i, where h(t) = exp(-B t)
    sin(w t) for t >= 0 and 0 otherwise. The amplitudes a_i are eliminated by variable projection. A is the
    slope of the regression through the origin of the a_i on the velocities. The initial values come from
    `find_onset` and `fit_okamura`.

    Parameters
    ----------
    taps : sequence of array_like, each of shape (n_samples,)
        Taps without offset, with or without noise before the impact. Lengths may differ; units must be equal.
    velocity : array_like of shape (n_taps,)
        Impact velocities in m/s, not all zero. Pass ones if they are unknown.
    fs : float
        Sampling rate in Hz.

    Raises
    ------
    ValueError
        If `fs` is not positive, the velocities are invalid, or `find_onset` rejects a tap.

    References
    ----------
    `okamura2001`, section II-B, which estimates amplitude, decay and frequency one after another.

    Examples
    --------
    >>> t = np.arange(300) / 10_000
    >>> tap = np.concatenate([np.zeros(20), np.exp(-90 * t) * np.sin(2 * np.pi * 300 * t)])
    >>> fit = fit_aligned([1.5 * tap, 3 * tap], [0.1, 0.2], fs=10_000)
    >>> round(fit.model.amplitude_slope, 2), round(fit.model.decay_per_s, 1), round(fit.model.frequency_hz, 1)
    (15.0, 90.0, 300.0)
    """
    positive(fs, "fs")
    x, v, exponent = checked_taps(taps, velocity, at_least=4)
    start = [find_onset(tap) for tap in x]
    cut = [tap[min(max(round(t), 0), tap.size - 4) :] for tap, t in zip(x, start, strict=True)]
    try:
        first = fit_okamura(cut, v, fs)
    except ValueError:  # if there are no peaks, start from the beginning of the strongest tap
        strongest = max(cut, key=lambda tap: float(tap @ tap))
        first = fit_tap_model([strongest[:400]], [1.0], fs)
    problem = TapShapes(x)
    beta, omega = first.decay_per_s / fs, 2 * np.pi * first.frequency_hz / fs
    max_shift = max(2.0, np.pi / (2 * omega))
    p = np.array([np.clip(beta, 2 * MIN_DECAY, MAX_DECAY / 2), min(omega, 3.1), *start])
    lower = np.array([MIN_DECAY, p[1] / 3, *(np.array(start) - max_shift)])
    upper = np.array([MAX_DECAY, min(3 * p[1], np.pi), *(np.array(start) + max_shift)])
    solution = optimize.least_squares(
        problem.residual,
        p,
        problem.jacobian,
        bounds=(lower, upper),
        x_scale="jac",
        xtol=1e-8,
        ftol=1e-10,
        max_nfev=60,
    )
    a, rest = problem.amplitudes(problem.shapes(solution.x)[1]), problem.residual(solution.x)
    A, r_squared = slope_through_origin(v, a)
    return AlignedTaps(
        TapModel(
            float(np.ldexp(A, exponent)),
            float(solution.x[0] * fs),
            float(solution.x[1] * fs / (2 * np.pi)),
        ),
        np.ldexp(a, exponent),
        solution.x[2:].copy(),
        r_squared,
        float(1 - rest @ rest / (problem.x @ problem.x)),
    )


def slope_through_origin(velocity: Samples, amplitude: Samples) -> tuple[float, float]:
    """Fit a = A v by least squares. Return A and R^2 (NaN if all velocities or all amplitudes are equal)."""
    A = float(velocity @ amplitude / (velocity @ velocity))
    spread = float(np.sum((amplitude - amplitude.mean()) ** 2))
    residual = float(np.sum((amplitude - A * velocity) ** 2))
    return A, 1 - residual / spread if spread > 0 and np.ptp(velocity) > 0 else float("nan")


def _crossing(magnitude: Samples, level: float) -> float:
    """Return the fractional sample position at which the magnitude first reaches the level."""
    i = int(np.argmax(magnitude >= level))
    if i == 0:
        return 0.0
    below, above = magnitude[i - 1], magnitude[i]
    return i - 1 + float((level - below) / (above - below))


# Library ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TapLibrary(Serializable, Mapping[str, TapModel]):
    """Tap models by material: a(t) = A v exp(-B t) sin(w t) at impact velocity v.

    A library is saved and loaded like a `Texture`, but it is not a texture: a tap has a single impact
    velocity and decays, unlike a stroke. A `VirtualWall` renders one of its materials.

    Parameters
    ----------
    materials : sequence of str
        Names of the materials, all different.
    models : sequence of TapModel
        One model per material.
    unit : str
        Unit of the accelerations (default "m/s^2"). Pass another unit if the scale of the sensor is unknown.

    Raises
    ------
    ValueError
        If there is no material, names are duplicated, or the numbers of materials and models differ.

    Examples
    --------
    >>> library = TapLibrary(("wood", "rubber"), (TapModel(1500.0, 90.0, 100.0), TapModel(300.0, 60.0, 30.0)))
    >>> library["wood"].frequency_hz, list(library)
    (100.0, ['wood', 'rubber'])
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
                f"materials must be one or more unique names, with one model each, got {self.materials} "
                f"and {len(self.models)} models"
            )

    def __getitem__(self, material: str) -> TapModel:
        return dict(zip(self.materials, self.models, strict=True))[material]

    def __iter__(self) -> Iterator[str]:
        return iter(self.materials)

    def __len__(self) -> int:
        return len(self.materials)

    @property
    def table(self) -> Samples:
        """Return A (1/s), B (1/s) and w (Hz) of each material, shape (n_materials, 3)."""
        return np.array([(m.amplitude_slope, m.decay_per_s, m.frequency_hz) for m in self.models])


def fit_library(
    taps: Mapping[str, Sequence[ArrayLike]],
    velocity: Mapping[str, ArrayLike],
    fs: float,
    *,
    unit: str = "m/s^2",
) -> tuple[TapLibrary, dict[str, AlignedTaps]]:
    """Fit one tap model per material, and return the library and the details of each fit.

    Parameters
    ----------
    taps : mapping of str to sequence of array_like, each of shape (n_samples,)
        Taps of each material at several velocities, with or without noise before the impact.
    velocity : mapping of str to array_like of shape (n_taps,)
        Impact velocities in m/s.
    fs : float
        Sampling rate in Hz.
    unit : str
        Unit of the accelerations (default "m/s^2").

    Returns
    -------
    library : TapLibrary
        Models of all materials.
    fits : dict of str to AlignedTaps
        Amplitudes, onsets and goodness of fit by material.

    Raises
    ------
    ValueError
        If the materials of the two mappings differ, or `fit_aligned` rejects the taps of a material.

    Examples
    --------
    >>> t = np.arange(300) / 10_000
    >>> tap = np.exp(-90 * t) * np.sin(2 * np.pi * 300 * t)
    >>> library, fits = fit_library({"wood": [tap, 2 * tap]}, {"wood": [0.1, 0.2]}, fs=10_000)
    >>> library.table.round(1).tolist(), round(fits["wood"].explained_energy, 2)
    ([[10.0, 90.0, 300.0]], 1.0)
    """
    if set(taps) != set(velocity):
        raise ValueError(
            f"taps and velocity must have the same materials, got {sorted(taps)} and {sorted(velocity)}"
        )
    fits = {material: fit_aligned(taps[material], velocity[material], fs) for material in taps}
    return TapLibrary(tuple(fits), tuple(fit.model for fit in fits.values()), unit), fits


def tap_peak(model: TapModel) -> Samples:
    """Return the maximum of exp(-B t) sin(w t) over time, which is reached at t = arctan(w / B) / w."""
    w, B = 2 * np.pi * model.frequency_hz, model.decay_per_s
    return np.asarray(np.exp(-B * np.arctan2(w, B) / w) * w / np.hypot(w, B))


# Virtual wall with the taps of a material -------------------------------------------------------------------


@dataclass(frozen=True)
class ForceDevice:
    """A force-feedback device that renders taps.

    Attributes
    ----------
    band_hz : (float, float)
        Frequency range in Hz that users perceive well and that the inertia of the device does not attenuate.
    force_n : (float, float)
        Smallest perceptible peak force and largest force of the vibration, in N.
    limit_n : float
        Largest force of the motors in N, for wall and vibration together.
    mass_kg : float
        Mass in kg that the motors accelerate: force = mass * acceleration.
    rate_hz : float
        Rate of the control loop in Hz.

    Notes
    -----
    `okamura2001`, section III, shows the frequency response of its device (3GM) only as a curve
    (figure 6) and states no force limit. The defaults are our choice: a band from 30 Hz to slightly above the
    peak of human sensitivity at 250 Hz, as in Table II, and the forces of a desktop device.

    Examples
    --------
    >>> round(ForceDevice().peak_force(TapModel(1500.0, 90.0, 100.0), velocity=0.2), 2)
    12.1
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
                raise ValueError(f"{name} must satisfy 0 < low < high, got {(low, high)}")
        if self.band_hz[1] >= self.rate_hz / 2:
            raise ValueError(
                f"band_hz must end below rate_hz / 2 = {self.rate_hz / 2:g} Hz, got {self.band_hz}"
            )
        if self.force_n[1] > self.limit_n:
            raise ValueError(f"force_n must not exceed limit_n = {self.limit_n:g} N, got {self.force_n}")

    def peak_force(self, model: TapModel, velocity: float) -> float:
        """Return the peak force (N) of a tap at an impact velocity (m/s)."""
        return float(self.mass_kg * abs(model.amplitude_slope * velocity) * tap_peak(model))


def scale_to_device(library: TapLibrary, device: ForceDevice, largest_velocity: float) -> TapLibrary:
    """Scale frequencies, decay rates and slopes of a library to the range of a device.

    - Frequencies: a lowest or highest frequency outside the band is moved to the limit of the band. The other
      frequencies keep their relative positions on a logarithmic scale, so materials remain distinct and in
      order.
    - Decay rates scale with the frequency, B' = B w'/w, which preserves the shape and the number of
      oscillations.
    - Amplitude slopes are scaled so that the peak forces at the largest velocity lie in the force range of
      the device, by the same rule as for frequencies. Signs are preserved.

    Parameters
    ----------
    library : TapLibrary
        Measured library, in m/s^2.
    device : ForceDevice
        Device that renders the taps.
    largest_velocity : float
        Largest impact velocity in m/s, positive.

    Returns
    -------
    TapLibrary
        Scaled library; equal to the argument if no scaling is needed.

    Raises
    ------
    ValueError
        If the largest velocity is not positive, or an amplitude slope is 0.

    Notes
    -----
    In the paper, expert users choose a factor for each material, "while maintaining a difference between
    materials". This function has the same purpose, and its result is a starting point for such adjustments.

    References
    ----------
    `okamura2001`, section III-A and Table II.

    Examples
    --------
    >>> library = TapLibrary(("steel", "rubber"), (TapModel(900.0, 90.0, 600.0), TapModel(300.0, 60.0, 30.0)))
    >>> [round(model.frequency_hz) for model in scale_to_device(library, ForceDevice(), 0.3).models]
    [300, 30]
    """
    v = positive(largest_velocity, "largest_velocity")
    f = _scale_into([m.frequency_hz for m in library.models], device.band_hz)
    shaped = [
        TapModel(m.amplitude_slope, float(m.decay_per_s * target / m.frequency_hz), float(target))
        for m, target in zip(library.models, f, strict=True)
    ]
    forces = [device.peak_force(m, v) for m in shaped]
    if min(forces) == 0:
        raise ValueError(f"amplitude slopes must be nonzero, got peak forces {forces} N")
    gains = _scale_into(forces, device.force_n) / forces
    models = [
        TapModel(float(m.amplitude_slope * g), m.decay_per_s, m.frequency_hz)
        for m, g in zip(shaped, gains, strict=True)
    ]
    return TapLibrary(library.materials, tuple(models), library.unit)


def _scale_into(values: ArrayLike, bounds: tuple[float, float]) -> Samples:
    """Return y with ln y = a + b ln x, whose extremes lie within the bounds; return x if they already do."""
    x = np.log(np.asarray(values, dtype=np.float64))
    low, high = np.clip([x.min(), x.max()], *np.log(bounds))
    if low == x.min() and high == x.max():
        return np.asarray(np.exp(x))
    if x.max() == x.min():
        return np.full(x.shape, np.exp(low))
    return np.asarray(np.exp(low + (x - x.min()) * (high - low) / (x.max() - x.min())))


@dataclass(frozen=True)
class VirtualWall:
    """A stiff virtual wall with the tap transient of a material.

    Parameters
    ----------
    tap : TapModel
        Tap scaled to the range of the device, see `scale_to_device`.
    device : ForceDevice
        Device that renders the wall.
    stiffness_n_mm : float
        Stiffness k in N/mm (default 0.5); the paper uses one value for all materials.

    Notes
    -----
    Inside the wall, the force is k x - m A v exp(-B t) sin(w t), positive out of the wall, with
    depth x, velocity v at the last impact, and time t since this impact. If A is negative, the vibration
    first pushes outwards, like a real impact. Outside the wall, the vibration fades out within 2 ms (our
    choice). The sum is clipped at the force limit of the device. The vibrations of consecutive impacts add
    up.

    References
    ----------
    `okamura2001`, section II-B and figure 5.

    Examples
    --------
    >>> wall = VirtualWall(TapModel(-300.0, 90.0, 100.0), ForceDevice())
    >>> wall.renderer().process([0.0, 0.1, 0.2], [100.0, 100.0, 100.0]).round(3).tolist()
    [0.0, 0.05, 0.193]
    """

    tap: TapModel
    device: ForceDevice
    stiffness_n_mm: float = 0.5

    def __post_init__(self) -> None:
        positive(self.stiffness_n_mm, "stiffness_n_mm")
        if self.tap.frequency_hz >= self.device.rate_hz / 2:
            raise ValueError(
                f"the frequency of the tap must be below half the rate of the device, "
                f"{self.device.rate_hz / 2:g} Hz, got {self.tap.frequency_hz} Hz"
            )

    @property
    def operations(self) -> float:
        """Operations per sample: one complex product, spring, gate and sum."""
        return 12.0

    def renderer(self) -> "WallRenderer":
        """Return a renderer with the tip outside the wall."""
        return WallRenderer(self)


class WallRenderer:
    """Renderer of a virtual wall; state is kept between calls, so blocks of any length join without clicks.

    Attributes
    ----------
    fs : float
        Sampling rate in Hz.
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
        """Reset the vibration, and move the tip outside the wall."""
        self._state[:] = 0.0

    def process(self, depth_mm: ArrayLike, velocity_mm_s: ArrayLike) -> Samples:
        """Return the forces for the next samples of a path.

        Parameters
        ----------
        depth_mm : array_like of shape (n,)
            Depth of the tip below the surface of the wall in mm; values of 0 or less are outside.
        velocity_mm_s : array_like of shape (n,)
            Velocity in mm/s, positive into the wall. Only the value at the first sample inside is used;
            negative values are replaced by 0.

        Returns
        -------
        ndarray of shape (n,)
            Force in N, positive out of the wall, clipped at the limit of the device.

        Raises
        ------
        ValueError
            If the shapes differ, or a value is NaN or exceeds `MAX_INPUT` (1e9) in magnitude.
        """
        x = np.ascontiguousarray(depth_mm, dtype=np.float64)
        v = np.ascontiguousarray(velocity_mm_s, dtype=np.float64)
        fits = np.ndim(depth_mm) == 1 and x.shape == v.shape
        if not (fits and np.all(np.abs([x, v]) <= MAX_INPUT)):
            raise ValueError(
                "depth_mm and velocity_mm_s must have the same shape (n,) and finite values of at most "
                f"{MAX_INPUT:g} in magnitude, got {x.shape} and {v.shape}"
            )
        out = np.empty(x.size)
        p = self._pole
        _press(x, v, self._push, p.real, p.imag, self._release, self._k, self._limit, self._state, out)
        return out


@njit(cache=True, error_model="numpy")
def _press(x, v, push, re, im, release, k, limit, state, out):  # type: ignore[no-untyped-def]
    """Render a block: multiply the phasor z by its pole at each sample; its imaginary part is the vibration.

    `state` contains z (two values), the gate that closes outside the wall, and whether the tip is inside.
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
