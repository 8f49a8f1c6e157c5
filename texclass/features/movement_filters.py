"""Conditioning of a movement that several features share: scale, checks, and filtered copies of its spectrum.

All of it works on `unit`, the samples divided by their largest magnitude, so that no gain overflows or
underflows in between; a feature puts `level` back as its declared gain law says. What is made from windows of
the movement, or is a power, stands in `spectra`.
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

FINEST = 20
"""Largest factor by which a low-passed movement is decimated."""


def magnitude_of(samples: Samples) -> float:
    """Return the largest magnitude.

    Raises
    ------
    UndefinedFeatureError
        If there is no sample, one is NaN or infinite, or all are 0.
    """
    undefined_if(samples.size == 0, "0 samples. Expected at least one")
    largest = float(max(samples.max(), -samples.min()))  # NaN and infinity pass through
    if not math.isfinite(largest):
        n_bad, first = int((~np.isfinite(samples)).sum()), int(np.argmin(np.isfinite(samples)))
        raise UndefinedFeatureError(
            f"{n_bad} samples are NaN or infinite (first at {first}). Expected finite"
        )
    if largest == 0:
        raise UndefinedFeatureError(f"silence: all {samples.size} samples are 0")
    return largest


@transform
def level(view: PhaseView) -> Any:
    """Return the largest magnitude of the samples, in their unit; of pieces that of each, (n_segments, 1).

    Raises
    ------
    UndefinedFeatureError
        If there is no sample, one is NaN or infinite, or all are the same.
    """
    if view.samples.ndim > 1:
        return np.array([[level(piece)] for piece in segment_views(view)])
    magnitude = magnitude_of(view.samples)
    if view.samples[0] == view.samples[-1] and np.ptp(view.samples) == 0:
        raise UndefinedFeatureError(f"silence: all {view.n_samples} samples are {view.samples[0]:g}")
    return magnitude


def unit(view: PhaseView) -> Samples:
    """Return the samples divided by `level`, shape as given; made anew, for of an hour it is 0.3 GB."""
    return np.asarray(view.samples / level(view))


def require(view: PhaseView, n_samples: int, why: str) -> None:
    """Refuse a phase that is shorter than `n_samples`."""
    if view.n_samples < n_samples:  # a message that nobody reads takes as long as a short feature
        raise UndefinedFeatureError(f"{view.n_samples} samples. Expected at least {n_samples} ({why})")


def below_nyquist(view: PhaseView, frequency_hz: float) -> float:
    """Return `frequency_hz`; refuse one that the sampling rate cannot hold."""
    if not frequency_hz < view.fs / 2:
        raise UndefinedFeatureError(f"fs is {view.fs:g} Hz. Expected fs/2 above {frequency_hz:g} Hz")
    return frequency_hz


def n_of(view: PhaseView, seconds: float) -> int:
    """Return a duration in samples, at least 1."""
    return max(1, round(seconds * view.fs))


def log10_of(value: float, what: str) -> float:
    """Return log10(value); refuse 0."""
    if not value > 0:
        raise UndefinedFeatureError(f"{what} is {value:g}. Expected a positive value, for its logarithm")
    return math.log10(value)


@transform
def unit32(view: PhaseView) -> NDArray[np.float32]:
    """Return `unit` in single precision, for transforms: half the memory, errors 130 dB below the signal."""
    return unit(view).astype(np.float32)


def padded_length(view: PhaseView) -> int:
    """Return the length of `spectrum`: a fast multiple of `FINEST` that holds all samples of `unit`."""
    level(view)  # refuses silence
    return FINEST * int(fft.next_fast_len(-(-view.n_samples // FINEST)))


@transform
def spectrum(view: PhaseView) -> NDArray[np.complex64]:
    """Return the discrete Fourier transform of `unit32`, zero-padded to `padded_length`."""
    return fourier.rfft(_padded(view))


@transform
def low_spectrum(view: PhaseView) -> NDArray[np.complex64]:
    """Return the bins 0 ... N/4 of `spectrum` (up to fs/4); those above are never made."""
    return fourier.rfft(_padded(view), quarter=True)


def _padded(view: PhaseView) -> NDArray[np.float32]:
    samples = np.zeros(padded_length(view), dtype=np.float32)
    samples[: view.n_samples] = unit32(view)
    return samples


def first_bins(view: PhaseView, n_bins: int) -> NDArray[np.complex64]:
    """Return the bins 0 ... n_bins-1 of the spectrum, of `low_spectrum` if that suffices for all features."""
    # From 6 kHz on, a fourth of the rate holds all that corrected features read from the spectrum.
    enough = view.fs >= 6000 and n_bins <= padded_length(view) // fourier.LANES + 1
    return (low_spectrum(view) if enough else spectrum(view))[:n_bins]


@transform
def low_passed(view: PhaseView, cutoff_hz: float, *, shared: bool = False) -> tuple[Samples, int]:
    """Return `unit` without what lies above `cutoff_hz`, and the factor its rate is lowered by.

    The new rate is 10 cut-offs or more. The spectrum (`first_bins`, which corrected features share, or
    `spectrum`, which printed ones do) is multiplied by the response of a second-order Butterworth low-pass
    run forwards and backwards, 1 / (1 + (f/cutoff)^4), and only its occupied part is transformed back.
    """
    n_fft, rate = padded_length(view), below_nyquist(view, cutoff_hz) * 10
    factor = next((k for k in (FINEST, 10, 5, 4, 2) if view.fs / k >= rate), 1)
    n_slow = n_fft // factor
    f = np.arange(n_slow // 2 + 1) * (view.fs / n_fft)
    x = first_bins(view, f.size) if shared else spectrum(view)[: f.size]
    f *= f / cutoff_hz**2
    slow = fft.irfft(x / (1 + f * f), n_slow)
    return np.asarray(slow[: -(-view.n_samples // factor)] / factor, dtype=np.float64), factor


def high_passed(view: PhaseView, cutoff_hz: float) -> NDArray[np.float32]:
    """Return `unit` after a linear-phase high-pass of half amplitude at `cutoff_hz`, single precision.

    The amplitude rises as a raised cosine from half the cut-off to one and a half, as that of a windowed FIR
    filter does, and is applied to `spectrum`, which is there already.
    """
    x = spectrum(view).copy()
    step = view.fs / (2 * (x.size - 1))
    first, last = (int(part * below_nyquist(view, cutoff_hz) / step) for part in (0.5, 1.5))
    rising = (np.arange(first, min(last, x.size)) * step / cutoff_hz - 0.5) * np.pi
    x[:first] = 0
    x[first:last] *= ((1 - np.cos(rising)) / 2).astype(np.float32)
    return np.asarray(fft.irfft(x, overwrite_x=True)[: view.n_samples])


@transform
def band_passed(view: PhaseView, low_hz: float, high_hz: float, rate_hz: float) -> NDArray[np.float32]:
    """Return what of `unit` lies between two frequencies, kept at `rate_hz` or a little more (fs, if lower).

    The spectrum is multiplied by the response of a second-order Butterworth band-pass run forwards and
    backwards, 1 / (1 + u^4) with u = (f^2 - low high) / (f (high - low)), and transformed back up to half the
    rate. Nothing is delayed; the response is half the amplitude at both frequencies.
    """
    below_nyquist(view, high_hz)
    n_fft = padded_length(view)
    n = min(n_fft, 2 * fft.next_fast_len(int(np.ceil(n_fft * rate_hz / view.fs / 2)), real=True))
    f = np.arange(n // 2 + 1, dtype=np.float32) * np.float32(view.fs / n_fft / np.sqrt(low_hz * high_hz))
    width = np.float32((high_hz - low_hz) / np.sqrt(low_hz * high_hz))
    through, beside = (f * width) ** 2, (f * f - 1) ** 2
    through, beside = through * through, beside * beside
    slow = fft.irfft(first_bins(view, f.size) * (through / (through + beside)), n, overwrite_x=True)
    return np.asarray(slow[: view.n_samples * n // n_fft] * np.float32(n / n_fft))


@transform
def banded(view: PhaseView, band_hz: float) -> tuple[Samples, float]:
    """Return `unit` at a rate of 2 `band_hz` (its own, if lower), the spectrum cut off there, and that rate.

    Raises
    ------
    UndefinedFeatureError
        If the movement holds fewer than 64 samples.
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
    """Return the wavelet details d_1 ... d_depth of the high-passed movement (index 0 is d_1).

    Raises
    ------
    UndefinedFeatureError
        If the movement is shorter than (filter length - 1) 2^depth samples: 544 for coif3 at depth 5.
    """
    import pywt

    taps = int(pywt.Wavelet(wavelet).dec_len)
    require(view, (taps - 1) * 2**depth, f"{wavelet}, level {depth}")
    coefficients = pywt.wavedec(high_passed(view, cutoff_hz), wavelet, level=depth)
    return tuple(coefficients[:0:-1])


def detail_band(view: PhaseView, cutoff_hz: float, wavelet: str, depth: int, j: int) -> NDArray[np.float32]:
    """Return detail j (1 = finest) rebuilt to the length of the movement, shape (n,), in single precision."""
    import pywt

    levels = details(view, cutoff_hz, wavelet, depth)
    band = pywt.idwt(None, levels[j - 1], wavelet)
    for finer in levels[j - 2 :: -1] if j > 1 else ():
        band = pywt.idwt(band[: finer.size], None, wavelet)
    return np.asarray(band[: view.n_samples])
