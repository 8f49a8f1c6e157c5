"""Height profiles: what the tip rides over, one line for each stroke, neighbouring lines alike."""

from collections.abc import Iterator

import numpy as np
from scipy import fft

from texclass.recording import Samples
from texclass.simulate.surfaces import Bumps, Grating, Surface

N_POINTS, STEP_MM = 2**14, 0.016
"""Points of a line, and their distance before a grating is made to close on itself."""


def synthesize_profile(
    surface: Surface,
    n_lines: int,
    rng: np.random.Generator,
    *,
    drift_mm: float = 0.2,
    direction_deg: float = 0.0,
) -> tuple[Samples, float]:
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
    heights_m : ndarray of shape (n_lines, n_points)
        Heights along parallel lines; every line closes on itself after `step_m * n_points`.
    step_m : float
        Distance of two points along a line.
    """
    stretch, step_mm = 1.0 / np.cos(np.deg2rad(direction_deg)), STEP_MM
    if surface.gratings:  # the first one closes on itself after N_POINTS
        wavelength = surface.gratings[0].wavelength_mm * stretch
        step_mm = float(wavelength * np.ceil(N_POINTS * STEP_MM / wavelength) / N_POINTS)
    frequency = fft.rfftfreq(N_POINTS, step_mm)  # 1/mm
    response = tip_response(surface, frequency)
    repeating = sum(_grating(g, stretch, step_mm, rng) for g in surface.gratings)
    still = fft.rfft(np.asarray(repeating) + np.zeros(N_POINTS)) * response
    # rfft magnitudes (um) of unit complex noise that give S(f) and the rms height
    density = (1.0 + (frequency * surface.corner_mm) ** 2) ** (-surface.slope / 2.0)
    density[0] = 0.0
    amplitude = surface.rms_um * N_POINTS * np.sqrt(density / (2.0 * density.sum())) * response
    # Lines a distance y apart: structures of wavelength w correlate as exp(-(y / w)^2).
    keep = np.exp(-((drift_mm * frequency) ** 2))
    fresh = np.sqrt(1.0 - keep**2)
    bumps = _bump_spectra(surface.bumps, frequency, step_mm, drift_mm, rng) if surface.bumps else None
    bumpy = next(bumps) if bumps else None
    heights = np.empty((n_lines, N_POINTS))
    state, spectrum = _complex_normal(rng, frequency.size).astype(np.complex128), np.empty_like(still)
    for line in range(n_lines):
        np.multiply(amplitude, state, out=spectrum)
        spectrum += still
        if bumpy is not None:
            spectrum += np.multiply(bumpy, response, out=bumpy)
        heights[line] = fft.irfft(spectrum, N_POINTS, overwrite_x=True)
        if line + 1 < n_lines:
            state *= keep
            state += np.multiply(fresh, _complex_normal(rng, frequency.size), out=spectrum)
            bumpy = next(bumps) if bumps else None
    heights *= 1e-6
    return heights, 1e-3 * step_mm


def tip_response(surface: Surface, frequency_per_mm: Samples) -> Samples:
    """Return how much of each spatial frequency a ball of 1.5 mm radius still follows.

    The ball touches over a patch of half-width sqrt(R (indentation + height)): what is finer averages out.
    """
    indentation_mm = 1e3 * float(surface.indentation_m(1.0))
    patch_mm = np.sqrt(1.5 * (min(indentation_mm, 0.1) + 1e-3 * surface.rms_um))
    return np.asarray(np.exp(-0.5 * (patch_mm * frequency_per_mm) ** 2))


def _complex_normal(rng: np.random.Generator, n: int) -> np.ndarray:
    pairs = rng.standard_normal(2 * n, dtype=np.float32) * np.float32(np.sqrt(0.5))
    return pairs.view(np.complex64)


def _grating(grating: Grating, stretch: float, step_mm: float, rng: np.random.Generator) -> Samples:
    """Return one line of ribs (um), mean 0: a cosine whose crests narrow with the sharpness."""
    n_periods = max(round(N_POINTS * step_mm / (grating.wavelength_mm * stretch)), 1)
    # a random walk, unit step per period, that ends where it began
    walk = np.concatenate([[0.0], np.cumsum(rng.standard_normal(n_periods))])
    walk -= np.linspace(0.0, walk[-1], walk.size)
    points = np.linspace(0.0, n_periods, N_POINTS, endpoint=False)
    wander = grating.jitter * np.interp(points, np.arange(walk.size), walk)
    phase = 2 * np.pi * n_periods * np.arange(N_POINTS) / N_POINTS + rng.uniform(0, 2 * np.pi) + wander
    rib = (0.5 + 0.5 * np.cos(phase)) ** (1.0 + 7.0 * grating.sharpness**2)
    return np.asarray(grating.depth_um * (rib - rib.mean()))


def _bump_spectra(
    bumps: Bumps, frequency: Samples, step_mm: float, drift_mm: float, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Yield, line by line, the rfft of the bumps: spikes, smoothed to a Gaussian of their width.

    From one line to the next those that are left behind are replaced.
    """
    length_mm = N_POINTS * step_mm
    deviation_mm = bumps.width_mm / 2.355
    area = np.sqrt(2 * np.pi) * deviation_mm / step_mm
    n, leave = rng.poisson(bumps.density_per_mm * length_mm), 1.0 - np.exp(-drift_mm / bumps.width_mm)
    position, height = np.empty(n), np.empty(n)
    new, shape = np.ones(n, bool), 3.0  # few are much higher than the rest
    smoothing = area * np.exp(-2.0 * (np.pi * frequency * deviation_mm) ** 2)
    while True:
        height[new] = rng.gamma(shape, bumps.height_um / shape, int(new.sum()))
        position[new] = rng.uniform(0, length_mm, int(new.sum()))
        spikes = np.zeros(N_POINTS)
        np.add.at(spikes, (position / step_mm).astype(np.intp) % N_POINTS, height)
        yield np.asarray(fft.rfft(spikes) * smoothing)
        new = rng.random(n) < leave
