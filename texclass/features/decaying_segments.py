"""Features of the decaying segments and the frequency band of a movement [guruswamy2011, section IV]."""

import numpy as np
from scipy import fft

from texclass.features.contract import feature
from texclass.features.movement_filters import spectrum
from texclass.features.phase_view import PhaseView, transform, undefined_if
from texclass.features.spectra import mean_spectrum
from texclass.recording import Samples
from texclass.vibration.decaying_modes import fit_prony
from texclass.vibration.rising_peaks import (
    THRESHOLD,
    Segmentation,
    VibrationBand,
    segment_rising_peaks,
    vibration_band,
)

LOWER_HZ = 15.0
"""Lower end of the band in Hz; hand motion has lower frequencies. The paper uses 0.122 Hz, because its set-up
is fixed and levelled."""
SMOOTHING_HZ = 30.0
"""Standard deviation in Hz of the Gaussian that smooths the spectrum.

Selected among 3, 10 and 30 Hz for the smallest ratio of the variation of the cut-off frequency within
surfaces to its variation between surfaces, on repetitions 1-20 of `biotac20` and on `simulated69`."""
DEAD_BAND = 0.3
"""Smallest rise from one peak to the next that starts a segment (dead band), in standard deviations of the
movement. It was selected like `SMOOTHING_HZ`, among 0.1, 0.3 and 0.5. The paper uses an absolute dead band of
0.3066 m/s^2, which is two quantisation steps of its sensor."""
RESOLUTION = 0.5
"""Mean absolute error at which a Prony fit is accepted, in standard deviations of the movement. The paper
uses 0.153 m/s^2, which is one quantisation step of its sensor and half its dead band."""


@transform
def band(view: PhaseView, lower_hz: float, smoothing_hz: float) -> VibrationBand:
    """Return the major frequency and the upper cut-off frequency of the movement above `lower_hz`."""
    frequency, power = mean_spectrum(view)
    above = frequency >= lower_hz
    undefined_if(above.sum() < 8, f"fs is {view.fs:g} Hz. Expected at least 8 bins above {lower_hz:g} Hz")
    undefined_if(not power[above].any(), f"silence: no energy above {lower_hz:g} Hz")
    return vibration_band(frequency[above], power[above], smoothing_hz=smoothing_hz)


