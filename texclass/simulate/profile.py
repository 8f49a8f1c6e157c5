"""Height profiles: what the tip rides over, one line for each stroke, neighbouring lines alike."""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from texclass.recording import Samples
from texclass.simulate.surfaces import Bumps, Grating, Surface

TIP_RADIUS_MM = 1.5
N_POINTS = 2**14
STEP_MM = 0.016
_BUMP_SHAPE = 3.0


@dataclass(frozen=True, eq=False)
class Profile:
    """Heights along parallel lines; every line closes on itself after `step_m * n_points`.

    Attributes
    ----------
    heights_m : ndarray of shape (n_lines, n_points)
        float64, metres.
    step_m : float
        Distance of two points along a line.
    """

    heights_m: Samples
    step_m: float


def synthesize_profile(
    surface: Surface,
    n_lines: int,
    rng: np.random.Generator,
    *,
    drift_mm: float = 0.2,
    direction_deg: float = 0.0,
) -> Profile:
    """Draw `n_lines` lines over the surface, each `drift_mm` beside the last.

    Parameters
    ----------
    surface : Surface
        What is drawn.
    n_lines : int
        Number of lines; a stroke back and forth uses neighbouring ones.
    rng : numpy.random.Generator
        Where the surface is touched.
    drift_mm : float
        Lateral distance of neighbouring lines. Structures wider than it stay, finer ones change.
    direction_deg : float
        Angle of the lines to the normal of the gratings; stretches their wavelength by 1 / cos.

    Returns
    -------
    Profile
    """
    stretch = 1.0 / np.cos(np.deg2rad(direction_deg))
    step_mm = _step(surface.gratings, stretch)
    frequency = fft.rfftfreq(N_POINTS, step_mm)  # 1/mm
    response = tip_response(surface, frequency)
    repeating = sum(_grating(g, stretch, step_mm, rng) for g in surface.gratings)
    still = fft.rfft(np.asarray(repeating) + np.zeros(N_POINTS)) * response
    amplitude = _amplitude(surface, frequency) * response
    # Lines a distance y apart: structures of wavelength w correlate as exp(-(y / w)^2).
    keep = np.exp(-((drift_mm * frequency) ** 2))
    fresh = np.sqrt(1.0 - keep**2)
    bumps = _BumpField(surface.bumps, N_POINTS * step_mm, drift_mm, rng)
    heights = np.empty((n_lines, N_POINTS))
    state = _complex_normal(rng, frequency.size)
    for line in range(n_lines):
        spectrum = amplitude * state + still
        if surface.bumps is not None:
            spectrum += bumps.spectrum(frequency, step_mm) * response
        heights[line] = fft.irfft(spectrum, N_POINTS)
        if line + 1 < n_lines:
            state = keep * state + fresh * _complex_normal(rng, frequency.size)
            bumps.move_on()
    return Profile(1e-6 * heights, 1e-3 * step_mm)


def tip_response(surface: Surface, frequency_per_mm: Samples) -> Samples:
    """Return how much of each spatial frequency a ball of `TIP_RADIUS_MM` still follows.

    The ball touches over a patch of half-width sqrt(R (indentation + height)): what is finer averages out.
    """
    indentation_mm = 1e3 * float(surface.indentation_m(1.0))
    patch_mm = np.sqrt(TIP_RADIUS_MM * (min(indentation_mm, 0.1) + 1e-3 * surface.rms_um))
    return np.asarray(np.exp(-0.5 * (patch_mm * frequency_per_mm) ** 2))


def _step(gratings: tuple[Grating, ...], stretch: float) -> float:
    """Return the step near STEP_MM at which the first grating closes on itself after N_POINTS."""
    if not gratings:
        return STEP_MM
    wavelength = gratings[0].wavelength_mm * stretch
    return float(wavelength * np.ceil(N_POINTS * STEP_MM / wavelength) / N_POINTS)


def _amplitude(surface: Surface, frequency: Samples) -> Samples:
    """Return the rfft magnitudes (um) of unit complex noise that give S(f) and the rms height."""
    density = (1.0 + (frequency * surface.corner_mm) ** 2) ** (-surface.slope / 2.0)
    density[0] = 0.0
    return np.asarray(surface.rms_um * N_POINTS * np.sqrt(density / (2.0 * density.sum())))


def _complex_normal(rng: np.random.Generator, n: int) -> np.ndarray:
    pairs = rng.standard_normal(2 * n, dtype=np.float32) * np.float32(np.sqrt(0.5))
    return pairs.view(np.complex64)


def _grating(grating: Grating, stretch: float, step_mm: float, rng: np.random.Generator) -> Samples:
    """Return one line of ribs (um), mean 0: a cosine whose crests narrow with the sharpness."""
    n_periods = max(round(N_POINTS * step_mm / (grating.wavelength_mm * stretch)), 1)
    wander = grating.jitter * _bridge(n_periods, rng)
    phase = 2 * np.pi * n_periods * np.arange(N_POINTS) / N_POINTS + rng.uniform(0, 2 * np.pi) + wander
    rib = (0.5 + 0.5 * np.cos(phase)) ** (1.0 + 7.0 * grating.sharpness**2)
    return np.asarray(grating.depth_um * (rib - rib.mean()))


def _bridge(n_periods: int, rng: np.random.Generator) -> Samples:
    """Return a random walk, unit step per period, that ends where it began, on N_POINTS points."""
    walk = np.concatenate([[0.0], np.cumsum(rng.standard_normal(n_periods))])
    walk -= np.linspace(0.0, walk[-1], walk.size)
    points = np.linspace(0.0, n_periods, N_POINTS, endpoint=False)
    return np.asarray(np.interp(points, np.arange(walk.size), walk))


class _BumpField:
    """Bumps along the present line; moving on to the next line replaces those that are left behind."""

    def __init__(
        self, bumps: Bumps | None, length_mm: float, drift_mm: float, rng: np.random.Generator
    ) -> None:
        self._rng, self._length = rng, length_mm
        self._bumps = bumps or Bumps(0.0, 0.0, 1.0)
        n = rng.poisson(self._bumps.density_per_mm * length_mm)
        self._position, self._height = self._draw(n)
        self._leave = 1.0 - np.exp(-drift_mm / self._bumps.width_mm)

    def _draw(self, n: int) -> tuple[Samples, Samples]:
        heights = self._rng.gamma(_BUMP_SHAPE, self._bumps.height_um / _BUMP_SHAPE, n)
        return self._rng.uniform(0, self._length, n), heights

    def move_on(self) -> None:
        left = self._rng.random(self._position.size) < self._leave
        self._position[left], self._height[left] = self._draw(int(left.sum()))

    def spectrum(self, frequency: Samples, step_mm: float) -> np.ndarray:
        """Return the rfft of the bumps: spikes at their positions, smoothed to a Gaussian of their width."""
        spikes = np.zeros(N_POINTS)
        np.add.at(spikes, (self._position / step_mm).astype(np.intp) % N_POINTS, self._height)
        deviation_mm = self._bumps.width_mm / 2.355
        area = np.sqrt(2 * np.pi) * deviation_mm / step_mm
        return np.asarray(fft.rfft(spikes) * area * np.exp(-2.0 * (np.pi * frequency * deviation_mm) ** 2))
