"""Modified mel-frequency cepstral coefficients (MFCC) of the movement [strese2015, section IV-A]."""

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
"""Smallest energy of a filter relative to its frame: -120 dB, below the rounding error of any sensor."""


Banks = dict[tuple[float, ...], NDArray[np.float32]]
"""Filter banks by the arguments of `mel_filters`."""
_active_banks: ContextVar[Banks | None] = ContextVar("banks of filters", default=None)


@contextmanager
def use_filter_banks(banks: Banks) -> Iterator[None]:
    """Use the mel filter banks in `banks`, and add missing ones to it.

    A trained model stores the filter banks that it needs, because importing librosa takes longer than a
    prediction.

    Parameters
    ----------
    banks : dict
        Arguments of `mel_filters` -> filters.
    """
    token = _active_banks.set(banks)
    try:
        yield
    finally:
        _active_banks.reset(token)


def mel_filters(
    fs: float, n_fft: int, n_filters: int, low_hz: float, high_hz: float, decay_hz: float
) -> NDArray[np.float32]:
    """Return triangular mel filters (Slaney's scale) with peaks of 1, times exp(-f/decay_hz) in every bin.

    Parameters
    ----------
    fs : float
        Sampling rate in Hz.
    n_fft : int
        Length of the transform.
    n_filters : int
        Number of filters.
    low_hz, high_hz : float
        Band of the filters in Hz.
    decay_hz : float
        Frequency in Hz at which the amplitude has fallen to 1/e; infinity for constant amplitudes.

    Returns
    -------
    ndarray of shape (n_fft // 2 + 1, n_filters)

    Raises
    ------
    UndefinedFeatureError
        If a filter contains no bin.
    """
    key = (fs, n_fft, n_filters, low_hz, high_hz, decay_hz)
    banks = _active_banks.get()
    if banks is None:
        return _mel_filters(*key)
    if key not in banks:
        banks[key] = _mel_filters(*key)
    return banks[key]


