"""Autoregressive candidates: every order from 1 to the largest on a grid of nodes, looked at in one go."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples
from texclass.scene.judge import Judge
from texclass.scene.models import GridModel, mixed_power, weights
from texclass.scene.nodes import line_powers, node_spectra
from texclass.scene.observed import Observed, Points
from texclass.scene.patterns import split
from texclass.scene.sinusoids import line_shapes
from texclass.vibration import recursions
from texclass.vibration.autoregressive import from_autocorrelation

LARGEST_ORDER = 400
"""What is tried at most, and what a plan is compared with; `oeztuerk2018`, figure 3.2."""


@dataclass(frozen=True, eq=False)
class LatticeGrid:
    """Models of all orders at the nodes of one grid, with the same lines or none.

    Attributes
    ----------
    speeds, forces : ndarray
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

    speeds: Samples
    forces: Samples
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
        size = self.speeds.size, self.forces.size
        power = self.noise[:, order] + self.tones.sum(axis=1)
        amplitude = np.sqrt(2 * self.tones / np.where(power > 0, power, 1.0)[:, np.newaxis])
        rows = np.hstack([self.reflection[:, :order], amplitude]).reshape(*size, -1)
        hz = np.zeros_like(self.per_mm)
        return GridModel(self.speeds, self.forces, rows, power.reshape(size), self.peak, hz, self.per_mm)

    def spectra(self, points: Points, judge: Judge, orders: NDArray[np.int64]) -> Samples:
        """Return what the models of some orders sound like at points: (n_points, n_orders, n_bins)."""
        share = weights(self.speeds, self.forces, points.speed, points.force)
        k, total = share @ self.reflection, self.noise[:, orders] + self.tones.sum(axis=1, keepdims=True)
        tonal = self.tones[:, np.newaxis] / np.where(total > 0, total, 1.0)[..., np.newaxis]
        a2 = np.tensordot(share, np.sqrt(tonal), axes=1) ** 2  # (n_points, n_orders, n_lines)
        power = mixed_power(share, total)
        left = power * np.maximum(1 - a2.sum(axis=-1), 0.0)
        found = np.stack(
            [w[:, np.newaxis] * unit_spectra(row, judge)[orders] for row, w in zip(k, left, strict=True)]
        )
        if self.per_mm.size:
            shape = line_shapes(np.multiply.outer(points.speed, self.per_mm), judge)
            found += np.einsum("nol,nlf->nof", power[..., np.newaxis] * a2, shape)
        return found


def fit_lattices(
    observed: Observed,
    judge: Judge,
    speeds: Samples,
    forces: Samples,
    order: int = LARGEST_ORDER,
    per_mm: Samples | None = None,
) -> LatticeGrid:
    """Fit autoregressive models to what was observed, at the nodes of a grid.

    Only the device's band counts: beyond its ends a spectrum is continued as in `continued`, so that no order
    is spent on what the device cannot play, nor on what drowns in its noise.

    Parameters
    ----------
    observed : Observed
    judge : Judge
    speeds, forces : ndarray
        Of the nodes.
    order : int
        Largest order.
    per_mm : ndarray of shape (n_lines,), optional
        Lines that are played as lines; the models are then fitted to the noise between them.
    """
    lines = np.zeros(0) if per_mm is None else per_mm
    noise, tonal = (
        split(observed.fit, lines, judge) if lines.size else (observed.fit, np.zeros((len(observed.fit), 0)))
    )
    X = node_spectra(noise, judge.power(noise.spectra), speeds, forces)
    r = np.fft.irfft(continued(X, judge), axis=-1)[:, : order + 1]
    k = from_autocorrelation(r).reflection
    unit = np.stack([judge.power(unit_spectra(row, judge)) for row in k])
    level = judge.power(X)[:, np.newaxis] / unit
    tones = line_powers(noise, tonal, speeds, forces)
    return LatticeGrid(speeds, forces, k, level, tones, lines, observed.peak)


def unit_spectra(k: Samples, judge: Judge) -> Samples:
    """Return the spectra of the orders 0 ... p of a model (p,) of unit power: (p + 1, n_bins), 1/Hz.

    S_m(f) = (2 / fs) g_m^2 / |A_m|^2,    g_m^2 = prod_{i <= m} (1 - k_i^2)
    """
    fs = judge.device.rate_hz
    ln_a = recursions.log_magnitudes(np.ascontiguousarray(k), 2 * np.pi * judge.frequencies / fs)
    ln_g2 = np.concatenate([[0.0], np.cumsum(np.log1p(-k) + np.log1p(k))])
    return np.asarray(2 / fs * np.exp(ln_g2[:, np.newaxis] - 2 * ln_a))


def continued(spectra: Samples, judge: Judge) -> Samples:
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
