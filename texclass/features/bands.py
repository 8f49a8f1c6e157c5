"""Levels of the vibration in frequency bands: how strong they are, and how they change during a movement.

Bands are evenly spaced up to fs/2, or fractions of octaves below; all levels of one movement are sums over
one periodogram, so that a set of many bands costs one Fourier transform. Changes compare the levels of a band
with those of the same band at other times. A sensor that drifts multiplies a band by the same factor at all
times, which cancels: these columns keep what a spectrum loses from one day to the next.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass import fourier
from texclass.features.contract import Gain, feature_in_samples
from texclass.features.movement_filters import level, require, unit32
from texclass.features.phase_view import LONG, PhaseView, transform, undefined_if
from texclass.features.spectra import BLOCK_SAMPLES, window_of
from texclass.recording import Samples, make_read_only

TAPER = 0.1
"""Share of the movement that fades in, and as much that fades out: the rest counts in full."""
FLOOR = 1e-10
"""Least power of a band, relative to the mean power: below it, single precision says nothing."""
N_PARTS = 6
"""Parts whose periodograms the course is taken from."""
FRAME = 64
"""Samples in a frame of `octave_frames`."""
OCTAVES = ("o0", "o1", "o2", "o3", "o4")
"""What a frame resolves: bins 17-32, 9-16, 5-8, 3-4 and 2."""


Periodogram = tuple[NDArray[np.float32], Samples, float]
"""Power density (1/Hz) of each bin, shape (..., n_bins), the least that counts (..., 1), and a bin in Hz."""


def density(periodogram: Periodogram, edges_hz: Samples) -> Samples:
    """Return the mean power density (1/Hz) between neighbouring edges, shape (..., n_edges - 1).

    An edge inside a bin takes its share of it.
    """
    power, least, step_hz = periodogram
    n_bins = power.shape[-1]
    edges = np.minimum(edges_hz / step_hz, n_bins)
    first = np.minimum(edges.astype(np.intp), n_bins - 1)
    sums = np.add.reduceat(power[..., : first[-1] + 1], first, axis=-1, dtype=np.float64)[..., :-1]
    sums *= first[1:] > first[:-1]  # of no bin, reduceat returns the next one
    shares = power[..., first] * (edges - first)
    sums += shares[..., 1:] - shares[..., :-1]
    sums /= edges[1:] - edges[:-1]
    return np.maximum(sums, least, out=sums)


def periodogram(x: NDArray[np.float32], fs: float) -> Periodogram:
    """Return the periodogram of the difference d_t = x_(t+1) - x_t, its ends tapered by a cosine.

    Vibrations fall by 60 dB and more from the lowest frequencies to the highest; the difference levels that,
    so that the strong ones do not leak over the weak ones, and nearly all samples count in full: what a short
    touch needs.

    Parameters
    ----------
    x : ndarray of shape (..., n)
        Signals of one length.
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
    in_four = d.ndim == 1 and n_fft > LONG and n_fft % fourier.LANES == 0
    spectrum = fourier.rfft(d) if in_four else fft.rfft(d)
    power = np.asarray(spectrum.real**2 + spectrum.imag**2, dtype=np.float32)
    power *= np.float32(2 / (fs * (n - 2 * n_taper + 2 * float(fade @ fade))))
    least = (FLOOR / power.shape[-1]) * power.sum(axis=-1, keepdims=True).astype(np.float64)
    undefined_if(not least.all(), "silence: no sample differs from the one before")
    return power, least, fs / n_fft


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
    """Power density in bands of equal width from 0 to fs/2; b1 is the lowest.

    Band i reaches from (i-1) fs/(2 n_bands) to i fs/(2 n_bands). Resonances of a tool or a finger are as wide
    at high frequencies as at low ones; fractions of octaves would merge them.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_bands : int
        Number of bands.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or fewer samples than four a band.
    """
    return even_levels(view, n_bands)


def fraction_names(*, octaves: tuple[int, int], per_octave: int) -> tuple[str, ...]:
    """Return the names of fractions of octaves."""
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
    """Power density in fractions of octaves, counted downwards from fs/2; o2.1 begins at fs/2 / 2^2.

    Octave k reaches from fs/2 / 2^k down to fs/2 / 2^(k+1): what `band_level` is too coarse for. Of a short
    touch, the deep octaves have no value; a set may hold them as a member of their own.

    Parameters
    ----------
    view : PhaseView
        Movement.
    octaves : tuple of int
        First octave, and the one after the last.
    per_octave : int
        Bands in an octave, equal on a logarithmic axis.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or a movement that holds fewer than 1.5 periods of the lowest frequency.
    """
    return octave_levels(view, octaves, per_octave)


@transform
def even_levels(view: PhaseView, n_bands: int) -> Samples:
    """Return what `band_level` is, shape (..., n_bands)."""
    require(view, max(32, 4 * n_bands), f"{n_bands} bands")
    return _levels(view, *_even_bands(view.fs, n_bands))


@transform
def octave_levels(view: PhaseView, octaves: tuple[int, int], per_octave: int) -> Samples:
    """Return what `octave_level` is, shape (..., n_bands)."""
    edges_hz, response = _octaves(view.fs, octaves, per_octave)
    lowest = edges_hz[0]
    require(view, max(32, math.ceil(1.5 * view.fs / lowest)), f"1.5 periods of {lowest:.3g} Hz")
    return _levels(view, edges_hz, response)[..., ::-1]


def _levels(view: PhaseView, edges_hz: Samples, response: Samples) -> Samples:
    """Return the log10 power density between edges: that of the difference over its `response`."""
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
    """Return edges (Hz), and 4 sin^2(pi f / fs) in the middle of each band, the response of a difference."""
    middle = (edges_hz[:-1] + edges_hz[1:]) / 2
    return make_read_only(edges_hz), make_read_only(4 * np.sin(np.pi * middle / fs) ** 2)


