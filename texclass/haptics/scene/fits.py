"""Models fitted to a surface at the nodes of a grid of speeds and forces, and what these sound like.

Two kinds are cheap to play: an autoregressive process, of which every order from 1 to the largest is looked
at in one go, and a few lines; and both together.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from texclass.haptics.scene.observations import Judge, Observed, Points
from texclass.haptics.textures.grid import (
    GridModel,
    fit_gamma_regression,
    interpolate_power,
    interpolation_weights,
)
from texclass.recording import Samples
from texclass.vibration import recursions
from texclass.vibration.autoregressive import from_autocorrelation
from texclass.vibration.major_frequencies import strongest_lines

LARGEST_ORDER = 400
"""What is tried at most, and what a plan is compared with; `oeztuerk2018`, figure 3.2."""
WIDTH = 0.03
"""A line reaches this part of its frequency to each side, beyond the window's own two bins: people's gratings
are never quite regular."""

Axes = tuple[Samples, Samples]
"""Speeds (mm/s) and forces (N) of the nodes."""
Course = Literal["fixed", "along"]
"""What rings keeps its frequency, what repeats in space follows the speed."""


@dataclass(frozen=True, eq=False)
class LatticeGrid:
    """Autoregressive models of all orders at the nodes of one grid, with the same lines or none.

    Attributes
    ----------
    axes : (ndarray, ndarray)
        Of the nodes.
    reflection : ndarray of shape (n_nodes, p)
        Of the largest order; a model of order m has the first m.
    noise : ndarray of shape (n_nodes, p + 1)
        Mean square of the process at which order m has the surface's power within the band.
    tones : ndarray of shape (n_nodes, n_lines)
        Power of each line.
    per_mm : ndarray of shape (n_lines,)
        Spatial frequencies of the lines, 1/mm.
    peak : float
        Largest recorded magnitude.
    """

    axes: Axes
    reflection: Samples
    noise: Samples
    tones: Samples
    per_mm: Samples
    peak: float

    @property
    def n_nodes(self) -> int:
        """Of the grid."""
        return len(self.reflection)

    def model(self, order: int) -> GridModel:
        """Return the model of one order, 1 ... p."""
        power, still = self.noise[:, order] + self.tones.sum(axis=1), np.zeros_like(self.per_mm)
        facts = {"peak": self.peak, "frequency_hz": still, "per_mm": self.per_mm}
        return _on_grid(self.axes, self.reflection[:, :order], self.tones, power, **facts)

    def spectra(self, points: Points, judge: Judge, orders: NDArray[np.int64]) -> Samples:
        """Return what the models of some orders sound like at points: (n_points, n_orders, n_bins)."""
        share = interpolation_weights(self.axes, (points.speed, points.force))
        k, total = share @ self.reflection, self.noise[:, orders] + self.tones.sum(axis=1, keepdims=True)
        tonal = self.tones[:, np.newaxis] / np.where(total > 0, total, 1.0)[..., np.newaxis]
        tonal = np.tensordot(share, np.sqrt(tonal), axes=1) ** 2
        hz = np.multiply.outer(points.speed, self.per_mm)
        return _mixed_spectra(k, orders, interpolate_power(share, total), tonal, hz, judge)


def fit_lattices(
    observed: Observed,
    judge: Judge,
    axes: Axes,
    order: int,
    per_mm: Samples,
) -> LatticeGrid:
    """Fit autoregressive models to what was observed, at the nodes of a grid.

    Only the device's band counts: beyond its ends a spectrum is continued smoothly, and within it is at least
    the device's noise, so that no order is spent on what the device cannot play, nor on what drowns in it.

    Parameters
    ----------
    observed : Observed
    judge : Judge
    axes : (ndarray, ndarray)
        Speeds and forces of the nodes.
    order : int
        Largest order.
    per_mm : ndarray of shape (n_lines,)
        Lines that are played as lines; the models are then fitted to the noise between them.
    """
    noise, tonal = split(observed.fit, per_mm, judge)
    X = node_spectra(noise, axes, judge)
    # within the band at least the device's noise; beyond it as at its ends, and falling by 6 dB an octave
    f, (low, high) = judge.frequencies, judge.device.band_hz
    within = np.flatnonzero((f >= low) & (f <= high))
    first, last = int(within[0]), int(within[-1])
    S = np.maximum(X, judge.floor)
    S[:, :first] = S[:, [first]]
    S[:, last + 1 :] = S[:, [last]] * (f[last] / f[last + 1 :]) ** 2
    r = np.fft.irfft(S, axis=-1)[:, : order + 1]
    k = from_autocorrelation(r).reflection
    unit = np.stack([judge.power(unit_spectra(row, judge)) for row in k])
    share = interpolation_weights(axes, (noise.speed, noise.force))
    least = 1e-6 * max(float(tonal.max(initial=0.0)), 1e-200)
    tones = [node_powers(share, np.maximum(one, least), axes) for one in tonal.T]
    level = judge.power(X)[:, np.newaxis] / unit
    return LatticeGrid(axes, k, level, np.array(tones).T.reshape(len(k), -1), per_mm, observed.peak)


def fit_lines(observed: Observed, judge: Judge, axes: Axes, n: int, course: Course) -> GridModel | None:
    """Return the model of the n strongest lines that do not beat, each with the power of its surroundings.

    Parameters
    ----------
    observed : Observed
    judge : Judge
    axes : (ndarray, ndarray)
        Speeds and forces of the nodes.
    n : int
        Lines.
    course : {"fixed", "along"}
        Whether frequencies stay, or go with the speed.

    Returns
    -------
    GridModel or None
        None where the band has not so many lines.
    """
    middle, along = float(np.exp(np.mean(np.log(observed.fit.speed)))), course == "along"
    f, (low, high) = judge.frequencies, judge.device.band_hz
    scale = observed.fit.speed / middle if along else np.ones(len(observed.fit))
    spectra = zip(scale, observed.fit.spectra, judge.power(observed.fit.spectra), strict=True)
    rows = [np.interp(f * r, f, S, right=0.0) / P for r, S, P in spectra if P]
    within = (f >= low) & (f <= high) & (f > 0)
    shape = np.where(within, np.mean(rows, axis=0) if rows else 0.0, 0.0)
    found = np.sort(f[strongest_lines(shape, f, n)])
    if len(found) < n:
        return None
    X = node_spectra(observed.fit, axes, judge)
    node_speed = np.repeat(axes[0], axes[1].size)
    ratio = node_speed / middle if along else np.ones(node_speed.size)
    power = np.zeros((len(X), n))
    for row, x, hz in zip(power, X, np.multiply.outer(ratio, found), strict=True):
        nearest = np.searchsorted((hz[1:] + hz[:-1]) / 2, judge.frequencies, side="right")
        row[:] = np.bincount(nearest, x * judge.in_band, minlength=n)
    hz, per_mm = (np.zeros(n), found / middle) if along else (found, np.zeros(n))
    facts = {"peak": observed.peak, "frequency_hz": hz, "per_mm": per_mm}
    return _on_grid(axes, np.zeros((len(X), 0)), power, power.sum(axis=1), **facts)


def _on_grid(axes: Axes, k: Samples, lines: Samples, power: Samples, **facts: Any) -> GridModel:
    """Return the model of reflection coefficients, powers of lines and whole powers (n_nodes, ...)."""
    size = axes[0].size, axes[1].size
    amplitudes = np.sqrt(2 * lines / np.where(power > 0, power, 1.0)[:, np.newaxis])
    return GridModel(axes, np.hstack([k, amplitudes]).reshape(*size, -1), power.reshape(size), **facts)


def model_spectra(model: GridModel, points: Points, judge: Judge) -> Samples:
    """Return the power densities of a model at speeds and forces, shape (n_points, n_bins), unit^2/Hz.

    Lines are seen through the window of the spectra.
    """
    rows, power = model.at(points.speed, points.force)
    k, tonal = rows[:, : model.order], rows[:, model.order :] ** 2 / 2
    hz = model.frequency_hz + np.multiply.outer(points.speed, model.per_mm)
    orders = np.array([model.order])
    return _mixed_spectra(k, orders, power[:, np.newaxis], tonal[:, np.newaxis], hz, judge)[:, 0]


def _mixed_spectra(
    k: Samples, orders: NDArray[np.int64], power: Samples, tonal: Samples, hz: Samples, judge: Judge
) -> Samples:
    """Return what first stages of lattices (n_points, p) and lines sound like: (n_points, n_orders, n_bins).

    Of the power (n_points, n_orders) each line at `hz` (n_points, n_lines) has its part, `tonal` (n_points,
    n_orders, n_lines), and noise through the lattice has the rest.
    """
    found = np.einsum("nol,nlf->nof", power[..., np.newaxis] * tonal, line_shapes(hz, judge))
    if k.shape[1]:
        left = power * np.maximum(1 - tonal.sum(axis=-1), 0.0)
        for i, row in enumerate(k):
            found[i] += left[i, :, np.newaxis] * unit_spectra(row, judge)[orders]
    return np.asarray(found)


def unit_spectra(k: Samples, judge: Judge) -> Samples:
    """Return the spectra of the orders 0 ... p of a model (p,) of unit power: (p + 1, n_bins), 1/Hz.

    S_m(f) = (2 / fs) g_m^2 / |A_m|^2,    g_m^2 = prod_{i <= m} (1 - k_i^2)
    """
    fs = judge.device.rate_hz
    ln_a = recursions.log_magnitudes(np.ascontiguousarray(k), 2 * np.pi * judge.frequencies / fs)
    ln_g2 = np.concatenate([[0.0], np.cumsum(np.log1p(-k) + np.log1p(k))])
    return np.asarray(2 / fs * np.exp(ln_g2[:, np.newaxis] - 2 * ln_a))


def line_shapes(hz: Samples, judge: Judge) -> Samples:
    """Return the power densities of lines of unit power at frequencies (...), Hz: (..., n_bins), 1/Hz.

    That of a Hann window, whose integral is 1; none beyond half the device's rate, where no line is played.
    """
    width = judge.device.rate_hz / judge.n_segment
    bins = (judge.frequencies - hz[..., np.newaxis]) / width
    near = np.where(np.abs(np.abs(bins) - 1) < 1e-6, bins + 1e-5, bins)
    shape = (np.sinc(near) / (1 - near**2)) ** 2 / 1.5 / width
    return np.asarray(np.where(hz[..., np.newaxis] < judge.device.rate_hz / 2, shape, 0.0))


def node_spectra(points: Points, axes: Axes, judge: Judge) -> Samples:
    """Return the spectra at the nodes, (n_nodes, n_bins): shapes from the nearest points, powers from all.

    Resonances that move with speed are lost in a mean of distant spectra, while reflection coefficients
    between two nodes let them move: hence shapes of few points. Powers scatter more and follow simple laws:
    hence `node_powers`.
    """
    power = judge.power(points.spectra)
    felt = power > 0
    if not felt.any():
        return np.zeros((axes[0].size * axes[1].size, points.spectra.shape[1]))
    v, f = (grid.ravel()[:, np.newaxis] for grid in np.meshgrid(*axes, indexing="ij"))
    octaves = np.log2(points.speed[felt] / v) ** 2 + np.log2(points.force[felt] / f) ** 2
    # to half at 0.24 octaves of speed and force
    near = np.exp(-12.0 * (octaves - octaves.min(axis=1, keepdims=True)))
    shape = (near / near.sum(axis=1, keepdims=True)) @ (points.spectra[felt] / power[felt, np.newaxis])
    share = interpolation_weights(axes, (points.speed[felt], points.force[felt]))
    return np.asarray(node_powers(share, power[felt], axes)[:, np.newaxis] * shape)


def node_powers(share: Samples, power: Samples, axes: Axes) -> Samples:
    """Return the powers of the nodes that make those of the points likeliest, see `fit_gamma_regression`.

    Between the nodes ln powers mix linearly, by the shares; T is tie D'D, with D the differences between
    neighbouring nodes.
    """
    steps = [np.diff(np.eye(nodes.size), axis=0) for nodes in axes]
    along = [one.T @ one for one in steps]
    D2 = np.kron(along[0], np.eye(axes[1].size)) + np.kron(np.eye(axes[0].size), along[1])
    # so weak a tie to the neighbours decides only where no point does
    return np.asarray(np.exp(fit_gamma_regression(share, power, 1e-3 * D2)))


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
    often = np.isfinite(excess).sum(axis=0) >= max(2, len(points) / 3)  # a third has it within the band
    middling = np.zeros(s.size)
    middling[often] = np.nanmedian(excess[:, often], axis=0)
    # 1.8 dB out of the noise at half of the speeds and forces: what keeps its frequency is so at few
    return s[strongest_lines(middling, s * middle, most, min_magnitude=np.log(1.5), width=WIDTH)]


def smoothed(spectrum: Samples, judge: Judge) -> Samples:
    """Return the noise that lines stand in: the running median over 40 Hz."""
    n = max(3, round(40.0 / judge.frequencies[1]))
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
