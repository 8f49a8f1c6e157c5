"""One filter per segment: stable decaying modes, a single decaying sinusoid, or Prony's as published."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from texclass.recording import Samples
from texclass.vibration.decaying_modes import DecayingModes, fit_matrix_pencil
from texclass.vibration.prony import PronyFilter, fit_prony, n_extrema

RING_S = 0.5
"""A filter has fallen by 60 dB after that long, at the latest."""
MAX_POLES = 24
"""Largest order of a filter: it bounds what a feature costs to render, and to fit."""
CANCELLING = 100.0
"""A fit whose modes exceed the segment's peak by that factor, and so nearly cancel, is not taken."""
LEAST_SAMPLES = 8
"""Shorter segments are continued by zeros, as the paper pads them."""

Method = Literal["modes", "sinusoid"]
NONE = DecayingModes(*np.zeros((4, 0)))


@dataclass(frozen=True, eq=False)
class Responses:
    """Filters of consecutive segments.

    Attributes
    ----------
    start : ndarray of shape (n_segments,)
        First sample of each segment.
    modes : tuple of DecayingModes
        The filter of each; one without modes adds nothing to what still rings.
    """

    start: Samples
    modes: tuple[DecayingModes, ...]

    @property
    def n_poles(self) -> Samples:
        """Order of each filter, shape (n_segments,): two for a sinusoid, one for an exponential."""
        return np.array([float(np.sum(1 + (m.frequency_hz > 0))) for m in self.modes])

    def sum(self, n_samples: int, fs: float) -> Samples:
        """Return the sum of all filters, each struck at its start: eq. (5) at the speed of the scan."""
        total = np.zeros(n_samples)
        for start, modes in zip(self.start.astype(np.int64), self.modes, strict=True):
            stop = min(start + _ring_samples(fs), n_samples)
            total[start:stop] += modes.synthesize(stop - start, fs)
        return total


def fit_responses(
    x: Samples,
    bounds: Sequence[int],
    fs: float,
    resolution: float,
    *,
    method: Method = "modes",
    tails: Literal["subtracted", "ignored"] = "subtracted",
) -> Responses:
    """Fit one filter to each segment of a profile.

    Parameters
    ----------
    x : ndarray of shape (n_samples,)
        The profile.
    bounds : sequence of int
        Segment i holds the samples bounds[i] ... bounds[i + 1] - 1.
    fs : float
        Hz.
    resolution : float
        Mean absolute error to reach, in the unit of `x`.
    method : {"modes", "sinusoid"}
        `fit_modes`, or one decaying sinusoid, eq. (3).
    tails : {"subtracted", "ignored"}
        "subtracted": what earlier filters still ring is taken off a segment before it is fitted, so that the
        sum of all filters is the profile again. "ignored": each is fitted alone, as printed; the sum then has
        tails on top.

    Returns
    -------
    Responses

    References
    ----------
    `guruswamy2011`, section IV-A.
    """
    rest = np.array(x, dtype=np.float64)
    fitted = []
    for start, stop in pairwise(bounds):
        piece = rest[start:stop]
        modes = fit_modes(piece, fs, resolution) if method == "modes" else fit_sinusoid(piece, fs)
        fitted.append(modes)
        if tails == "subtracted":
            end = min(start + _ring_samples(fs), rest.size)
            rest[start:end] -= modes.synthesize(end - start, fs)
    return Responses(np.asarray(bounds[:-1], dtype=np.float64), tuple(fitted))