@transform
def sixths(view: PhaseView) -> Periodogram:
    """Return the periodograms of six equal parts of the movement, shape (..., 6, n_bins)."""
    x, n = unit32(view), view.n_samples // N_PARTS
    return periodogram(x[..., : N_PARTS * n].reshape(*x.shape[:-1], N_PARTS, n), view.fs)


@transform
def octave_courses(view: PhaseView) -> Samples:
    """Return the log10 power of Hann frames, one after the other, in octaves from fs/2 down.

    Of shape (..., 5, n_frames), in arbitrary units, floored far below the mean.
    """
    require(view, 8 * FRAME, f"8 frames of {FRAME} samples")
    x, n = unit32(view), view.n_samples // FRAME
    frames = x[..., : n * FRAME].reshape(-1, FRAME)
    power = np.empty((len(OCTAVES), len(frames)))
    for k in range(0, len(frames), BLOCK_SAMPLES // FRAME):
        rows = slice(k, k + BLOCK_SAMPLES // FRAME)
        spectra = fft.rfft(frames[rows] * window_of("hann", FRAME))
        power[:, rows] = _parts_of_octaves().T @ np.square(spectra.view(np.float32)).T
    power = np.moveaxis(power.reshape(-1, *x.shape[:-1], n), 0, -2)
    mean = power.mean(axis=(-2, -1), keepdims=True)
    undefined_if(not mean.all(), "silence: no frame holds any power")
    return np.asarray(np.log10(np.maximum(power, FLOOR * mean)))


@functools.cache
def _parts_of_octaves() -> NDArray[np.float32]:
    """Return whether the real and the imaginary part of each bin of a frame count in each octave."""
    octave = len(OCTAVES) - np.ceil(np.log2(np.maximum(np.arange(FRAME // 2 + 1), 1)))
    of_each = octave[:, np.newaxis] == np.arange(len(OCTAVES))
    return make_read_only(np.repeat(of_each, 2, axis=0).astype(np.float32))


@feature_in_samples(
    "log10(1)",
    "texclass; cosine transform over time of log band levels",
    outputs=lambda n_parts, octaves: tuple(
        f"term{j}.o{k}" for j in range(1, n_parts) for k in range(*octaves)
    ),
)
def band_course(view: PhaseView, *, n_parts: int = 3, octaves: tuple[int, int] = (0, 4)) -> Samples:
    """How the level of each octave runs from the first to the last part of a movement.

    With L_i the log10 power density of an octave in part i of n, term j is
    2/n sum_i L_i cos(pi j (i + 1/2)/n): term 1 is positive where the level falls, term 2 where it is higher
    at both ends than in the middle. A surface that warms, wears or stretches changes; so does a hand that
    gets faster, so a classifier should weigh these columns.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_parts : int
        Number of equal parts: 6, or 3 or 2 of several sixths each.
    octaves : tuple of int
        First octave, and the one after the last; octave k reaches from fs/2 / 2^k down to fs/2 / 2^(k+1).
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        For silence, a sixth in which nothing changes, or one that holds fewer than 1.5 periods of the lowest
        frequency.
    """
    low = 3 * 2 ** octaves[1]
    if n_parts not in (2, 3, 6):
        raise ValueError(f"n_parts is {n_parts!r}. Expected 2, 3 or 6")
    require(view, N_PARTS * max(16, low), f"1.5 periods of octave {octaves[1] - 1} in each sixth")
    edges = view.fs / 2 * np.exp2(-np.arange(octaves[1], octaves[0] - 1, -1.0))
    power = density(sixths(view), edges)[..., ::-1]
    lead = power.shape[:-2]
    L = np.log10(power.reshape(*lead, n_parts, N_PARTS // n_parts, -1).mean(axis=-2))
    return np.asarray((_terms(n_parts) @ L).reshape(*lead, -1))


@functools.cache
def _terms(n_parts: int) -> Samples:
    """Return 2/n cos(pi j (i + 1/2)/n) in row j - 1 and column i, shape (n_parts - 1, n_parts)."""
    return make_read_only(fft.dct(np.eye(n_parts), axis=0)[1:] / n_parts)


@feature_in_samples("log10(1)", "texclass; deviation over frames of log band levels", outputs=OCTAVES)
def level_fluctuation(view: PhaseView) -> Samples:
    """How much the log10 power of each octave from fs/2 down deviates from frame to frame.

    Frames of 64 samples: noise of steady level fluctuates least, and the less the wider the octave; grains,
    threads and stick-slip more.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or fewer than 512 samples.
    """
    return np.asarray(octave_courses(view).std(axis=-1))


@feature_in_samples("1", "texclass; autocorrelation of log band levels", outputs=OCTAVES)
def level_persistence(view: PhaseView) -> Samples:
    """Correlation of the log10 power of each octave with that a frame, 64 samples, later.

    Parameters
    ----------
    view : PhaseView
        Movement.
    n_segments : int
        Equal pieces to compute it of, each by itself; see `feature`.

    Raises
    ------
    UndefinedFeatureError
        For silence, fewer than 512 samples, or an octave whose level never changes.
    """
    L = octave_courses(view)
    L = L - L.mean(axis=-1, keepdims=True)
    variance = np.mean(L * L, axis=-1)
    undefined_if(
        not variance.min() > 1e-12,
        f"the level of octave {variance.argmin()} is constant. Expected one that changes",
    )
    return np.asarray(np.mean(L[..., 1:] * L[..., :-1], axis=-1) / variance)
