"""Transforms of a movement that several features share; each is computed once per view.

All of them work on `unit`, the samples divided by their largest magnitude, so that no gain overflows or
underflows in between; a feature puts `level` back as its declared gain law says.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pywt
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft
from scipy.signal import get_window

from texclass import filters
from texclass.features.contract import UndefinedFeatureError
from texclass.features.view import PhaseView, transform
from texclass.recording import Samples

LONG_FRAME_S = 0.4096
"""Frame of `long_frames`, in s: 4096 samples at the 10 kHz of strese2015."""
FINEST = 20
"""Largest factor by which a low-passed movement is decimated."""
BAND_HZ = 2100.0
"""End of `mean_spectrum` in Hz: half as much again as the band of the sensor."""
BLOCK = 128
"""Frames transformed at a time, so that a block stays in the cache."""


@dataclass(frozen=True, eq=False)
class PowerFrames:
    """Power spectra of the windowed frames of a movement.

    Attributes
    ----------
    power : ndarray of shape (n_frames, n_bins)
        One-sided power density of each frame of `unit`, in 1/Hz, single precision.
    frequency : ndarray of shape (n_bins,)
        In Hz.
    """

    power: NDArray[np.float32]
    frequency: Samples


def magnitude_of(samples: Samples) -> float:
    """Return the largest magnitude.

    Raises
    ------
    UndefinedFeatureError
        If there is no sample, one is NaN or infinite, or all are 0.
    """
    if samples.size == 0:
        raise UndefinedFeatureError("0 samples; the rule is at least one")
    largest = float(max(samples.max(), -samples.min()))  # NaN and infinity pass through
    if not np.isfinite(largest):
        n_bad, first = int((~np.isfinite(samples)).sum()), int(np.argmin(np.isfinite(samples)))
        raise UndefinedFeatureError(
            f"{n_bad} samples are NaN or infinite (first at {first}); the rule is finite"
        )
    if largest == 0:
        raise UndefinedFeatureError(f"silence: all {samples.size} samples are 0")
    return largest


@transform
def level(view: PhaseView) -> float:
    """Return the largest magnitude of the samples, in their unit.

    Raises
    ------
    UndefinedFeatureError
        If there is no sample, one is NaN or infinite, or all are the same.
    """
    magnitude = magnitude_of(view.samples)
    if view.samples[0] == view.samples[-1] and np.ptp(view.samples) == 0:
        raise UndefinedFeatureError(f"silence: all {view.n_samples} samples are {view.samples[0]:g}")
    return magnitude


@transform
def unit(view: PhaseView) -> Samples:
    """Return the samples divided by `level`, shape (n,)."""
    return np.asarray(view.samples / level(view))


def require(view: PhaseView, n_samples: int, why: str) -> None:
    """Refuse a phase that is shorter than `n_samples`."""
    if view.n_samples < n_samples:
        raise UndefinedFeatureError(f"{view.n_samples} samples; the rule is at least {n_samples} ({why})")


def below_nyquist(view: PhaseView, frequency_hz: float) -> float:
    """Return `frequency_hz`; refuse one that the sampling rate cannot hold."""
    if not frequency_hz < view.fs / 2:
        raise UndefinedFeatureError(f"fs is {view.fs:g} Hz; the rule is fs/2 above {frequency_hz:g} Hz")
    return frequency_hz


def n_of(view: PhaseView, seconds: float) -> int:
    """Return a duration in samples, at least 1."""
    return max(1, round(seconds * view.fs))


@transform
def unit32(view: PhaseView) -> NDArray[np.float32]:
    """Return `unit` in single precision, for transforms: half the memory, errors 130 dB below the signal."""
    return unit(view).astype(np.float32)


@transform
def spectrum(view: PhaseView) -> NDArray[np.complex64]:
    """Return the discrete Fourier transform of `unit32`, zero-padded to a fast multiple of `FINEST`."""
    n_fft = FINEST * fft.next_fast_len(-(-view.n_samples // FINEST))
    return np.asarray(fft.rfft(unit32(view), n_fft))


@transform
def mean_spectrum(view: PhaseView) -> tuple[Samples, Samples]:
    """Return frequency (Hz) and power density of `unit` (1/Hz), both of shape (n_bins,).

    The periodogram of the whole movement up to `BAND_HZ`, averaged over each 1 Hz from 0 on; of a movement
    shorter than 1 s, bin by bin.
    """
    require(view, 64, "a spectrum")
    x = spectrum(view)
    step = view.fs / (2 * (x.size - 1))
    width = max(1.0, step)
    n_bins = int(min(BAND_HZ, view.fs / 2) / width)
    if n_bins < 8:
        raise UndefinedFeatureError(f"fs is {view.fs:g} Hz; the rule is a spectrum of 8 bins of {width:g} Hz")
    first = np.ceil(np.arange(n_bins + 1) * (width / step) - 1e-6).astype(np.intp)
    x = x[: first[-1]]
    power = np.add.reduceat(x.real**2 + x.imag**2, first[:-1], dtype=np.float64) / np.diff(first)
    offset = 0.5 if width > step else 0.0
    frequency = np.asarray((np.arange(n_bins) + offset) * width, dtype=np.float64)
    return frequency, np.asarray(power * (2 / (view.fs * view.n_samples)))


@dataclass(frozen=True, eq=False)
class Slow:
    """A low-passed movement at a rate that holds it: `samples` of shape (n // factor,) at `fs` / `factor`."""

    samples: Samples
    factor: int


@transform
def low_passed(view: PhaseView, cutoff_hz: float) -> Slow:
    """Return `unit` without what lies above `cutoff_hz`, kept at a rate of 10 cut-offs or more.

    The spectrum is multiplied by the response of a second-order Butterworth low-pass run forwards and
    backwards, 1 / (1 + (f/cutoff)^4), and only its occupied part is transformed back.
    """
    x, rate = spectrum(view), below_nyquist(view, cutoff_hz) * 10
    factor = next((k for k in (FINEST, 10, 5, 4, 2) if view.fs / k >= rate), 1)
    n_slow = 2 * (x.size - 1) // factor
    f = np.arange(n_slow // 2 + 1) * (view.fs / (2 * (x.size - 1)))
    f *= f / cutoff_hz**2
    slow = fft.irfft(x[: f.size] / (1 + f * f), n_slow)
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
def band_passed(view: PhaseView, low_hz: float, high_hz: float) -> Samples:
    """Return what of `unit` lies between two frequencies (zero phase), shape (n,)."""
    below_nyquist(view, high_hz)
    return filters.bandpass(unit(view), (low_hz, high_hz), view.fs, order=2)


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


@transform
def power_frames(
    view: PhaseView, frame_s: float, hop_s: float, window: str, high_hz: float = np.inf
) -> PowerFrames:
    """Return the power spectra of windowed frames, zero-padded to a power of two, up to `high_hz`.

    Raises
    ------
    UndefinedFeatureError
        If a frame would hold fewer than 8 samples, the movement is shorter than one, or only the bin
        at 0 Hz lies below `high_hz`.
    """
    length = n_of(view, frame_s)
    if length < 8:
        raise UndefinedFeatureError(
            f"fs is {view.fs:g} Hz; the rule is at least 8 samples in a frame of {frame_s:g} s"
        )
    require(view, length, f"one frame of {frame_s:g} s")
    w = get_window(window, length).astype(np.float32)
    n_fft = 1 << (length - 1).bit_length()
    frames = sliding_window_view(unit32(view), length)[:: n_of(view, hop_s)]
    frequency = np.linspace(0, view.fs / 2, n_fft // 2 + 1)
    n_bins = int(np.searchsorted(frequency, high_hz, side="right"))
    if n_bins < 2:
        raise UndefinedFeatureError(
            f"bins lie every {frequency[1]:g} Hz; the rule is one up to {high_hz:g} Hz"
        )
    power = np.empty((len(frames), n_bins), dtype=np.float32)
    block = np.zeros((BLOCK, n_fft), dtype=np.float32)
    for k in range(0, len(frames), BLOCK):
        n = min(BLOCK, len(frames) - k)
        np.multiply(frames[k : k + n], w, out=block[:n, :length])
        spectra = fft.rfft(block[:n])[:, :n_bins]
        power[k : k + BLOCK] = spectra.real**2 + spectra.imag**2
    power *= np.float32(2 / (view.fs * float(w @ w)))
    power[:, 0] /= 2
    power[:, n_fft // 2 :] /= 2
    return PowerFrames(power, frequency[:n_bins])


@transform
def long_frames(view: PhaseView) -> PowerFrames:
    """Return the power spectra of half-overlapping Hann frames of `LONG_FRAME_S`, at most the movement.

    Raises
    ------
    UndefinedFeatureError
        If the movement holds fewer than 64 samples.
    """
    require(view, 64, "a spectrum")
    frame_s = min(LONG_FRAME_S, view.n_samples / view.fs)
    return power_frames(view, frame_s, frame_s / 2, "hann")


@transform
def autocorrelation(view: PhaseView) -> NDArray[np.float32]:
    """Return r_k = sum_n x_n x_(n+k) of `unit` for k = 0 ... n-1, shape (n,), to about 1e-7 of r_0.

    The movement is cut into pieces of L samples, and the correlations of pieces d apart are the lags around
    d L: short transforms in single precision, several at once, take a third of the time of one long one.
    """
    n, n_pieces = view.n_samples, 8
    length = -(-n // n_pieces)
    n_fft = fft.next_fast_len(2 * length, real=True)
    pieces = np.zeros((n_pieces, length), dtype=np.float32)
    pieces.reshape(-1)[:n] = unit32(view)
    spectra = fft.rfft(pieces, n_fft, axis=1)
    conjugate, cross = spectra.conj(), np.zeros_like(spectra)
    for d in range(n_pieces):
        for i in range(n_pieces - d):
            cross[d] += conjugate[i] * spectra[i + d]
    r = fft.irfft(cross, n_fft, axis=1)
    r[:-1, :length] += r[1:, n_fft - length :]  # lags before those of the next distance
    return np.asarray(r[:, :length].reshape(-1)[:n])


@transform
def spectral_changes(view: PhaseView, length: int, shift: int) -> Samples:
    """Return the mean over bins of D_k^2 for every frame k, shape (n_differences,).

    D_k = |X_k| - |X_(k+1)| with X_k the orthonormal DCT-II of frame k of `length` samples, frames `shift`
    apart [strese2015, eq. 4]. Blocks of float32: neighbouring magnitudes differ by far more than 1e-7 of
    them, and half the memory traffic is half the time.

    Raises
    ------
    UndefinedFeatureError
        If the movement does not hold two frames.
    """
    require(view, length + shift, f"two frames of {length} samples, {shift} apart")
    frames = sliding_window_view(unit32(view), length)[::shift]
    return np.concatenate([_changes(frames[k : k + 65]) for k in range(0, len(frames) - 1, 64)])


def _changes(frames: NDArray[np.float32]) -> NDArray[Any]:
    magnitude: NDArray[np.float32] = fft.dct(frames, axis=1, norm="ortho")
    np.abs(magnitude, out=magnitude)
    change = magnitude[1:] - magnitude[:-1]
    return np.asarray(np.einsum("kj,kj->k", change, change).astype(np.float64) / change.shape[1])


def log10_of(value: float, what: str) -> float:
    """Return log10(value); refuse 0."""
    if not value > 0:
        raise UndefinedFeatureError(f"{what} is {value:g}; the rule is a logarithm of more than 0")
    return float(np.log10(value))
