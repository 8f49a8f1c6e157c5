"""What repeats along a surface: lines whose frequencies go with the speed, and the noise about them."""

import numpy as np
from scipy import ndimage

from texclass.recording import Samples
from texclass.scene.judge import Judge
from texclass.scene.observations import Points
from texclass.vibration.major_frequencies import beat_threshold_hz

SMOOTH_HZ = 40.0
"""Width of the median that stands for the noise about a line."""
LEAST_EXCESS = np.log(1.5)
"""A line stands out of the noise by 1.8 dB at least at half of the speeds and forces: what keeps its
frequency does so at few."""
LEAST_SEEN = 1 / 3
"""Part of the points in whose band it must lie."""
WIDTH = 0.03
"""A line reaches this part of its frequency to each side, beyond the window's own two bins: people's gratings
are never quite regular."""


def pattern_frequencies(points: Points, judge: Judge, most: int) -> Samples:
    """Return up to `most` spatial frequencies, 1/mm, the most outstanding first."""
    if not len(points) or np.ptp(np.log(points.speed)) < np.log(1.5):
        return np.zeros(0)  # at one speed nothing tells what follows it
    middle = float(np.exp(np.mean(np.log(points.speed))))
    low, high = judge.device.band_hz
    s = np.geomspace(max(low, judge.frequencies[2]) / middle, high / middle, 1000)
    excess = np.full((len(points), s.size), np.nan)
    for row, S, v in zip(excess, points.spectra, points.speed, strict=True):
        above = np.log(S + judge.floor) - np.log(smoothed(S, judge) + judge.floor)
        within = (s * v >= low) & (s * v <= high)
        row[within] = np.interp(s[within] * v, judge.frequencies, above)
    often = np.isfinite(excess).sum(axis=0) >= max(2, LEAST_SEEN * len(points))
    middling = np.zeros(s.size)
    middling[often] = np.nanmedian(excess[:, often], axis=0)
    found: list[float] = []
    while len(found) < most and middling.max() > LEAST_EXCESS:
        found.append(float(s[np.argmax(middling)]))
        f, g = s * middle, found[-1] * middle
        middling[np.abs(f - g) < np.maximum(beat_threshold_hz(np.minimum(f, g)), 2 * WIDTH * g)] = 0.0
    return np.array(found)


def smoothed(spectrum: Samples, judge: Judge) -> Samples:
    """Return the noise that lines stand in: the running median."""
    n = max(3, round(SMOOTH_HZ / judge.frequencies[1]))
    return np.asarray(ndimage.median_filter(spectrum, n, mode="nearest"), dtype=np.float64)


def split(points: Points, per_mm: Samples, judge: Judge) -> tuple[Points, Samples]:
    """Return the points without the lines, and the power of each line, (n_points, n_lines).

    About a line only the median stays; what is above it is the line's. Of two lines that reach into each
    other the nearer one takes it.
    """
    noise, power = points.spectra.copy(), np.zeros((len(points), per_mm.size))
    if not per_mm.size:
        return points, power
    f, own = judge.frequencies, 2 * judge.device.rate_hz / judge.n_segment
    for i, (S, v) in enumerate(zip(points.spectra, points.speed, strict=True)):
        hz = per_mm * v
        distance = np.abs(f - hz[:, np.newaxis])
        reach = distance <= (own + WIDTH * hz)[:, np.newaxis]
        nearest = reach & (distance == distance.min(axis=0))
        floor = np.minimum(S, smoothed(S, judge))
        power[i] = (nearest * (S - floor)) @ judge.in_band
        noise[i] = np.where(nearest.any(axis=0), floor, S)
    return Points(noise, points.speed, points.force), power
