"""Modified mel-frequency cepstral coefficients of the movement [strese2015, section IV-A]."""

import functools
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.contract import UndefinedFeatureError, feature
from texclass.features.phase_view import PhaseView, transform, undefined_if
from texclass.features.spectra import power_frames
from texclass.recording import Samples, make_read_only

ALL = tuple(range(1, 14))
FLOOR = 1e-12
"""Least energy of a filter, in energies of its frame: -120 dB, below the rounding of any sensor."""


Banks = dict[tuple[float, ...], NDArray[np.float32]]
_given: ContextVar[Banks | None] = ContextVar("banks of filters", default=None)


@contextmanager
def with_banks(banks: Banks) -> Iterator[None]:
    """Take banks of mel filters, by the arguments of `mel_filters`, from here; what is missing is added.

    A trained model keeps those that it needs: loading librosa takes longer than an answer.
    """
    token = _given.set(banks)
    try:
        yield
    finally:
        _given.reset(token)


def mel_filters(
    fs: float, n_fft: int, n_filters: int, low_hz: float, high_hz: float, decay_hz: float
) -> NDArray[np.float32]:
    """Return triangular mel filters (Slaney's scale) of peak 1, times exp(-f/decay_hz) at every bin.

    Parameters
    ----------
    fs : float
        Sampling rate in Hz.
    n_fft : int
        Points of the transform.
    n_filters : int
        How many filters.
    low_hz, high_hz : float
        Their band, in Hz.
    decay_hz : float
        Where their amplitude has fallen to 1/e, in Hz.

    Returns
    -------
    ndarray of shape (n_fft // 2 + 1, n_filters)

    Raises
    ------
    UndefinedFeatureError
        If a filter holds no bin.
    """
    key = (fs, n_fft, n_filters, low_hz, high_hz, decay_hz)
    banks = _given.get()
    if banks is None:
        return _mel_filters(*key)
    if key not in banks:
        banks[key] = _mel_filters(*key)
    return banks[key]


