"""Power spectra of a movement and of its frames, each computed once per view."""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.movement_filters import n_of, require, spectrum, unit32
from texclass.features.phase_view import PhaseView, transform, undefined_if
from texclass.recording import Samples, make_read_only

BAND_HZ = 2100.0
"""Upper end of `mean_spectrum` in Hz: 1.5 times the bandwidth of the sensor in strese2015."""
BLOCK = 128
"""Maximum number of frames per transform call, so that a block fits into the cache of the processor."""
LONG_FRAME_S = 0.4096
"""Length of a frame of `long_frames` in s: 4096 samples at the 10 kHz of strese2015."""
BLOCK_SAMPLES = 1 << 16
"""Maximum number of samples per transform call (256 kB), so that a block of long frames also fits into the
cache."""


@transform
def mean_spectrum(view: PhaseView) -> tuple[Samples, Samples]:
    """Return the frequencies (Hz) and the power density of `unit` (1/Hz), both of shape (n_bins,).

    The power density is the periodogram of the whole movement up to `BAND_HZ`, or up to and including fs/2 if
    that is lower. It is averaged over intervals of 1 Hz, or not averaged if the movement is shorter than 1 s.

    Raises
    ------
    UndefinedFeatureError
        If the movement has fewer than 64 samples, or the spectrum fewer than 8 bins.
    """
    require(view, 64, "a spectrum")
    x = spectrum(view)
    step = view.fs / (2 * (x.size - 1))
    width = max(1.0, step)
    is_full_band = view.fs / 2 <= BAND_HZ
    if is_full_band:
        n_bins = x.size if width == step else int(np.ceil(view.fs / 2 - 1e-6))
    else:
        n_bins = int(BAND_HZ / width)
    undefined_if(n_bins < 8, f"fs is {view.fs:g} Hz. Expected a spectrum of at least 8 bins of {width:g} Hz")
    first = np.ceil(np.arange(n_bins + 1) * (width / step) - 1e-6).astype(np.intp)
    first[-1] = x.size if is_full_band else first[-1]
    power, n_in = x[: first[-1]].real ** 2 + x[: first[-1]].imag ** 2, np.diff(first).astype(np.float64)
    if is_full_band:  # the bin at fs/2 has no mirror image
        power[-1] /= 2
        n_in[-1] = max(n_in[-1] - 1, 1.0)
    power = np.add.reduceat(power, first[:-1], dtype=np.float64) / n_in
    offset = 0.5 if width > step else 0.0
    frequency = np.asarray((np.arange(n_bins) + offset) * width, dtype=np.float64)
    return frequency, np.asarray(power * (2 / (view.fs * view.n_samples)))


def frames_of(x: NDArray[np.float32], length: int, hop: int = 1) -> NDArray[np.float32]:
    """Return a view of the frames of contiguous samples, shape (n_frames, length).

    Callers must not write to it. `numpy.lib.stride_tricks.sliding_window_view` is not used, because it takes
    as long as the transform of several frames.
    """
    n_frames, step = (x.size - length) // hop + 1, x.itemsize
    return np.ndarray((n_frames, length), x.dtype, x, strides=(hop * step, step))


