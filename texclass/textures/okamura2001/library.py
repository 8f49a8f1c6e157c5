"""Tap models by material: taps that do not begin at their first sample, fitted together, and the library."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from texclass.recording import Samples
from texclass.signals import one_channel, positive, to_unit_scale
from texclass.textures.contract import Stored
from texclass.vibration import TapModel, fit_okamura, fit_tap_model
from texclass.vibration.decaying_sinusoid import checked_taps

LOW, HIGH = 0.1, 0.3
"""Parts of the largest magnitude through which the first rise is followed back to zero."""
CLEAR = 8.0
"""The rise begins above this times the median magnitude before it: 5.4 deviations of Gaussian noise."""
N_START = 400
"""Samples of the strongest tap from which the search starts where a tap shows no peaks."""
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
        raise ValueError("tap is all zero; the rule is at least one sample that is not")
    magnitude = np.abs(x[: peak + 1])
    noise = np.median(magnitude[: max(peak // 2, 1)])
    low = max(LOW * magnitude[peak], min(CLEAR * noise, 0.5 * magnitude[peak]))
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
        first = fit_tap_model([strongest[:N_START]], [1.0], fs)
    problem = _Problem(x)
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


class _Problem:
    """Residual and Jacobian over (B / fs, w / fs, onsets), the amplitudes eliminated."""

    def __init__(self, taps: list[Samples]) -> None:
        sizes = [x.size for x in taps]
        self.x = np.concatenate(taps)
        self.which: NDArray[np.intp] = np.repeat(np.arange(len(taps)), sizes)
        self.n = np.concatenate([np.arange(size, dtype=np.float64) for size in sizes])
        self.n_taps = len(taps)

    def sums(self, values: Samples) -> Samples:
        """Sum over the samples of each tap."""
        return np.asarray(np.bincount(self.which, values, self.n_taps), dtype=np.float64)

    def shapes(self, p: Samples) -> tuple[Samples, Samples, Samples]:
        """Return t - t_i, exp(-B t) sin(w t) and exp(-B t) cos(w t), 0 before the onset."""
        t = self.n - p[2:][self.which]
        with np.errstate(under="ignore"):
            envelope = np.where(t >= 0, np.exp(-p[0] * np.maximum(t, 0.0)), 0.0)
        return t, envelope * np.sin(p[1] * t), envelope * np.cos(p[1] * t)

    def amplitudes(self, phi: Samples) -> Samples:
        """Return a_i = x_i phi_i / phi_i phi_i."""
        energy = self.sums(phi * phi)
        return np.asarray(self.sums(phi * self.x) / np.where(energy > 0, energy, 1.0))

    def residual(self, p: Samples) -> Samples:
        """Return a_i phi_i - x_i."""
        phi = self.shapes(p)[1]
        return np.asarray(self.amplitudes(phi)[self.which] * phi - self.x)

    def jacobian(self, p: Samples) -> Samples:
        """Return a_i (1 - phi phi^T / phi^T phi) d phi, Kaufman's form; a row has B, w and one onset."""
        t, phi, cosine = self.shapes(p)
        a, energy = self.amplitudes(phi)[self.which], self.sums(phi * phi)
        energy = np.where(energy > 0, energy, 1.0)
        derivatives = (-t * phi, t * cosine, p[0] * phi - p[1] * cosine)
        columns = (np.zeros_like(self.which), np.ones_like(self.which), 2 + self.which)
        out = np.zeros((self.x.size, p.size))
        for column, d_phi in zip(columns, derivatives, strict=True):
            along = (self.sums(phi * d_phi) / energy)[self.which] * phi
            out[np.arange(self.x.size), column] = a * (d_phi - along)
        return out


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
                f"{len(self.models)} models for materials {self.materials}; the rule is one for each name, "
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
        raise ValueError(f"materials are {sorted(taps)} and {sorted(velocity)}; the rule is the same ones")
    found = {material: fit_aligned(taps[material], velocity[material], fs) for material in taps}
    return TapLibrary(tuple(found), tuple(one.model for one in found.values()), unit), found


def tap_peak(model: TapModel) -> Samples:
    """Return max_t exp(-B t) sin(w t): at t = arctan(w / B) / w, sin is w / sqrt(w^2 + B^2)."""
    w, B = 2 * np.pi * model.frequency_hz, model.decay_per_s
    return np.asarray(np.exp(-B * np.arctan2(w, B) / w) * w / np.hypot(w, B))