@transform
def band_passed_unit(view: PhaseView, lower_hz: float, smoothing_hz: float) -> tuple[Samples, float]:
    """Return the band-passed movement with standard deviation 1, and its sampling rate in Hz.

    The band reaches from `lower_hz` to the upper cut-off frequency. The spectrum is multiplied by the
    response of second-order Butterworth filters run forwards and backwards, which do not move peaks. It is
    then transformed back at a sampling rate of 10 times the cut-off frequency, or at fs if that is lower.
    """
    x, upper_hz = spectrum(view), band(view, lower_hz, smoothing_hz).upper_hz
    n_fft = 2 * (x.size - 1)
    n = min(n_fft, 2 * fft.next_fast_len(int(n_fft * 10 * upper_hz / view.fs / 2) + 1, real=True))
    f = np.arange(n // 2 + 1) * (view.fs / n_fft)
    f *= f
    high, low = (f / lower_hz**2) ** 2, (f / upper_hz**2) ** 2
    response = (high / ((1 + high) * (1 + low))).astype(np.float32)
    samples = fft.irfft(x[: f.size] * response, n)[: view.n_samples * n // n_fft].astype(np.float64)
    deviation = float(samples.std())
    undefined_if(not deviation > 0, f"silence: no energy between {lower_hz:g} and {upper_hz:g} Hz")
    return np.asarray(samples / deviation), view.fs * n / n_fft


@transform
def segmentation(
    view: PhaseView, lower_hz: float, smoothing_hz: float, dead_band: float, threshold: float
) -> Segmentation:
    """Cut the band-passed movement into segments that start where a peak is higher than the previous one."""
    samples, _ = band_passed_unit(view, lower_hz, smoothing_hz)
    return segment_rising_peaks(samples, dead_band, threshold=threshold)


@feature("movement", "Hz", "guruswamy2011, section IV-C, eq. 6 and 7")
def upper_cutoff(view: PhaseView, *, lower_hz: float = LOWER_HZ, smoothing_hz: float = SMOOTHING_HZ) -> float:
    """Return the upper cut-off frequency of the movement, determined from its power spectrum.

    At least 75 % of the power lies below this frequency. Above it, no bin reaches a tenth of the largest
    power.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lower_hz : float
        Lower end of the spectrum in Hz (default 15). The upper end is 2100 Hz, or fs/2 if that is lower.
    smoothing_hz : float
        Standard deviation of the Gaussian that smooths the power spectrum, in Hz (default 30).

    Returns
    -------
    float
        Frequency in Hz.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 64 samples, or its spectrum has fewer than 8 bins in the
        band.

    References
    ----------
    `guruswamy2011`, section IV-C, eq. 6 and 7.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 300 * np.arange(20_000) / 10_000)
    >>> bool(300 < upper_cutoff(x, fs=10_000) < 400)
    True
    """
    return band(view, lower_hz, smoothing_hz).upper_hz


@feature("movement", "Hz", "guruswamy2011, section IV-C")
def major_frequency(
    view: PhaseView, *, lower_hz: float = LOWER_HZ, smoothing_hz: float = SMOOTHING_HZ
) -> float:
    """Return the frequency of the peak of the smoothed power spectrum.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lower_hz, smoothing_hz : float
        See `upper_cutoff`. If the spectrum falls with frequency, the peak is at `lower_hz`.

    Returns
    -------
    float
        Frequency in Hz.

    Raises
    ------
    UndefinedFeatureError
        If `upper_cutoff` is undefined.

    References
    ----------
    `guruswamy2011`, section IV-C.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 300 * np.arange(20_000) / 10_000)
    >>> round(major_frequency(x, fs=10_000))
    300
    """
    return band(view, lower_hz, smoothing_hz).major_hz


@feature("movement", "1/s", "guruswamy2011, section IV-B")
def segment_rate(
    view: PhaseView,
    *,
    lower_hz: float = LOWER_HZ,
    smoothing_hz: float = SMOOTHING_HZ,
    dead_band: float = DEAD_BAND,
    threshold: float = THRESHOLD,
) -> float:
    """Return the number of decaying segments per second: how often the surface excites the tool.

    The paper counts segments per mm. This feature needs no position signal, but it depends on the speed of
    the hand.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lower_hz, smoothing_hz : float
        Parameters of the frequency band; see `upper_cutoff`.
    dead_band : float
        Smallest rise from one peak to the next that starts a segment, in standard deviations of the movement.
    threshold : float
        Smallest rise relative to the previous peak (alpha). It decreases by 5 % per peak within a segment.

    Returns
    -------
    float
        Rate in 1/s.

    Raises
    ------
    UndefinedFeatureError
        If `upper_cutoff` is undefined.

    References
    ----------
    `guruswamy2011`, section IV-B.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000 % 0.05  # an impact every 0.05 s
    >>> x = np.exp(-150 * t) * np.sin(2 * np.pi * 200 * t)
    >>> round(segment_rate(x, fs=10_000))
    20
    """
    _, fs = band_passed_unit(view, lower_hz, smoothing_hz)
    segments = segmentation(view, lower_hz, smoothing_hz, dead_band, threshold)
    return float(segments.n_segments * fs / segments.bounds[-1])


@feature("movement", "1", "guruswamy2011, section IV-A")
def segment_peaks(
    view: PhaseView,
    *,
    lower_hz: float = LOWER_HZ,
    smoothing_hz: float = SMOOTHING_HZ,
    dead_band: float = DEAD_BAND,
    threshold: float = THRESHOLD,
) -> float:
    """Return the mean number of extrema per segment, which is the initial order of a Prony fit.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lower_hz, smoothing_hz, dead_band, threshold : float
        See `segment_rate`.

    Returns
    -------
    float
        Number of extrema.

    Raises
    ------
    UndefinedFeatureError
        If `upper_cutoff` is undefined.

    References
    ----------
    `guruswamy2011`, section IV-A.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(20_000) / 10_000 % 0.05
    >>> x = np.exp(-150 * t) * np.sin(2 * np.pi * 200 * t)
    >>> bool(segment_peaks(x, fs=10_000) > 5)
    True
    """
    return float(segmentation(view, lower_hz, smoothing_hz, dead_band, threshold).n_peaks.mean())


@feature("movement", "1", "guruswamy2011, section IV-A", depends_on=("rate",))
def segment_order(
    view: PhaseView,
    *,
    lower_hz: float = LOWER_HZ,
    smoothing_hz: float = SMOOTHING_HZ,
    dead_band: float = DEAD_BAND,
    threshold: float = THRESHOLD,
    resolution: float = RESOLUTION,
    n_fitted: int = 8,
) -> float:
    """Return the mean order at which Prony fits of the segments reach the required accuracy.

    The order of a fit starts at the number of extrema of the segment and grows until the error is below
    `resolution`. Because the order depends on a threshold, it can change with rounding, sampling rate and
    library versions.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    lower_hz, smoothing_hz, dead_band, threshold : float
        See `segment_rate`.
    resolution : float
        Required mean absolute error, in standard deviations of the movement (default 0.5).
    n_fitted : int
        Maximum number of segments to fit (default 8), evenly spaced over the movement. The order of a fit is
        at most 40.

    Returns
    -------
    float
        Mean order.

    Raises
    ------
    UndefinedFeatureError
        If `upper_cutoff` is undefined, or no segment has at least two samples.

    References
    ----------
    `guruswamy2011`, section IV-A.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2500) / 10_000 % 0.05
    >>> x = np.exp(-150 * t) * np.sin(2 * np.pi * 200 * t)
    >>> coarse, fine = (segment_order(x, fs=10_000, resolution=r) for r in (0.5, 0.1))
    >>> coarse <= fine
    True
    """
    samples, _ = band_passed_unit(view, lower_hz, smoothing_hz)
    signals = segmentation(view, lower_hz, smoothing_hz, dead_band, threshold).split(samples)
    signals = [signal for signal in signals if signal.size >= 2]
    undefined_if(not signals, "no segment has two samples. Expected at least one such segment")
    indices = np.unique(np.linspace(0, len(signals) - 1, n_fitted).round().astype(np.intp))
    fits = [fit_prony(signals[i], resolution, max_order=min(40, signals[i].size - 1)) for i in indices]
    return float(np.mean([fit.order for fit in fits]))