def autocorrelation(view: PhaseView) -> NDArray[np.float32]:
    """Return the autocorrelation r_k = sum_n x_n x_(n+k) of `unit` for k = 0 ... n-1, shape (n,).

    The error is 1e-7 r_0. The movement is cut into blocks of L samples. The correlation of two blocks that
    are d blocks apart contributes to the lags around d L. Several short transforms in single precision take a
    third of the time of one long transform.
    """
    n, n_blocks = view.n_samples, 8
    length = -(-n // n_blocks)
    n_fft = fft.next_fast_len(2 * length, real=True)
    blocks = np.zeros((n_blocks, n_fft), dtype=np.float32)
    for i in range(n_blocks):
        block = unit32(view)[i * length : (i + 1) * length]
        blocks[i, : block.size] = block
    spectra = fft.rfft(blocks, axis=1)
    del blocks  # 0.6 GB with the spectra for one hour at 10 kHz
    cross = np.zeros_like(spectra)
    for d in range(n_blocks):
        for i in range(n_blocks - d):
            cross[d] += spectra[i].conj() * spectra[i + d]
    del spectra
    r = fft.irfft(cross, n_fft, axis=1, overwrite_x=True)
    r[:-1, :length] += r[1:, n_fft - length :]  # lags below d L
    return np.asarray(r[:, :length].reshape(-1)[:n])


@transform
def power_frames(
    view: PhaseView, frame_s: float, hop_s: float, window: str, high_hz: float = np.inf
) -> tuple[NDArray[np.float32], Samples]:
    """Return the power spectra of windowed frames up to `high_hz`.

    Frames are zero-padded to a power of two.

    Parameters
    ----------
    view : PhaseView
        Movement.
    frame_s, hop_s : float
        Length of a frame and distance between the starts of two frames, in s.
    window : {"hann", "hamming"}
        Window function.
    high_hz : float
        Upper end of the band in Hz (default: fs/2).

    Returns
    -------
    power : ndarray of shape (n_frames, n_bins)
        One-sided power density of each frame of `unit`, in 1/Hz, single precision.
    frequency : ndarray of shape (n_bins,)
        Frequencies in Hz.

    Raises
    ------
    UndefinedFeatureError
        If a frame has fewer than 8 samples, the movement is shorter than a frame, or only the bin at 0 Hz is
        below `high_hz`.
    """
    length = n_of(view, frame_s)
    undefined_if(length < 8, f"fs is {view.fs:g} Hz. Expected at least 8 samples in a frame of {frame_s:g} s")
    require(view, length, f"one frame of {frame_s:g} s")
    w = window_of(window, length)
    n_fft = 1 << (length - 1).bit_length()
    frames = frames_of(unit32(view), length, n_of(view, hop_s))
    frequency = np.linspace(0, view.fs / 2, n_fft // 2 + 1)
    n_bins = int(np.searchsorted(frequency, high_hz, side="right"))
    undefined_if(n_bins < 2, f"bins are {frequency[1]:g} Hz apart. Expected one up to {high_hz:g} Hz")
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
    """Return a periodic "hann" or "hamming" window of shape (length,)."""
    constant = {"hann": 0.5, "hamming": 0.54}[name]
    window = constant + (1 - constant) * np.cos(np.linspace(-np.pi, np.pi, length + 1)[:-1])
    return make_read_only(window.astype(np.float32))


@transform
def long_frames(view: PhaseView) -> tuple[NDArray[np.float32], Samples]:
    """Return the power spectra of half-overlapping Hann frames of `LONG_FRAME_S`.

    A shorter movement forms a single frame.

    Raises
    ------
    UndefinedFeatureError
        If the movement has fewer than 64 samples.
    """
    require(view, 64, "a spectrum")
    frame_s = min(LONG_FRAME_S, view.n_samples / view.fs)
    return power_frames(view, frame_s, frame_s / 2, "hann")


@transform
def spectral_moments(view: PhaseView) -> tuple[Samples, Samples]:
    """Return the spectral centroid and spread (Hz) of each non-silent frame of `long_frames`.

    The centroid is SC = sum f P / sum P, and the spread is sqrt(sum (f - SC)^2 P / sum P). Frequencies are
    taken relative to the middle of the band to avoid cancellation.
    """
    power, frequency = long_frames(view)
    middle = frequency[-1] / 2
    f = frequency - middle
    total, first, second = (power.astype(np.float64) @ np.stack([f**0, f, f**2], axis=1)).T
    is_audible = total > 0
    centroid, square = first[is_audible] / total[is_audible], second[is_audible] / total[is_audible]
    return centroid + middle, np.sqrt(np.maximum(square - centroid**2, 0))


@transform
def spectral_changes(view: PhaseView, length: int, shift: int) -> Samples:
    """Return the mean over bins of D_k^2 for every pair of adjacent frames, shape (n_pairs,).

    D_k = |X_k| - |X_(k+1)|, where X_k is the orthonormal DCT-II of frame k. Frames have `length` samples and
    start every `shift` samples [strese2015, eq. 4]. The computation uses single precision, which halves the
    computing time. It is accurate enough, because adjacent magnitudes differ by much more than 1e-7.

    Raises
    ------
    UndefinedFeatureError
        If the movement has fewer than two frames.
    """
    require(view, length + shift, f"two frames of {length} samples, {shift} apart")
    frames = frames_of(unit32(view), length, shift)
    blocks = (magnitudes(frames[k : k + 65]) for k in range(0, len(frames) - 1, 64))
    return np.concatenate([mean_square(block[1:] - block[:-1]) for block in blocks])


def magnitudes(frames: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the magnitudes of the orthonormal DCT-II of each frame, shape (n_frames, length)."""
    magnitude: NDArray[np.float32] = fft.dct(frames, axis=1, norm="ortho")
    return np.abs(magnitude, out=magnitude)


def mean_square(change: NDArray[np.float32]) -> Samples:
    """Return the mean square of each row."""
    return np.asarray(np.einsum("kj,kj->k", change, change).astype(np.float64) / change.shape[1])


def evenly_spaced(last: int, step: int, n_max: int) -> NDArray[np.intp]:
    """Return up to `n_max` integers from 0 to `last`, evenly spaced with a distance of at least `step`."""
    n = min(n_max, last // step + 1)
    return np.arange(n) * last // max(1, n - 1)
