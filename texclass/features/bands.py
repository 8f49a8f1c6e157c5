"""Levels of the vibration in frequency bands: evenly spaced ones up to fs/2, fractions of octaves below.

All of them are sums over one periodogram, so that a set of many bands costs one Fourier transform.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from texclass.features.contract import Gain, UndefinedFeatureError, feature
from texclass.features.divided import divisible, named_pieces
from texclass.features.transforms import level, require, unit32
from texclass.features.view import PhaseView, transform
from texclass.recording import Samples, read_only

TAPER = 0.1
"""Share of the movement that fades in, and as much that fades out: the rest counts in full."""
FLOOR = 1e-10
"""Least power of a band, relative to the mean power: below it, single precision says nothing."""


@dataclass(frozen=True, eq=False)
class Periodogram:
    """Running sum of a periodogram over its bins, so that any band is one difference.

    Attributes
    ----------
    running : ndarray of shape (n_bins + 1,)
        running[k] is the power density (1/Hz) of bins 0 ... k-1, summed.
    step_hz : float
        Distance of two bins.
    """

    running: Samples
    step_hz: float

    def density(self, edges_hz: Samples) -> Samples:
        """Return the mean power density (1/Hz) between neighbouring edges, shape (n_edges - 1,).

        An edge inside a bin takes its share of it.
        """
        edges = np.minimum(edges_hz / self.step_hz, self.running.size - 1)
        below = np.minimum(edges.astype(np.intp), self.running.size - 2)
        sums = self.running[below] + (edges - below) * (self.running[below + 1] - self.running[below])
        floor = FLOOR * self.running[-1] / (self.running.size - 1)
        return np.asarray(np.maximum((sums[1:] - sums[:-1]) / (edges[1:] - edges[:-1]), floor))


def periodogram(x: NDArray[np.float32], fs: float) -> Periodogram:
    """Return the periodogram of the difference d_t = x_(t+1) - x_t, its ends tapered by a cosine.

    Vibrations fall by 60 dB and more from the lowest frequencies to the highest; the difference levels that,
    so that the strong ones do not leak over the weak ones, and nearly all samples count in full: what a short
    touch needs. `density` is that of d; see `Bands`.

    Raises
    ------
    UndefinedFeatureError
        If all differences are 0.
    """
    d = x[1:] - x[:-1]
    n_taper = max(1, round(TAPER * d.size))
    fade = _fade(n_taper)
    d[:n_taper] *= fade
    d[-n_taper:] *= fade[::-1]
    n_fft = fft.next_fast_len(d.size, real=True)
    spectrum = fft.rfft(d, n_fft)
    running = np.zeros(spectrum.size + 1)
    np.cumsum(spectrum.real**2 + spectrum.imag**2, out=running[1:], dtype=np.float64)
    if not running[-1] > 0:
        raise UndefinedFeatureError("silence: no sample differs from the one before")
    weight = d.size - 2 * n_taper + 2 * float(fade @ fade)
    running *= 2 / (fs * weight)
    return Periodogram(running, fs / n_fft)


@functools.lru_cache(maxsize=8)
def _fade(n: int) -> NDArray[np.float32]:
    return read_only((0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n)).astype(np.float32))


@transform
def whole_periodogram(view: PhaseView) -> Periodogram:
    """Return the `periodogram` of the whole movement."""
    require(view, 32, "a periodogram")
    return periodogram(unit32(view), view.fs)


@dataclass(frozen=True, eq=False)
class Bands:
    """Neighbouring bands of a signal; made once for each division and sampling rate.

    Attributes
    ----------
    edges_hz : ndarray of shape (n_bands + 1,)
        Rising.
    tilt : ndarray of shape (n_bands,)
        Power of a difference to that of its signal, |D(f)|^2 / |X(f)|^2 = 4 sin^2(pi f / fs), at the middle
        of each band.
    """

    edges_hz: Samples
    tilt: Samples

    @classmethod
    def between(cls, edges_hz: Samples, fs: float) -> "Bands":
        """Return the bands between edges, of a signal of sampling rate `fs`."""
        middle = (edges_hz[:-1] + edges_hz[1:]) / 2
        return cls(read_only(edges_hz), read_only(4 * np.sin(np.pi * middle / fs) ** 2))


@functools.lru_cache(maxsize=32)
def even_bands(fs: float, n_bands: int) -> Bands:
    """Return bands of equal width from 0 to fs/2."""
    return Bands.between(np.linspace(0, fs / 2, n_bands + 1), fs)


@functools.lru_cache(maxsize=32)
def octave_bands(fs: float, first: int, stop: int, per_octave: int) -> Bands:
    """Return fractions of the octaves `first` ... stop - 1, counted downwards from fs/2; the lowest first."""
    n_bands = (stop - first) * per_octave
    return Bands.between(fs / 2 * 2.0 ** -(first + np.arange(n_bands, -1, -1) / per_octave), fs)


def even_names(*, n_bands: int) -> tuple[str, ...]:
    """Return the names of bands of equal width."""
    return tuple(f"b{i}" for i in range(1, n_bands + 1))


@feature(
    phase="movement",
    unit="log10((m/s^2)^2/Hz)",
    reference="texclass; log power spectrum in bands of equal width",
    outputs=named_pieces(even_names),
    gain=Gain(shift=2),
    depends_on=("rate",),
)
@divisible
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
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or fewer samples than four a band.
    """
    require(view, max(32, 4 * n_bands), f"{n_bands} bands")
    return _levels(view, even_bands(view.fs, n_bands))


def fraction_names(*, octaves: tuple[int, int], per_octave: int) -> tuple[str, ...]:
    """Return the names of fractions of octaves."""
    first, last = octaves
    return tuple(
        f"o{first + i // per_octave}.{i % per_octave + 1}" for i in range((last - first) * per_octave)
    )


@feature(
    phase="movement",
    unit="log10((m/s^2)^2/Hz)",
    reference="texclass; log power spectrum in fractions of octaves",
    outputs=named_pieces(fraction_names),
    gain=Gain(shift=2),
    depends_on=("rate",),
)
@divisible
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
    n_pieces : int
        Equal pieces to compute it of, each by itself; see `divisible`.

    Raises
    ------
    UndefinedFeatureError
        For silence, or a movement that holds fewer than 1.5 periods of the lowest frequency.
    """
    bands = octave_bands(view.fs, *octaves, per_octave)
    lowest = bands.edges_hz[0]
    require(view, max(32, math.ceil(1.5 * view.fs / lowest)), f"1.5 periods of {lowest:.3g} Hz")
    return _levels(view, bands)[::-1]


def _levels(view: PhaseView, bands: Bands) -> Samples:
    density = whole_periodogram(view).density(bands.edges_hz) / bands.tilt
    return np.asarray(np.log10(density) + 2 * np.log10(level(view)))
