"""Features of related work in Table I of strese2015; numbers in brackets are its references."""

import functools

import numpy as np
import scipy
from scipy.linalg import LinAlgError, solve_toeplitz

from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.movement_filters import details, level, require, unit
from texclass.features.phase_view import PhaseView, undefined_if
from texclass.features.spectra import mean_spectrum, power_frames
from texclass.recording import Samples
from texclass.signals import moving_average

CHATHURANGA = "strese2015, Table I [17] (Chathuranga et al., 2013)"
SENSOR_BAND_HZ = 1400.0
"""Where the acceleration sensor of strese2015 ends."""


@feature("movement", "(m/s^2)^2", "strese2015, Table I [7] (Fishel and Loeb, 2012)", gain=Gain(power=2))
def standard_roughness(view: PhaseView) -> float:
    """Power of the vibration, mean x^2.

    Raises
    ------
    UndefinedFeatureError
        For silence.
    """
    x = unit(view)
    return float(x @ x) / x.size * float(level(view)) ** 2


@feature(
    "movement",
    "1",
    "strese2015, Table I [10] (Culbertson et al., 2014)",
    outputs="a{order}",
    depends_on=("rate",),
)
def lpc_coefficients(view: PhaseView, *, order: int = 10) -> Samples:
    """Linear prediction x_n = sum_k a_k x_(n-k) of the movement, by the autocorrelation method.

    a solves the Toeplitz equations of r_0 ... r_order (biased autocorrelation), so the predictor is stable.

    Parameters
    ----------
    view : PhaseView
        Movement.
    order : int
        Number of coefficients.

    Returns
    -------
    ndarray of shape (order,)

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 10 x order samples, or a singular system.
    """
    require(view, 10 * order, "10 times the order")
    x = unit(view)
    r = np.array([x[k:] @ x[: x.size - k] for k in range(order + 1)]) / (x @ x)
    try:
        a = np.asarray(solve_toeplitz(r[:-1], r[1:]))
    except LinAlgError as error:
        raise UndefinedFeatureError(f"prediction of order {order} has no solution ({error})") from None
    undefined_if(not np.isfinite(a).all(), f"prediction of order {order} has no finite solution")
    return a


@feature("movement", "m/s^2", CHATHURANGA, gain=Gain(power=1))
def mean_magnitude(view: PhaseView) -> float:
    """Mean of |x|: the movement's own mean is gravity and removed with it.

    Raises
    ------
    UndefinedFeatureError
        For silence.
    """
    x = unit(view)
    return float(np.abs(x, out=x).mean()) * float(level(view))


@feature("movement", "(m/s^2)^2", CHATHURANGA, gain=Gain(power=2))
def variance(view: PhaseView) -> float:
    """Variance of the movement.

    Raises
    ------
    UndefinedFeatureError
        For silence.
    """
    x = unit(view)
    return (float(x @ x) / x.size - float(x.mean()) ** 2) * float(level(view)) ** 2


@feature("movement", "(m/s^2)^2", CHATHURANGA, gain=Gain(power=2), depends_on=("rate",))
def wavelet_energy(view: PhaseView, *, wavelet: str = "coif3", depth: int = 5) -> float:
    """Energy of the wavelet details d_1 ... d_5 per sample, of the movement high-passed at 100 Hz.

    The transform is that of `temporal_roughness_as_printed` and computed once for both.

    Parameters
    ----------
    view : PhaseView
        Movement.
    wavelet : str
        Name in PyWavelets.
    depth : int
        Number of levels.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 544 samples (coif3, level 5), or fs/2 not above 100 Hz.
    """
    energy = sum(float(np.sum(d * d, dtype=np.float64)) for d in details(view, 100.0, wavelet, depth))
    undefined_if(energy == 0, "silence: no energy in the details")
    return energy / view.n_samples * float(level(view)) ** 2


@feature("movement", "Hz", "strese2015, Table I [7] (Fishel and Loeb, 2012)")
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
    undefined_if(total == 0, f"silence: no energy up to {high_hz:g} Hz")
    return float(power[inside] @ f[inside]) / total


@feature(
    "movement",
    "(m/s^2)^2",
    "strese2015, Table I [8] (Romano and Kuchenbecker, 2014)",
    outputs="b{n_bands:02d}",
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
    last_hz = min(high_hz, 0.95 * view.fs / 2)
    weight = _gaussians(n_bands, low_hz, last_hz, f.size, float(f[0]), float(f[1] - f[0]))
    undefined_if(
        (weight.sum(axis=1) < 0.5).any(),
        f"the spectrum has a bin every {f[1] - f[0]:.1f} Hz. Expected a bin in each of the bands "
        f"from {low_hz:g} Hz on",
    )
    return np.asarray(weight @ power * ((f[1] - f[0]) * level(view) ** 2))


@functools.lru_cache(maxsize=8)
def _gaussians(
    n_bands: int, low_hz: float, high_hz: float, n_bins: int, first_hz: float, step_hz: float
) -> Samples:
    """Return the weights of the bins, shape (n_bands, n_bins); the same for all movements of 1 s or more."""
    centre = np.geomspace(low_hz, high_hz, n_bands)[:, np.newaxis]
    width = centre * (centre[1] / centre[0] - 1) / 2
    f = first_hz + step_hz * np.arange(n_bins)
    return np.asarray(np.exp(-(((f - centre) / width) ** 2) / 2))


@feature(
    "movement",
    "log10((m/s^2)^2/Hz)",
    "strese2015, Table I [5] (Sinapov and Sukhoy, 2011)",
    outputs="t{n_times:02d}f{n_bands}",
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
    power, _ = power_frames(view, 0.025, 0.015, "hamming", high_hz)
    n_frames, n_bins = power.shape
    undefined_if(
        n_frames < n_times or n_bins < n_bands,
        f"{n_frames} frames and {n_bins} bins. Expected at least {n_times} and {n_bands}",
    )
    rows = np.arange(n_times) * n_frames // n_times
    columns = np.arange(n_bands) * n_bins // n_bands
    in_time = np.add.reduceat(power, rows, axis=0, dtype=np.float64)
    cells = np.add.reduceat(in_time, columns, axis=1)
    size = np.outer(np.diff(rows, append=n_frames), np.diff(columns, append=n_bins))
    undefined_if((cells == 0).any(), f"silence in {int((cells == 0).sum())} of {cells.size} cells")
    return np.asarray((np.log10(cells / size) + 2 * np.log10(level(view))).ravel())


@feature("movement", "Hz", "strese2015, Table I [9] (Jamali and Sammut, 2011)", outputs="f{n_peaks}")
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
    envelope = moving_average(moving_average(power[inside], width), width)
    peaks, _ = scipy.signal.find_peaks(envelope, height=1e-10 * float(envelope.max()), distance=width)
    undefined_if(peaks.size < n_peaks, f"{peaks.size} peaks in the spectral envelope. Expected {n_peaks}")
    highest = peaks[np.argsort(-envelope[peaks], kind="stable")[:n_peaks]]
    return np.asarray(f[inside][highest])
