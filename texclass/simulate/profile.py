"""Height profiles of surfaces under the tip. Each stroke follows one line; neighbouring lines are similar."""

from collections.abc import Iterator

import numpy as np
from scipy import fft

from texclass.recording import Samples
from texclass.simulate.surfaces import Bumps, Grating, Surface

N_POINTS, STEP_MM = 2**14, 0.016
"""Number of points of a line, and their distance in mm before it is adjusted to the period of a grating."""
ROLL_OFF_MM = 20.0
"""Longest wavelength of the waviness in mm. At the speed of a stroke, it passes below 10 Hz."""


def synthesize_profile(
    surface: Surface,
    n_lines: int,
    rng: np.random.Generator,
    *,
    drift_mm: float = 0.2,
    direction_deg: float = 0.0,
) -> tuple[Samples, float]:
    """Synthesize `n_lines` parallel lines of heights over the surface, `drift_mm` apart.

    The power spectrum of the random heights is S(f) ~ (1 + (f corner_mm)^2)^(-slope / 2) W(f), with the
    waviness W of `waviness_gain`.

    Parameters
    ----------
    surface : Surface
        Surface with the statistics of the heights.
    n_lines : int
        Number of lines. Strokes back and forth use neighbouring lines.
    rng : numpy.random.Generator
        Generator of the random heights.
    drift_mm : float
        Lateral distance between neighbouring lines in mm (default 0.2). Neighbouring lines share structures
        that are wider than this distance.
    direction_deg : float
        Angle between the lines and the normal of the gratings in degrees (default 0). The wavelength of the
        gratings along a line is multiplied by 1 / cos(angle).

    Returns
    -------
    heights_m : ndarray of shape (n_lines, n_points)
        Heights in m along the lines, with mean 0. Every line is periodic with the period `step_m * n_points`,
        and the first one starts at the height 0.
    step_m : float
        Distance between adjacent points of a line in m.
    """
    stretch, step_mm = 1.0 / np.cos(np.deg2rad(direction_deg)), STEP_MM
    if surface.gratings:  # N_POINTS contain a whole number of periods of the first grating
        wavelength = surface.gratings[0].wavelength_mm * stretch
        step_mm = float(wavelength * np.ceil(N_POINTS * STEP_MM / wavelength) / N_POINTS)
    frequency = fft.rfftfreq(N_POINTS, step_mm)  # 1/mm
    response = tip_response(surface, frequency)
    gratings = sum(_grating(g, stretch, step_mm, rng) for g in surface.gratings)
    grating_spectrum = fft.rfft(np.asarray(gratings) + np.zeros(N_POINTS)) * response
    # factors (um) of unit complex noise that give the spectrum S(f) and the RMS height
    density = (1.0 + (frequency * surface.corner_mm) ** 2) ** (-surface.slope / 2.0)
    density[0] = 0.0
    density *= waviness_gain(surface, frequency) / (2.0 * density.sum())
    amplitude = surface.rms_um * N_POINTS * np.sqrt(density) * response
    # Structures of wavelength w on lines at the distance y have the correlation exp(-(y / w)^2).
    correlation = np.exp(-((drift_mm * frequency) ** 2))
    innovation = np.sqrt(1.0 - correlation**2)
    bumps = _bump_spectra(surface.bumps, frequency, step_mm, drift_mm, rng) if surface.bumps else None
    bump_spectrum = next(bumps) if bumps else None
    heights = np.empty((n_lines, N_POINTS))
    state = _complex_normal(rng, frequency.size).astype(np.complex128)
    spectrum = np.empty_like(grating_spectrum)
    for line in range(n_lines):
        np.multiply(amplitude, state, out=spectrum)
        spectrum += grating_spectrum
        if bump_spectrum is not None:
            spectrum += np.multiply(bump_spectrum, response, out=bump_spectrum)
        spectrum[0] = 0.0
        heights[line] = fft.irfft(spectrum, N_POINTS, overwrite_x=True)
        if line + 1 < n_lines:
            state *= correlation
            state += np.multiply(innovation, _complex_normal(rng, frequency.size), out=spectrum)
            bump_spectrum = next(bumps) if bumps else None
    heights *= 1e-6
    # The tool starts on the mean plane, so that the mean force of the strokes is that of the hand.
    heights = np.roll(heights, -int(np.argmin(np.abs(heights[0]))), axis=1)
    return heights, 1e-3 * step_mm


