"""Fineness of a surface: spectral centroid and spread [strese2015, sections IV-B and IV-D], and ridges."""

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
        Length of a frame in m, and minimum number of half-overlapping frames. With fewer frames, peaks of
        noise are as high as peaks of ridges.
    lowest_per_mm, highest_per_mm, end_per_mm
        Lowest and highest spatial frequency of the search in 1/mm (periods of 20 to 0.33 mm), and highest
        frequency of a harmonic in 1/mm.
    step, smoothing, background
        Distances in the natural logarithm of the spatial frequency: step of the search, half-width of the
        moving average of the power, and standard deviation of the Gaussian that estimates the background.
    weights
        Weights of the harmonics, starting with the fundamental.
    floor
        Power that is added to every bin, relative to the mean power, so that logarithms are finite.
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

    SC = sum k |I(k)|^2 / sum |I(k)|^2, k = 1 ... m/2, averaged over frames. Bin k of a DCT-II of m samples
    has the frequency k fs/(2m), so the printed sum ends at fs/4.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    length : int
        Length m of the adjacent frames in samples (default 4096). A shorter movement is one zero-padded
        frame.

    Returns
    -------
    float
        Centroid in DCT bins.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent, has fewer than 64 samples, or has no energy in the bins 1 ... m/2.

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
    """Return the centroid of eq. 2 for every frame that has energy in the bins 1 ... m/2.

    Parameters
    ----------
    frames : ndarray of shape (n_frames, n)
        Frames. They are truncated or zero-padded to m samples.
    length : int
        Length m of the DCT in samples.

    Returns
    -------
    ndarray of shape (at most n_frames,)
        Centroids in bins.

    Raises
    ------
    UndefinedFeatureError
        If no frame has energy in the bins 1 ... m/2.
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

    The centroid sum f P(f) / sum P(f) of the power spectrum of each Hann frame (0.41 s, half-overlapping) is
    averaged over frames.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.

    Returns
    -------
    float
        Centroid in Hz.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 64 samples.

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
    """Return the spectral spread: the standard deviation of frequency around the centroid SC, in Hz.

    The spread sqrt(sum (f - SC)^2 P / sum P) of the power spectrum of each frame is averaged over frames. It
    is small for a grating and large for sandpaper.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.

    Returns
    -------
    float
        Spread in Hz.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 64 samples.

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
    """Return the geometric mean frequency of the velocity spectrum from 15 to 150 Hz.

    The value is high for closely spaced ridges and grains, but it also rises with the speed of the hand. It
    is exp(sum V ln f / sum V), where V = P(f) / f^2 and P is the power spectrum of a Hann frame (0.41 s,
    half-overlapping). The median over frames is returned. At 110 mm/s, a typical speed of a stroke, the band
    corresponds to ridges 7 to 0.7 mm apart.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    low_hz, high_hz : float
        Band in Hz (default 15 to 150), above hand motion and below most resonances of tool and surface.

    Returns
    -------
    float
        Frequency in Hz.

    Raises
    ------
    UndefinedFeatureError
        If fs/2 is not above `high_hz`, the movement is shorter than three periods of `low_hz`, or all frames
        are silent in the band.

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
    undefined_if(view.fs / 2 <= high_hz, f"fs is {view.fs:g} Hz. Expected more than {2 * high_hz:g} Hz")
    require(view, max(64, round(3 * view.fs / low_hz)), f"three periods of {low_hz:g} Hz")
    power, f = long_frames(view)
    band = (f >= low_hz) & (f < high_hz)
    v, f = power[:, band] / f[band] ** 2, f[band]
    v = v[v.sum(axis=1) > 0]
    undefined_if(not len(v), f"silence from {low_hz:g} to {high_hz:g} Hz")
    return float(np.exp(np.median(v @ np.log(f) / v.sum(axis=1))))


# Ridges: periodic structure along the path of the tool. Requires a recording with the speed of the tool.
# -----


@feature("travel", "1/mm", "texclass, by subharmonic summation (Hermes, J. Acoust. Soc. Am. 83, 1988)")
def ridge_density(view: PhaseView, *, threshold_db: float = 3.3) -> float:
    """Return the number of ridges per mm: the spatial frequency with the most prominent harmonics.

    The value does not depend on the speed of the hand. It is computed in three steps:

    1. P(k) is the power spectrum over the path of the tool. It is averaged over half-overlapping Hann frames
       of 0.1024 m, each normalised by its power, and over frequencies within 3 % of k.
    2. D(k) is 10 log10 P(k) minus the background level, a Gaussian average with standard deviation 0.3 in ln
       k.
    3. The result is the k between 0.05 and 3 per mm with the largest prominence H, with a resolution of 1 %::

        H(k) = sum_h 0.6^(h-1) D(h k) / sum_h 0.6^(h-1),   h = 1 ... 5

    If the speed is constant, a hum cannot be distinguished from ridges. For simulated surfaces without ridges
    that are explored for 6 s, H exceeds 3.3 dB in one of eleven recordings.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement over the path of the tool. For an array, also pass `fs` in samples per m.
    threshold_db : float
        Smallest prominence H in dB at which ridges are reported (default 3.3).

    Returns
    -------
    float
        Ridges per mm.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent, no H reaches the threshold, the path is shorter than three frames (0.2048
        m), or samples are more than 0.5 mm apart.

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

    For surfaces without ridges, the prominence is about 2.5 dB after a few strokes and lower after many
    strokes. For a grating it is at least 10 dB.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement over the path of the tool. For an array, also pass `fs` in samples per m.

    Returns
    -------
    float
        Prominence in dB.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent, the path is shorter than three frames (0.2048 m), or samples are more than
        0.5 mm apart.

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
    """Return the spatial frequencies k (1/mm) and the prominence H(k) in dB, both of shape (n,).

    See `ridge_density` for the definition.
    """
    n_min = round((search.min_frames + 1) / 2 * search.frame_m * view.fs)
    require(view, n_min, f"three frames of {search.frame_m:g} m")
    end = min(search.end_per_mm, view.fs / 2000)
    undefined_if(end < 1, f"samples are {1e3 / view.fs:.3g} mm apart. Expected at most 0.5 mm")
    k = np.exp(np.arange(np.log(search.lowest_per_mm), np.log(end), search.step))
    level = 10 * np.log10(_spectrum(view, k, search))
    above = level - ndimage.gaussian_filter1d(level, search.background / search.step, mode="nearest")
    height = np.zeros(int(np.searchsorted(k, search.highest_per_mm)))
    for h, weight in enumerate(np.divide(search.weights, sum(search.weights)), 1):
        line = above[round(np.log(h) / search.step) :][: height.size]
        height[: line.size] += weight * line
    return k[: height.size], height


def _spectrum(view: PhaseView, k: Samples, search: RidgeSearch) -> Samples:
    """Return the power spectrum P of `ridge_density` at k (1/mm), shape (n,)."""
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
