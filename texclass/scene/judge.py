"""How far a model is from a surface, as the device can make it felt."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from texclass.recording import Samples
from texclass.scene.definition import Device, Tolerance

N_PARTS = 64
"""Equal parts of the band in which power is compared."""
THIRD_OCTAVE = 2 ** (1 / 3)
LEAST_POWER = 1e-12
"""Where the device's noise is 0: powers below this part of the largest one count as that (-120 dB)."""
SEGMENT, SEGMENT_S = 512, 0.1
"""Segments of the spectra: a power of two of at least 512 samples and 0.1 s."""


@dataclass(frozen=True)
class Verdict:
    """What a model scored at the held-out points.

    Attributes
    ----------
    scores : tuple of float
        One a point, in the unit of the tolerance's score.
    levels_db : tuple of float
        Level of the model above the surface's, one a point.
    relative : float
        The deciding one (worst or mean) in parts of the tolerance: 1 or less is within.
    """

    scores: tuple[float, ...]
    levels_db: tuple[float, ...]
    relative: float

    @property
    def within(self) -> bool:
        """Whether the tolerance is kept."""
        return self.relative <= 1


@dataclass(frozen=True)
class Judge:
    """Compares power spectra within the device's band, above its noise."""

    device: Device
    tolerance: Tolerance

    @cached_property
    def n_segment(self) -> int:
        """Samples per segment of a spectrum."""
        return max(SEGMENT, 1 << int(np.ceil(np.log2(SEGMENT_S * self.device.rate_hz))))

    @cached_property
    def frequencies(self) -> Samples:
        """Of the spectra, Hz, shape (n_segment + 1,): segments are padded, so that no lag wraps around."""
        width = self.device.rate_hz / (2 * self.n_segment)
        return np.asarray(np.arange(self.n_segment + 1) * width, dtype=np.float64)

    @cached_property
    def in_band(self) -> Samples:
        """Width of each bin within the band, Hz, shape (n_bins,)."""
        return np.asarray(self._share(np.array(self.device.band_hz))[0])

    @cached_property
    def parts(self) -> Samples:
        """Means over the parts of the band, shape (n_parts, n_bins)."""
        low, high = self.device.band_hz
        if self.tolerance.score == "band_db":
            first = max(low, 2 * self.frequencies[1])
            n = max(1, round(np.log(high / first) / np.log(THIRD_OCTAVE)))
            edges = np.geomspace(first, high, n + 1)
        else:
            n = min(N_PARTS, max(1, int((high - low) / (2 * self.frequencies[1]))))
            edges = np.linspace(low, high, n + 1)
        share = self._share(edges)
        return np.asarray(share / share.sum(axis=1, keepdims=True))

    @property
    def floor(self) -> float:
        """Power density of the device's noise, unit^2/Hz."""
        low, high = self.device.band_hz
        return self.device.noise_floor**2 / (high - low)

    def spectrum(self, x: ArrayLike) -> Samples:
        """Return the power density (Welch, Hann) of a signal at the device's rate, unit^2/Hz, (n_bins,)."""
        samples = np.asarray(x, dtype=np.float64)
        n = min(self.n_segment, samples.size)
        _, P = signal.welch(
            samples, self.device.rate_hz, "hann", n, nfft=2 * self.n_segment, detrend="constant"
        )
        return np.asarray(P)

    def power(self, spectrum: Samples) -> Samples:
        """Return the power within the band of spectra (..., n_bins), unit^2."""
        return np.asarray(spectrum @ self.in_band)

    def errors(self, recorded: Samples, modelled: Samples) -> tuple[Samples, Samples]:
        """Return scores and differences of level (dB) of spectra (..., n_bins), one by one.

        Scores are those of the tolerance: dB, or GFC.
        """
        largest = (recorded @ self.parts.T).max(axis=-1, keepdims=True)
        least = np.maximum(max(self.floor, 1e-300), LEAST_POWER * largest)
        S, M = (np.maximum(P @ self.parts.T, least) for P in (recorded, modelled))
        mean = [10 * np.log10(P.mean(axis=-1)) for P in (S, M)]
        if self.tolerance.score == "gfc":
            product = np.sqrt(S * M).sum(axis=-1)
            score = product / np.sqrt(S.sum(axis=-1) * M.sum(axis=-1))
        else:
            score = np.sqrt(np.mean((10 * np.log10(M / S)) ** 2, axis=-1))
        return np.asarray(score), np.asarray(mean[1] - mean[0])

    def relative(self, scores: Samples, levels_db: Samples) -> Samples:
        """Return scores (n_points, ...) and levels in parts of the tolerance, over the points: (...)."""
        t = self.tolerance
        miss = (1 - scores) / (1 - t.limit) if t.score == "gfc" else scores / t.limit
        found = miss if t.level_db is None else np.maximum(miss, np.abs(levels_db) / t.level_db)
        return np.asarray(found.max(axis=0) if t.over == "worst" else found.mean(axis=0))

    def verdict(self, recorded: Samples, modelled: Samples) -> Verdict:
        """Return what spectra of a model (n_points, n_bins) score against those of the surface."""
        scores, levels = self.errors(recorded, modelled)
        return Verdict(
            tuple(map(float, scores)), tuple(map(float, levels)), float(self.relative(scores, levels))
        )

    def _share(self, edges: Samples) -> Samples:
        """Return how many Hz of each bin lie between each two edges, shape (n_edges - 1, n_bins)."""
        half = self.frequencies[1] / 2
        below = np.maximum(self.frequencies - half, 0.0)
        above = np.minimum(self.frequencies + half, self.device.rate_hz / 2)
        low, high = edges[:-1, np.newaxis], edges[1:, np.newaxis]
        return np.asarray(np.maximum(np.minimum(above, high) - np.maximum(below, low), 0.0))
