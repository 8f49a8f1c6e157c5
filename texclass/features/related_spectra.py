"""Spectral features of related work in Table I of strese2015; numbers in brackets are its references."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.signal import find_peaks

from texclass import signals
from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.frames import power_frames
from texclass.features.transforms import level, mean_spectrum
from texclass.features.view import PhaseView
from texclass.recording import Samples

SENSOR_BAND_HZ = 1400.0
"""Where the acceleration sensor of strese2015 ends."""


@feature(phase="movement", unit="Hz", reference="strese2015, Table I [7] (Fishel and Loeb, 2012)")
def spectral_centroid(view: PhaseView, *, high_hz: float = 600.0) -> float:
    """Centroid of the mean power spectrum up to 600 Hz, where [7] cuts off: sum f P(f) / sum P(f).

    Parameters
    ----------
    view : PhaseView
        Movement.
    high_hz : float
        End of the band in Hz; fs/2 if that is lower.

    Raises
    ------
    UndefinedFeatureError
        For silence (in that band) or fewer than 64 samples.
    """
    f, power = mean_spectrum(view)
    inside = f <= high_hz
    total = float(power[inside].sum())
    if total == 0:
        raise UndefinedFeatureError(f"silence: no energy up to {high_hz:g} Hz")
    return float(power[inside] @ f[inside]) / total


@dataclass(frozen=True)
class GaussianBands:
    """Gaussian bins: how many, and the centres of the first and the last (Hz)."""

    n_bands: int
    low_hz: float
    high_hz: float


def _band_names(*, n_bands: int, **_: object) -> tuple[str, ...]:
    return tuple(f"b{i + 1:02d}" for i in range(n_bands))


@feature(
    phase="movement",
    unit="(m/s^2)^2",
    reference="strese2015, Table I [8] (Romano and Kuchenbecker, 2014)",
    outputs=_band_names,
    gain=Gain(power=2),
)
def gaussian_band_energies(
    view: PhaseView, *, n_bands: int = 30, low_hz: float = 20.0, high_hz: float = SENSOR_BAND_HZ
) -> Samples:
    """Energy of the movement in Gaussian bins of the spectrum.

    Bin b weighs the power density with exp(-((f - f_b) / w_b)^2 / 2). Centres f_b lie geometrically between
    the two frequencies and the width w_b is half the distance to the next centre, so that resolution falls
    with frequency as the skin's does. The bins' exact places are this program's reading of the table's "30
    Energy Values (Gaussian Binning)".

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_bands : int
        Number of bins.
    low_hz, high_hz : float
        First and last centre in Hz; the last is 0.95 fs/2 if that is lower.

    Returns
    -------
    ndarray of shape (n_bands,)

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 64 samples, or a movement too short to resolve the lowest bin.
    """
    f, power = mean_spectrum(view)
    band = GaussianBands(n_bands, low_hz, min(high_hz, 0.95 * view.fs / 2))
    weight = _gaussians(band, f.size, float(f[0]), float(f[1] - f[0]))
    if (weight.sum(axis=1) < 0.5).any():
        raise UndefinedFeatureError(
            f"the spectrum has a bin every {f[1] - f[0]:.1f} Hz; the rule is a bin in each of the bands "
            f"from {low_hz:g} Hz on"
        )
    return np.asarray(weight @ power * ((f[1] - f[0]) * level(view) ** 2))


@lru_cache(maxsize=8)
def _gaussians(band: GaussianBands, n_bins: int, first_hz: float, step_hz: float) -> Samples:
    """Return the weights of the bins, shape (n_bands, n_bins); the same for all movements of 1 s or more."""
    centre = np.geomspace(band.low_hz, band.high_hz, band.n_bands)[:, np.newaxis]
    width = centre * (centre[1] / centre[0] - 1) / 2
    f = first_hz + step_hz * np.arange(n_bins)
    return np.asarray(np.exp(-(((f - centre) / width) ** 2) / 2))


def _cell_names(*, n_times: int, n_bands: int, **_: object) -> tuple[str, ...]:
    return tuple(f"t{t + 1:02d}f{b + 1}" for t in range(n_times) for b in range(n_bands))


@feature(
    phase="movement",
    unit="log10((m/s^2)^2/Hz)",
    reference="strese2015, Table I [5] (Sinapov and Sukhoy, 2011)",
    outputs=_cell_names,
    gain=Gain(shift=2),
    depends_on=("length",),
)
def discretized_spectrogram(
    view: PhaseView, *, n_times: int = 25, n_bands: int = 5, high_hz: float = SENSOR_BAND_HZ
) -> Samples:
    """Spectrogram in 25 equal stretches of time by 5 equal bands: log10 of the mean power density of each.

    Frames of 25 ms every 15 ms, as for `mfcc`. A stretch is a fraction of the movement, whatever its length.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_times, n_bands : int
        Number of stretches and bands.
    high_hz : float
        End of the last band in Hz; fs/2 if that is lower.

    Returns
    -------
    ndarray of shape (n_times * n_bands,)
        The bands of the first stretch, then of the second.

    Raises
    ------
    UndefinedFeatureError
        For silence in a cell, fewer frames than stretches, or fewer bins than bands.
    """
    frames = power_frames(view, 0.025, 0.015, "hamming", high_hz)
    n_frames, n_bins = frames.power.shape
    if n_frames < n_times or n_bins < n_bands:
        raise UndefinedFeatureError(
            f"{n_frames} frames and {n_bins} bins; the rule is at least {n_times} and {n_bands}"
        )
    rows = np.arange(n_times) * n_frames // n_times
    columns = np.arange(n_bands) * n_bins // n_bands
    in_time = np.add.reduceat(frames.power, rows, axis=0, dtype=np.float64)
    cells = np.add.reduceat(in_time, columns, axis=1)
    size = np.outer(np.diff(rows, append=n_frames), np.diff(columns, append=n_bins))
    if (cells == 0).any():
        raise UndefinedFeatureError(f"silence in {int((cells == 0).sum())} of {cells.size} cells")
    return np.asarray((np.log10(cells / size) + 2 * np.log10(level(view))).ravel())


def _peak_names(*, n_peaks: int, **_: object) -> tuple[str, ...]:
    return tuple(f"f{i + 1}" for i in range(n_peaks))


@feature(
    phase="movement",
    unit="Hz",
    reference="strese2015, Table I [9] (Jamali and Sammut, 2011)",
    outputs=_peak_names,
)
def spectral_peaks(
    view: PhaseView, *, n_peaks: int = 5, smooth_hz: float = 20.0, high_hz: float = SENSOR_BAND_HZ
) -> Samples:
    """Frequencies of the five highest peaks of the spectral envelope, highest first.

    The envelope is the power spectrum, twice averaged over 20 Hz; so far apart are the peaks at least.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_peaks : int
        How many.
    smooth_hz : float
        Width of the averages, and least distance of two peaks, in Hz.
    high_hz : float
        End of the band in Hz.

    Returns
    -------
    ndarray of shape (n_peaks,)

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 64 samples, or fewer peaks above 1e-10 of the highest (a pure tone).
    """
    f, power = mean_spectrum(view)
    inside = f <= high_hz
    width = max(1, round(smooth_hz / (f[1] - f[0])))
    envelope = signals.moving_average(signals.moving_average(power[inside], width), width)
    peaks, _ = find_peaks(envelope, height=1e-10 * float(envelope.max()), distance=width)
    if peaks.size < n_peaks:
        raise UndefinedFeatureError(f"{peaks.size} peaks in the spectral envelope; the rule is {n_peaks}")
    highest = peaks[np.argsort(-envelope[peaks], kind="stable")[:n_peaks]]
    return np.asarray(f[inside][highest])
