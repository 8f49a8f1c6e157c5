"""Textures against scans at other speeds, and along random paths."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from texclass import signals
from texclass.recording import Samples
from texclass.textures.guruswamy2011.fit import fit_texture
from texclass.textures.guruswamy2011.simulated import SimulatedObject, lay_out, simulate_scan
from texclass.textures.guruswamy2011.texture import SpatialTexture
from texclass.textures.scan import Scan
from texclass.vibration.scores import goodness_of_fit

SPEED_STEPS = (1.0, 2.0, 4.0)
"""Of figures 11 and 12, relative to the speed of the scan."""


@dataclass(frozen=True, eq=False)
class SpeedPair:
    """A scan and the texture rendered along the same path, at one speed.

    Attributes
    ----------
    scan : Scan
        Not the one the texture was fitted to, but of the same section; compared within the texture's band.
    rendered : ndarray of shape (n_samples,)
    fit : float
        Goodness of fit of the spectra, see `goodness_of_fit`.
    level, level_printed : float
        RMS of the rendered over that of the scanned; with the amplitude as printed, see `Amplitude`.
    """

    scan: Scan
    rendered: Samples
    fit: float
    level: float
    level_printed: float


def at_speeds(thing: SimulatedObject, rng: np.random.Generator) -> tuple[SpatialTexture, list[SpeedPair]]:
    """Fit a texture to a slow scan and render it along scans of the section at further speeds."""
    section = lay_out(thing, 10 * thing.speed, rng)
    slow = simulate_scan(thing, section, rng)
    fitted = fit_texture(slow, thing.law)
    texture = fitted.texture
    pairs = []
    for step in SPEED_STEPS:
        scan = simulate_scan(thing, section, rng, speed=step * thing.speed)
        pairs.append(_pair(texture, scan, fitted.profile.cutoff_hz))
    return texture, pairs


def _pair(texture: SpatialTexture, scan: Scan, cutoff_hz: float) -> SpeedPair:
    rendered = texture.renderer().process(scan.velocity, scan.force, scan.position)
    a = within(scan.acceleration, cutoff_hz, scan.fs)
    plain = replace(texture, scaling=replace(texture.scaling, compensated=False))
    printed = plain.renderer().process(scan.velocity, scan.force, scan.position)
    level, level_printed = (float(np.sqrt(np.mean(y**2) / np.mean(a**2))) for y in (rendered, printed))
    return SpeedPair(scan, rendered, goodness_of_fit(a, rendered), level, level_printed)


def within(acceleration: Samples, cutoff_hz: float, fs: float) -> Samples:
    """Return what the band of the texture holds of a recording."""
    a: Samples = np.asarray(acceleration - acceleration.mean())
    if cutoff_hz >= fs / 2:
        return a
    return np.asarray(signals.causal(signals.butterworth("lowpass", cutoff_hz, fs), a)[0])


@dataclass(frozen=True)
class PathsResult:
    """What random paths gave.

    Attributes
    ----------
    n_paths : int
    largest : float
        Largest output over all of them, relative to the recorded peak.
    limited : float
        Part of the samples at the limit.
    most_ringing : int
        Modes that rang at once, at most.
    finite : bool
    """

    n_paths: int
    largest: float
    limited: float
    most_ringing: int
    finite: bool


def random_paths(
    textures: list[SpatialTexture], rng: np.random.Generator, n_paths: int = 1000, n_samples: int = 500
) -> PathsResult:
    """Render random paths: wandering, jumps, standing still, lifting off, speeds to 5 m/s, forces to 20 N."""
    largest, limited, ringing, finite = 0.0, 0, 0, True
    for i in range(n_paths):
        texture = textures[i % len(textures)]
        renderer = texture.renderer()
        fastest, hardest = 10 ** rng.uniform(0, 3.7), 10 ** rng.uniform(-1, 1.3)
        velocity = fastest * _smooth(rng.standard_normal((n_samples, 2)))
        force = hardest * (_smooth(rng.standard_normal((n_samples, 1)))[:, 0] + rng.uniform(-0.5, 1))
        position = np.cumsum(velocity, axis=0) / texture.fs
        if i % 4 == 0:  # jumps
            position += 100 * np.round(rng.random((n_samples, 1)) - 0.49)
        for part in np.array_split(np.arange(n_samples), 8):
            out = renderer.process(velocity[part], force[part], position[part])
            relative = np.abs(out) / texture.peak
            finite = finite and bool(np.all(np.isfinite(out)))
            largest = max(largest, float(relative.max()))
            limited += int(np.sum(relative >= 7.999))
            ringing = max(ringing, renderer.n_ringing)
    return PathsResult(n_paths, largest, limited / (n_paths * n_samples), ringing, finite)


def _smooth(x: Samples) -> Samples:
    y = ndimage.gaussian_filter1d(x, 25, axis=0)
    return np.asarray(y / max(float(np.abs(y).max()), 1e-12))
