"""Transforms of a movement that several features share; each is computed once per view.

What is needed of all of them stands here, with transforms of the whole movement; `frames` has those of its
frames, `filtered` has filtered copies.

All of them work on `unit`, the samples divided by their largest magnitude, so that no gain overflows or
underflows in between; a feature puts `level` back as its declared gain law says.
"""

import functools

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.contract import UndefinedFeatureError
from texclass.features.view import PhaseView, transform
from texclass.recording import Samples, read_only

FINEST = 20
"""Largest factor by which a low-passed movement is decimated."""
BAND_HZ = 2100.0
"""End of `mean_spectrum` in Hz: half as much again as the band of the sensor."""
INTERLEAVED = 4
"""Transforms that `low_spectrum` does at once: lanes of single precision in the narrowest vector unit."""
WIDE_HZ = 6000.0
"""Sampling rate from which on a fourth of it holds all that corrected features read from the spectrum."""
BLOCK = 128
"""Frames transformed at a time, so that a block stays in the cache."""


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


def padded_length(view: PhaseView) -> int:
    """Return the length of `spectrum`: a fast multiple of `FINEST` that holds all samples of `unit`."""
    return FINEST * int(fft.next_fast_len(-(-unit(view).size // FINEST)))


@transform
def spectrum(view: PhaseView) -> NDArray[np.complex64]:
    """Return the discrete Fourier transform of `unit32`, zero-padded to `padded_length`."""
    return np.asarray(fft.rfft(unit32(view), padded_length(view)))


@transform
def low_spectrum(view: PhaseView) -> NDArray[np.complex64]:
    """Return the bins 0 ... N/4 of `spectrum` (up to fs/4) to its precision, in 60 % of the time.

    With Y_p the transform of every fourth sample from p on, of period N/4 = M, and Z_p = exp(-2 pi i k p / N)
    Y_p, the sums are X_k = Z_0 + Z_1 + Z_2 + Z_3 and X_(M-k) = conj(Z_0 + i Z_1 - Z_2 - i Z_3): four short
    transforms at once fill the vector unit of a processor, which one long one does not, and the bins above
    fs/4 are never made.
    """
    n_fft, n_low = padded_length(view), padded_length(view) // INTERLEAVED
    samples = np.zeros((n_low, INTERLEAVED), dtype=np.float32)
    samples.reshape(-1)[: view.n_samples] = unit32(view)
    Y: NDArray[np.complex64] = fft.rfft(samples, axis=0)
    w = _turns(len(Y), n_fft)
    square = w * w
    Z0, Z1, Z2, Z3 = Y[:, 0], Y[:, 1] * w, Y[:, 2] * square, Y[:, 3] * (square * w)
    X = np.empty(n_low + 1, dtype=np.complex64)
    X[: len(Y)] = (Z0 + Z2) + (Z1 + Z3)
    X[n_low + 1 - len(Y) :] = np.conj((Z0 - Z2) + 1j * (Z1 - Z3))[::-1]
    return X


@functools.lru_cache(maxsize=2)
def _turns(n: int, n_fft: int) -> NDArray[np.complex64]:
    """Return exp(-2 pi i k / n_fft) for k = 0 ... n-1, as products of coarse and fine turns."""
    fine = int(np.ceil(np.sqrt(n)))
    angle = -2j * np.pi / n_fft * np.arange(fine)
    return read_only(np.outer(np.exp(fine * angle), np.exp(angle)).astype(np.complex64).reshape(-1)[:n])


def first_bins(view: PhaseView, n_bins: int) -> NDArray[np.complex64]:
    """Return the bins 0 ... n_bins-1 of the spectrum, of `low_spectrum` if that suffices for all features."""
    enough = view.fs >= WIDE_HZ and n_bins <= padded_length(view) // INTERLEAVED + 1
    return (low_spectrum(view) if enough else spectrum(view))[:n_bins]


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


def log10_of(value: float, what: str) -> float:
    """Return log10(value); refuse 0."""
    if not value > 0:
        raise UndefinedFeatureError(f"{what} is {value:g}; the rule is a logarithm of more than 0")
    return float(np.log10(value))
