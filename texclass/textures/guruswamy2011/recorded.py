"""The method on recordings of others: a freehand stylus with speed and force, and excerpts without."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal

from texclass import signals
from texclass.recording import Samples
from texclass.textures.guruswamy2011.comparison import within
from texclass.textures.guruswamy2011.fit import FittedScan, fit_texture
from texclass.textures.guruswamy2011.level import LevelLaw, fit_level_law
from texclass.textures.scan import Scan
from texclass.vibration.scores import goodness_of_fit

RESOLUTION = 0.17
"""Relative to the RMS, where the sensor's bit is not known: what 0.153 m/s^2 is to the paper's scans."""
HIGHEST_HZ = 350.0
"""What lies above in `stylus6` is a device line at 400 Hz and noise of the converter up to fs/2."""
LINES_HZ = (100.0, 200.0, 300.0)
"""Further lines of the device, seen in all six recordings."""


@dataclass(frozen=True)
class HeldOut:
    """A freehand recording: texture and law from its first half, rendered along its second.

    Attributes
    ----------
    name : str
    law : LevelLaw
    r_squared : float
    f_max_hz, f_major_hz, segments_per_mm, poles : float
        Of the first half.
    sad_bandpass : float
        Relative to the mean absolute profile.
    level : float
        RMS of the rendered over that of the recorded, second half.
    fit : float
        Goodness of fit of the spectra, second half.
    level_correlation : float
        Of the RMS in windows of 0.25 s, rendered and recorded.
    """

    name: str
    law: LevelLaw
    r_squared: float
    f_max_hz: float
    f_major_hz: float
    segments_per_mm: float
    poles: float
    sad_bandpass: float
    level: float
    fit: float
    level_correlation: float


def cleaned(scan: Scan) -> Scan:
    """Return a `stylus6` scan without the device's lines and without wild values of speed and force."""
    a = signals.lowpass(scan.acceleration - scan.acceleration.mean(), HIGHEST_HZ, scan.fs)
    for line in LINES_HZ:
        a = signal.filtfilt(*signal.iirnotch(line, line / 2.0, scan.fs), a)  # 2 Hz wide
    speed = ndimage.median_filter(scan.speed, 51)
    force = ndimage.median_filter(scan.force, 51)
    return Scan.along_line(a, speed, force, scan.fs, scan.name)


def held_out(scan: Scan, *, piece_s: float = 0.25) -> HeldOut:
    """Fit law and texture to the first half of a freehand scan, and render its second half.

    No bit of the sensor is known: see `RESOLUTION`.
    """
    n = len(scan) // 2
    first, second = scan.part(0, n), scan.part(n, 2 * n)
    size = int(piece_s * scan.fs)
    pieces = [first.part(i, i + size) for i in range(0, n - size + 1, size)]
    level = fit_level_law(pieces)
    fitted = fit_texture(
        first, level.law, resolution=RESOLUTION * float(first.acceleration.std()), course="travelled"
    )
    rendered = fitted.texture.renderer().process(second.velocity, second.force, second.position)
    recorded = within(second.acceleration, fitted.profile.cutoff_hz, scan.fs)
    return HeldOut(
        name=scan.name,
        law=level.law,
        r_squared=level.r_squared,
        f_max_hz=fitted.profile.band.upper_hz,
        f_major_hz=fitted.profile.band.major_hz,
        segments_per_mm=fitted.profile.segmentation.n_segments / first.distance_mm[-1],
        poles=float(fitted.responses.n_poles.mean()),
        sad_bandpass=_relative_difference(fitted),
        level=float(np.sqrt(np.mean(rendered**2) / np.mean(recorded**2))),
        fit=goodness_of_fit(recorded, rendered),
        level_correlation=float(np.corrcoef(_levels(recorded, size), _levels(rendered, size))[0, 1]),
    )


@dataclass(frozen=True)
class Excerpt:
    """A recording without speed and force.

    Attributes
    ----------
    name : str
    f_max_hz, f_major_hz, segments_per_s, poles : float
    sad_bandpass : float
        Of the sum of all filters, relative to the mean absolute profile.
    """

    name: str
    f_max_hz: float
    f_major_hz: float
    segments_per_s: float
    poles: float
    sad_bandpass: float


def excerpt(acceleration: Samples, fs: float, name: str) -> Excerpt:
    """Fit the filters of a recording of which only the acceleration is known, in any unit."""
    scan = Scan.along_line(acceleration, 100.0, 1.0, fs, name)
    fitted = fit_texture(scan, resolution=RESOLUTION * float(np.std(acceleration)))
    return Excerpt(
        name=name,
        f_max_hz=fitted.profile.band.upper_hz,
        f_major_hz=fitted.profile.band.major_hz,
        segments_per_s=fitted.profile.segmentation.n_segments / len(scan) * fs,
        poles=float(fitted.responses.n_poles.mean()),
        sad_bandpass=_relative_difference(fitted),
    )


def _relative_difference(fitted: FittedScan) -> float:
    x = fitted.profile.samples
    total = fitted.responses.sum(x.size, fitted.scan.fs)
    return float(np.mean(np.abs(x - total)) / np.mean(np.abs(x)))


def _levels(x: Samples, size: int) -> Samples:
    return np.asarray(np.sqrt(np.mean(x[: x.size // size * size].reshape(-1, size) ** 2, axis=1)))