@functools.lru_cache(maxsize=32)
def _mel_filters(
    fs: float, n_fft: int, n_filters: int, low_hz: float, high_hz: float, decay_hz: float
) -> NDArray[np.float32]:
    import librosa  # slow to import

    edges = librosa.mel_frequencies(n_filters + 2, fmin=low_hz, fmax=high_hz)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # empty filters raise an error below
        # Unit area, converted to peaks of 1: with norm=None, librosa compiles a function for several seconds.
        weights = librosa.filters.mel(
            sr=fs, n_fft=n_fft, n_mels=n_filters, fmin=low_hz, fmax=high_hz, norm="slaney", dtype=np.float64
        ).T * ((edges[2:] - edges[:-2]) / 2)
    f = np.arange(n_fft // 2 + 1) * (fs / n_fft)
    if (empty := np.flatnonzero(weights.max(axis=0) == 0)).size:
        i = int(empty[0])
        raise UndefinedFeatureError(
            f"mel filter {i + 1} ({edges[i]:.0f} ... {edges[i + 2]:.0f} Hz) contains no bin of the spectrum "
            f"(one every {f[1]:.0f} Hz). Expected at least one per filter: use fewer filters or longer frames"
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
    """Return the natural logarithm of the filter energies of each non-silent frame, (n_frames, n_filters).

    Energies have a floor of `FLOOR` times the energy of the frame, so no value depends on another frame.
    """
    power, frequency = power_frames(view, frame_s, hop_s, "hamming", high_hz)
    n_fft = round(view.fs / frequency[1])
    weights = mel_filters(view.fs, n_fft, n_filters, low_hz, min(high_hz, view.fs / 2), decay_hz)
    energy: NDArray[np.float32] = power @ weights[: frequency.size]
    total = energy.sum(axis=1, keepdims=True)
    is_audible = total[:, 0] > 0
    undefined_if(not is_audible.any(), f"silence: no energy between {low_hz:g} and {high_hz:g} Hz")
    return np.asarray(np.log(np.maximum(energy, np.float32(FLOOR) * total)[is_audible]), dtype=np.float32)


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
    """Return the modified MFCC: mean over frames of the cepstrum of the mel-filtered power spectrum.

    For each Hamming frame (25 ms, every 15 ms): power spectrum, 20 triangular mel filters (Slaney's scale)
    over the band of the accelerometer, natural logarithm, orthonormal DCT-II. There is no pre-emphasis, no
    lifter, and no floor over several frames: each frame is independent, so stream and batch agree.

    Coefficient n is bin n of the DCT, n = 1 ... 13, which is number n of the paper's 13 coefficients. (The
    authors select the one-based numbers 2 ... 14.) Bin 0, the level, is omitted, so the gain has no effect.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    coefficients : tuple of int
        Coefficients by the numbers of the paper (default 1 ... 13). The five that the paper selects are
        (2, 5, 6, 8, 12).
    decay_hz : float
        The amplitude of the filters is exp(-f/decay_hz) in the bin at frequency f; constant for infinity
        (default). See Notes: the effect is small.
    n_filters : int
        Number of filters.
    low_hz, high_hz : float
        Band of the filters in Hz. If fs/2 is below `high_hz`, the band ends at fs/2, and the value depends on
        fs.
    frame_s, hop_s : float
        Length of a frame and distance between the starts of two frames, in s.

    Returns
    -------
    ndarray of shape (len(coefficients),)
        Mean over frames of each coefficient.

    Raises
    ------
    UndefinedFeatureError
        For silence, a movement shorter than a frame, a filter without a bin, or a number above the filters.

    Notes
    -----
    Section IV-A tests "exponential decaying as well as constant Mel filter bank spectral amplitudes". The
    amplitudes are applied before the logarithm: log(a_i E_i) = log a_i + log E_i. An amplitude per filter a_i
    therefore adds a constant to each coefficient. Standardisation removes it, and no classifier of Table I
    can use it. Later steps do not change this: energies are sums, the transform is linear, and the floor is
    120 dB below the energy of the frame. A decay per bin also shifts the weight within a filter, but filters
    are narrow compared with 500 Hz. The two rows of Table I therefore agree within one percentage point here.
    The published ones differ by 1 to 3 points (89 and 88, 88 and 87, 71 and 74 %), in both directions.

    References
    ----------
    `strese2015`, section IV-A.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> mfcc(x, fs=10_000, coefficients=(2, 5)).round(1).tolist()
    [0.4, 0.2]
    >>> mfcc(100 * x, fs=10_000, coefficients=(2, 5)).round(1).tolist()  # no effect of the gain
    [0.4, 0.2]
    """
    energies = log_energies(view, n_filters, low_hz, high_hz, decay_hz, frame_s, hop_s)
    mean = energies.mean(axis=0, dtype=np.float64)  # the transform is linear, so the mean may come first
    return np.asarray((mean @ _cosines(n_filters))[_as_list(coefficients, n_filters)])


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
    """Return the standard deviation over frames of the modified MFCC; see `mfcc`.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement; an array with `fs` in Hz.
    coefficients, decay_hz, n_filters, low_hz, high_hz, frame_s, hop_s
        As in `mfcc`.

    Returns
    -------
    ndarray of shape (len(coefficients),)
        Deviation over frames of each coefficient.

    Raises
    ------
    UndefinedFeatureError
        As `mfcc`, and for fewer than two non-silent frames.

    References
    ----------
    `strese2015`, section IV-A, extended.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> mfcc_deviation(x, fs=10_000, coefficients=(2, 5)).round(1).tolist()
    [1.1, 0.9]
    """
    energies = log_energies(view, n_filters, low_hz, high_hz, decay_hz, frame_s, hop_s)
    undefined_if(len(energies) < 2, "1 non-silent frame. Expected at least 2 for a deviation")
    frames = energies @ _cosines(n_filters)
    return np.asarray(frames[:, _as_list(coefficients, n_filters)].std(axis=0))


@functools.cache
def _cosines(n_filters: int) -> Samples:
    """Return the orthonormal DCT-II as a matrix with one column per coefficient."""
    return make_read_only(fft.dct(np.eye(n_filters), axis=1, norm="ortho"))


def _as_list(coefficients: tuple[int, ...], n_filters: int) -> list[int]:
    if invalid := [n for n in coefficients if not 1 <= n < n_filters]:
        raise UndefinedFeatureError(
            f"coefficients must be 1 ... {n_filters - 1} (n_filters - 1), got {invalid[0]}"
        )
    return list(coefficients)
