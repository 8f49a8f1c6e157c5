"""The movement as a row of decaying segments, and the band that holds it [guruswamy2011, section IV]."""

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
"""Lower end of the band: below is the hand. The paper's 0.122 Hz belong to a fixed, levelled set-up."""
SMOOTHING_HZ = 30.0
"""Of the spectrum. Of 3, 10 and 30 Hz, the one whose cut-off varies least within a surface beside between
surfaces, on repetitions 1-20 of `biotac20` and on `simulated69`."""
DEAD_BAND = 0.3
"""In deviations of the movement, chosen in the same way of 0.1, 0.3 and 0.5; the paper's two bits are an
absolute 0.3066 m/s^2."""
RESOLUTION = 0.5
"""Mean absolute error of a Prony fit, in deviations of the movement; the paper's one bit is 0.153 m/s^2, half
its dead band."""


@transform
def band(view: PhaseView, lower_hz: float, smoothing_hz: float) -> VibrationBand:
    """Return major frequency and automatic upper cut-off of the movement above `lower_hz`."""
    frequency, power = mean_spectrum(view)
    above = frequency >= lower_hz
    undefined_if(above.sum() < 8, f"fs is {view.fs:g} Hz. Expected 8 bins above {lower_hz:g} Hz")
    undefined_if(not power[above].any(), f"silence: no energy above {lower_hz:g} Hz")
    return vibration_band(frequency[above], power[above], smoothing_hz=smoothing_hz)


@transform
def kept(view: PhaseView, lower_hz: float, smoothing_hz: float) -> tuple[Samples, float]:
    """Return the movement between `lower_hz` and its automatic cut-off, of deviation 1, and its rate in Hz.

    The spectrum is multiplied by the responses of second-order Butterworth filters run forwards and backwards
    and transformed back at a rate of 10 cut-offs (its own, if that is lower): peaks are found where
    they are.
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
    """Cut the movement, band-passed, where its peaks rise."""
    samples, _ = kept(view, lower_hz, smoothing_hz)
    return segment_rising_peaks(samples, dead_band, threshold=threshold)


@feature("movement", "Hz", "guruswamy2011, section IV-C, eq. 6 and 7")
def upper_cutoff(view: PhaseView, *, lower_hz: float = LOWER_HZ, smoothing_hz: float = SMOOTHING_HZ) -> float:
    """Automatic upper cut-off: holds 75 % of the power and all of the spectrum above a tenth of its peak.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lower_hz : float
        Where the spectrum begins, in Hz; it ends at 2100 Hz or fs/2.
    smoothing_hz : float
        Standard deviation of the Gaussian that smooths the power spectrum, in Hz.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 64 samples, or a rate that leaves fewer than 8 bins.
    """
    return band(view, lower_hz, smoothing_hz).upper_hz


@feature("movement", "Hz", "guruswamy2011, section IV-C")
def major_frequency(
    view: PhaseView, *, lower_hz: float = LOWER_HZ, smoothing_hz: float = SMOOTHING_HZ
) -> float:
    """Major frequency: that of the peak of the smoothed power spectrum.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lower_hz, smoothing_hz
        As in `upper_cutoff`. A spectrum that falls from there on has its peak at `lower_hz`.

    Raises
    ------
    UndefinedFeatureError
        As `upper_cutoff`.
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
    """Decaying segments per second: how often the surface makes the tool ring anew.

    The paper counts them per mm; without a position, the hand's speed comes in.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lower_hz, smoothing_hz
        Of the band that is kept, as in `upper_cutoff`.
    dead_band : float
        Least rise of a peak that begins a segment, in deviations of the movement.
    threshold : float
        alpha: least rise in parts of the peak before, falling by 5 % from peak to peak within a segment.

    Raises
    ------
    UndefinedFeatureError
        As `upper_cutoff`.
    """
    _, fs = kept(view, lower_hz, smoothing_hz)
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
    """Mean number of extrema of a segment, the order at which its Prony fit begins.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lower_hz, smoothing_hz, dead_band, threshold
        As in `segment_rate`.

    Raises
    ------
    UndefinedFeatureError
        As `upper_cutoff`.
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
    """Mean order of the Prony filters of segments, grown from their extrema until the resolution is met.

    The order of a segment is the first one that meets the resolution, so that rounding, the sampling rate and
    the version of a library may change it.

    Parameters
    ----------
    view : PhaseView
        Movement.
    lower_hz, smoothing_hz, dead_band, threshold
        As in `segment_rate`.
    resolution : float
        Mean absolute error that is enough, in deviations of the movement.
    n_fitted : int
        How many segments, evenly spread, are fitted at most. Orders end at 40.

    Raises
    ------
    UndefinedFeatureError
        As `upper_cutoff`, and if no segment has two samples.
    """
    samples, _ = kept(view, lower_hz, smoothing_hz)
    pieces = segmentation(view, lower_hz, smoothing_hz, dead_band, threshold).split(samples)
    pieces = [piece for piece in pieces if piece.size >= 2]
    undefined_if(not pieces, "0 segments of two samples. Expected at least one")
    chosen = np.unique(np.linspace(0, len(pieces) - 1, n_fitted).round().astype(np.intp))
    orders = [fit_prony(pieces[i], resolution, max_order=min(40, pieces[i].size - 1)).order for i in chosen]
    return float(np.mean(orders))
