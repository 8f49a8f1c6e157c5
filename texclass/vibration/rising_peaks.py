"""A stroke cut into decaying pieces, and the band that holds it, as [guruswamy2011, section IV] does it.

The passage over each feature of a surface makes the tool ring: a segment begins where the vibration grows and
lasts while it decays, so that one decaying filter can stand for it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, signal

from texclass.recording import Samples
from texclass.signals import one_channel, to_unit_scale

Indices = NDArray[np.int64]

THRESHOLD = 1.0
"""alpha of `guruswamy2011`, section IV-B: the rise over the peak before that begins a segment."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Consecutive segments that together are the whole signal.

    Attributes
    ----------
    bounds : ndarray of shape (n_segments + 1,)
        Segment i holds the samples bounds[i] ... bounds[i + 1] - 1; the first bound is 0, the last n_samples.
    n_peaks : ndarray of shape (n_segments,)
        Maxima of the magnitude in each; 0 only for a signal without any.
    """

    bounds: Indices
    n_peaks: Indices

    @property
    def n_segments(self) -> int:
        """How many segments there are."""
        return int(self.n_peaks.size)

    def pieces(self, x: ArrayLike) -> list[Samples]:
        """Return the segments of a signal of that length, as views of it."""
        return np.split(np.asarray(x, dtype=np.float64), self.bounds[1:-1])


@dataclass(frozen=True)
class VibrationBand:
    """Where a vibration lies in frequency.

    Attributes
    ----------
    major_hz : float
        Frequency of the highest peak of the smoothed power spectrum.
    upper_hz : float
        Cut-off above which nothing worth keeping lies.
    """

    major_hz: float
    upper_hz: float


def segment_rising_peaks(
    x: ArrayLike, dead_band: float, *, threshold: float = THRESHOLD, decay: float = 0.05
) -> Segmentation:
    """Cut a signal where a peak of its magnitude is larger than the one before.

    Of two neighbouring peaks p and q, q begins a segment if it rises by more than the dead band and by more
    than a part of p, which falls with the number j of peaks that the segment already has::

        |q| - |p| > d,    |q| - |p| > err(j) |p|,    err(j) = alpha exp(-beta j)

    It begins at the minimum of the magnitude between the two.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Zero-centred (band-passed) signal, at least 1 sample. Any unit.
    dead_band : float
        d, at least 0, in the unit of `x`; the paper's is two bits of the sensor, 0.3066 m/s^2.
    threshold : float
        alpha, at least 0 (default 1.0, as published). With 0 the dead band decides alone.
    decay : float
        beta per peak, at least 0 (default 0.05, as published).

    Returns
    -------
    Segmentation
        One segment for silence.

    Raises
    ------
    ValueError
        For an empty signal, more than one channel, NaN or infinity, or a parameter below 0.

    Notes
    -----
    Printed is |q| > err(j) |p|; with alpha = 1 and beta = 0.05 that is never stricter than |q| > |p| + d and
    would change nothing. The threshold is said to keep a too low first peak in one segment with what follows
    and to make segments overly long when it does not decay: a relative *rise* does both. A plateau is one
    peak, and the ends of the signal count as peaks if the magnitude falls from there.

    References
    ----------
    `guruswamy2011`, section IV-B.

    Examples
    --------
    >>> t = np.arange(100)
    >>> ring = np.exp(-0.03 * t) * np.sin(0.5 * t)
    >>> segment_rising_peaks(np.tile(ring, 3), dead_band=0.1).bounds
    array([  0, 100, 200, 300])
    """
    samples = one_channel(x, "signal", at_least=1)
    if not (dead_band >= 0 and threshold >= 0 and decay >= 0):
        raise ValueError(
            f"dead band, threshold, decay are {dead_band}, {threshold}, {decay}. Expected all at least 0"
        )
    magnitude = np.abs(samples)
    peaks = signal.find_peaks(np.pad(magnitude, 1), plateau_size=1)[1]["right_edges"] - 1
    height = magnitude[peaks]
    rise = np.diff(height)
    first_peaks = [0]  # of each segment
    for i in np.flatnonzero(rise > dead_band).tolist():
        j = i + 1 - first_peaks[-1]
        if rise[i] > threshold * math.exp(-decay * j) * height[i]:
            first_peaks.append(i + 1)
    minima = [peaks[i - 1] + np.argmin(magnitude[peaks[i - 1] : peaks[i]]) for i in first_peaks[1:]]
    bounds = np.array([0, *minima, samples.size])
    return Segmentation(bounds, np.diff(first_peaks, append=peaks.size))


def vibration_band(
    frequency_hz: ArrayLike,
    power: ArrayLike,
    *,
    smoothing_hz: float,
    share: float = 0.75,
    floor: float = 0.1,
) -> VibrationBand:
    """Return the major frequency of a power spectrum and its automatic upper cut-off.

    With Y the smoothed spectrum, the cut-off is the lowest frequency of the grid with both ::

        sum_(f <= f_upper) Y / sum Y > share,    Y(f) < floor Y(f_major)  for all f > f_upper

    Parameters
    ----------
    frequency_hz : array_like of shape (n_bins,)
        Evenly spaced, rising. Where it begins is the lower limit of the band (0.122 Hz in the paper).
    power : array_like of shape (n_bins,)
        Power (density) at these frequencies, not negative, not all 0. Any unit.
    smoothing_hz : float
        Standard deviation of the Gaussian that low-passes the spectrum, at least 0.
    share : float
        Part of the whole power (default 0.75, as published).
    floor : float
        Part of the highest power (default 0.1, as published).

    Returns
    -------
    VibrationBand

    Raises
    ------
    ValueError
        If the shapes differ, there are fewer than 2 bins, a power is negative, NaN or infinite, all are 0, or
        the smoothing is negative.

    Notes
    -----
    Y is read as the power spectrum: the text speaks of power in both conditions and of the peak of the power
    spectrum, where eq. (6) and (7) print abs(Y(f)).

    References
    ----------
    `guruswamy2011`, section IV-C, eq. (6) and (7).

    Examples
    --------
    >>> f = np.arange(500.0)
    >>> band = vibration_band(f, 1 / ((f - 80) ** 2 + 400), smoothing_hz=3.0)
    >>> band.major_hz, band.upper_hz
    (80.0, 140.0)
    """
    f = one_channel(frequency_hz, "frequency", at_least=2)
    P, _ = to_unit_scale(one_channel(power, "power", at_least=2))
    if f.shape != P.shape or np.any(P < 0) or not np.any(P):
        raise ValueError(f"power is {P} at {f} Hz. Expected one for each frequency, >= 0 and not all 0")
    if not smoothing_hz >= 0:
        raise ValueError(f"smoothing is {smoothing_hz} Hz. Expected at least 0")
    Y = ndimage.gaussian_filter1d(P, smoothing_hz / (f[1] - f[0])) if smoothing_hz > 0 else P
    running = np.cumsum(Y)
    enough = int(np.argmax(running > share * running[-1]))
    high = int(np.flatnonzero(floor * Y.max() <= Y)[-1])
    return VibrationBand(float(f[np.argmax(Y)]), float(f[max(enough, high)]))