@functools.lru_cache(maxsize=32)
def _mel_filters(
    fs: float, n_fft: int, n_filters: int, low_hz: float, high_hz: float, decay_hz: float
) -> NDArray[np.float32]:
    import librosa  # loads what is used of it when it is used

    edges = librosa.mel_frequencies(n_filters + 2, fmin=low_hz, fmax=high_hz)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about empty filters: an error here
        # Of unit area, undone below: to scale peaks to 1, librosa would compile a normalisation for seconds.
        weights = librosa.filters.mel(
            sr=fs, n_fft=n_fft, n_mels=n_filters, fmin=low_hz, fmax=high_hz, norm="slaney", dtype=np.float64
        ).T * ((edges[2:] - edges[:-2]) / 2)
    f = np.arange(n_fft // 2 + 1) * (fs / n_fft)
    if (empty := np.flatnonzero(weights.max(axis=0) == 0)).size:
        i = int(empty[0])
        raise UndefinedFeatureError(
            f"mel filter {i + 1} ({edges[i]:.0f} ... {edges[i + 2]:.0f} Hz) holds no bin of the spectrum "
            f"(every {f[1]:.0f} Hz). Expected at least one"
        )
    weights = weights * np.exp(-f / decay_hz)[:, np.newaxis]
    return make_read_only(np.array(weights, dtype=np.float32, order="C"))


@transform
def log_energies(
    view: PhaseView,
    n_filters: int,
    low_hz: float,
    high_hz: float,
    decay_hz: float,
    frame_s: float,
    hop_s: float,
) -> NDArray[np.float32]:
    """Return ln of the filters' energies, frame by frame without silent ones, shape (n_frames, n_filters).

    A filter's energy is kept above `FLOOR` times that of its own frame: no value depends on another frame.
    """
    power, frequency = power_frames(view, frame_s, hop_s, "hamming", high_hz)
    n_fft = round(view.fs / frequency[1])
    weights = mel_filters(view.fs, n_fft, n_filters, low_hz, min(high_hz, view.fs / 2), decay_hz)
    energy: NDArray[np.float32] = power @ weights[: frequency.size]
    total = energy.sum(axis=1, keepdims=True)
    heard = total[:, 0] > 0
    undefined_if(not heard.any(), f"silence: no energy between {low_hz:g} and {high_hz:g} Hz")
    return np.asarray(np.log(np.maximum(energy, np.float32(FLOOR) * total)[heard]), dtype=np.float32)


@feature("movement", "1", "strese2015, section IV-A", outputs="c{coefficients}")
def mfcc(
    view: PhaseView,
    *,
    coefficients: tuple[int, ...] = ALL,
    decay_hz: float = math.inf,
    n_filters: int = 20,
    low_hz: float = 0.0,
    high_hz: float = 1400.0,
    frame_s: float = 0.025,
    hop_s: float = 0.015,
) -> Samples:
    """MFCC, modified: mean over frames of the cepstrum of the mel-filtered power spectrum.

    Each 25 ms Hamming frame, every 15 ms: power spectrum, 20 triangular mel filters (Slaney's scale) over the
    band of the accelerometer, natural logarithm, orthonormal DCT-II. No pre-emphasis and no lifter, and no
    floor that spans frames: the value of a frame depends on that frame alone, so stream equals batch.

    Coefficient n here is bin n of the DCT, n = 1 ... 13: number n of the paper's 13, which the authors take
    from the usual one-based numbers 2 ... 14. Bin 0, the level, is left out: a gain changes nothing.

    Parameters
    ----------
    view : PhaseView
        Movement.
    coefficients : tuple of int
        Which, by the paper's numbers; its selected five are (2, 5, 6, 8, 12).
    decay_hz : float
        Filter amplitudes fall as exp(-f/decay_hz) with the frequency f of each *bin*; inf leaves them
        constant. See Notes: this changes hardly more than an offset that all recordings share.
    n_filters : int
        Number of filters.
    low_hz, high_hz : float
        Band of the filters in Hz; it ends at fs/2 if that is lower, and the value then depends on fs.
    frame_s, hop_s : float
        Length of a frame and distance of two starts, in s.

    Returns
    -------
    ndarray of shape (len(coefficients),)

    Raises
    ------
    UndefinedFeatureError
        For silence, a movement shorter than a frame, a filter without a bin, or a number beyond the filters.

    Notes
    -----
    Section IV-A tests "exponential decaying as well as constant Mel filter bank spectral amplitudes". These
    act before the logarithm: log(a_i E_i) = log a_i + log E_i. An amplitude a_i per filter therefore adds one
    constant to each coefficient, which standardisation removes and no classifier of Table I sees. Nothing
    between the filters and the cepstrum prevents this: energies are sums, the transform is linear, and the
    floor is 120 dB below the energy of the frame. A decay per bin also shifts the weight within a filter, but
    filters are narrow beside 500 Hz. The two rows of Table I therefore agree within one point here; the
    published ones differ by 1 to 3 points (89 and 88, 88 and 87, 71 and 74 %), in both directions.
    """
    energies = log_energies(view, n_filters, low_hz, high_hz, decay_hz, frame_s, hop_s)
    mean = energies.mean(axis=0, dtype=np.float64)  # the transform is linear: of the mean is the mean of all
    return np.asarray((mean @ _cosines(n_filters))[_checked(coefficients, n_filters)])


@feature("movement", "1", "strese2015, section IV-A, extended", outputs="c{coefficients}")
def mfcc_deviation(
    view: PhaseView,
    *,
    coefficients: tuple[int, ...] = ALL,
    decay_hz: float = math.inf,
    n_filters: int = 20,
    low_hz: float = 0.0,
    high_hz: float = 1400.0,
    frame_s: float = 0.025,
    hop_s: float = 0.015,
) -> Samples:
    """Deviation over frames of the modified MFCC: how steady the surface sounds; see `mfcc`.

    Parameters
    ----------
    view : PhaseView
        Movement.
    coefficients, decay_hz, n_filters, low_hz, high_hz, frame_s, hop_s
        As in `mfcc`.

    Returns
    -------
    ndarray of shape (len(coefficients),)

    Raises
    ------
    UndefinedFeatureError
        As `mfcc`, and for fewer than two frames that are not silent.
    """
    energies = log_energies(view, n_filters, low_hz, high_hz, decay_hz, frame_s, hop_s)
    undefined_if(len(energies) < 2, "1 frame that is not silent. Expected at least 2 for a deviation")
    frames = energies @ _cosines(n_filters)
    return np.asarray(frames[:, _checked(coefficients, n_filters)].std(axis=0))


@functools.cache
def _cosines(n_filters: int) -> Samples:
    """Return the orthonormal DCT-II as a matrix, a column each coefficient."""
    return make_read_only(fft.dct(np.eye(n_filters), axis=1, norm="ortho"))


def _checked(coefficients: tuple[int, ...], n_filters: int) -> list[int]:
    if wrong := [n for n in coefficients if not 1 <= n < n_filters]:
        raise UndefinedFeatureError(f"coefficient {wrong[0]}. Expected 1 ... {n_filters - 1} (filters - 1)")
    return list(coefficients)
