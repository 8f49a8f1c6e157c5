"""Features of related work in Table I of strese2015.

Numbers in brackets are the reference numbers of that paper.
"""

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
"""Bandwidth in Hz of the acceleration sensor of strese2015."""


@feature("movement", "(m/s^2)^2", "strese2015, Table I [7] (Fishel and Loeb, 2012)", gain=Gain(power=2))
def standard_roughness(view: PhaseView) -> float:
    """Return the power of the vibration, mean x^2.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.

    Returns
    -------
    float
        Power in (m/s^2)^2.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent.

    References
    ----------
    `strese2015`, Table I [7]: Fishel and Loeb, 2012.

    Examples
    --------
    >>> import numpy as np
    >>> round(standard_roughness(2 * np.sin(np.arange(10_000.0)), fs=10_000), 2)
    2.0
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
    """Return the linear prediction coefficients of the movement, x_n = sum_k a_k x_(n-k).

    The coefficients solve the Toeplitz equations of the biased autocorrelation r_0 ... r_order, which
    guarantees a stable model.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    order : int
        Number of coefficients.

    Returns
    -------
    ndarray of shape (order,)
        Coefficients a_1 ... a_order.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 10 samples per coefficient, or the equations are singular.

    References
    ----------
    `strese2015`, Table I [10]: Culbertson et al., 2014.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 0.1 * np.arange(10_000))  # x_n = 2 cos(2 pi 0.1) x_(n-1) - x_(n-2)
    >>> lpc_coefficients(x, fs=10_000, order=2).round(2).tolist()
    [1.62, -1.0]
    """
    require(view, 10 * order, "10 times the order of the prediction")
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
    """Return the mean magnitude of the movement, mean |x|.

    The mean of x is not used, because it is 0 after the removal of gravity.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.

    Returns
    -------
    float
        Mean magnitude in m/s^2.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent.

    References
    ----------
    `strese2015`, Table I [17]: Chathuranga et al., 2013.

    Examples
    --------
    >>> import numpy as np
    >>> round(mean_magnitude(np.sin(np.arange(10_000.0)), fs=10_000), 2)  # 2 / pi
    0.64
    """
    x = unit(view)
    return float(np.abs(x, out=x).mean()) * float(level(view))


@feature("movement", "(m/s^2)^2", CHATHURANGA, gain=Gain(power=2))
def variance(view: PhaseView) -> float:
    """Return the variance of the movement.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.

    Returns
    -------
    float
        Variance in (m/s^2)^2.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent.

    References
    ----------
    `strese2015`, Table I [17]: Chathuranga et al., 2013.

    Examples
    --------
    >>> import numpy as np
    >>> round(variance(2 * np.sin(np.arange(10_000.0)) + 9.81, fs=10_000), 2)
    2.0
    """
    x = unit(view)
    return (float(x @ x) / x.size - float(x.mean()) ** 2) * float(level(view)) ** 2


@feature("movement", "(m/s^2)^2", CHATHURANGA, gain=Gain(power=2), depends_on=("rate",))
def wavelet_energy(view: PhaseView, *, wavelet: str = "coif3", depth: int = 5) -> float:
    """Return the energy per sample of the wavelet details d_1 ... d_5 of the movement high-passed at 100 Hz.

    `temporal_roughness_as_printed` uses the same transform, which is computed only once.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    wavelet : str
        Name of the wavelet in PyWavelets.
    depth : int
        Number of wavelet levels.

    Returns
    -------
    float
        Energy per sample in (m/s^2)^2.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 544 samples (with coif3 and depth 5), or if fs/2 is not
        above 100 Hz.

    References
    ----------
    `strese2015`, Table I [17]: Chathuranga et al., 2013.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 1000 * np.arange(10_000) / 10_000)
    >>> round(wavelet_energy(x, fs=10_000), 1)
    0.5
    """
    energy = sum(float(np.sum(d * d, dtype=np.float64)) for d in details(view, 100.0, wavelet, depth))
    undefined_if(energy == 0, "silence: no energy in the details")
    return energy / view.n_samples * float(level(view)) ** 2


@feature("movement", "Hz", "strese2015, Table I [7] (Fishel and Loeb, 2012)")
def spectral_centroid(view: PhaseView, *, high_hz: float = 600.0) -> float:
    """Return the centroid of the mean power spectrum up to 600 Hz, sum f P(f) / sum P(f).

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    high_hz : float
        Upper end of the band in Hz (default 600, the cut-off frequency in [7]), or fs/2 if that is lower.

    Returns
    -------
    float
        Centroid in Hz.

    Raises
    ------
    UndefinedFeatureError
        If there is no energy in the band, or the movement has fewer than 64 samples.

    References
    ----------
    `strese2015`, Table I [7]: Fishel and Loeb, 2012.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(10_000) / 10_000
    >>> x = np.sin(2 * np.pi * 200 * t) + np.sin(2 * np.pi * 2000 * t)  # 2000 Hz is above the band
    >>> round(spectral_centroid(x, fs=10_000))
    200
    """
    f, power = mean_spectrum(view)
    is_in_band = f <= high_hz
    total = float(power[is_in_band].sum())
    undefined_if(total == 0, f"silence: no energy up to {high_hz:g} Hz")
    return float(power[is_in_band] @ f[is_in_band]) / total


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
    """Return the energy of the movement in Gaussian bands of the spectrum.

    Band b weights the power density by exp(-((f - f_b) / w_b)^2 / 2). The centres f_b are spaced
    geometrically, and the width w_b is half the distance to the next centre. Like the resolution of the skin,
    the resolution thus decreases with frequency. The table only states "30 Energy Values (Gaussian Binning)";
    the positions of the bands are our choice.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_bands : int
        Number of bands.
    low_hz, high_hz : float
        Centres of the first and the last band in Hz. The last centre is 0.95 fs/2 if that is lower.

    Returns
    -------
    ndarray of shape (n_bands,)
        Energies in (m/s^2)^2, lowest band first.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent, has fewer than 64 samples, or is too short to resolve the lowest band.

    References
    ----------
    `strese2015`, Table I [8]: Romano and Kuchenbecker, 2014.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 300 * np.arange(10_000) / 10_000)
    >>> energies = gaussian_band_energies(x, fs=10_000)
    >>> round(float(np.geomspace(20, 1400, 30)[energies.argmax()]))  # centre of the strongest band
    324
    """
    f, power = mean_spectrum(view)
    last_hz = min(high_hz, 0.95 * view.fs / 2)
    weight = _gaussians(n_bands, low_hz, last_hz, f.size, float(f[0]), float(f[1] - f[0]))
    undefined_if(
        (weight.sum(axis=1) < 0.5).any(),
        f"the bins of the spectrum are {f[1] - f[0]:.1f} Hz apart. Expected at least one bin in each "
        f"of the bands from {low_hz:g} Hz",
    )
    return np.asarray(weight @ power * ((f[1] - f[0]) * level(view) ** 2))


@functools.lru_cache(maxsize=8)
def _gaussians(
    n_bands: int, low_hz: float, high_hz: float, n_bins: int, first_hz: float, step_hz: float
) -> Samples:
    """Return the weights of the bins in each band, shape (n_bands, n_bins).

    The weights are cached, because they are the same for all movements of at least 1 s.
    """
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
    """Return the log10 mean power density of a spectrogram with 25 time intervals and 5 equal bands.

    As in `mfcc`, frames of 25 ms start every 15 ms. The movement is divided into equal time intervals, whose
    duration depends on its length.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_times, n_bands : int
        Number of time intervals and bands.
    high_hz : float
        Upper end of the last band in Hz, or fs/2 if that is lower.

    Returns
    -------
    ndarray of shape (n_times * n_bands,)
        Levels in log10((m/s^2)^2/Hz): all bands of the first time interval, then all bands of the second, and
        so on.

    Raises
    ------
    UndefinedFeatureError
        If a cell of the spectrogram is silent, or there are fewer frames than time intervals or fewer bins
        than bands.

    References
    ----------
    `strese2015`, Table I [5]: Sinapov and Sukhoy, 2011.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal(t.size)
    >>> chirp = np.sin(2 * np.pi * (100 + 300 * t) * t) + noise
    >>> cells = discretized_spectrogram(chirp, fs=10_000, n_times=4, n_bands=3).reshape(4, 3)
    >>> cells.argmax(axis=1).tolist()  # the strongest band moves up
    [0, 1, 1, 2]
    """
    power, _ = power_frames(view, 0.025, 0.015, "hamming", high_hz)
    n_frames, n_bins = power.shape
    undefined_if(
        n_frames < n_times or n_bins < n_bands,
        f"{n_frames} frames and {n_bins} bins. Expected at least {n_times} frames and {n_bands} bins",
    )
    rows = np.arange(n_times) * n_frames // n_times
    columns = np.arange(n_bands) * n_bins // n_bands
    sums = np.add.reduceat(power, rows, axis=0, dtype=np.float64)
    cells = np.add.reduceat(sums, columns, axis=1)
    size = np.outer(np.diff(rows, append=n_frames), np.diff(columns, append=n_bins))
    undefined_if((cells == 0).any(), f"silence in {int((cells == 0).sum())} of {cells.size} cells")
    return np.asarray((np.log10(cells / size) + 2 * np.log10(level(view))).ravel())


@feature("movement", "Hz", "strese2015, Table I [9] (Jamali and Sammut, 2011)", outputs="f{n_peaks}")
def spectral_peaks(
    view: PhaseView, *, n_peaks: int = 5, smooth_hz: float = 20.0, high_hz: float = SENSOR_BAND_HZ
) -> Samples:
    """Return the frequencies of the five highest peaks of the spectral envelope, highest first.

    The envelope is the power spectrum, smoothed by two moving averages over 20 Hz. Two peaks are at least 20
    Hz apart.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_peaks : int
        Number of peaks.
    smooth_hz : float
        Width of the moving averages and smallest distance between two peaks, in Hz.
    high_hz : float
        Upper end of the band in Hz.

    Returns
    -------
    ndarray of shape (n_peaks,)
        Frequencies in Hz.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 64 samples, or fewer than `n_peaks` peaks exceed 1e-10 of
        the highest peak (for example for a pure tone).

    References
    ----------
    `strese2015`, Table I [9]: Jamali and Sammut, 2011.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(10_000) / 10_000
    >>> x = 2 * np.sin(2 * np.pi * 300 * t) + np.sin(2 * np.pi * 900 * t)
    >>> spectral_peaks(x, fs=10_000, n_peaks=2).round(-1).tolist()
    [300.0, 900.0]
    """
    f, power = mean_spectrum(view)
    is_in_band = f <= high_hz
    width = max(1, round(smooth_hz / (f[1] - f[0])))
    envelope = moving_average(moving_average(power[is_in_band], width), width)
    peaks, _ = scipy.signal.find_peaks(envelope, height=1e-10 * float(envelope.max()), distance=width)
    undefined_if(peaks.size < n_peaks, f"{peaks.size} peaks in the spectral envelope. Expected {n_peaks}")
    highest = peaks[np.argsort(-envelope[peaks], kind="stable")[:n_peaks]]
    return np.asarray(f[is_in_band][highest])
