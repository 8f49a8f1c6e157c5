"""Fineness: spectral centroid and spread [strese2015, sections IV-B and IV-D], and density of ridges."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from texclass.features.contract import feature
from texclass.features.movement_filters import require, unit32
from texclass.features.phase_view import PhaseView, transform, undefined_if
from texclass.features.spectra import long_frames, power_frames, spectral_moments
from texclass.recording import Samples


@dataclass(frozen=True, kw_only=True)
class RidgeSearch:
    """Settings of the search for ridges in the spectrum over the path of the tool.

    Attributes
    ----------
    frame_m, min_frames
        Length of a frame in m, and how many half-overlapping frames a movement needs: with fewer, peaks of
        noise are as high as those of ridges.
    lowest_per_mm, highest_per_mm, end_per_mm
        Spatial frequencies that are tried, in 1/mm (periods of 20 to 0.33 mm), and the highest frequency of
        their harmonics.
    step, smoothing, background
        Natural logarithms of ratios of spatial frequencies: between two that are tried; over which the power
        is averaged to both sides; and the standard deviation of the Gaussian that gives the background level.
    weights
        Weights of the harmonics, fundamental first.
    floor
        Smallest power relative to the mean; less is rounding error.
    """

    frame_m: float = 0.1024
    min_frames: int = 3
    lowest_per_mm: float = 0.05
    highest_per_mm: float = 3.0
    end_per_mm: float = 10.0
    step: float = 0.01
    smoothing: float = 0.03
    background: float = 0.3
    weights: tuple[float, ...] = (1.0, 0.6, 0.6**2, 0.6**3, 0.6**4)
    floor: float = 1e-9


@feature("movement", "DCT bin", "strese2015, eq. 2 and section IV-D.3", depends_on=("rate",))
def fineness_as_printed(view: PhaseView, *, length: int = 4096) -> float:
    """Return the spectral centroid of DCT frames as printed, in DCT bins.

    SC = sum k |I(k)|^2 / sum |I(k)|^2, k = 1 ... m/2; mean over frames. Bin k of a DCT-II of m samples is at
    k fs/(2m), so the printed sum stops at fs/4.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    length : int
        m (default 4096). Adjacent frames of m samples; one zero-padded frame if the movement is shorter.

    Returns
    -------
    float
        Centroid in DCT bins.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 64 samples, or no energy in these bins.

    References
    ----------
    `strese2015`, eq. 2 and section IV-D.3.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 500 * np.arange(40_960) / 10_000)
    >>> round(fineness_as_printed(x, fs=10_000))  # about 500 Hz * 2 * 4096 / fs
    409
    """
    require(view, 64, "a spectrum")
    x = unit32(view)
    frames = x[: x.size // length * length].reshape(-1, length) if x.size >= length else x[np.newaxis]
    return float(np.mean(printed_centroids(frames, length)))


def printed_centroids(frames: NDArray[Any], length: int) -> Samples:
    """Return eq. 2 for every frame that has energy in the bins 1 ... m/2.

    Parameters
    ----------
    frames : ndarray of shape (n_frames, n)
        Frames; cut or zero-padded to m samples.
    length : int
        m.

    Returns
    -------
    ndarray of shape (at most n_frames,)
        Centroids in bins.

    Raises
    ------
    UndefinedFeatureError
        If no frame has energy in these bins.
    """
    energy = fft.dct(frames, n=length, axis=1)[:, 1 : length // 2 + 1] ** 2
    total = energy.sum(axis=1, dtype=np.float64)
    is_audible = total > 0
    undefined_if(not is_audible.any(), f"silence: no energy in the DCT bins 1 ... {length // 2}")
    k = np.arange(1, length // 2 + 1, dtype=energy.dtype)
    return np.asarray((energy @ k)[is_audible] / total[is_audible])


@feature("movement", "Hz", "strese2015, eq. 2, corrected")
def fineness(view: PhaseView) -> float:
    """Return the spectral centroid over the full band, in Hz.

    sum f P(f) / sum P(f) of the power spectrum of each Hann frame (0.41 s, half-overlapping); mean over
    frames.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.

    Returns
    -------
    float
        Centroid in Hz.

    Raises
    ------
    UndefinedFeatureError
        For silence or fewer than 64 samples.

    References
    ----------
    `strese2015`, eq. 2, corrected.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 432 * np.arange(20_000) / 10_000)
    >>> round(fineness(x, fs=10_000))
    432
    """
    centroid, _ = spectral_moments(view)
    return float(centroid.mean())


@feature("movement", "Hz", "strese2015, eq. 2, corrected")
def fineness_spread(view: PhaseView) -> float:
    """Return the spectral spread, the standard deviation of frequency around the centroid, in Hz.

    sqrt(sum (f - SC)^2 P / sum P) of the power spectrum of each frame; mean over frames. It is small for a
    grating and large for sandpaper.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.

    Returns
    -------
    float
        Spread in Hz.

    Raises
    ------
    UndefinedFeatureError
        For silence or fewer than 64 samples.

    References
    ----------
    `strese2015`, eq. 2, corrected.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(40_960) / 10_000
    >>> round(fineness_spread(np.sin(2 * np.pi * 1000 * t) + np.sin(2 * np.pi * 3000 * t), fs=10_000))
    1000
    """
    _, deviation = spectral_moments(view)
    return float(deviation.mean())


@feature("movement", "Hz", "texclass")
def grain_frequency(view: PhaseView, *, low_hz: float = 15.0, high_hz: float = 150.0) -> float:
    """Return the geometric mean frequency of the velocity from 15 to 150 Hz.

    It is high for closely spaced ridges and grains.

    exp(sum V ln f / sum V), V = P(f) / f^2 of the power spectrum of each Hann frame (0.41 s,
    half-overlapping); median over frames. At 110 mm/s, a usual speed of a stroke, the band corresponds to
    ridges 7 to 0.7 mm apart. The value also rises with the speed of the hand.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    low_hz, high_hz : float
        Band in Hz: above hand motion, below most resonances of tool and surface.

    Returns
    -------
    float
        Frequency in Hz.

    Raises
    ------
    UndefinedFeatureError
        If fs/2 is not above the band, the movement is shorter than three periods of its lower end, or all
        frames are silent in the band.

    References
    ----------
    texclass.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 60 * np.arange(20_000) / 10_000)
    >>> round(grain_frequency(x, fs=10_000))
    60
    """
    undefined_if(view.fs / 2 <= high_hz, f"fs is {view.fs:g} Hz. Expected above {2 * high_hz:g} Hz")
    require(view, max(64, round(3 * view.fs / low_hz)), f"three periods of {low_hz:g} Hz")
    power, f = long_frames(view)
    band = (f >= low_hz) & (f < high_hz)
    v, f = power[:, band] / f[band] ** 2, f[band]
    v = v[v.sum(axis=1) > 0]
    undefined_if(not len(v), f"silence from {low_hz:g} to {high_hz:g} Hz")
    return float(np.exp(np.median(v @ np.log(f) / v.sum(axis=1))))


# Ridges: periodic structure along the path of the tool, if its speed was recorded --------------------------


@feature("travel", "1/mm", "texclass, by subharmonic summation (Hermes, J. Acoust. Soc. Am. 83, 1988)")
def ridge_density(view: PhaseView, *, threshold_db: float = 3.3) -> float:
    """Return the number of ridges per mm: the spatial frequency with the most prominent harmonics.

    It does not depend on the speed of the hand. P(k) is the power spectrum over the path of the tool: mean
    over half-overlapping Hann frames of 0.1024 m, each divided by its power, and averaged over 3 % of k to
    both sides. D(k) = 10 lg P(k) minus the level around it (Gaussian, standard deviation 0.3 in ln k). The
    result is the k from 0.05 to 3 per mm with the largest

        H(k) = sum_h 0.6^(h-1) D(h k) / sum_h 0.6^(h-1),   h = 1 ... 5,

    with a resolution of 1 %. While the speed is constant, a hum cannot be distinguished from ridges. For
    simulated surfaces without ridges, explored for 6 s, H exceeds 3.3 dB in one of eleven recordings.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement over the path of the tool; an array with `fs` in samples per m.
    threshold_db : float
        Smallest H in dB; below, there are no ridges.

    Returns
    -------
    float
        Ridges per mm.

    Raises
    ------
    UndefinedFeatureError
        If no H reaches the threshold, the path is shorter than three frames (0.2048 m), samples are more than
        0.5 mm apart, or for silence.

    References
    ----------
    Subharmonic summation: Hermes, "Measurement of pitch by subharmonic summation", J. Acoust. Soc. Am. 83,
    1988.

    Examples
    --------
    >>> import numpy as np
    >>> path_mm = np.arange(10_000) / 20  # 0.5 m, a sample every 0.05 mm
    >>> x = np.cos(2 * np.pi * 0.5 * path_mm) + 0.5 * np.random.default_rng(0).standard_normal(10_000)
    >>> round(ridge_density(x, fs=20_000), 2)  # one ridge every 2 mm
    0.5
    """
    k, height = harmonic_sum(view)
    peak = int(np.argmax(ndimage.gaussian_filter1d(height, 1)))  # the centre of a flat maximum
    undefined_if(
        height[peak] < threshold_db,
        f"no ridges: the largest prominence is {height[peak]:.1f} dB. Expected at least {threshold_db:g} dB",
    )
    return float(k[peak])


@feature("travel", "dB", "texclass, by subharmonic summation (Hermes, J. Acoust. Soc. Am. 83, 1988)")
def ridge_prominence(view: PhaseView) -> float:
    """Return the prominence of periodic structure along the path: the largest H of `ridge_density`, in dB.

    About 2.5 dB for a few strokes over noise, less for many; 10 dB and more for a grating.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement over the path of the tool; an array with `fs` in samples per m.

    Returns
    -------
    float
        Prominence in dB.

    Raises
    ------
    UndefinedFeatureError
        If the path is shorter than three frames (0.2048 m), samples are more than 0.5 mm apart, or for
        silence.

    References
    ----------
    Subharmonic summation: Hermes, "Measurement of pitch by subharmonic summation", J. Acoust. Soc. Am. 83,
    1988.

    Examples
    --------
    >>> import numpy as np
    >>> path_mm = np.arange(10_000) / 20
    >>> x = np.cos(2 * np.pi * 0.5 * path_mm) + 0.5 * np.random.default_rng(0).standard_normal(10_000)
    >>> ridge_prominence(x, fs=20_000) > 5
    True
    """
    return float(harmonic_sum(view)[1].max())


@transform
def harmonic_sum(view: PhaseView, search: RidgeSearch = RidgeSearch()) -> tuple[Samples, Samples]:
    """Return spatial frequencies k (1/mm) and H(k) of `ridge_density` (dB), both of shape (n,)."""
    n_min = round((search.min_frames + 1) / 2 * search.frame_m * view.fs)
    require(view, n_min, f"three frames of {search.frame_m:g} m")
    end = min(search.end_per_mm, view.fs / 2000)
    undefined_if(end < 1, f"samples every {1e3 / view.fs:.3g} mm of the path. Expected at most 0.5 mm")
    k = np.exp(np.arange(np.log(search.lowest_per_mm), np.log(end), search.step))
    level = 10 * np.log10(_spectrum(view, k, search))
    above = level - ndimage.gaussian_filter1d(level, search.background / search.step, mode="nearest")
    height = np.zeros(int(np.searchsorted(k, search.highest_per_mm)))
    for h, weight in enumerate(np.divide(search.weights, sum(search.weights)), 1):
        line = above[round(np.log(h) / search.step) :][: height.size]
        height[: line.size] += weight * line
    return k[: height.size], height


def _spectrum(view: PhaseView, k: Samples, search: RidgeSearch) -> Samples:
    """Return P of `ridge_density` at k (1/mm), shape (n,)."""
    frame_m = search.frame_m
    frames, per_m = power_frames(view, frame_m, frame_m / 2, "hann", 1e3 * search.end_per_mm)
    frame_power = frames.sum(axis=1, dtype=np.float64, keepdims=True)
    power = (frames / np.where(frame_power > 0, frame_power, 1)).mean(axis=0, dtype=np.float64)
    power += search.floor * power.mean()
    integral = np.concatenate([[0], np.cumsum(power)])  # up to the lower edge of each bin
    edge = (np.arange(integral.size) - 0.5) * per_m[1]
    f, half, ratio = 1e3 * k, per_m[1] / 2, np.exp(search.smoothing)
    low, high = np.minimum(f / ratio, f - half), np.maximum(f * ratio, f + half)
    return np.asarray((np.interp(high, edge, integral) - np.interp(low, edge, integral)) / (high - low))
