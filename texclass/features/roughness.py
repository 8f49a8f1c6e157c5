"""Microscopic roughness in time and in frequency [strese2015, section IV-C]."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.features.contract import Gain, feature
from texclass.features.transforms import (
    band_passed,
    detail_band,
    level,
    log10_of,
    n_of,
    require,
    spectral_changes,
)
from texclass.features.view import PhaseView


@feature(
    phase="movement",
    unit="log10(m/s^2)",
    reference="strese2015, eq. 3",
    gain=Gain(shift=1),
    depends_on=("rate",),
)
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
    return _difference(np.abs(d1), np.abs(d5)) + float(np.log10(level(view)))


@feature(phase="movement", unit="log10(m/s^2)", reference="strese2015, eq. 3, corrected", gain=Gain(shift=1))
def temporal_roughness(
    view: PhaseView,
    *,
    fine_hz: tuple[float, float] = (500.0, 1000.0),
    coarse_hz: tuple[float, float] = (150.0, 300.0),
) -> float:
    """Difference of a fine and a coarse band, TR = log10 mean|d|, both given in Hz.

    As `temporal_roughness_as_printed`, with two octaves inside the band of the sensor in place of wavelet
    levels: at 10 kHz the printed d_1 lies at 2.5 ... 5 kHz, where an LIS344 feels nothing.

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
    require(view, 64, "band-passes")
    fine, coarse = np.abs(band_passed(view, *fine_hz)), np.abs(band_passed(view, *coarse_hz))
    return _difference(fine, coarse) + float(np.log10(level(view)))


@feature(phase="movement", unit="log10(1)", reference="strese2015, section IV-C, corrected")
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
    require(view, 64, "band-passes")
    fine, coarse = np.abs(band_passed(view, *fine_hz)).mean(), np.abs(band_passed(view, *coarse_hz)).mean()
    return log10_of(float(fine), "the fine band") - log10_of(float(coarse), "the coarse band")


def _difference(d1: NDArray[Any], d5: NDArray[Any]) -> float:
    """log10 mean |d1 - (mean d1 / mean d5) d5|; d5 is overwritten."""
    mean1, mean5 = float(d1.mean(dtype=np.float64)), float(d5.mean(dtype=np.float64))
    log10_of(mean5, "the mean of the coarse band")
    d5 *= mean1 / mean5
    np.abs(np.subtract(d1, d5, out=d5), out=d5)
    return log10_of(float(d5.mean(dtype=np.float64)), "the mean difference of the bands")


@feature(
    phase="movement",
    unit="log10((m/s^2)^2)",
    reference="strese2015, eq. 4",
    gain=Gain(shift=2),
    depends_on=("length", "rate"),
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


@feature(
    phase="movement",
    unit="log10((m/s^2)^2)",
    reference="strese2015, eq. 4, corrected",
    gain=Gain(shift=2),
)
def spectral_roughness(view: PhaseView, *, frame_s: float = 0.5, shift_s: float = 0.01) -> float:
    """Change of the magnitude spectrum from frame to frame: in seconds, and averaged over frames.

    SR = log10 mean_k D_k^2; see `spectral_roughness_as_printed`. The orthonormal DCT and the mean over bins
    make the value of a band-limited signal independent of the sampling rate.

    Parameters
    ----------
    view : PhaseView
        Movement.
    frame_s, shift_s : float
        Of the frames, in s.

    Raises
    ------
    UndefinedFeatureError
        As `spectral_roughness_as_printed`.
    """
    change = float(spectral_changes(view, n_of(view, frame_s), n_of(view, shift_s)).mean())
    return log10_of(change, "the change of the spectrum") + 2 * float(np.log10(level(view)))
