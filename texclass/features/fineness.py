"""Fineness: where the energy of the movement lies in frequency [strese2015, sections IV-B and IV-D]."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.conditioning import require, unit32
from texclass.features.contract import feature
from texclass.features.phase_view import PhaseView, undefined_if
from texclass.features.spectra import spectral_moments
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
