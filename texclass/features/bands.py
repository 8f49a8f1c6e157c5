"""Levels of the vibration in frequency bands, and their changes during a movement.

The bands are either of equal width from 0 to fs/2 or fractions of octaves. All levels of a movement are sums
over one periodogram, so any number of bands requires only one Fourier transform. The features of change
(`band_course`, `level_fluctuation`, `level_persistence`) compare the level of a band at different times of
one movement. Drift of the sensor from day to day multiplies the power of a band by a constant factor. This
factor cancels, so these features are stable from day to day.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass import fourier
from texclass.features.contract import Gain, feature_in_samples
from texclass.features.movement_filters import level, require, unit32
from texclass.features.phase_view import LONG_SAMPLES, PhaseView, transform, undefined_if
from texclass.features.spectra import BLOCK_SAMPLES, window_of
from texclass.recording import Samples, make_read_only

TAPER = 0.1
"""Fraction of the movement that is tapered at each end."""
FLOOR = 1e-10
"""Lower limit of the power of a band, relative to the mean power. Smaller values are rounding errors of
single precision."""
N_PARTS = 6
"""Number of equal parts into which `band_course` divides a movement; each part has its own periodogram."""
FRAME = 64
"""Samples per frame of `octave_courses`."""
OCTAVES = ("o0", "o1", "o2", "o3", "o4")
"""Octaves that a frame of `FRAME` samples resolves, from fs/2 down: bins 17-32, 9-16, 5-8, 3-4 and 2."""


Periodogram = tuple[NDArray[np.float32], Samples, float]
"""Power density (1/Hz) of each bin, shape (..., n_bins); its lower limit, shape (..., 1); and the bin width
in Hz."""


def density(periodogram: Periodogram, edges_hz: Samples) -> Samples:
    """Return the mean power density (1/Hz) between adjacent edges, shape (..., n_edges - 1).

    The power of a bin that contains an edge is divided between both bands in proportion.
    """
    power, floor, step_hz = periodogram
    n_bins = power.shape[-1]
    edges = np.minimum(edges_hz / step_hz, n_bins)
    first = np.minimum(edges.astype(np.intp), n_bins - 1)
    sums = np.add.reduceat(power[..., : first[-1] + 1], first, axis=-1, dtype=np.float64)[..., :-1]
    sums *= first[1:] > first[:-1]  # reduceat returns the next bin for an empty range
    shares = power[..., first] * (edges - first)
    sums += shares[..., 1:] - shares[..., :-1]
    sums /= edges[1:] - edges[:-1]
    return np.maximum(sums, floor, out=sums)


def periodogram(x: NDArray[np.float32], fs: float) -> Periodogram:
    """Return the periodogram of the difference d_t = x_(t+1) - x_t, with cosine-tapered ends.

    The spectrum of a vibration falls by 60 dB and more from low to high frequencies. Differencing flattens
    the spectrum and thus prevents leakage from strong to weak frequencies. Only the ends are tapered, so that
    most samples of a short window have full weight.

    Parameters
    ----------
    x : ndarray of shape (..., n)
        Signals of the same length.
    fs : float
        Sampling rate in Hz.

    Raises
    ------
    UndefinedFeatureError
        If all differences of a signal are 0.
    """
    n = x.shape[-1] - 1
    n_fft, n_taper = fft.next_fast_len(n, real=True), max(1, round(TAPER * n))
    d, fade = np.zeros((*x.shape[:-1], n_fft), dtype=np.float32), _fade(n_taper)
    np.subtract(x[..., 1:], x[..., :-1], out=d[..., :n])
    d[..., :n_taper] *= fade
    d[..., n - n_taper : n] *= fade[::-1]
    is_long = d.ndim == 1 and n_fft > LONG_SAMPLES and n_fft % fourier.LANES == 0
    spectrum = fourier.rfft(d) if is_long else fft.rfft(d)
    power = np.asarray(spectrum.real**2 + spectrum.imag**2, dtype=np.float32)
    power *= np.float32(2 / (fs * (n - 2 * n_taper + 2 * float(fade @ fade))))
    floor = (FLOOR / power.shape[-1]) * power.sum(axis=-1, keepdims=True).astype(np.float64)
    undefined_if(not floor.all(), "silence: all samples are equal")
    return power, floor, fs / n_fft


@functools.lru_cache(maxsize=8)
def _fade(n: int) -> NDArray[np.float32]:
    return make_read_only((0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n)).astype(np.float32))


@transform
def whole_periodogram(view: PhaseView) -> Periodogram:
    """Return the `periodogram` of the whole movement."""
    require(view, 32, "a periodogram")
    return periodogram(unit32(view), view.fs)


@feature_in_samples(
    "log10((m/s^2)^2/Hz)",
    "texclass; log power spectrum in bands of equal width",
    outputs="b{n_bands}",
    gain=Gain(shift=2),
)
def band_level(view: PhaseView, *, n_bands: int = 24) -> Samples:
    """Return the power density in bands of equal width from 0 to fs/2, in log10.

    Band i covers (i-1) fs/(2 n_bands) to i fs/(2 n_bands). The resonances of a tool or a finger have similar
    widths in Hz at all frequencies, so bands that widen with frequency would merge the high resonances.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_bands : int
        Number of bands.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (n_bands,)
        Levels in log10((m/s^2)^2/Hz), lowest band first.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than four samples per band.

    References
    ----------
    texclass; periodogram in bands of equal width.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> band_level(x, fs=10_000, n_bands=4).round(1).tolist()  # density of white noise: log10(1 / 5000)
    [-3.6, -3.7, -3.7, -3.7]
    """
    return even_levels(view, n_bands)


def fraction_names(*, octaves: tuple[int, int], per_octave: int) -> tuple[str, ...]:
    """Return the output names of fractional octaves, for example "o2.1"."""
    first, last = octaves
    return tuple(
        f"o{first + i // per_octave}.{i % per_octave + 1}" for i in range((last - first) * per_octave)
    )


@feature_in_samples(
    "log10((m/s^2)^2/Hz)",
    "texclass; log power spectrum in fractions of octaves",
    outputs=fraction_names,
    gain=Gain(shift=2),
)
def octave_level(view: PhaseView, *, octaves: tuple[int, int] = (2, 5), per_octave: int = 3) -> Samples:
    """Return the power density in fractions of octaves, counted down from fs/2, in log10.

    Octave k covers fs/2 / 2^(k+1) to fs/2 / 2^k. The band "o2.1" is the highest band of octave 2. These bands
    resolve frequencies that are too low for `band_level`. The lowest octaves are undefined for short windows.
    A feature set can list them as a separate feature, so that the higher octaves remain defined.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    octaves : tuple of int
        First octave, and the octave after the last one.
    per_octave : int
        Number of bands per octave, of equal width on a logarithmic axis.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (n_octaves * per_octave,)
        Levels in log10((m/s^2)^2/Hz), highest band first.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or shorter than 2 periods of the lowest frequency.

    References
    ----------
    texclass; periodogram in fractional-octave bands.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.sin(2 * np.pi * 400 * np.arange(10_000) / 10_000)
    >>> levels = octave_level(x, fs=10_000)  # o2 ... o4, 1250 to 156 Hz
    >>> int(levels.argmax())  # 496 to 394 Hz
    4
    """
    return octave_levels(view, octaves, per_octave)


@transform
def even_levels(view: PhaseView, n_bands: int) -> Samples:
    """Return the values of `band_level`, shape (..., n_bands)."""
    require(view, max(32, 4 * n_bands), f"{n_bands} bands")
    return _levels(view, *_even_bands(view.fs, n_bands))


@transform
def octave_levels(view: PhaseView, octaves: tuple[int, int], per_octave: int) -> Samples:
    """Return the values of `octave_level`, shape (..., n_bands)."""
    edges_hz, response = _octaves(view.fs, octaves, per_octave)
    lowest = edges_hz[0]
    require(view, max(32, math.ceil(2 * view.fs / lowest)), f"2 periods of {lowest:.3g} Hz")
    return _levels(view, edges_hz, response)[..., ::-1]


def _levels(view: PhaseView, edges_hz: Samples, response: Samples) -> Samples:
    """Return the log10 power density of the signal between adjacent edges.

    It is the power density of the differenced signal divided by the `response` of the difference.
    """
    power = density(whole_periodogram(view), edges_hz) / response
    return np.asarray(np.log10(power) + 2 * np.log10(level(view)))


@functools.lru_cache(maxsize=32)
def _even_bands(fs: float, n_bands: int) -> tuple[Samples, Samples]:
    return _with_response(np.linspace(0, fs / 2, n_bands + 1), fs)


@functools.lru_cache(maxsize=32)
def _octaves(fs: float, octaves: tuple[int, int], per_octave: int) -> tuple[Samples, Samples]:
    first, stop = octaves
    octave = first + np.arange((stop - first) * per_octave, -1, -1) / per_octave
    return _with_response(fs / 2 * 2.0**-octave, fs)


def _with_response(edges_hz: Samples, fs: float) -> tuple[Samples, Samples]:
    """Return the edges (Hz) and the power response 4 sin^2(pi f / fs) of a difference at each band centre."""
    middle = (edges_hz[:-1] + edges_hz[1:]) / 2
    return make_read_only(edges_hz), make_read_only(4 * np.sin(np.pi * middle / fs) ** 2)


@transform
def part_periodograms(view: PhaseView) -> Periodogram:
    """Return the periodograms of six equal parts of the movement, shape (..., 6, n_bins)."""
    x, n = unit32(view), view.n_samples // N_PARTS
    return periodogram(x[..., : N_PARTS * n].reshape(*x.shape[:-1], N_PARTS, n), view.fs)


@transform
def octave_courses(view: PhaseView) -> Samples:
    """Return the log10 power of successive Hann frames in octaves from fs/2 down.

    The result has the shape (..., 5, n_frames). The unit is arbitrary. Values have a lower limit of `FLOOR`
    times the mean power.
    """
    require(view, 8 * FRAME, f"8 frames of {FRAME} samples")
    x, n = unit32(view), view.n_samples // FRAME
    frames = x[..., : n * FRAME].reshape(-1, FRAME)
    power = np.empty((len(OCTAVES), len(frames)))
    for k in range(0, len(frames), BLOCK_SAMPLES // FRAME):
        rows = slice(k, k + BLOCK_SAMPLES // FRAME)
        spectra = fft.rfft(frames[rows] * window_of("hann", FRAME))
        power[:, rows] = _octave_weights().T @ np.square(spectra.view(np.float32)).T
    power = np.moveaxis(power.reshape(-1, *x.shape[:-1], n), 0, -2)
    mean = power.mean(axis=(-2, -1), keepdims=True)
    undefined_if(not mean.all(), "silence: no frame has any power")
    return np.asarray(np.log10(np.maximum(power, FLOOR * mean)))


@functools.cache
def _octave_weights() -> NDArray[np.float32]:
    """Return the weight (0 or 1) of the real and imaginary part of each bin of a frame in each octave."""
    octave = len(OCTAVES) - np.ceil(np.log2(np.maximum(np.arange(FRAME // 2 + 1), 1)))
    is_in_octave = octave[:, np.newaxis] == np.arange(len(OCTAVES))
    return make_read_only(np.repeat(is_in_octave, 2, axis=0).astype(np.float32))


@feature_in_samples(
    "log10(1)",
    "texclass; cosine transform over time of log band levels",
    outputs=lambda n_parts, octaves: tuple(
        f"term{j}.o{k}" for j in range(1, n_parts) for k in range(*octaves)
    ),
)
def band_course(view: PhaseView, *, n_parts: int = 3, octaves: tuple[int, int] = (0, 4)) -> Samples:
    """Return the trend of the level of each octave during a movement, as coefficients of a DCT over time.

    Let L_i be the log10 power density of an octave in part i of n. Term j is 2/n sum_i L_i cos(pi j (i +
    1/2)/n). Term 1 is positive if the level falls, and term 2 if the level is higher at both ends than in the
    middle. The terms describe how a surface warms, wears or stretches. They also depend on changes of the
    speed of the hand, which limits their reliability.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_parts : int
        Number n of equal parts: 2, 3 or 6.
    octaves : tuple of int
        First octave, and the octave after the last one. Octave k covers fs/2 / 2^(k+1) to fs/2 / 2^k.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape ((n_parts - 1) * n_octaves,)
        Term 1 of each octave, then term 2 of each octave, and so on.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent, or a sixth of it is constant or shorter than 1.5 periods of the lowest
        frequency.

    References
    ----------
    texclass; cosine transform over time of log band levels.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000) * np.linspace(2, 1, 10_000)  # becomes weaker
    >>> band_course(x, fs=10_000, n_parts=2, octaves=(0, 2)).round(1).tolist()
    [0.2, 0.2]
    """
    low = 3 * 2 ** octaves[1]
    if n_parts not in (2, 3, 6):
        raise ValueError(f"n_parts must be 2, 3 or 6, got {n_parts!r}")
    require(view, N_PARTS * max(16, low), f"1.5 periods of octave {octaves[1] - 1} in each sixth")
    edges = view.fs / 2 * np.exp2(-np.arange(octaves[1], octaves[0] - 1, -1.0))
    power = density(part_periodograms(view), edges)[..., ::-1]
    lead = power.shape[:-2]
    L = np.log10(power.reshape(*lead, n_parts, N_PARTS // n_parts, -1).mean(axis=-2))
    return np.asarray((_terms(n_parts) @ L).reshape(*lead, -1))


@functools.cache
def _terms(n_parts: int) -> Samples:
    """Return the weights 2/n cos(pi j (i + 1/2)/n) in row j - 1, column i, shape (n_parts - 1, n_parts)."""
    return make_read_only(fft.dct(np.eye(n_parts), axis=0)[1:] / n_parts)


@feature_in_samples("log10(1)", "texclass; deviation over frames of log band levels", outputs=OCTAVES)
def level_fluctuation(view: PhaseView) -> Samples:
    """Return the standard deviation over frames of the log10 power of each octave from fs/2 down.

    Frames have 64 samples. The deviation is smallest for noise of constant level, where it decreases with the
    width of the octave. Grains, threads and stick-slip increase it.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (5,)
        Standard deviations in log10(1), highest octave first.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent or has fewer than 512 samples.

    References
    ----------
    texclass; deviation over frames of log band levels.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> level_fluctuation(x, fs=10_000).round(1).tolist()
    [0.2, 0.2, 0.3, 0.4, 0.5]
    """
    return np.asarray(octave_courses(view).std(axis=-1))


@feature_in_samples("1", "texclass; autocorrelation of log band levels", outputs=OCTAVES)
def level_persistence(view: PhaseView) -> Samples:
    """Return the correlation of the log10 power of each octave between successive frames of 64 samples.

    Parameters
    ----------
    view : PhaseView or array_like of shape (n,)
        Movement. For an array, also pass `fs` in Hz.
    n_segments : int
        Number of equal segments on which the feature is computed (default 1); see `feature`.

    Returns
    -------
    ndarray of shape (5,)
        Correlations, highest octave first.

    Raises
    ------
    UndefinedFeatureError
        If the movement is silent, has fewer than 512 samples, or has an octave with a constant level.

    References
    ----------
    texclass; autocorrelation of log band levels.

    Examples
    --------
    >>> import numpy as np
    >>> bursts = 1 + 5 * (np.sin(np.arange(10_000) / 300) > 0)
    >>> x = np.random.default_rng(0).standard_normal(10_000)
    >>> level_persistence(x * bursts, fs=10_000).round(1).tolist()
    [0.8, 0.8, 0.8, 0.7, 0.7]
    >>> bool(abs(level_persistence(x, fs=10_000)).max() < 0.2)  # steady noise
    True
    """
    L = octave_courses(view)
    L = L - L.mean(axis=-1, keepdims=True)
    variance = np.mean(L * L, axis=-1)
    undefined_if(
        not variance.min() > 1e-12,
        f"the level of octave {variance.argmin()} is constant. Expected a varying level in each octave",
    )
    return np.asarray(np.mean(L[..., 1:] * L[..., :-1], axis=-1) / variance)
