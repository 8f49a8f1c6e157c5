"""Fineness: where the energy lies in frequency [strese2015, sections IV-B, IV-D], and how close ribs are."""

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
    """How ridges are found in the spectrum of a movement over its way.

    Attributes
    ----------
    frame_m, least_frames
        Length of a frame in m, and how many, half overlapping, a movement must hold: with fewer of them,
        noise has peaks as high as ridges have.
    lowest_per_mm, highest_per_mm, end_per_mm
        Spatial frequencies that are tried, in 1/mm (20 to 0.33 mm apart), and the highest of their harmonics.
    step, smoothing, around
        Natural logarithm of a ratio of spatial frequencies: from one that is tried to the next; within which
        power is averaged; and the deviation of the window above which a line stands out.
    weights
        Of the harmonics, the first one first.
    floor
        Power below this share of the mean is rounding.
    """

    frame_m: float = 0.1024
    least_frames: int = 3
    lowest_per_mm: float = 0.05
    highest_per_mm: float = 3.0
    end_per_mm: float = 10.0
    step: float = 0.01
    smoothing: float = 0.03
    around: float = 0.3
    weights: tuple[float, ...] = (1.0, 0.6, 0.6**2, 0.6**3, 0.6**4)
    floor: float = 1e-9


@feature("movement", "DCT bin", "strese2015, eq. 2 and section IV-D.3", depends_on=("rate",))
def fineness_as_printed(view: PhaseView, *, length: int = 4096) -> float:
    """Spectral centroid of DCT frames, SC = sum k |I(k)|^2 / sum |I(k)|^2, k = 1 ... m/2; mean over frames.

    Bin k of a DCT-II of m samples lies at k fs/(2m), so the printed sum stops at fs/4.

    Parameters
    ----------
    view : PhaseView
        Movement.
    length : int
        m; consecutive frames of m samples, one zero-padded frame if the movement is shorter.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 64 samples, or no energy in these bins.
    """
    require(view, 64, "a spectrum")
    x = unit32(view)
    frames = x[: x.size // length * length].reshape(-1, length) if x.size >= length else x[np.newaxis]
    return float(np.mean(printed_centroids(frames, length)))


def printed_centroids(frames: NDArray[Any], length: int) -> Samples:
    """Return eq. 2 of every frame that has energy in the bins 1 ... m/2.

    Parameters
    ----------
    frames : ndarray of shape (n_frames, n)
        Cut or zero-padded to m.
    length : int
        m.

    Returns
    -------
    ndarray of shape (at most n_frames,), in bins

    Raises
    ------
    UndefinedFeatureError
        If no frame has.
    """
    energy = fft.dct(frames, n=length, axis=1)[:, 1 : length // 2 + 1] ** 2
    total = energy.sum(axis=1, dtype=np.float64)
    heard = total > 0
    undefined_if(not heard.any(), f"silence: no energy in the DCT bins 1 ... {length // 2}")
    k = np.arange(1, length // 2 + 1, dtype=energy.dtype)
    return np.asarray((energy @ k)[heard] / total[heard])


@feature("movement", "Hz", "strese2015, eq. 2, corrected")
def fineness(view: PhaseView) -> float:
    """Spectral centroid in Hz over the full band, mean over frames.

    sum f P(f) / sum P(f) of the power spectrum of each Hann frame (0.41 s, half overlapping).

    Raises
    ------
    UndefinedFeatureError
        For silence or fewer than 64 samples.
    """
    centroid, _ = spectral_moments(view)
    return float(centroid.mean())


@feature("movement", "Hz", "strese2015, eq. 2, corrected")
def fineness_spread(view: PhaseView) -> float:
    """Deviation of frequency around the spectral centroid in Hz: narrow for a grating, wide for sandpaper.

    sqrt(sum (f - SC)^2 P / sum P) of the power spectrum of each frame, mean over frames.

    Raises
    ------
    UndefinedFeatureError
        For silence or fewer than 64 samples.
    """
    _, deviation = spectral_moments(view)
    return float(deviation.mean())


@feature("movement", "Hz", "texclass")
def grain_frequency(view: PhaseView, *, low_hz: float = 15.0, high_hz: float = 150.0) -> float:
    """Geometric mean frequency of the velocity from 15 to 150 Hz: high where ribs and grains stand close.

    exp(sum V ln f / sum V), V = P(f) / f^2 of the power spectrum of each Hann frame (0.41 s, half
    overlapping); median over frames. At the 110 mm/s of a usual stroke the band is ribs 7 to 0.7 mm apart.
    It rises with the speed of the hand, too.

    Parameters
    ----------
    view : PhaseView
        Movement.
    low_hz, high_hz : float
        The band, in Hz: above the hand, below most resonances of tool and surface.

    Raises
    ------
    UndefinedFeatureError
        If fs/2 is not above the band, a frame does not hold three periods of its lower end, or all are
        silent.
    """
    undefined_if(view.fs / 2 <= high_hz, f"fs is {view.fs:g} Hz. Expected above {2 * high_hz:g} Hz")
    require(view, max(64, round(3 * view.fs / low_hz)), f"three periods of {low_hz:g} Hz")
    power, f = long_frames(view)
    band = (f >= low_hz) & (f < high_hz)
    v, f = power[:, band] / f[band] ** 2, f[band]
    v = v[v.sum(axis=1) > 0]
    undefined_if(not len(v), f"silence from {low_hz:g} to {high_hz:g} Hz")
    return float(np.exp(np.median(v @ np.log(f) / v.sum(axis=1))))


# Ribs: what repeats along the way of the tool, where the speed of the tool was recorded --------------------


@feature("travel", "1/mm", "texclass, by subharmonic summation (Hermes, J. Acoust. Soc. Am. 83, 1988)")
def ridge_density(view: PhaseView, *, least_db: float = 3.3) -> float:
    """Ribs per mm: the spatial frequency whose harmonics stand out most, at any speed of the hand.

    With P(k) the power spectrum over the way of the tool (mean over half-overlapping Hann frames of 0.1024 m,
    each divided by its power; averaged over 3 % of k to both sides), and D(k) = 10 lg P(k) less what is
    around it (Gaussian, deviation 0.3 in ln k), the answer is the k from 0.05 to 3 per mm with the largest

        H(k) = sum_h 0.6^(h-1) D(h k) / sum_h 0.6^(h-1),   h = 1 ... 5,

    found to 1 %. While the hand keeps one speed, nothing tells a hum from ribs. Of simulated surfaces without
    ribs, explored for 6 s, H passes 3.3 dB in one recording of eleven.

    Parameters
    ----------
    view : PhaseView
        Movement over the way of the tool; of an array, `fs` is in samples per m.
    least_db : float
        What H has to reach, in dB: less is no ribs.

    Raises
    ------
    UndefinedFeatureError
        If nothing stands out so far, the way is shorter than three frames (0.2048 m), samples lie more than
        0.5 mm apart, or for silence.
    """
    k, height = comb(view)
    best = int(np.argmax(ndimage.gaussian_filter1d(height, 1)))  # the middle of a flat top
    undefined_if(
        height[best] < least_db,
        f"no ribs: what repeats stands out by {height[best]:.1f} dB. Expected at least {least_db:g} dB",
    )
    return float(k[best])


@feature("travel", "dB", "texclass, by subharmonic summation (Hermes, J. Acoust. Soc. Am. 83, 1988)")
def ridge_prominence(view: PhaseView) -> float:
    """How far what repeats along the way stands out of the spectrum: H of `ridge_density`, in dB.

    About 2.5 for a few strokes over noise, less for many; 10 and more for a grating.

    Raises
    ------
    UndefinedFeatureError
        If the way is shorter than three frames (0.2048 m), samples lie more than 0.5 mm apart, or for
        silence.
    """
    return float(comb(view)[1].max())


@transform
def comb(view: PhaseView, search: RidgeSearch = RidgeSearch()) -> tuple[Samples, Samples]:
    """Return spatial frequencies k (1/mm) and H(k) of `ridge_density` (dB), both of shape (n,)."""
    least = round((search.least_frames + 1) / 2 * search.frame_m * view.fs)
    require(view, least, f"three frames of {search.frame_m:g} m")
    end = min(search.end_per_mm, view.fs / 2000)
    undefined_if(end < 1, f"samples every {1e3 / view.fs:.3g} mm of the way. Expected at most 0.5 mm")
    k = np.exp(np.arange(np.log(search.lowest_per_mm), np.log(end), search.step))
    level = 10 * np.log10(_spectrum(view, k, search))
    above = level - ndimage.gaussian_filter1d(level, search.around / search.step, mode="nearest")
    height = np.zeros(int(np.searchsorted(k, search.highest_per_mm)))
    for h, weight in enumerate(np.divide(search.weights, sum(search.weights)), 1):
        line = above[round(np.log(h) / search.step) :][: height.size]
        height[: line.size] += weight * line
    return k[: height.size], height


def _spectrum(view: PhaseView, k: Samples, search: RidgeSearch) -> Samples:
    """Return P of `ridge_density` at k (1/mm), shape (n,)."""
    frame_m = search.frame_m
    frames, per_m = power_frames(view, frame_m, frame_m / 2, "hann", 1e3 * search.end_per_mm)
    of_frame = frames.sum(axis=1, dtype=np.float64, keepdims=True)
    power = (frames / np.where(of_frame > 0, of_frame, 1)).mean(axis=0, dtype=np.float64)
    power += search.floor * power.mean()
    integral = np.concatenate([[0], np.cumsum(power)])  # up to the lower edge of each bin
    edge = (np.arange(integral.size) - 0.5) * per_m[1]
    f, half, ratio = 1e3 * k, per_m[1] / 2, np.exp(search.smoothing)
    low, high = np.minimum(f / ratio, f - half), np.maximum(f * ratio, f + half)
    return np.asarray((np.interp(high, edge, integral) - np.interp(low, edge, integral)) / (high - low))