def fit_modes(piece: Samples, fs: float, resolution: float) -> DecayingModes:
    """Fit decaying modes of about the least number of poles that meets the resolution.

    The number of poles is doubled until the mean absolute error of the segment falls below the resolution,
    then halved back; without success the fit of the least error counts. All modes decay by 60 dB in `RING_S`
    at the latest.

    Parameters
    ----------
    piece : ndarray of shape (n_samples,)
        Segment.
    fs : float
        Hz.
    resolution : float
        In the unit of `piece`, above 0.

    Returns
    -------
    DecayingModes
        None at all for a segment below the resolution.
    """
    if np.mean(np.abs(piece)) < resolution:
        return NONE
    x = np.pad(piece, (0, max(0, LEAST_SAMPLES - piece.size)))
    tried: dict[int, tuple[float, DecayingModes]] = {}

    def error(order: int) -> float:
        if order not in tried:
            modes = _bounded(fit_matrix_pencil(x, fs, order=order), x, fs)
            missed = float(np.mean(np.abs(modes.synthesize(piece.size, fs) - piece)))
            moderate = np.max(modes.amplitude, initial=0.0) <= CANCELLING * np.max(np.abs(x))
            tried[order] = missed if moderate else np.inf, modes
        return tried[order][0]

    low, high, highest = 0, 2, min(x.size // 2, MAX_POLES)
    while error(high) >= resolution and high < highest:
        low, high = high, min(2 * high, highest)
    while high - low > 1 and tried[high][0] < resolution:
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) < resolution else (middle, high)
    best = tried[high] if tried[high][0] < resolution else min(tried.values(), key=lambda each: each[0])
    return best[1] if np.isfinite(best[0]) else fit_sinusoid(piece, fs)


def fit_sinusoid(piece: Samples, fs: float) -> DecayingModes:
    """Fit a(t) = A exp(-beta t) sin(omega t) to a segment by least squares, A of either sign.

    For given beta and omega, A is the projection of the segment on the shape; beta and omega are searched on
    a grid that is narrowed four times about its best point.

    References
    ----------
    `guruswamy2011`, eq. (3) and (4), after `okamura2001`, whose fit from peaks and spectrum needs two peaks.
    """
    if not np.any(piece):
        return NONE
    t = np.arange(piece.size) / fs
    low = np.log([_least_decay(), 0.25 / max(t[-1], 1 / fs)])
    high = np.log([2 * fs, 0.49 * fs])
    for _ in range(5):
        B, f = (np.exp(axis) for axis in np.meshgrid(*np.linspace(low, high, 24).T))
        shape = np.exp(-B.ravel()[:, np.newaxis] * t) * np.sin(2 * np.pi * f.ravel()[:, np.newaxis] * t)
        size = np.maximum(np.linalg.norm(shape, axis=1), np.finfo(float).tiny)
        best = int(np.argmax(np.abs(shape @ piece / size)))
        centre, half = np.log([B.ravel()[best], f.ravel()[best]]), (high - low) / 8
        low, high = np.maximum(centre - half, low), np.minimum(centre + half, high)
    A = shape[[best]] @ piece / size[best] ** 2
    return DecayingModes(f.ravel()[[best]], B.ravel()[[best]], np.abs(A), np.where(A >= 0, -0.5, 0.5) * np.pi)


def fit_published(pieces: Sequence[Samples], resolution: float) -> list[PronyFilter]:
    """Fit each segment by Prony's method as published: from order = number of extrema upwards.

    Some of these filters are unstable; they are for comparison and are not rendered.
    """
    padded = [np.pad(piece, (0, max(0, 2 - piece.size))) for piece in pieces]
    return [
        fit_prony(piece, resolution, least_order=min(max(n_extrema(piece), 1), piece.size - 1))
        for piece in padded
    ]


def _bounded(modes: DecayingModes, x: Samples, fs: float) -> DecayingModes:
    """Return the modes, those that decay too slowly made faster, all amplitudes then fitted again."""
    if not modes.n_modes or modes.decay_per_s.min() >= _least_decay():
        return modes
    f, B = modes.frequency_hz, np.maximum(modes.decay_per_s, _least_decay())
    t = np.arange(x.size)[:, np.newaxis] / fs
    s = np.exp((-B + 2j * np.pi * f) * t)
    turning = (f > 0) & (f < fs / 2)
    c = np.linalg.lstsq(np.hstack([s.real, -s.imag[:, turning]]), x, rcond=1e-9)[0]
    amplitude = c[: f.size].astype(np.complex128)
    amplitude[turning] += 1j * c[f.size :]
    return DecayingModes(f, B, np.abs(amplitude), np.angle(amplitude))


def _least_decay() -> float:
    return float(np.log(1000) / RING_S)


def _ring_samples(fs: float) -> int:
    """Three times `RING_S`: 180 dB."""
    return int(3 * RING_S * fs)
