"""Roughness, macroscopic and microscopic: what a movement feels like in time and in frequency.

Waviness, spikiness and regularity of what lies below 100 Hz [strese2015, section IV-D]; roughness in time and
in frequency above [section IV-C].
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.contract import Gain, feature
from texclass.features.movement_filters import (
    band_limited,
    band_passed,
    detail_band,
    level,
    log10_of,
    low_passed,
    n_of,
    require,
)
from texclass.features.phase_view import PhaseView, transform, undefined_if
from texclass.features.spectra import (
    autocorrelation,
    evenly_spaced,
    frames_of,
    magnitudes,
    mean_square,
    spectral_changes,
)
from texclass.recording import Samples
from texclass.signals import moving_average

BLOCK_PAIRS = 32
"""Pairs of frames transformed at a time: larger arrays would be new memory each time."""
PERIOD = 3
"""Samples in a period of the upper end of the fine band: a rate that holds the magnitudes of both."""


@feature("movement", "log10(m/s^2)", "strese2015, eq. 5", gain=Gain(shift=1), depends_on=("rate",))
def waviness_as_printed(
    view: PhaseView, *, cutoff_hz: float = 100.0, frame: int = 200, average: int = 100
) -> float:
    """How much the level of the low frequencies varies, WV = log10 sigma(m - s_100), frames in samples.

    m is the mean magnitude of each frame of the low-passed movement, and s_100 the moving average *of m* over
    100 frames (of x, as printed, the lengths would not match).

    Parameters
    ----------
    view : PhaseView
        Movement.
    cutoff_hz : float
        Of the low-pass, in Hz.
    frame : int
        Samples per frame.
    average : int
        Frames per moving average; at the ends it takes the frames there are.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than two frames, fs/2 not above the cut-off, or frames of one and the same level.
    """
    return _waviness(view, *low_passed(view, cutoff_hz), frame, average)


@feature("movement", "log10(m/s^2)", "strese2015, eq. 5, corrected", gain=Gain(shift=1))
def waviness(
    view: PhaseView, *, cutoff_hz: float = 100.0, frame_s: float = 0.02, average_s: float = 2.0
) -> float:
    """How much the level of the low frequencies varies: `waviness_as_printed` with frames in seconds.

    The defaults are the printed 200 and 100 x 200 samples at the paper's 10 kHz.

    Parameters
    ----------
    view : PhaseView
        Movement.
    cutoff_hz : float
        Of the low-pass, in Hz.
    frame_s, average_s : float
        Length of a frame and of the moving average, in s.

    Raises
    ------
    UndefinedFeatureError
        As `waviness_as_printed`.
    """
    slow, factor = low_passed(view, cutoff_hz, shared=True)
    return _waviness(view, slow, factor, n_of(view, frame_s), max(1, round(average_s / frame_s)))


def _waviness(view: PhaseView, slow: Samples, factor: int, frame: int, average: int) -> float:
    require(view, 2 * frame, f"two frames of {frame} samples")
    edges = np.arange(0, view.n_samples + 1, frame) // factor
    m = np.add.reduceat(np.abs(slow[: edges[-1]]), edges[:-1]) / (edges[1:] - edges[:-1])
    sigma = float(np.std(m - moving_average(m, average)))
    return log10_of(sigma, "the deviation of the frames' levels") + float(np.log10(level(view)))


@feature("movement", "log10(m/s^2)", "strese2015, eq. 6", gain=Gain(shift=1), depends_on=("rate", "sign"))
def spikiness_as_printed(view: PhaseView, *, cutoff_hz: float = 100.0, average: int = 5000) -> float:
    """Mean excess over a moving threshold, SP = log10 mean(max(x - x_th, 0)), average in samples.

    x is the low-passed movement and x_th = 2 sigma(x) + mean(x) + the moving average of x over 5000 samples.
    Spikes count on the positive side alone. At the ends the average takes the samples there are, and the
    low-pass what lies beyond as 0; on one second, other rules for the ends give other values.

    Parameters
    ----------
    view : PhaseView
        Movement.
    cutoff_hz : float
        Of the low-pass, in Hz.
    average : int
        Samples per moving average.

    Raises
    ------
    UndefinedFeatureError
        For silence, fs/2 not above the cut-off, or no sample above the threshold (log10 of 0).
    """
    excess, _ = _excess(*low_passed(view, cutoff_hz), average)
    return log10_of(excess, "the mean excess over the spike threshold") + float(np.log10(level(view)))


@feature("movement", "log10(m/s^2)", "strese2015, eq. 6, corrected", gain=Gain(shift=1), depends_on=("sign",))
def spikiness(
    view: PhaseView, *, cutoff_hz: float = 100.0, average_s: float = 0.5, floor: float = 1e-3
) -> float:
    """Mean excess over a moving threshold: `spikiness_as_printed` in seconds and with a floor.

    SP = log10(mean(max(x - x_th, 0)) + floor sigma(x)): without spikes it answers log10(floor sigma) where
    the printed form is -inf. Gaussian noise has a mean excess of 8.5e-3 sigma.

    Parameters
    ----------
    view : PhaseView
        Movement.
    cutoff_hz : float
        Of the low-pass, in Hz.
    average_s : float
        Length of the moving average, in s (0.5 s are the printed 5000 samples).
    floor : float
        In standard deviations of the low-passed movement.

    Raises
    ------
    UndefinedFeatureError
        For silence, or fs/2 not above the cut-off.
    """
    excess, sigma = _excess(*low_passed(view, cutoff_hz, shared=True), n_of(view, average_s))
    return log10_of(excess + floor * sigma, "the low-passed movement") + float(np.log10(level(view)))


def _excess(x: Samples, factor: int, average: int) -> tuple[float, float]:
    """Return mean(max(x - x_th, 0)) and sigma(x)."""
    sigma = float(np.std(x))
    above = x - moving_average(x, max(1, average // factor))
    above -= 2 * sigma + x.mean()
    return float(np.maximum(above, 0, out=above).mean()), sigma


@feature("movement", "1", "strese2015, eq. 7", depends_on=("length", "rate"))
def regularity_as_printed(view: PhaseView) -> float:
    """Mean rise of the autocorrelation, RG = mean(max(r_k - r_(k-1), 0)), over all lags k = 1 ... n-1.

    The movement is divided by its range first; r_k = sum_n x_n x_(n+k) has no normalisation, so RG grows with
    the length of the movement.

    Raises
    ------
    UndefinedFeatureError
        For silence.
    """
    slope = np.diff(autocorrelation(view))
    rise = float(np.maximum(slope, 0, out=slope).mean(dtype=np.float64))
    return rise / float(np.ptp(view.samples) / level(view)) ** 2


@feature("movement", "1", "strese2015, eq. 7, corrected")
def regularity(
    view: PhaseView, *, frame_s: float = 0.5, n_frames: int = 64, band_hz: float = 1000.0
) -> float:
    """Typical height of the rises of the autocorrelation: near 0 for noise, near 1 for a periodic signal.

    The autocorrelation r of each frame of what lies below `band_hz` is taken to half the frame, without bias,
    with r_0 = 1. Each of its rises, from a minimum to the next maximum, has a height h; the answer is the
    mean over frames of sum h^2 / (2 sum h). The printed mean slope grows with the length (frames of fixed
    length do not) and with frequency: it puts white noise above a grating felt at 30 Hz.

    Parameters
    ----------
    view : PhaseView
        Movement.
    frame_s : float
        Length of the frames, in s; a shorter movement is one frame.
    n_frames : int
        How many frames at most, evenly spread over the movement; those of a shorter one overlap by half.
    band_hz : float
        Upper end of the band, in Hz; fs/2 if that is lower.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 64 samples, frames of fewer than 32 below `band_hz`, or an autocorrelation
        without any rise.
    """
    x, fs = band_limited(view, band_hz)
    length = min(max(1, round(frame_s * fs)), x.size)
    undefined_if(length < 32, f"{length} samples in a frame. Expected at least 32")
    frames = frames_of(x.astype(np.float32), length)[evenly_spaced(x.size - length, length // 2, n_frames)]
    frames -= frames.mean(axis=1, keepdims=True)
    frames = frames[np.ptp(frames, axis=1) > 0]
    # Zeros for half the length keep lags up to there apart from those that wrap around; twice the rate,
    # since near half a rate the extrema of a curve lie between its samples.
    n_fft = 2 * fft.next_fast_len(-(-3 * length // 4), real=True)
    spectra = fft.rfft(frames, n_fft)
    r = fft.dct(spectra.real**2 + spectra.imag**2, type=1, n=n_fft + 1)
    n_lags = 2 * (length // 2)
    r = r[:, :n_lags] * (length / (length - np.arange(n_lags, dtype=np.float32) / 2) / r[:, :1])
    # The height of each rise, from a minimum to the next maximum.
    up = r[:, 1:] > r[:, :-1]
    turn = np.flatnonzero(up[:, 1:] != up[:, :-1])
    row = turn // (n_lags - 2)
    height = np.diff(r.reshape(-1)[turn + 2 * row + 1].astype(np.float64))
    rise = np.flatnonzero((height > 0) & (row[1:] == row[:-1]))
    row, height = row[rise], height[rise]
    total, square = (np.bincount(row, h, len(r)) for h in (height, height * height))
    heights = square[total > 0] / (2 * total[total > 0])
    undefined_if(not heights.any(), "the autocorrelation has no rise. Expected at least one")
    return float(np.mean(heights[heights > 0]))


@feature("movement", "log10(m/s^2)", "strese2015, eq. 3", gain=Gain(shift=1), depends_on=("rate",))
def temporal_roughness_as_printed(
    view: PhaseView, *, cutoff_hz: float = 100.0, wavelet: str = "coif3", fine: int = 1, coarse: int = 5
) -> float:
    """Difference of a fine and a coarse wavelet detail, TR = log10 mean|d|.

    d = d_1 - (mean d_1 / mean d_5) d_5 with d_j the magnitude of detail j of the movement high-passed at
    100 Hz, rebuilt to its length. Read literally, mean(d) is 0 for every signal; the magnitude of the
    element-wise difference is what is averaged here.

    Parameters
    ----------
    view : PhaseView
        Movement.
    cutoff_hz : float
        Of the FIR high-pass, in Hz.
    wavelet : str
        Name in PyWavelets.
    fine, coarse : int
        Levels; level j covers fs/2^(j+1) ... fs/2^j.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 544 samples (coif3, level 5), or no energy in a detail.
    """
    d1 = detail_band(view, cutoff_hz, wavelet, coarse, fine)
    d5 = detail_band(view, cutoff_hz, wavelet, coarse, coarse)
    return _difference(np.abs(d1, out=d1), np.abs(d5, out=d5)) + float(np.log10(level(view)))


@feature("movement", "log10(m/s^2)", "strese2015, eq. 3, corrected", gain=Gain(shift=1))
def temporal_roughness(
    view: PhaseView,
    *,
    fine_hz: tuple[float, float] = (500.0, 1000.0),
    coarse_hz: tuple[float, float] = (150.0, 300.0),
) -> float:
    """Difference of a fine and a coarse band, TR = log10 mean|d|, both given in Hz.

    As `temporal_roughness_as_printed`, with two octaves inside the band of the sensor in place of wavelet
    levels: at 10 kHz the printed d_1 lies at 2.5 ... 5 kHz, where an LIS344 feels nothing. Both are kept at
    `PERIOD` samples per period of the upper end, whatever the rate of the sensor.

    Parameters
    ----------
    view : PhaseView
        Movement.
    fine_hz, coarse_hz : tuple of float
        Edges of the bands, in Hz.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 64 samples, no energy in a band, or fs/2 not above the fine band.
    """
    fine, coarse = both_bands(view, fine_hz, coarse_hz)
    return _difference(fine, coarse.copy()) + float(np.log10(level(view)))


@feature("movement", "log10(1)", "strese2015, section IV-C, corrected")
def roughness_ratio(
    view: PhaseView,
    *,
    fine_hz: tuple[float, float] = (500.0, 1000.0),
    coarse_hz: tuple[float, float] = (150.0, 300.0),
) -> float:
    """Level of a fine over that of a coarse band, log10(mean d_1 / mean d_5): free of force.

    The ratio that eq. 3 forms in order to mitigate force and speed, by itself.

    Parameters
    ----------
    view : PhaseView
        Movement.
    fine_hz, coarse_hz : tuple of float
        Edges of the bands, in Hz.

    Raises
    ------
    UndefinedFeatureError
        As `temporal_roughness`.
    """
    fine, coarse = (float(band.mean(dtype=np.float64)) for band in both_bands(view, fine_hz, coarse_hz))
    return log10_of(fine, "the fine band") - log10_of(coarse, "the coarse band")


@transform
def both_bands(
    view: PhaseView, fine_hz: tuple[float, float], coarse_hz: tuple[float, float]
) -> tuple[NDArray[np.float32], ...]:
    """Return the magnitudes of the movement in two bands, at `PERIOD` samples per period of the fine one."""
    require(view, 64, "band-passes")
    rate_hz = PERIOD * fine_hz[1]
    return tuple(np.abs(band_passed(view, *band_hz, rate_hz)) for band_hz in (fine_hz, coarse_hz))


def _difference(d1: NDArray[Any], d5: NDArray[Any]) -> float:
    """log10 mean |d1 - (mean d1 / mean d5) d5|; d5 is overwritten."""
    mean1, mean5 = float(d1.mean(dtype=np.float64)), float(d5.mean(dtype=np.float64))
    log10_of(mean5, "the mean of the coarse band")
    d5 *= mean1 / mean5
    np.abs(np.subtract(d1, d5, out=d5), out=d5)
    return log10_of(float(d5.mean(dtype=np.float64)), "the mean difference of the bands")


@feature(
    "movement", "log10((m/s^2)^2)", "strese2015, eq. 4", gain=Gain(shift=2), depends_on=("length", "rate")
)
def spectral_roughness_as_printed(view: PhaseView, *, length: int = 5000, shift: int = 100) -> float:
    """Change of the magnitude spectrum from frame to frame, SR = log10 sum_k D_k^2, frames in samples.

    D_k = |X_k| - |X_(k+1)| with X_k the orthonormal DCT of frame k; D_k^2 is averaged over bins, and summed
    over frames as printed, so SR grows with the length of the movement.

    Parameters
    ----------
    view : PhaseView
        Movement.
    length, shift : int
        Of the frames, in samples.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than two frames, or frames that do not differ.
    """
    change = float(spectral_changes(view, length, shift).sum())
    return log10_of(change, "the change of the spectrum") + 2 * float(np.log10(level(view)))


@feature("movement", "log10((m/s^2)^2)", "strese2015, eq. 4, corrected", gain=Gain(shift=2))
def spectral_roughness(
    view: PhaseView,
    *,
    frame_s: float = 0.5,
    shift_s: float = 0.01,
    n_pairs: int = 64,
    band_hz: float = 1000.0,
) -> float:
    """Change of the magnitude spectrum from frame to frame: in seconds, and averaged over pairs of frames.

    SR = log10 mean_k D_k^2; see `spectral_roughness_as_printed`. The orthonormal DCT and the mean over bins
    of what lies below `band_hz` make the value independent of the sampling rate.

    Neighbouring pairs share 98 % of their samples, so the mean is taken over pairs spread evenly over the
    movement, a hundredth of the work for a long one: its rank correlation with the mean over all pairs of the
    full band is 0.9998 on `simulated69` and 0.995 on `biotac20`, and surfaces lie 1 % nearer to each other.
    Half-overlapping frames in place of such pairs would be another feature (0.82 on `biotac20`, half the
    separation): what changes within 10 ms is the texture, within 250 ms the hand as well.

    Parameters
    ----------
    view : PhaseView
        Movement.
    frame_s, shift_s : float
        Of the frames, in s.
    n_pairs : int
        How many pairs at most; a movement of 1.2 s has 64.
    band_hz : float
        Upper end of the band, in Hz; fs/2 if that is lower.

    Raises
    ------
    UndefinedFeatureError
        As `spectral_roughness_as_printed`.
    """
    x, fs = band_limited(view, band_hz)
    length, shift = (max(1, round(seconds * fs)) for seconds in (frame_s, shift_s))
    last = x.size - length - shift
    undefined_if(last < 0, f"{x.size / fs:.3g} s. Expected frames of {frame_s:g} s, {shift_s:g} s apart")
    frames, first, changes = frames_of(x.astype(np.float32), length), evenly_spaced(last, shift, n_pairs), []
    for k in range(0, first.size, BLOCK_PAIRS):
        at = first[k : k + BLOCK_PAIRS]
        one, other = np.split(magnitudes(frames[np.concatenate([at, at + shift])]), 2)
        changes.append(mean_square(one - other))
    change = float(np.concatenate(changes).mean())
    return log10_of(change, "the change of the spectrum") + 2 * float(np.log10(level(view)))
