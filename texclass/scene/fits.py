"""Models fitted to a surface at the nodes of a grid of speeds and forces, and what these sound like.

Two kinds are cheap to play: an autoregressive process, of which every order from 1 to the largest is looked
at in one go, and a few lines; and both together.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.scene.judge import Judge
from texclass.scene.observations import Observed, Points
from texclass.scene.patterns import split
from texclass.textures.grid import GridModel, mixed_power, shares
from texclass.vibration import recursions
from texclass.vibration.autoregressive import from_autocorrelation
from texclass.vibration.major_frequencies import beat_threshold_hz

LARGEST_ORDER = 400
"""What is tried at most, and what a plan is compared with; `oeztuerk2018`, figure 3.2."""
N_STEPS = 12
"""Of the scoring; it has settled to 1e-3 after about 8."""
LARGEST_STEP = 2.0
TIE = 1e-3
"""Weight that ties powers of nodes to their neighbours: it decides only where no point does."""
SHARPNESS = 12.0
"""Weights of spectra fall with exp(-12 octaves^2) of speed and force: to half at 0.24 octaves."""

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
        power = self.noise[:, order] + self.tones.sum(axis=1)
        rows = np.hstack([self.reflection[:, :order], _amplitudes(self.tones, power)])
        return _on_grid(self.axes, rows, power, self.peak, per_mm=self.per_mm)

    def spectra(self, points: Points, judge: Judge, orders: NDArray[np.int64]) -> Samples:
        """Return what the models of some orders sound like at points: (n_points, n_orders, n_bins)."""
        share = shares(self.axes, (points.speed, points.force))
        k, total = share @ self.reflection, self.noise[:, orders] + self.tones.sum(axis=1, keepdims=True)
        tonal = self.tones[:, np.newaxis] / np.where(total > 0, total, 1.0)[..., np.newaxis]
        a2 = np.tensordot(share, np.sqrt(tonal), axes=1) ** 2  # (n_points, n_orders, n_lines)
        power = mixed_power(share, total)
        left = power * np.maximum(1 - a2.sum(axis=-1), 0.0)
        noise = [w[:, np.newaxis] * unit_spectra(row, judge)[orders] for row, w in zip(k, left, strict=True)]
        shape = line_shapes(np.multiply.outer(points.speed, self.per_mm), judge)
        return np.asarray(np.stack(noise) + np.einsum("nol,nlf->nof", power[..., np.newaxis] * a2, shape))


def fit_lattices(
    observed: Observed,
    judge: Judge,
    axes: Axes,
    order: int = LARGEST_ORDER,
    per_mm: Samples | None = None,
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
    per_mm : ndarray of shape (n_lines,), optional
        Lines that are played as lines; the models are then fitted to the noise between them.
    """
    lines = np.zeros(0) if per_mm is None else per_mm
    noise, tonal = split(observed.fit, lines, judge)
    X = node_spectra(noise, axes, judge)
    r = np.fft.irfft(_continued(X, judge), axis=-1)[:, : order + 1]
    k = from_autocorrelation(r).reflection
    unit = np.stack([judge.power(unit_spectra(row, judge)) for row in k])
    share = shares(axes, (noise.speed, noise.force))
    least = 1e-6 * max(float(tonal.max(initial=0.0)), 1e-200)
    tones = [node_powers(share, np.maximum(one, least), axes) for one in tonal.T]
    level = judge.power(X)[:, np.newaxis] / unit
    return LatticeGrid(axes, k, level, np.array(tones).T.reshape(len(k), -1), lines, observed.peak)


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
    found = _strongest(observed.fit, judge, n, observed.fit.speed / middle if along else None)
    if len(found) < n:
        return None
    X = node_spectra(observed.fit, axes, judge)
    node_speed = np.repeat(axes[0], axes[1].size)
    ratio = node_speed / middle if along else np.ones(node_speed.size)
    power = np.stack([_cells(x, found * r, judge) for x, r in zip(X, ratio, strict=True)])
    total = power.sum(axis=1)
    hz, per_mm = (np.zeros(n), found / middle) if along else (found, np.zeros(n))
    return _on_grid(axes, _amplitudes(power, total), total, observed.peak, hz=hz, per_mm=per_mm)


def _amplitudes(lines: Samples, total: Samples) -> Samples:
    """Return the amplitudes of lines of powers (n_nodes, n_lines) in vibrations of unit RMS."""
    return np.asarray(np.sqrt(2 * lines / np.where(total > 0, total, 1.0)[:, np.newaxis]))


