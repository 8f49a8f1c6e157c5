"""Filtered copies of a movement, shared by features: made from its spectrum, at a rate that holds them."""

from dataclasses import dataclass

import numpy as np
import pywt
from numpy.typing import NDArray
from scipy import fft

from texclass.features.transforms import (
    FINEST,
    below_nyquist,
    first_bins,
    padded_length,
    require,
    spectrum,
    unit,
)
from texclass.features.view import PhaseView, transform
from texclass.recording import Samples


@dataclass(frozen=True, eq=False)
class Slow:
    """A low-passed movement at a rate that holds it: `samples` of shape (n // factor,) at `fs` / `factor`."""

    samples: Samples
    factor: int


@transform
def low_passed(view: PhaseView, cutoff_hz: float, *, shared: bool = False) -> Slow:
    """Return `unit` without what lies above `cutoff_hz`, kept at a rate of 10 cut-offs or more.

    The spectrum (`first_bins`, which corrected features share, or `spectrum`, which printed ones do) is
    multiplied by the response of a second-order Butterworth low-pass run forwards and backwards,
    1 / (1 + (f/cutoff)^4), and only its occupied part is transformed back.
    """
    n_fft, rate = padded_length(view), below_nyquist(view, cutoff_hz) * 10
    factor = next((k for k in (FINEST, 10, 5, 4, 2) if view.fs / k >= rate), 1)
    n_slow = n_fft // factor
    f = np.arange(n_slow // 2 + 1) * (view.fs / n_fft)
    x = first_bins(view, f.size) if shared else spectrum(view)[: f.size]
    f *= f / cutoff_hz**2
    slow = fft.irfft(x / (1 + f * f), n_slow)
    return Slow(np.asarray(slow[: -(-view.n_samples // factor)] / factor, dtype=np.float64), factor)


@transform
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


@dataclass(frozen=True, eq=False)
class Banded:
    """What of `unit` lies below a frequency: `samples` of shape (n,), at a rate of `fs` Hz."""

    samples: Samples
    fs: float


@transform
def banded(view: PhaseView, band_hz: float) -> Banded:
    """Return the movement at a rate of 2 `band_hz` (its own, if lower), the spectrum cut off there.

    Raises
    ------
    UndefinedFeatureError
        If the movement holds fewer than 64 samples.
    """
    require(view, 64, "a spectrum")
    if view.fs <= 2 * band_hz:
        return Banded(unit(view), view.fs)
    n_fft = padded_length(view)
    n = 2 * int(band_hz * n_fft / view.fs)
    slow = fft.irfft(first_bins(view, n // 2 + 1), n)[: view.n_samples * n // n_fft]
    return Banded(np.asarray(slow * (n / n_fft), dtype=np.float64), view.fs * n / n_fft)


@transform
def details(view: PhaseView, cutoff_hz: float, wavelet: str, depth: int) -> tuple[NDArray[np.float32], ...]:
    """Return the wavelet details d_1 ... d_depth of the high-passed movement (index 0 is d_1).

    Raises
    ------
    UndefinedFeatureError
        If the movement is shorter than (filter length - 1) 2^depth samples: 544 for coif3 at depth 5.
    """
    taps = int(pywt.Wavelet(wavelet).dec_len)
    require(view, (taps - 1) * 2**depth, f"{wavelet}, level {depth}")
    coefficients = pywt.wavedec(high_passed(view, cutoff_hz), wavelet, level=depth)
    return tuple(coefficients[:0:-1])


@transform
def detail_band(view: PhaseView, cutoff_hz: float, wavelet: str, depth: int, j: int) -> NDArray[np.float32]:
    """Return detail j (1 = finest) rebuilt to the length of the movement, shape (n,), in single precision."""
    levels = details(view, cutoff_hz, wavelet, depth)
    band = pywt.idwt(None, levels[j - 1], wavelet)
    for finer in levels[j - 2 :: -1] if j > 1 else ():
        band = pywt.idwt(band[: finer.size], None, wavelet)
    return np.asarray(band[: view.n_samples])
