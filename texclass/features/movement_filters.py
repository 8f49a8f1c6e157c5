"""Scaling, checks and filters of a movement that several features share.

All functions work on `unit`, the samples divided by their largest magnitude, so that no gain causes overflow
or underflow. A feature multiplies its result by `level` if its gain law requires it. Power spectra and
transforms of frames are in `texclass.features.spectra`.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass import fourier
from texclass.features.phase_view import (
    PhaseView,
    UndefinedFeatureError,
    segment_views,
    transform,
    undefined_if,
)
from texclass.recording import Samples

MAX_DECIMATION = 20
"""Largest decimation factor of a low-passed movement."""


def magnitude_of(samples: Samples) -> float:
    """Return the largest magnitude of the samples.

    Raises
    ------
    UndefinedFeatureError
        If there is no sample, a sample is NaN or infinite, or all samples are 0.

    Examples
    --------
    >>> import numpy as np
    >>> magnitude_of(np.array([0.5, -2.0, 1.0]))
    2.0
    """
    undefined_if(samples.size == 0, "0 samples. Expected at least one")
    largest = float(max(samples.max(), -samples.min()))  # NaN and infinity pass through
    if not math.isfinite(largest):
        is_finite = np.isfinite(samples)
        raise UndefinedFeatureError(
            f"{int((~is_finite).sum())} samples are NaN or infinite (first at index "
            f"{int(np.argmin(is_finite))}). Expected finite samples"
        )
    if largest == 0:
        raise UndefinedFeatureError(f"silence: all {samples.size} samples are 0")
    return largest


@transform
def level(view: PhaseView) -> Any:
    """Return the largest magnitude of the samples, or of each segment with shape (n_segments, 1).

    Raises
    ------
    UndefinedFeatureError
        If there is no sample, a sample is NaN or infinite, or all samples are equal.

    Examples
    --------
    >>> import numpy as np
    >>> level(PhaseView(np.array([0.5, -2.0, 1.0]), fs=1000))
    2.0
    """
    if view.samples.ndim > 1:
        return np.array([[level(segment)] for segment in segment_views(view)])
    magnitude = magnitude_of(view.samples)
    if view.samples[0] == view.samples[-1] and np.ptp(view.samples) == 0:
        raise UndefinedFeatureError(f"silence: all {view.n_samples} samples are {view.samples[0]:g}")
    return magnitude


def unit(view: PhaseView) -> Samples:
    """Return the samples divided by `level`.

    The array is not cached, because it takes 0.3 GB per hour of a recording at 10 kHz.

    Examples
    --------
    >>> import numpy as np
    >>> unit(PhaseView(np.array([0.5, -2.0, 1.0]), fs=1000)).tolist()
    [0.25, -1.0, 0.5]
    """
    return np.asarray(view.samples / level(view))


def require(view: PhaseView, n_samples: int, purpose: str) -> None:
    """Raise `UndefinedFeatureError` if a phase has fewer than the `n_samples` required for `purpose`."""
    if view.n_samples < n_samples:  # not undefined_if: formatting the message would take as long as a feature
        raise UndefinedFeatureError(f"{view.n_samples} samples. Expected at least {n_samples} ({purpose})")


def below_nyquist(view: PhaseView, frequency_hz: float) -> float:
    """Return `frequency_hz`; raise `UndefinedFeatureError` if it is not below fs/2."""
    if not frequency_hz < view.fs / 2:
        raise UndefinedFeatureError(f"fs is {view.fs:g} Hz. Expected more than {2 * frequency_hz:g} Hz")
    return frequency_hz


def n_of(view: PhaseView, seconds: float) -> int:
    """Return the number of samples in a duration, at least 1."""
    return max(1, round(seconds * view.fs))


def log10_of(value: float, name: str) -> float:
    """Return log10(value); raise `UndefinedFeatureError` if the value is not positive."""
    if not value > 0:
        raise UndefinedFeatureError(f"{name} must be positive to take its logarithm, got {value:g}")
    return math.log10(value)


@transform
def unit32(view: PhaseView) -> NDArray[np.float32]:
    """Return `unit` in single precision, which halves the memory of transforms.

    The errors of the transforms are 130 dB below the signal.
    """
    return unit(view).astype(np.float32)


def padded_length(view: PhaseView) -> int:
    """Return the transform length of `spectrum`: a multiple of `MAX_DECIMATION` with a fast transform."""
    level(view)  # raises for silence
    return MAX_DECIMATION * int(fft.next_fast_len(-(-view.n_samples // MAX_DECIMATION)))


@transform
def spectrum(view: PhaseView) -> NDArray[np.complex64]:
    """Return the discrete Fourier transform of `unit32`, zero-padded to `padded_length`."""
    return fourier.rfft(_padded(view))


@transform
def low_spectrum(view: PhaseView) -> NDArray[np.complex64]:
    """Return the bins 0 ... N/4 of `spectrum` (up to fs/4), without computing the higher bins."""
    return fourier.rfft(_padded(view), quarter=True)


def _padded(view: PhaseView) -> NDArray[np.float32]:
    samples = np.zeros(padded_length(view), dtype=np.float32)
    samples[: view.n_samples] = unit32(view)
    return samples


def first_bins(view: PhaseView, n_bins: int) -> NDArray[np.complex64]:
    """Return the bins 0 ... n_bins-1 of the spectrum, from `low_spectrum` if it is sufficient."""
    # At 6 kHz and above, the corrected features use no frequency above fs/4.
    is_enough = view.fs >= 6000 and n_bins <= padded_length(view) // fourier.LANES + 1
    return (low_spectrum(view) if is_enough else spectrum(view))[:n_bins]


@transform
def low_passed(view: PhaseView, cutoff_hz: float, *, shared: bool = False) -> tuple[Samples, int]:
    """Return `unit` low-passed at `cutoff_hz`, and the decimation factor.

    The spectrum is multiplied by 1 / (1 + (f/cutoff)^4), the response of a second-order Butterworth low-pass
    run forwards and backwards. It is then transformed back at a sampling rate of at least 10 times the
    cut-off frequency.

    Parameters
    ----------
    view : PhaseView
        Movement.
    cutoff_hz : float
        Cut-off frequency in Hz.
    shared : bool
        Whether to use `first_bins`, the part of the spectrum that the corrected features share. By default,
        the full `spectrum` is used, which the features as printed share.
    """
    n_fft, rate = padded_length(view), below_nyquist(view, cutoff_hz) * 10
    factor = next((k for k in (MAX_DECIMATION, 10, 5, 4, 2) if view.fs / k >= rate), 1)
    n_slow = n_fft // factor
    f = np.arange(n_slow // 2 + 1) * (view.fs / n_fft)
    x = first_bins(view, f.size) if shared else spectrum(view)[: f.size]
    f *= f / cutoff_hz**2
    slow = fft.irfft(x / (1 + f * f), n_slow)
    return np.asarray(slow[: -(-view.n_samples // factor)] / factor, dtype=np.float64), factor


def high_passed(view: PhaseView, cutoff_hz: float) -> NDArray[np.float32]:
    """Return `unit` after a zero-phase high-pass with half amplitude at `cutoff_hz`, in single precision.

    Like the response of a windowed FIR filter, the amplitude rises as a raised cosine, from 0.5 to 1.5 times
    the cut-off frequency. The filter is applied to `spectrum`, which other features use too.
    """
    x = spectrum(view).copy()
    step = view.fs / (2 * (x.size - 1))
    first, last = (int(ratio * below_nyquist(view, cutoff_hz) / step) for ratio in (0.5, 1.5))
    rising = (np.arange(first, min(last, x.size)) * step / cutoff_hz - 0.5) * np.pi
    x[:first] = 0
    x[first:last] *= ((1 - np.cos(rising)) / 2).astype(np.float32)
    return np.asarray(fft.irfft(x, overwrite_x=True)[: view.n_samples])


@transform
def band_passed(view: PhaseView, low_hz: float, high_hz: float, rate_hz: float) -> NDArray[np.float32]:
    """Return `unit` band-passed between two frequencies.

    The sampling rate of the result is at least `rate_hz`, or fs if that is lower. The spectrum is multiplied
    by 1 / (1 + u^4) with u = (f^2 - low high) / (f (high - low)), the response of a second-order Butterworth
    band-pass run forwards and backwards. The filter has no delay, and its amplitude is 0.5 at both
    frequencies.
    """
    below_nyquist(view, high_hz)
    n_fft = padded_length(view)
    n = min(n_fft, 2 * fft.next_fast_len(int(np.ceil(n_fft * rate_hz / view.fs / 2)), real=True))
    f = np.arange(n // 2 + 1, dtype=np.float32) * np.float32(view.fs / n_fft / np.sqrt(low_hz * high_hz))
    width = np.float32((high_hz - low_hz) / np.sqrt(low_hz * high_hz))
    passband, stopband = (f * width) ** 2, (f * f - 1) ** 2
    passband, stopband = passband * passband, stopband * stopband
    slow = fft.irfft(first_bins(view, f.size) * (passband / (passband + stopband)), n, overwrite_x=True)
    return np.asarray(slow[: view.n_samples * n // n_fft] * np.float32(n / n_fft))


@transform
def band_limited(view: PhaseView, band_hz: float) -> tuple[Samples, float]:
    """Return `unit` band-limited to `band_hz`, and its sampling rate in Hz.

    The sampling rate is 2 `band_hz`, or fs if that is lower.

    Raises
    ------
    UndefinedFeatureError
        If the movement has fewer than 64 samples.
    """
    require(view, 64, "a spectrum")
    if view.fs <= 2 * band_hz:
        return unit(view), view.fs
    n_fft = padded_length(view)
    n = 2 * int(band_hz * n_fft / view.fs)
    slow = fft.irfft(first_bins(view, n // 2 + 1), n)[: view.n_samples * n // n_fft]
    return np.asarray(slow * (n / n_fft), dtype=np.float64), view.fs * n / n_fft


@transform
def details(view: PhaseView, cutoff_hz: float, wavelet: str, depth: int) -> tuple[NDArray[np.float32], ...]:
    """Return the wavelet details d_1 ... d_depth of the high-passed movement; index 0 is d_1.

    Raises
    ------
    UndefinedFeatureError
        If the movement has fewer than (filter length - 1) 2^depth samples: 544 for coif3 at depth 5.
    """
    import pywt

    taps = int(pywt.Wavelet(wavelet).dec_len)
    require(view, (taps - 1) * 2**depth, f"{wavelet}, level {depth}")
    coefficients = pywt.wavedec(high_passed(view, cutoff_hz), wavelet, level=depth)
    return tuple(coefficients[:0:-1])


def detail_band(view: PhaseView, cutoff_hz: float, wavelet: str, depth: int, j: int) -> NDArray[np.float32]:
    """Return detail j (1 is the finest), reconstructed to the length of the movement, in single precision."""
    import pywt

    levels = details(view, cutoff_hz, wavelet, depth)
    band = pywt.idwt(None, levels[j - 1], wavelet)
    for finer in levels[j - 2 :: -1] if j > 1 else ():
        band = pywt.idwt(band[: finer.size], None, wavelet)
    return np.asarray(band[: view.n_samples])
