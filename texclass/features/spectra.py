"""Power spectra of a movement, of the whole and of its frames, each computed once per view."""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.movement_filters import n_of, require, spectrum, unit32
from texclass.features.phase_view import PhaseView, transform, undefined_if
from texclass.recording import Samples, make_read_only

BAND_HZ = 2100.0
"""End of `mean_spectrum` in Hz: half as much again as the band of the sensor."""
BLOCK = 128
"""Frames transformed at a time, so that a block stays in the cache."""
LONG_FRAME_S = 0.4096
"""Frame of `long_frames`, in s: 4096 samples at the 10 kHz of strese2015."""
BLOCK_SAMPLES = 1 << 16
"""Samples transformed at a time: 256 kB, so that a block of long frames stays in the cache, too."""


@transform
def mean_spectrum(view: PhaseView) -> tuple[Samples, Samples]:
    """Return frequency (Hz) and power density of `unit` (1/Hz), both of shape (n_bins,).

    The periodogram of the whole movement up to `BAND_HZ`, or fs/2 and what lies at it, averaged over each
    1 Hz from 0 on; of a movement shorter than 1 s, bin by bin.
    """
    require(view, 64, "a spectrum")
    x = spectrum(view)
    step = view.fs / (2 * (x.size - 1))
    width = max(1.0, step)
    whole = view.fs / 2 <= BAND_HZ
    n_bins = (
        int(BAND_HZ / width) if not whole else x.size if width == step else int(np.ceil(view.fs / 2 - 1e-6))
    )
    undefined_if(n_bins < 8, f"fs is {view.fs:g} Hz. Expected a spectrum of 8 bins of {width:g} Hz")
    first = np.ceil(np.arange(n_bins + 1) * (width / step) - 1e-6).astype(np.intp)
    first[-1] = x.size if whole else first[-1]
    power, n_in = x[: first[-1]].real ** 2 + x[: first[-1]].imag ** 2, np.diff(first).astype(np.float64)
    if whole:  # the bin at fs/2 is its own mirror image, and ends the band
        power[-1] /= 2
        n_in[-1] = max(n_in[-1] - 1, 1.0)
    power = np.add.reduceat(power, first[:-1], dtype=np.float64) / n_in
    offset = 0.5 if width > step else 0.0
    frequency = np.asarray((np.arange(n_bins) + offset) * width, dtype=np.float64)
    return frequency, np.asarray(power * (2 / (view.fs * view.n_samples)))


def frames_of(x: NDArray[np.float32], length: int, hop: int = 1) -> NDArray[np.float32]:
    """Return the frames of contiguous samples, (n_frames, length), without copying: nobody may write to them.

    `numpy.lib.stride_tricks.sliding_window_view` takes as long as the transform of some frames.
    """
    n_frames, step = (x.size - length) // hop + 1, x.itemsize
    return np.ndarray((n_frames, length), x.dtype, x, strides=(hop * step, step))