def _on_grid(
    axes: Axes, rows: Samples, power: Samples, peak: float, *, per_mm: Samples, hz: Samples | None = None
) -> GridModel:
    size = axes[0].size, axes[1].size
    fixed = np.zeros_like(per_mm) if hz is None else hz
    return GridModel(axes, rows.reshape(*size, -1), power.reshape(size), peak, fixed, per_mm)


def model_spectra(model: GridModel, points: Points, judge: Judge) -> Samples:
    """Return the power densities of a model at speeds and forces, shape (n_points, n_bins), unit^2/Hz.

    Lines are seen through the window of the spectra.
    """
    rows, power = model.at(points.speed, points.force)
    k, tonal = rows[:, : model.order], rows[:, model.order :] ** 2 / 2
    hz = model.frequency_hz + np.multiply.outer(points.speed, model.per_mm)
    found = np.einsum("nl,nlf->nf", power[:, np.newaxis] * tonal, line_shapes(hz, judge))
    if model.order:
        left = power * np.maximum(1 - tonal.sum(axis=1), 0.0)
        found += np.stack([w * unit_spectra(row, judge)[-1] for row, w in zip(k, left, strict=True)])
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


def axis(values: Samples, n: int, within: tuple[float, float]) -> Samples:
    """Return n nodes at equal ratios between the ends of what is expected, as far as `values` reach."""
    low, high = max(within[0], values.min()), min(within[1], values.max())
    if n == 1 or low >= high:
        return np.array([np.sqrt(values.min() * values.max())])
    return np.geomspace(low, high, n)


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
    near = np.exp(-SHARPNESS * (octaves - octaves.min(axis=1, keepdims=True)))
    shape = (near / near.sum(axis=1, keepdims=True)) @ (points.spectra[felt] / power[felt, np.newaxis])
    share = shares(axes, (points.speed[felt], points.force[felt]))
    return np.asarray(node_powers(share, power[felt], axes)[:, np.newaxis] * shape)


def node_powers(share: Samples, power: Samples, axes: Axes) -> Samples:
    """Return the powers of the nodes that make the powers P_i of the points likeliest.

    Between the nodes ln powers mix linearly, ln M_i = sum_n H_in theta_n, and estimates of a power scatter
    about it as gamma variables: a regression with logarithmic link, by scoring::

        theta <- theta + (H'H + tie D'D)^-1 (H' (P / M - 1) - tie D'D theta)

    with D the differences between neighbouring nodes.

    References
    ----------
    McCullagh, Nelder, "Generalized linear models", 1989, chapter 8.
    """
    steps = [np.diff(np.eye(nodes.size), axis=0) for nodes in axes]
    along = [one.T @ one for one in steps]
    D2 = np.kron(along[0], np.eye(axes[1].size)) + np.kron(np.eye(axes[0].size), along[1])
    H, tie = share, TIE * D2
    solve = np.linalg.pinv(H.T @ H + tie)
    theta = solve @ (H.T @ np.log(power))
    for _ in range(N_STEPS):
        step = np.minimum(power * np.exp(-H @ theta) - 1, LARGEST_STEP)
        theta = theta + solve @ (H.T @ step - tie @ theta)
    return np.asarray(np.exp(theta))


def _continued(spectra: Samples, judge: Judge) -> Samples:
    """Return spectra (n, n_bins) as they are within the band, at least the device's noise, smooth beyond.

    Below the band the value at its lower end; above it that at its upper end, falling by 6 dB an octave.
    """
    f = judge.frequencies
    within = np.flatnonzero((f >= judge.device.band_hz[0]) & (f <= judge.device.band_hz[1]))
    first, last = int(within[0]), int(within[-1])
    S = np.maximum(spectra, judge.floor)
    S[:, :first] = S[:, [first]]
    S[:, last + 1 :] = S[:, [last]] * (f[last] / f[last + 1 :]) ** 2
    return np.asarray(S)


def _strongest(points: Points, judge: Judge, n: int, ratio: Samples | None) -> Samples:
    """Return up to n frequencies, rising, none closer than the threshold of beats.

    With the ratios of the speeds to the middle one, of lines that follow the speed, at the middle speed.
    """
    f, level = judge.frequencies, judge.power(points.spectra)
    scale = np.ones(len(points)) if ratio is None else ratio
    rows = [
        np.interp(f * r, f, S, right=0.0) / P
        for r, S, P in zip(scale, points.spectra, level, strict=True)
        if P
    ]
    within = (f >= judge.device.band_hz[0]) & (f <= judge.device.band_hz[1]) & (f > 0)
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
