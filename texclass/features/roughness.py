"""Microscopic roughness in time and in frequency [strese2015, section IV-C]."""

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.filtered import band_passed, banded, detail_band
from texclass.features.frames import magnitudes, mean_square, spectral_changes, spread
from texclass.features.transforms import level, log10_of, require
from texclass.features.view import PhaseView, transform

PERIOD = 3
"""Samples in a period of the upper end of the fine band: a rate that holds the magnitudes of both."""


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
    fine, coarse = (magnitude(view, band, PERIOD * fine_hz[1]) for band in (fine_hz, coarse_hz))
    return _difference(fine, coarse.copy()) + float(np.log10(level(view)))


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
    fine, coarse = (
        float(magnitude(view, band, PERIOD * fine_hz[1]).mean(dtype=np.float64))
        for band in (fine_hz, coarse_hz)
    )
    return log10_of(fine, "the fine band") - log10_of(coarse, "the coarse band")


@transform
def magnitude(view: PhaseView, band_hz: tuple[float, float], rate_hz: float) -> NDArray[np.float32]:
    """Return the magnitude of the movement in a band, at `rate_hz`."""
    require(view, 64, "band-passes")
    return np.asarray(np.abs(band_passed(view, *band_hz, rate_hz)))


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
def spectral_roughness(
    view: PhaseView,
    *,
    frame_s: float = 0.5,
    shift_s: float = 0.01,
    n_pairs: int = 128,
    band_hz: float = 1000.0,
) -> float:
    """Change of the magnitude spectrum from frame to frame: in seconds, and averaged over pairs of frames.

    SR = log10 mean_k D_k^2; see `spectral_roughness_as_printed`. The orthonormal DCT and the mean over bins
    of what lies below `band_hz` make the value independent of the sampling rate.

    Neighbouring pairs share 98 % of their samples, so the mean is taken over pairs spread evenly over the
    movement, a fiftieth of the work for a long one: its rank correlation with the mean over all pairs of the
    full band is 0.9998 on `simulated69` and 0.998 on `biotac20`, at the same separation of surfaces.
    Half-overlapping frames in place of such pairs would be another feature (0.82 on `biotac20`, half the
    separation): what changes within 10 ms is the texture, within 250 ms the hand as well.

    Parameters
    ----------
    view : PhaseView
        Movement.
    frame_s, shift_s : float
        Of the frames, in s.
    n_pairs : int
        How many pairs at most; a movement of 1.8 s has 128.
    band_hz : float
        Upper end of the band, in Hz; fs/2 if that is lower.

    Raises
    ------
    UndefinedFeatureError
        As `spectral_roughness_as_printed`.
    """
    slow = banded(view, band_hz)
    length, shift = (max(1, round(seconds * slow.fs)) for seconds in (frame_s, shift_s))
    last = slow.samples.size - length - shift
    if last < 0:
        raise UndefinedFeatureError(
            f"{slow.samples.size / slow.fs:.3g} s; the rule is frames of {frame_s:g} s, {shift_s:g} s apart"
        )
    frames, first = sliding_window_view(slow.samples.astype(np.float32), length), spread(last, shift, n_pairs)
    change = float(mean_square(magnitudes(frames[first]) - magnitudes(frames[first + shift])).mean())
    return log10_of(change, "the change of the spectrum") + 2 * float(np.log10(level(view)))
