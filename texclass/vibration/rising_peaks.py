"""Segmentation of a stroke into decaying segments, and the frequency band of a vibration.

The methods are those of `guruswamy2011`, section IV. Each element of a surface that the tool passes excites a
decaying vibration. A segment begins where the vibration grows and lasts while it decays, so that one decaying
filter can model it.
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
"""Relative rise over the previous peak that begins a segment: alpha of `guruswamy2011`, section IV-B."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Consecutive segments that cover the whole signal.

    Attributes
    ----------
    bounds : ndarray of shape (n_segments + 1,)
        Segment i contains the samples bounds[i] ... bounds[i + 1] - 1. The first bound is 0, and the last is
        n_samples.
    n_peaks : ndarray of shape (n_segments,)
        Number of maxima of the magnitude in each segment. It can only be 0 if the whole signal has no
        maximum.

    Examples
    --------
    >>> segmentation = Segmentation(bounds=np.array([0, 3, 5]), n_peaks=np.array([1, 1]))
    >>> segmentation.n_segments, segmentation.split([4, 2, 1, 5, 3])
    (2, [array([4., 2., 1.]), array([5., 3.])])
    """

    bounds: Indices
    n_peaks: Indices

    @property
    def n_segments(self) -> int:
        """Number of segments."""
        return int(self.n_peaks.size)

    def split(self, x: ArrayLike) -> list[Samples]:
        """Split a signal of n_samples samples at the bounds, and return a view of each segment."""
        return np.split(np.asarray(x, dtype=np.float64), self.bounds[1:-1])


@dataclass(frozen=True)
class VibrationBand:
    """Major frequency and upper cut-off frequency of a vibration; returned by `vibration_band`.

    Attributes
    ----------
    major_hz : float
        Frequency of the highest peak of the smoothed power spectrum, in Hz.
    upper_hz : float
        Cut-off frequency in Hz; the power above it is negligible.

    Examples
    --------
    >>> band = VibrationBand(major_hz=80.0, upper_hz=140.0)
    >>> band.upper_hz
    140.0
    """

    major_hz: float
    upper_hz: float


def segment_rising_peaks(
    x: ArrayLike, dead_band: float, *, threshold: float = THRESHOLD, decay: float = 0.05
) -> Segmentation:
    """Split a signal before each peak of its magnitude that is much larger than the previous peak.

    Of two neighbouring peaks p and q, q begins a segment if it exceeds p by more than the dead band and by
    more than a fraction of p. This fraction decreases with the number j of peaks in the segment::

        |q| - |p| > d,    |q| - |p| > err(j) |p|,    err(j) = alpha exp(-beta j)

    The segment begins at the minimum of the magnitude between the two peaks.

    Parameters
    ----------
    x : array_like of shape (n_samples,)
        Zero-mean (band-passed) signal of at least 1 sample, in any unit.
    dead_band : float
        Dead band d, at least 0, in the unit of `x`. The paper uses two bits of its sensor, 0.3066 m/s^2.
    threshold : float
        Factor alpha, at least 0 (default 1.0, as published). With 0, only the dead band is used.
    decay : float
        Decay beta per peak, at least 0 (default 0.05, as published).

    Returns
    -------
    Segmentation
        Segments of the signal; one segment for silence.

    Raises
    ------
    ValueError
        If the signal is empty, has more than one channel, or contains NaN or infinity, or if a parameter is
        negative.

    Notes
    -----
    The printed condition is |q| > err(j) |p|. With alpha = 1 and beta = 0.05, it follows from |q| > |p| + d
    and would have no effect. According to the text, the threshold keeps a low first peak in the same segment
    as the next peaks, and segments become too long if the threshold does not decay. Both statements are true
    if the threshold applies to the relative *rise*. A plateau counts as one peak. The first or last sample is
    a peak if its neighbour is smaller.

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
            f"dead_band, threshold and decay must not be negative, got {dead_band}, {threshold} and {decay}"
        )
    magnitude = np.abs(samples)
    peaks = signal.find_peaks(np.pad(magnitude, 1), plateau_size=1)[1]["right_edges"] - 1
    height = magnitude[peaks]
    rise = np.diff(height)
    first_peaks = [0]  # index of the first peak of each segment
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
    """Return the major frequency and the upper cut-off frequency of a power spectrum.

    The cut-off is the lowest of the given frequencies that satisfies both conditions, where Y is the smoothed
    spectrum::

        sum_(f <= f_upper) Y / sum Y > share,    Y(f) < floor Y(f_major)  for all f > f_upper

    Parameters
    ----------
    frequency_hz : array_like of shape (n_bins,)
        Frequencies in Hz, evenly spaced and increasing. The first is the lower limit of the band (0.122 Hz in
        the paper).
    power : array_like of shape (n_bins,)
        Power (density) at these frequencies, not negative, not all 0, in any unit.
    smoothing_hz : float
        Standard deviation in Hz of the Gaussian that smooths the spectrum, at least 0.
    share : float
        Fraction of the total power below the cut-off (default 0.75, as published).
    floor : float
        Fraction of the largest smoothed power. The power above the cut-off is smaller (default 0.1, as
        published).

    Returns
    -------
    VibrationBand

    Raises
    ------
    ValueError
        If the shapes differ, there are fewer than 2 bins, a power is negative, NaN or infinite, all powers
        are 0, or the smoothing is negative.

    Notes
    -----
    Eqs. (6) and (7) contain abs(Y(f)). Y is taken as the power spectrum, because the text of the paper states
    both conditions in terms of power and defines the major frequency as the peak of the power spectrum.

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
        raise ValueError(
            f"power must contain one value per frequency, not negative and not all 0, got {P} at {f} Hz"
        )
    if not smoothing_hz >= 0:
        raise ValueError(f"smoothing_hz must not be negative, got {smoothing_hz} Hz")
    Y = ndimage.gaussian_filter1d(P, smoothing_hz / (f[1] - f[0])) if smoothing_hz > 0 else P
    cumulative = np.cumsum(Y)
    share_bin = int(np.argmax(cumulative > share * cumulative[-1]))
    floor_bin = int(np.flatnonzero(floor * Y.max() <= Y)[-1])
    return VibrationBand(float(f[np.argmax(Y)]), float(f[max(share_bin, floor_bin)]))