def waviness_gain(surface: Surface, frequency_per_mm: Samples) -> Samples:
    """Return the gain of the power spectrum by waviness, i.e. by wavelengths longer than the corner.

    Real surfaces are self-affine up to wavelengths of centimetres, S(f) ~ f^-(1 + 2 H), with the Hurst
    exponent H. The gain is 1 for wavelengths well below the corner.
    """
    ratio = (surface.corner_mm * frequency_per_mm) ** 2
    lowest = (surface.corner_mm / ROLL_OFF_MM) ** 2
    return np.asarray(((1.0 + ratio) / (lowest + ratio)) ** (0.5 + surface.hurst))


def tip_response(surface: Surface, frequency_per_mm: Samples) -> Samples:
    """Return the gain of each spatial frequency for a spherical tip of 1.5 mm radius.

    The contact patch has the half-width sqrt(R (indentation + height)); finer structures are averaged.
    """
    indentation_mm = 1e3 * float(surface.indentation_m(1.0))
    patch_mm = np.sqrt(1.5 * (min(indentation_mm, 0.1) + 1e-3 * surface.rms_um))
    return np.asarray(np.exp(-0.5 * (patch_mm * frequency_per_mm) ** 2))


def _complex_normal(rng: np.random.Generator, n: int) -> np.ndarray:
    pairs = rng.standard_normal(2 * n, dtype=np.float32) * np.float32(np.sqrt(0.5))
    return pairs.view(np.complex64)


def _grating(grating: Grating, stretch: float, step_mm: float, rng: np.random.Generator) -> Samples:
    """Return the heights of a grating in um, with mean 0: a cosine whose crests narrow with the sharpness."""
    n_periods = max(round(N_POINTS * step_mm / (grating.wavelength_mm * stretch)), 1)
    # a random walk with unit steps per period that ends at its start
    walk = np.concatenate([[0.0], np.cumsum(rng.standard_normal(n_periods))])
    walk -= np.linspace(0.0, walk[-1], walk.size)
    points = np.linspace(0.0, n_periods, N_POINTS, endpoint=False)
    jitter = grating.jitter * np.interp(points, np.arange(walk.size), walk)
    phase = 2 * np.pi * n_periods * np.arange(N_POINTS) / N_POINTS + rng.uniform(0, 2 * np.pi) + jitter
    ridges = (0.5 + 0.5 * np.cos(phase)) ** (1.0 + 7.0 * grating.sharpness**2)
    return np.asarray(grating.depth_um * (ridges - ridges.mean()))


def _bump_spectra(
    bumps: Bumps, frequency: Samples, step_mm: float, drift_mm: float, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Yield the rfft of the bumps of each line: spikes smoothed by a Gaussian as wide as the bumps.

    A bump that ends between two lines is replaced by a new one.
    """
    length_mm = N_POINTS * step_mm
    deviation_mm = bumps.width_mm / 2.355
    area = np.sqrt(2 * np.pi) * deviation_mm / step_mm
    n, end_probability = (
        rng.poisson(bumps.density_per_mm * length_mm),
        1.0 - np.exp(-drift_mm / bumps.width_mm),
    )
    position, height = np.empty(n), np.empty(n)
    is_new, shape = np.ones(n, bool), 3.0  # shape of the gamma distribution: few bumps are very high
    smoothing = area * np.exp(-2.0 * (np.pi * frequency * deviation_mm) ** 2)
    while True:
        height[is_new] = rng.gamma(shape, bumps.height_um / shape, int(is_new.sum()))
        position[is_new] = rng.uniform(0, length_mm, int(is_new.sum()))
        spikes = np.zeros(N_POINTS)
        np.add.at(spikes, (position / step_mm).astype(np.intp) % N_POINTS, height)
        yield np.asarray(fft.rfft(spikes) * smoothing)
        is_new = rng.random(n) < end_probability
