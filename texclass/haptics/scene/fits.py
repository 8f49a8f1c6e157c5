"""Fit models of a surface at the nodes of a speed-force grid, and compute their spectra.

Two kinds of models are cheap to render: autoregressive models and models of a few spectral lines. They can
be combined. All orders of an autoregressive model, up to the largest, are evaluated at once.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from texclass.haptics.scene.surface_spectra import OperatingPoints, SpectralScorer, SurfaceSpectra
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
"""Largest model order, and the reference order for the savings of a plan (`oeztuerk2018`, figure 3.2)."""
LINE_WIDTH = 0.03
"""Half width of a line relative to its frequency, in addition to two bins of the window. The ridges of real
surfaces are not perfectly regular."""

Axes = tuple[Samples, Samples]
"""Speeds (mm/s) and forces (N) of the nodes."""
LineKind = Literal["fixed", "spatial"]
"""A fixed line has a constant frequency (resonance). The frequency of a spatial line is proportional to the
speed (ridges)."""


@dataclass(frozen=True, eq=False)
class LatticeGrid:
    """Autoregressive models of all orders at the nodes of a grid, with spectral lines common to all orders.

    Attributes
    ----------
    axes : (ndarray, ndarray)
        Speeds (mm/s) and forces (N) of the nodes.
    reflection : ndarray of shape (n_nodes, p)
        Reflection coefficients of the largest order; the model of order m uses the first m.
    noise_power : ndarray of shape (n_nodes, p + 1)
        Mean square of the process of order m that gives it the power of the surface within the band.
    line_power : ndarray of shape (n_nodes, n_lines)
        Power of each line.
    per_mm : ndarray of shape (n_lines,)
        Spatial frequencies of the lines in 1/mm.
    peak : float
        Largest recorded magnitude.
    """

    axes: Axes
    reflection: Samples
    noise_power: Samples
    line_power: Samples
    per_mm: Samples
    peak: float

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.reflection)

    def model(self, order: int) -> GridModel:
        """Return the model of one order between 1 and p."""
        power = self.noise_power[:, order] + self.line_power.sum(axis=1)
        properties = {"peak": self.peak, "frequency_hz": np.zeros_like(self.per_mm), "per_mm": self.per_mm}
        return _grid_model(self.axes, self.reflection[:, :order], self.line_power, power, **properties)

    def spectra(self, points: OperatingPoints, scorer: SpectralScorer, orders: NDArray[np.int64]) -> Samples:
        """Return the power densities of several orders at operating points.

        Parameters
        ----------
        points : OperatingPoints
            Speeds and forces.
        scorer : SpectralScorer
            Frequencies of the spectra.
        orders : ndarray of shape (n_orders,)
            Model orders.

        Returns
        -------
        ndarray of shape (n_points, n_orders, n_bins)
            Power densities in unit^2/Hz.
        """
        weights = interpolation_weights(self.axes, (points.speed, points.force))
        k = weights @ self.reflection
        total = self.noise_power[:, orders] + self.line_power.sum(axis=1, keepdims=True)
        line_share = self.line_power[:, np.newaxis] / np.where(total > 0, total, 1.0)[..., np.newaxis]
        line_share = np.tensordot(weights, np.sqrt(line_share), axes=1) ** 2
        line_hz = np.multiply.outer(points.speed, self.per_mm)
        return _mixed_spectra(k, orders, interpolate_power(weights, total), line_share, line_hz, scorer)


def fit_lattices(
    surface: SurfaceSpectra,
    scorer: SpectralScorer,
    axes: Axes,
    order: int,
    per_mm: Samples,
) -> LatticeGrid:
    """Fit autoregressive models to the fitting set of a surface, at the nodes of a grid.

    Only the band of the device is fitted. Outside the band the spectrum is extrapolated smoothly. Within the
    band it is clipped from below at the noise of the device. Model orders are therefore not spent on
    vibration that the device cannot render or that its noise masks.

    Parameters
    ----------
    surface : SurfaceSpectra
        Spectra of the surface.
    scorer : SpectralScorer
        Band and noise of the device.
    axes : (ndarray, ndarray)
        Speeds (mm/s) and forces (N) of the nodes.
    order : int
        Largest order.
    per_mm : ndarray of shape (n_lines,)
        Spatial frequencies in 1/mm that are rendered as lines; the autoregressive models are fitted to the
        remaining noise.

    Returns
    -------
    LatticeGrid
        Models of all orders up to `order`.
    """
    noise, line_power = separate_lines(surface.fitting, per_mm, scorer)
    X = node_spectra(noise, axes, scorer)
    # The spectrum is constant below the band and falls by 6 dB per octave above it.
    f, (low, high) = scorer.frequencies, scorer.device.band_hz
    bins = np.flatnonzero((f >= low) & (f <= high))
    first, last = int(bins[0]), int(bins[-1])
    S = np.maximum(X, scorer.noise_density)
    S[:, :first] = S[:, [first]]
    S[:, last + 1 :] = S[:, [last]] * (f[last] / f[last + 1 :]) ** 2
    r = np.fft.irfft(S, axis=-1)[:, : order + 1]
    k = from_autocorrelation(r).reflection
    unit_power = np.stack([scorer.power(unit_spectra(row, scorer)) for row in k])
    weights = interpolation_weights(axes, (noise.speed, noise.force))
    lowest = 1e-6 * max(float(line_power.max(initial=0.0)), 1e-200)
    node_lines = [node_powers(weights, np.maximum(power, lowest), axes) for power in line_power.T]
    noise_power = scorer.power(X)[:, np.newaxis] / unit_power
    return LatticeGrid(axes, k, noise_power, np.array(node_lines).T.reshape(len(k), -1), per_mm, surface.peak)


def fit_lines(
    surface: SurfaceSpectra, scorer: SpectralScorer, axes: Axes, n_lines: int, kind: LineKind
) -> GridModel | None:
    """Fit the strongest lines that are too far apart to beat; each has the power of the bins nearest to it.

    Parameters
    ----------
    surface : SurfaceSpectra
        Spectra of the surface.
    scorer : SpectralScorer
        Band and noise of the device.
    axes : (ndarray, ndarray)
        Speeds (mm/s) and forces (N) of the nodes.
    n_lines : int
        Number of lines.
    kind : {"fixed", "spatial"}
        Whether the frequencies are constant ("fixed") or proportional to the speed ("spatial").

    Returns
    -------
    GridModel or None
        Fitted model; None if the band contains fewer lines.
    """
    points, is_spatial = surface.fitting, kind == "spatial"
    middle = float(np.exp(np.mean(np.log(points.speed))))
    f, (low, high) = scorer.frequencies, scorer.device.band_hz
    scale = points.speed / middle if is_spatial else np.ones(len(points))
    spectra = zip(scale, points.spectra, scorer.power(points.spectra), strict=True)
    rows = [np.interp(f * ratio, f, S, right=0.0) / P for ratio, S, P in spectra if P]
    in_band = (f >= low) & (f <= high) & (f > 0)
    mean_spectrum = np.where(in_band, np.mean(rows, axis=0) if rows else 0.0, 0.0)
    lines_hz = np.sort(f[strongest_lines(mean_spectrum, f, n_lines)])
    if len(lines_hz) < n_lines:
        return None
    X = node_spectra(points, axes, scorer)
    node_speed = np.repeat(axes[0], axes[1].size)
    node_scale = node_speed / middle if is_spatial else np.ones(node_speed.size)
    power = np.zeros((len(X), n_lines))
    for row, x, hz in zip(power, X, np.multiply.outer(node_scale, lines_hz), strict=True):
        nearest = np.searchsorted((hz[1:] + hz[:-1]) / 2, scorer.frequencies, side="right")
        row[:] = np.bincount(nearest, x * scorer.bin_widths, minlength=n_lines)
    zeros = np.zeros(n_lines)
    hz, per_mm = (zeros, lines_hz / middle) if is_spatial else (lines_hz, zeros)
    properties = {"peak": surface.peak, "frequency_hz": hz, "per_mm": per_mm}
    return _grid_model(axes, np.zeros((len(X), 0)), power, power.sum(axis=1), **properties)


def _grid_model(axes: Axes, k: Samples, line_power: Samples, total: Samples, **properties: Any) -> GridModel:
    """Return a model from reflection coefficients, line powers and total powers, each (n_nodes, ...)."""
    size = axes[0].size, axes[1].size
    amplitudes = np.sqrt(2 * line_power / np.where(total > 0, total, 1.0)[:, np.newaxis])
    return GridModel(axes, np.hstack([k, amplitudes]).reshape(*size, -1), total.reshape(size), **properties)


def model_spectra(model: GridModel, points: OperatingPoints, scorer: SpectralScorer) -> Samples:
    """Return the power densities of a model at operating points.

    Lines have the shape of the Hann window with which the spectra of the surface were estimated.

    Parameters
    ----------
    model : GridModel
        Model of one order.
    points : OperatingPoints
        Speeds and forces.
    scorer : SpectralScorer
        Frequencies of the spectra.

    Returns
    -------
    ndarray of shape (n_points, n_bins)
        Power densities in unit^2/Hz.
    """
    rows, power = model.at(points.speed, points.force)
    k, line_share = rows[:, : model.order], rows[:, model.order :] ** 2 / 2
    line_hz = model.frequency_hz + np.multiply.outer(points.speed, model.per_mm)
    order = np.array([model.order])
    spectra = _mixed_spectra(k, order, power[:, np.newaxis], line_share[:, np.newaxis], line_hz, scorer)
    return spectra[:, 0]


def _mixed_spectra(
    k: Samples,
    orders: NDArray[np.int64],
    power: Samples,
    line_share: Samples,
    line_hz: Samples,
    scorer: SpectralScorer,
) -> Samples:
    """Return the power densities of lattices with lines, (n_points, n_orders, n_bins).

    Each line at `line_hz` (n_points, n_lines) has its share (n_points, n_orders, n_lines) of the power
    (n_points, n_orders). The remaining power is noise filtered by the lattice of coefficients k (n_points,
    p).
    """
    spectra = power[..., np.newaxis] * line_share @ line_shapes(line_hz, scorer)
    if k.shape[1]:
        noise_power = power * np.maximum(1 - line_share.sum(axis=-1), 0.0)
        for i, row in enumerate(k):
            spectra[i] += noise_power[i, :, np.newaxis] * unit_spectra(row, scorer)[orders]
    return np.asarray(spectra)


def unit_spectra(k: Samples, scorer: SpectralScorer) -> Samples:
    """Return the power densities of orders 0 ... p of an autoregressive model with unit power.

    S_m(f) = (2 / fs) g_m^2 / |A_m|^2,    g_m^2 = prod_{i <= m} (1 - k_i^2)

    Parameters
    ----------
    k : ndarray of shape (p,)
        Reflection coefficients.
    scorer : SpectralScorer
        Frequencies of the spectra.

    Returns
    -------
    ndarray of shape (p + 1, n_bins)
        Power densities in 1/Hz.
    """
    fs = scorer.device.rate_hz
    omega = 2 * np.pi * scorer.frequencies / fs
    return np.asarray(2 / fs * recursions.unit_spectra(np.ascontiguousarray(k), omega))


def line_shapes(hz: Samples, scorer: SpectralScorer) -> Samples:
    """Return the power densities of lines with unit power, estimated with a Hann window.

    Lines at or above half the sampling rate are not rendered and have no power.

    Parameters
    ----------
    hz : ndarray of shape (...)
        Frequencies of the lines in Hz.
    scorer : SpectralScorer
        Frequencies of the spectra.

    Returns
    -------
    ndarray of shape (..., n_bins)
        Power densities in 1/Hz.
    """
    width = scorer.device.rate_hz / scorer.n_segment
    bins = (scorer.frequencies - hz[..., np.newaxis]) / width
    # The closed form is 0 / 0 at a distance of one bin from the line.
    regular = np.where(np.abs(np.abs(bins) - 1) < 1e-6, bins + 1e-5, bins)
    shape = (np.sinc(regular) / (1 - regular**2)) ** 2 / 1.5 / width
    return np.asarray(np.where(hz[..., np.newaxis] < scorer.device.rate_hz / 2, shape, 0.0))


def node_spectra(points: OperatingPoints, axes: Axes, scorer: SpectralScorer) -> Samples:
    """Return the power densities at the nodes: shape from the nearest points, power from all points.

    A mean over distant points would blur resonances whose frequency changes with the speed. Interpolating
    reflection coefficients between two nodes preserves them. Powers scatter more and are fitted to all
    points, see `node_powers`.

    Parameters
    ----------
    points : OperatingPoints
        Spectra of the surface.
    axes : (ndarray, ndarray)
        Speeds (mm/s) and forces (N) of the nodes.
    scorer : SpectralScorer
        Band of the device.

    Returns
    -------
    ndarray of shape (n_nodes, n_bins)
        Power densities in unit^2/Hz.
    """
    power = scorer.power(points.spectra)
    has_power = power > 0
    if not has_power.any():
        return np.zeros((axes[0].size * axes[1].size, points.spectra.shape[1]))
    speed, force = points.speed[has_power], points.force[has_power]
    v, f = (grid.ravel()[:, np.newaxis] for grid in np.meshgrid(*axes, indexing="ij"))
    octaves_squared = np.log2(speed / v) ** 2 + np.log2(force / f) ** 2
    # The weight of a point is halved at a distance of 0.24 octaves of speed and force.
    closeness = np.exp(-12.0 * (octaves_squared - octaves_squared.min(axis=1, keepdims=True)))
    closeness /= closeness.sum(axis=1, keepdims=True)
    shape = closeness @ (points.spectra[has_power] / power[has_power, np.newaxis])
    weights = interpolation_weights(axes, (speed, force))
    return np.asarray(node_powers(weights, power[has_power], axes)[:, np.newaxis] * shape)


def node_powers(weights: Samples, power: Samples, axes: Axes) -> Samples:
    """Return the maximum-likelihood powers at the nodes, see `fit_gamma_regression`.

    The log power at a point is interpolated linearly between the nodes. A weak prior D'D, with D the
    differences between neighbouring nodes, determines the power of nodes without points.

    Parameters
    ----------
    weights : ndarray of shape (n_points, n_nodes)
        Interpolation weights of the nodes at each point.
    power : ndarray of shape (n_points,)
        Powers at the points.
    axes : (ndarray, ndarray)
        Speeds (mm/s) and forces (N) of the nodes.

    Returns
    -------
    ndarray of shape (n_nodes,)
        Powers at the nodes.
    """
    differences = [np.diff(np.eye(nodes.size), axis=0) for nodes in axes]
    squared = [D.T @ D for D in differences]
    D2 = np.kron(squared[0], np.eye(axes[1].size)) + np.kron(np.eye(axes[0].size), squared[1])
    return np.asarray(np.exp(fit_gamma_regression(weights, power, 1e-3 * D2)))


def spatial_frequencies(points: OperatingPoints, scorer: SpectralScorer, n_max: int) -> Samples:
    """Return the spatial frequencies of ridges, in order of decreasing prominence.

    Parameters
    ----------
    points : OperatingPoints
        Spectra of the surface.
    scorer : SpectralScorer
        Band and noise of the device.
    n_max : int
        Largest number of frequencies.

    Returns
    -------
    ndarray of shape (n_lines,)
        Spatial frequencies in 1/mm, at most `n_max`.
    """
    if not len(points) or np.ptp(np.log(points.speed)) < np.log(1.5):
        return np.zeros(0)  # spatial lines cannot be identified at a single speed
    middle = float(np.exp(np.mean(np.log(points.speed))))
    low, high = scorer.device.band_hz
    s = np.geomspace(max(low, scorer.frequencies[2]) / middle, high / middle, 1000)
    prominence = np.full((len(points), s.size), np.nan)
    for row, S, v in zip(prominence, points.spectra, points.speed, strict=True):
        noise = median_spectrum(S, scorer)
        log_ratio = np.log(S + scorer.noise_density) - np.log(noise + scorer.noise_density)
        in_band = (s * v >= low) & (s * v <= high)
        row[in_band] = np.interp(s[in_band] * v, scorer.frequencies, log_ratio)
    # A frequency must be within the band at one third of the points or more.
    has_points = np.isfinite(prominence).sum(axis=0) >= max(2, len(points) / 3)
    median = np.zeros(s.size)
    median[has_points] = np.nanmedian(prominence[:, has_points], axis=0)
    # A median prominence of 1.8 dB over all points excludes fixed lines, which align at few speeds only.
    return s[strongest_lines(median, s * middle, n_max, min_magnitude=np.log(1.5), width=LINE_WIDTH)]


def median_spectrum(spectrum: Samples, scorer: SpectralScorer) -> Samples:
    """Return the running median of a spectrum (n_bins,) over 40 Hz, which is the noise level at its lines."""
    n = max(3, round(40.0 / scorer.frequencies[1]))
    return np.asarray(ndimage.median_filter(spectrum, n, mode="nearest"), dtype=np.float64)


def separate_lines(
    points: OperatingPoints, per_mm: Samples, scorer: SpectralScorer
) -> tuple[OperatingPoints, Samples]:
    """Separate spectra into noise and lines.

    Near a line, the noise is the running median of the spectrum, and the power above the median belongs to
    the line. Where two lines are close, the power belongs to the nearer one.

    Parameters
    ----------
    points : OperatingPoints
        Spectra of the surface.
    per_mm : ndarray of shape (n_lines,)
        Spatial frequencies of the lines in 1/mm.
    scorer : SpectralScorer
        Band of the device.

    Returns
    -------
    noise : OperatingPoints
        Spectra without the lines.
    line_power : ndarray of shape (n_points, n_lines)
        Power of each line.
    """
    noise, line_power = points.spectra.copy(), np.zeros((len(points), per_mm.size))
    if not per_mm.size:
        return points, line_power
    f, window_width = scorer.frequencies, 2 * scorer.device.rate_hz / scorer.n_segment
    for i, (S, v) in enumerate(zip(points.spectra, points.speed, strict=True)):
        hz = per_mm * v
        distance = np.abs(f - hz[:, np.newaxis])
        in_reach = distance <= (window_width + LINE_WIDTH * hz)[:, np.newaxis]
        is_of_line = in_reach & (distance == distance.min(axis=0))
        floor = np.minimum(S, median_spectrum(S, scorer))
        line_power[i] = (is_of_line * (S - floor)) @ scorer.bin_widths
        noise[i] = np.where(is_of_line.any(axis=0), floor, S)
    return OperatingPoints(noise, points.speed, points.force), line_power
