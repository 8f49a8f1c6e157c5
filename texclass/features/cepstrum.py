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
"""Lower limit of the energy of a filter, relative to the energy of the frame: -120 dB, below the quantisation
noise of any sensor."""


Banks = dict[tuple[float, ...], NDArray[np.float32]]
"""Filter banks, with the arguments of `mel_filters` as keys."""
_active_banks: ContextVar[Banks | None] = ContextVar("banks of filters", default=None)


@contextmanager
def use_filter_banks(banks: Banks) -> Iterator[None]:
    """Use the mel filter banks in `banks` within the context, and add missing ones to `banks`.

    A trained model stores its filter banks, so that a prediction does not have to import librosa, which is
    slow.

    Parameters
    ----------
    banks : dict
        Mapping from arguments of `mel_filters` to filters. Missing filters are added.
    """
    token = _active_banks.set(banks)
    try:
        yield
    finally:
        _active_banks.reset(token)


def mel_filters(
    fs: float, n_fft: int, n_filters: int, low_hz: float, high_hz: float, decay_hz: float
) -> NDArray[np.float32]:
    """Return triangular mel filters (Slaney's scale) with peak 1, multiplied by exp(-f/decay_hz) in each bin.

    Parameters
    ----------
    fs : float
        Sampling rate in Hz.
    n_fft : int
        Length of the Fourier transform in samples.
    n_filters : int
        Number of filters.
    low_hz, high_hz : float
        Band of the filters in Hz.
    decay_hz : float
        Frequency in Hz at which the amplitude has fallen to 1/e. With infinity, the amplitude is constant.

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
        # Filters of unit area are converted to a peak of 1: with norm=None, librosa spends seconds compiling.
        weights = librosa.filters.mel(
            sr=fs, n_fft=n_fft, n_mels=n_filters, fmin=low_hz, fmax=high_hz, norm="slaney", dtype=np.float64
        ).T * ((edges[2:] - edges[:-2]) / 2)
    f = np.arange(n_fft // 2 + 1) * (fs / n_fft)
    if (empty := np.flatnonzero(weights.max(axis=0) == 0)).size:
        i = int(empty[0])
        raise UndefinedFeatureError(
            f"mel filter {i + 1} ({edges[i]:.0f} ... {edges[i + 2]:.0f} Hz) contains no bin of the spectrum "
            f"(bins are {f[1]:.0f} Hz apart). Use fewer filters or longer frames"
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
    """Return the natural log of the filter energies of each non-silent frame, shape (n_frames, n_filters).

    Energies are raised to at least `FLOOR` times the energy of their own frame, so no value depends on
    another frame.
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
    """Return the modified MFCC: the mean over frames of the cepstrum of the mel-filtered power spectrum.

    Each Hamming frame (25 ms, every 15 ms) is processed in four steps: power spectrum, 20 triangular mel
    filters (Slaney's scale) over the band of the accelerometer, natural logarithm, orthonormal DCT-II. There
    is no pre-emphasis and no liftering. Frames are independent of each other, so live streams and recordings
    give the same values.

    Coefficient n (1 ... 13) is bin n of the DCT and the n-th of the paper's 13 coefficients. (The authors
    count bins from 1 and therefore select the numbers 2 ... 14.) Bin 0 contains the level and is omitted, so
    the gain has no effect.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    coefficients : tuple of int
        Numbers of the coefficients as in the paper (default 1 ... 13). The paper selects (2, 5, 6, 8, 12).
    decay_hz : float
        Decay of the filter amplitude with frequency, exp(-f/decay_hz), in Hz (default infinity: constant
        amplitude). The effect is small; see Notes.
    n_filters : int
        Number of filters.
    low_hz, high_hz : float
        Band of the filters in Hz. If fs/2 is below `high_hz`, the band ends at fs/2, and the values depend on
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
        If the movement is silent or shorter than a frame, a filter contains no bin, or a coefficient exceeds
        ``n_filters - 1``.

    Notes
    -----
    Section IV-A compares "exponential decaying as well as constant Mel filter bank spectral amplitudes". The
    amplitudes are applied before the logarithm: log(a_i E_i) = log a_i + log E_i. The DCT is linear, so an
    amplitude a_i per filter only adds a constant to each coefficient. Standardisation removes this constant,
    and no classifier of Table I can use it. A decay per bin also shifts the weight within a filter, but this
    effect is small, because filters are narrow compared with 500 Hz. Therefore, the accuracies of texclass
    for the two rows of Table I agree within one percentage point. The published accuracies differ by 1 to 3
    points, in both directions (89 and 88, 88 and 87, 71 and 74 %).

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
        Movement. For an array, also pass `fs` in Hz.
    coefficients, decay_hz, n_filters, low_hz, high_hz, frame_s, hop_s
        See `mfcc`.

    Returns
    -------
    ndarray of shape (len(coefficients),)
        Standard deviation over frames of each coefficient.

    Raises
    ------
    UndefinedFeatureError
        If `mfcc` is undefined, or fewer than two frames are not silent.

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
    undefined_if(len(energies) < 2, "only 1 frame is not silent. Expected at least 2")
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