def autocorrelation(view: PhaseView) -> NDArray[np.float32]:
    """Return r_k = sum_n x_n x_(n+k) of `unit` for k = 0 ... n-1, shape (n,), to about 1e-7 of r_0.

    The movement is cut into pieces of L samples, and the correlations of pieces d apart are the lags around
    d L: short transforms in single precision, several at once, take a third of the time of one long one.
    """
    n, n_segments = view.n_samples, 8
    length = -(-n // n_segments)
    n_fft = fft.next_fast_len(2 * length, real=True)
    pieces = np.zeros((n_segments, n_fft), dtype=np.float32)
    for i in range(n_segments):
        part = unit32(view)[i * length : (i + 1) * length]
        pieces[i, : part.size] = part
    spectra = fft.rfft(pieces, axis=1)
    del pieces  # of an hour at 10 kHz this and the spectra are 0.6 GB
    cross = np.zeros_like(spectra)
    for d in range(n_segments):
        for i in range(n_segments - d):
            cross[d] += spectra[i].conj() * spectra[i + d]
    del spectra
    r = fft.irfft(cross, n_fft, axis=1, overwrite_x=True)
    r[:-1, :length] += r[1:, n_fft - length :]  # lags before those of the next distance
    return np.asarray(r[:, :length].reshape(-1)[:n])


@transform
def power_frames(
    view: PhaseView, frame_s: float, hop_s: float, window: str, high_hz: float = np.inf
) -> tuple[NDArray[np.float32], Samples]:
    """Return the power spectra of windowed frames, zero-padded to a power of two, up to `high_hz`.

    Returns
    -------
    power : ndarray of shape (n_frames, n_bins)
        One-sided power density of each frame of `unit`, in 1/Hz, single precision.
    frequency : ndarray of shape (n_bins,)
        In Hz.

    Raises
    ------
    UndefinedFeatureError
        If a frame would hold fewer than 8 samples, the movement is shorter than one, or only the bin
        at 0 Hz lies below `high_hz`.
    """
    length = n_of(view, frame_s)
    undefined_if(length < 8, f"fs is {view.fs:g} Hz. Expected at least 8 samples in a frame of {frame_s:g} s")
    require(view, length, f"one frame of {frame_s:g} s")
    w = window_of(window, length)
    n_fft = 1 << (length - 1).bit_length()
    frames = frames_of(unit32(view), length, n_of(view, hop_s))
    frequency = np.linspace(0, view.fs / 2, n_fft // 2 + 1)
    n_bins = int(np.searchsorted(frequency, high_hz, side="right"))
    undefined_if(n_bins < 2, f"bins lie every {frequency[1]:g} Hz. Expected one up to {high_hz:g} Hz")
    power = np.empty((len(frames), n_bins), dtype=np.float32)
    block = np.zeros((min(BLOCK, max(1, BLOCK_SAMPLES // n_fft)), n_fft), dtype=np.float32)
    for k in range(0, len(frames), len(block)):
        n = min(len(block), len(frames) - k)
        np.multiply(frames[k : k + n], w, out=block[:n, :length])
        spectra = fft.rfft(block[:n])[:, :n_bins]
        power[k : k + n] = spectra.real**2 + spectra.imag**2
    power *= np.float32(2 / (view.fs * float(w @ w)))
    power[:, 0] /= 2
    power[:, n_fft // 2 :] /= 2
    return power, frequency[:n_bins]


@functools.lru_cache(maxsize=32)
def window_of(name: str, length: int) -> NDArray[np.float32]:
    """Return a window, "hann" or "hamming", periodic, shape (length,); made once for each length."""
    constant = {"hann": 0.5, "hamming": 0.54}[name]
    window = constant + (1 - constant) * np.cos(np.linspace(-np.pi, np.pi, length + 1)[:-1])
    return make_read_only(window.astype(np.float32))


@transform
def long_frames(view: PhaseView) -> tuple[NDArray[np.float32], Samples]:
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
def spectral_moments(view: PhaseView) -> tuple[Samples, Samples]:
    """Return centroid and deviation (Hz) of the power spectrum of each of the `long_frames` that has energy.

    SC = sum f P / sum P and sqrt(sum (f - SC)^2 P / sum P), shape (n_frames,) each: the sums over f and f^2
    are those around the middle of the band, so that little is lost where they are subtracted.
    """
    power, frequency = long_frames(view)
    middle = frequency[-1] / 2
    f = frequency - middle
    total, first, second = (power.astype(np.float64) @ np.stack([f**0, f, f**2], axis=1)).T
    heard = total > 0
    centroid, square = first[heard] / total[heard], second[heard] / total[heard]
    return centroid + middle, np.sqrt(np.maximum(square - centroid**2, 0))


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
    frames = frames_of(unit32(view), length, shift)
    blocks = (magnitudes(frames[k : k + 65]) for k in range(0, len(frames) - 1, 64))
    return np.concatenate([mean_square(block[1:] - block[:-1]) for block in blocks])


def magnitudes(frames: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return |X_k|, X_k the orthonormal DCT-II of each frame, shape as given."""
    magnitude: NDArray[np.float32] = fft.dct(frames, axis=1, norm="ortho")
    return np.abs(magnitude, out=magnitude)


def mean_square(change: NDArray[np.float32]) -> Samples:
    """Return the mean over bins of D_k^2 for each row."""
    return np.asarray(np.einsum("kj,kj->k", change, change).astype(np.float64) / change.shape[1])


def spread(last: int, step: int, n_most: int) -> NDArray[np.intp]:
    """Return up to `n_most` starts of frames from 0 to `last`, evenly spread and `step` apart at least."""
    n = min(n_most, last // step + 1)
    return np.arange(n) * last // max(1, n - 1)
