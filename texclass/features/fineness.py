"""Fineness: where the energy of the movement lies in frequency [strese2015, sections IV-B and IV-D]."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.conditioning import require, unit32
from texclass.features.contract import feature
from texclass.features.phase_view import PhaseView, undefined_if
from texclass.features.spectra import long_frames, spectral_moments
from texclass.recording import Samples


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
    undefined_if(view.fs / 2 <= high_hz, f"fs is {view.fs:g} Hz; the rule is above {2 * high_hz:g} Hz")
    require(view, max(64, round(3 * view.fs / low_hz)), f"three periods of {low_hz:g} Hz")
    power, f = long_frames(view)
    band = (f >= low_hz) & (f < high_hz)
    v, f = power[:, band] / f[band] ** 2, f[band]
    v = v[v.sum(axis=1) > 0]
    undefined_if(not len(v), f"silence from {low_hz:g} to {high_hz:g} Hz")
    return float(np.exp(np.median(v @ np.log(f) / v.sum(axis=1))))
