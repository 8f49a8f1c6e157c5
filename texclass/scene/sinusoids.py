"""Candidates of a few lines: what rings keeps its frequency, what repeats in space follows the speed."""

from typing import Literal

import numpy as np

from texclass.recording import Samples
from texclass.scene.judge import Judge
from texclass.scene.models import GridModel, mixed_power, weights
from texclass.scene.nodes import node_spectra
from texclass.scene.observed import Observed, Points
from texclass.vibration.major_frequencies import beat_threshold_hz

COUNTS = (1, 2, 3, 4, 6, 8, 10, 13, 16, 20, 25, 30)
"""`oeztuerk2018`, section 3.2: from 2 to 30 were tried."""
Course = Literal["fixed", "along"]


def fit_lines(
    observed: Observed, judge: Judge, speeds: Samples, forces: Samples, n: int, course: Course
) -> GridModel | None:
    """Return the model of the n strongest lines that do not beat, each with the power of its surroundings.

    Parameters
    ----------
    observed : Observed
    judge : Judge
    speeds, forces : ndarray
        Of the nodes.
    n : int
        Lines.
    course : {"fixed", "along"}
        Whether frequencies stay, or go with the speed.

    Returns
    -------
    GridModel or None
        None where the band has not so many lines.
    """
    middle = float(np.exp(np.mean(np.log(observed.fit.speed))))
    found = _strongest(observed.fit, judge, n, course, middle)
    if len(found) < n:
        return None
    X = node_spectra(observed.fit, judge.power(observed.fit.spectra), speeds, forces)
    node_speed = np.repeat(speeds, forces.size)
    ratio = node_speed / middle if course == "along" else np.ones(node_speed.size)
    power = np.stack([_cells(x, found * r, judge) for x, r in zip(X, ratio, strict=True)])
    total = power.sum(axis=1, keepdims=True)
    amplitude = np.sqrt(2 * power / np.where(total > 0, total, 1.0))
    size = speeds.size, forces.size
    hz, per_mm = (np.zeros(n), found / middle) if course == "along" else (found, np.zeros(n))
    return GridModel(
        speeds, forces, amplitude.reshape(*size, n), total.reshape(size), observed.peak, hz, per_mm
    )


def line_spectra(model: GridModel, points: Points, judge: Judge) -> Samples:
    """Return what the lines of a model look like at points, through the window: (n_points, n_bins)."""
    share = weights(model.speeds, model.forces, points.speed, points.force)
    amplitude = share @ model.rows[..., model.order :].reshape(-1, model.n_lines)
    power = mixed_power(share, model.power.ravel())[:, np.newaxis] * amplitude**2 / 2
    hz = model.frequency_hz + np.multiply.outer(points.speed, model.per_mm)
    return np.asarray(np.einsum("nl,nlf->nf", power, line_shapes(hz, judge)))


def line_shapes(hz: Samples, judge: Judge) -> Samples:
    """Return the power densities of lines of unit power at frequencies (...), Hz: (..., n_bins), 1/Hz.

    None beyond half the device's rate, where a line is not played.
    """
    width = judge.device.rate_hz / judge.n_segment
    shape = _hann((judge.frequencies - hz[..., np.newaxis]) / width) / width
    return np.asarray(np.where(hz[..., np.newaxis] < judge.device.rate_hz / 2, shape, 0.0))


def _strongest(points: Points, judge: Judge, n: int, course: Course, middle: float) -> Samples:
    """Return up to n frequencies at the middle speed, rising, none closer than the threshold of beats."""
    f = judge.frequencies
    within = (f >= judge.device.band_hz[0]) & (f <= judge.device.band_hz[1]) & (f > 0)
    ratio = points.speed / middle if course == "along" else np.ones(len(points))
    level = judge.power(points.spectra)
    rows = [
        np.interp(f * r, f, S, right=0.0) / P
        for r, S, P in zip(ratio, points.spectra, level, strict=True)
        if P
    ]
    free = np.where(within, np.mean(rows, axis=0) if rows else 0.0, 0.0)
    taken: list[float] = []
    while len(taken) < n and free.any():
        taken.append(float(f[np.argmax(free)]))
        free[np.abs(f - taken[-1]) < beat_threshold_hz(np.minimum(f, taken[-1]))] = 0
    return np.sort(taken)


def _cells(spectrum: Samples, hz: Samples, judge: Judge) -> Samples:
    """Return the power within the band that is nearest to each line."""
    edges = np.concatenate([[-np.inf], (hz[1:] + hz[:-1]) / 2, [np.inf]])
    nearest = np.searchsorted(edges, judge.frequencies, side="right") - 1
    power = np.bincount(nearest, spectrum * judge.in_band, minlength=hz.size)
    return np.asarray(power, dtype=np.float64)[: hz.size]


def _hann(bins: Samples) -> Samples:
    """Return the power density of a line at so many bins of a Hann window from it; its integral is 1."""
    near = np.where(np.abs(np.abs(bins) - 1) < 1e-6, bins + 1e-5, bins)
    return np.asarray((np.sinc(near) / (1 - near**2)) ** 2 / 1.5)
