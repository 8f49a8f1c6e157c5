"""Macroscopic roughness: waviness, spikiness and regularity [strese2015, section IV-D]."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft

from texclass import signals
from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.filtered import Slow, banded, low_passed
from texclass.features.frames import spread
from texclass.features.transforms import autocorrelation, level, log10_of, n_of, require, unit
from texclass.features.view import PhaseView
from texclass.recording import Samples


@feature(
    phase="movement",
    unit="log10(m/s^2)",
    reference="strese2015, eq. 5",
    gain=Gain(shift=1),
    depends_on=("rate",),
)
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
    return _waviness(view, low_passed(view, cutoff_hz), frame, average)


@feature(
    phase="movement",
    unit="log10(m/s^2)",
    reference="strese2015, eq. 5, corrected",
    gain=Gain(shift=1),
)
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
    slow = low_passed(view, cutoff_hz, shared=True)
    return _waviness(view, slow, n_of(view, frame_s), max(1, round(average_s / frame_s)))


def _waviness(view: PhaseView, slow: Slow, frame: int, average: int) -> float:
    require(view, 2 * frame, f"two frames of {frame} samples")
    edges = np.arange(0, view.n_samples - frame + 1, frame) // slow.factor
    x = np.abs(slow.samples[: (view.n_samples // frame) * frame // slow.factor])
    m = np.add.reduceat(x, edges) / np.diff(edges, append=x.size)
    sigma = float(np.std(m - signals.moving_average(m, average)))
    return log10_of(sigma, "the deviation of the frames' levels") + float(np.log10(level(view)))


@feature(
    phase="movement",
    unit="log10(m/s^2)",
    reference="strese2015, eq. 6",
    gain=Gain(shift=1),
    depends_on=("rate",),
)
def spikiness_as_printed(view: PhaseView, *, cutoff_hz: float = 100.0, average: int = 5000) -> float:
    """Mean excess over a moving threshold, SP = log10 mean(max(x - x_th, 0)), average in samples.

    x is the low-passed movement and x_th = 2 sigma(x) + mean(x) + the moving average of x over 5000 samples.

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
    excess, _ = _excess(low_passed(view, cutoff_hz), average)
    return log10_of(excess, "the mean excess over the spike threshold") + float(np.log10(level(view)))


@feature(
    phase="movement",
    unit="log10(m/s^2)",
    reference="strese2015, eq. 6, corrected",
    gain=Gain(shift=1),
)
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
    excess, sigma = _excess(low_passed(view, cutoff_hz, shared=True), n_of(view, average_s))
    return log10_of(excess + floor * sigma, "the low-passed movement") + float(np.log10(level(view)))


def _excess(slow: Slow, average: int) -> tuple[float, float]:
    """Return mean(max(x - x_th, 0)) and sigma(x)."""
    x = slow.samples
    sigma = float(np.std(x))
    above = x - signals.moving_average(x, max(1, average // slow.factor))
    above -= 2 * sigma + x.mean()
    return float(np.maximum(above, 0, out=above).mean()), sigma


@feature(
    phase="movement",
    unit="1",
    reference="strese2015, eq. 7",
    depends_on=("length", "rate"),
)
def regularity_as_printed(view: PhaseView) -> float:
    """Mean rise of the autocorrelation, RG = mean(max(r_k - r_(k-1), 0)), over all lags k = 1 ... n-1.

    The movement is divided by its range first; r_k = sum_n x_n x_(n+k) has no normalisation, so RG grows with
    the length of the movement.

    Raises
    ------
    UndefinedFeatureError
        For silence.
    """
    x = unit(view)
    slope = np.diff(autocorrelation(view))
    rise = float(np.maximum(slope, 0, out=slope).mean(dtype=np.float64))
    return rise / float(x.max() - x.min()) ** 2


@feature(phase="movement", unit="1", reference="strese2015, eq. 7, corrected")
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
    slow = banded(view, band_hz)
    length = min(max(1, round(frame_s * slow.fs)), slow.samples.size)
    if length < 32:
        raise UndefinedFeatureError(f"{length} samples in a frame; the rule is at least 32")
    frames = sliding_window_view(slow.samples.astype(np.float32), length)
    frames = frames[spread(slow.samples.size - length, length // 2, n_frames)]
    frames -= frames.mean(axis=1, keepdims=True)
    heights = _typical_rises(_autocorrelations(frames[np.ptp(frames, axis=1) > 0]))
    if not heights.any():
        raise UndefinedFeatureError("the autocorrelation has no rise; the rule is at least one")
    return float(np.mean(heights[heights > 0]))


def _autocorrelations(frames: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unbiased autocorrelation of each frame up to half its length, r_0 = 1, at twice the rate.

    Zeros for half the length keep lags up to there apart from those that wrap around. Twice the rate, since
    near half a rate the extrema of a curve lie between its samples.
    """
    length = frames.shape[1]
    n_fft = 2 * fft.next_fast_len(-(-3 * length // 4), real=True)
    spectra = fft.rfft(frames, n_fft)
    r = fft.irfft(spectra.real**2 + spectra.imag**2, 2 * n_fft)[:, : 2 * (length // 2)]
    unbiased = length / (length - np.arange(r.shape[1], dtype=np.float32) / 2)
    return np.asarray(r / r[:, :1] * unbiased)


def _typical_rises(r: NDArray[np.float32]) -> Samples:
    """Return sum h^2 / (2 sum h) over the rises of each row, 0 for a row without any."""
    up = np.diff(r, axis=1) > 0
    turn = np.flatnonzero(up[:, 1:] != up[:, :-1])
    row = turn // (r.shape[1] - 2)
    height = np.diff(r[:, 1:-1].reshape(-1)[turn].astype(np.float64))
    height[(height < 0) | (row[1:] != row[:-1])] = 0
    total, square = (np.bincount(row[1:], h, len(r)) for h in (height, height**2))
    return np.divide(square, 2 * total, out=np.zeros(len(r)), where=total > 0)
