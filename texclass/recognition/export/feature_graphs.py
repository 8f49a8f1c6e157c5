"""Features that need the samples, their differences or the power of their spectrum, as graphs."""

from functools import partial
from typing import Any

import numpy as np
from scipy import fft

from texclass.features import bands, cepstrum, slopes
from texclass.features.excess import octaves_of
from texclass.features.spectra import LONG_FRAME_S, window_of
from texclass.recognition.export.fourier_graphs import power
from texclass.recognition.export.graph_view import GraphView, graph_of
from texclass.recording import Samples

# Slopes and curvatures.


def _signs(view: GraphView, kind: str, lag: int) -> str:
    """Add +1 where x rises over a lag (or bends upwards), else -1, in single precision."""

    def make() -> str:
        x, n = view.unit32, view.n_samples
        if kind == "rising":
            up = view.add("Greater", view.shifted(x, lag, n - lag), view.shifted(x, 0, n - lag))
        else:
            ends = view.add("Add", view.shifted(x, 2 * lag, n - 2 * lag), view.shifted(x, 0, n - 2 * lag))
            ends = view.add("Mul", ends, np.array(0.5, dtype=np.float32))
            up = view.add("Greater", ends, view.shifted(x, lag, n - 2 * lag))
        return view.add("Where", up, np.array(1, dtype=np.float32), np.array(-1, dtype=np.float32))

    return str(view.once((kind, lag), make))


def _agreement(view: GraphView, kind: str, lags: tuple[int, ...], steps: tuple[int, ...]) -> str:
    """Add the share of equal signs: (1 + mean of their product) / 2."""
    sums, counts = [], []
    for lag in lags:
        signs, size = _signs(view, kind, lag), view.n_samples - lag * (1 if kind == "rising" else 2)
        for step in steps:
            n = size - step * lag
            product = view.add("Mul", view.shifted(signs, step * lag, n), view.shifted(signs, 0, n))
            sums.append(view.mean(product, "ReduceSum"))
            counts.append(n)
    agreeing = view.graph.cast(view.beside(*sums), np.float64)
    n_both = np.array(counts, dtype=np.float64)
    return view.add("Div", view.add("Mul", view.add("Add", agreeing, n_both), 0.5), n_both)


graph_of("slope_agreement")(lambda view, lags, steps: _agreement(view, "rising", lags, steps))
graph_of("curvature_agreement")(lambda view, lags, steps: _agreement(view, "convex", lags, steps))


@graph_of("slope_level")
def _slope_level(view: GraphView, lags: tuple[int, ...]) -> str:
    """Add log10 mean |x_(t+lag) - x_t|."""

    def level(lag: int) -> str:
        x, n = view.unit, view.n_samples - lag
        change = view.add("Sub", view.shifted(x, lag, n), view.shifted(x, 0, n))
        return view.mean(view.add("Abs", change))

    means = view.beside(*(str(view.once(("slope", lag), partial(level, lag))) for lag in lags))
    return view.add("Add", view.log10(means), view.log_level)


def _moments(view: GraphView, lag: int) -> tuple[str, str]:
    """Add the mean square (n, 1) and the three shapes (n, 3) of half the second difference; see `moments`."""

    def make() -> tuple[str, str]:
        x, n = view.unit, view.n_samples - 2 * lag
        if lag:
            ends = view.add("Add", view.shifted(x, 2 * lag, n), view.shifted(x, 0, n))
            c = view.add("Sub", view.add("Mul", ends, 0.5), view.shifted(x, lag, n))
        else:
            c = view.add("Sub", x, view.mean(x))
        return _shapes(view, c)

    found: tuple[str, str] = view.once(("moments", lag), make)
    return found


def _shapes(view: GraphView, c: str) -> tuple[str, str]:
    """Add the mean square (n, 1) and the three shapes (n, 3) of some samples."""
    size, square = view.add("Abs", c), view.add("Mul", c, c)
    first, signed = view.mean(size), view.mean(view.add("Mul", c, size))
    second, fourth = view.mean(square), view.mean(view.add("Mul", square, square))
    second = view.where(view.add("Greater", second, slopes.LEAST**2), second)
    shapes = view.beside(
        view.add("Div", signed, second),
        view.log10(view.add("Div", fourth, view.add("Mul", second, second))),
        view.log10(view.add("Div", first, view.add("Sqrt", second))),
    )
    return second, shapes


@graph_of("vibration_shape")
def _vibration_shape(view: GraphView) -> str:
    return _moments(view, 0)[1]


@graph_of("curvature_shape")
def _curvature_shape(view: GraphView, lags: tuple[int, ...]) -> str:
    return view.beside(*(_moments(view, lag)[1] for lag in lags))


@graph_of("slope_shape")
def _slope_shape(view: GraphView, lags: tuple[int, ...]) -> str:
    x, n = view.unit, view.n_samples
    ends = ((view.shifted(x, lag, n - lag), view.shifted(x, 0, n - lag)) for lag in lags)
    return view.beside(*(_shapes(view, view.add("Sub", *pair))[1] for pair in ends))


@graph_of("curvature_level")
def _curvature_level(view: GraphView, lags: tuple[int, ...]) -> str:
    squares = view.log10(view.beside(*(_moments(view, lag)[0] for lag in lags)))
    return view.add("Add", view.add("Mul", squares, 0.5), view.log_level)


@graph_of("vibration_level")
def _vibration_level(view: GraphView) -> str:
    return _curvature_level(view, (0,))


# Levels of bands.


def _periodogram(view: GraphView, rows: str, n: int) -> tuple[str, int, float]:
    """Add the running sum of the periodogram (n_rows, n_bins + 1), and say n_bins and the step in Hz.

    Of rows (n_rows, n); see `texclass.features.bands.periodogram`.
    """
    d = view.add("Sub", view.shifted(rows, 1, n - 1), view.shifted(rows, 0, n - 1))
    size = n - 1
    n_taper = max(1, round(bands.TAPER * size))
    fade = 0.5 - 0.5 * np.cos(np.pi * (np.arange(n_taper) + 0.5) / n_taper)
    window = np.concatenate([fade, np.ones(size - 2 * n_taper), fade[::-1]])
    n_fft = int(fft.next_fast_len(size, real=True))
    n_bins = n_fft // 2 + 1
    square = power(view.graph, view.add("Mul", d, window), size, n_fft, n_bins)
    square = view.add("Mul", square, 2 / (view.fs * (size - 2 * n_taper + 2 * float(fade @ fade))))
    return view.running(square), n_bins, view.fs / n_fft


def _density(view: GraphView, periodogram: tuple[str, int, float], edges_hz: Samples) -> str:
    """Add the mean power density between neighbouring edges, (n_rows, n_edges - 1); see `bands.density`."""
    running, n_bins, step_hz = periodogram
    edges = np.minimum(edges_hz / step_hz, n_bins)
    below = np.minimum(edges.astype(np.int64), n_bins - 1)
    low, high = (view.add("Gather", running, at, axis=1) for at in (below, below + 1))
    sums = view.add("Add", low, view.add("Mul", view.add("Sub", high, low), edges - below))
    n = edges.size - 1
    means = view.add(
        "Div", view.add("Sub", view.shifted(sums, 1, n), view.shifted(sums, 0, n)), edges[1:] - edges[:-1]
    )
    whole = view.shifted(running, n_bins, 1)
    means = view.add("Max", means, view.add("Mul", whole, bands.FLOOR / n_bins))
    return view.where(view.add("Greater", whole, 0.0), means)


def _levels(view: GraphView, edges_hz: Samples) -> str:
    """Add the log10 power density between edges."""
    whole = view.once(("periodogram",), lambda: _periodogram(view, view.unit, view.n_samples))
    middle = (edges_hz[:-1] + edges_hz[1:]) / 2
    felt = view.add("Div", _density(view, whole, edges_hz), 4 * np.sin(np.pi * middle / view.fs) ** 2)
    return view.add("Add", view.log10(felt), view.add("Mul", view.log_level, 2.0))


@graph_of("band_level")
def _band_level(view: GraphView, n_bands: int) -> str:
    return _levels(view, np.linspace(0, view.fs / 2, n_bands + 1))


@graph_of("octave_level")
def _octave_level(view: GraphView, octaves: tuple[int, int], per_octave: int) -> str:
    first, stop = octaves
    octave = first + np.arange((stop - first) * per_octave, -1, -1) / per_octave
    levels = _levels(view, view.fs / 2 * 2.0**-octave)
    return view.add("Gather", levels, np.arange(octave.size - 1)[::-1].copy(), axis=1)


@graph_of("band_course")
def _band_course(view: GraphView, n_parts: int, octaves: tuple[int, int]) -> str:
    n = view.n_samples // bands.N_PARTS
    n_octaves = octaves[1] - octaves[0]

    def sixths() -> tuple[str, int, float]:
        parts = view.graph.reshape(view.shifted(view.unit, 0, n * bands.N_PARTS), -1, n)
        return _periodogram(view, parts, n)

    edges = view.fs / 2 * np.exp2(-np.arange(octaves[1], octaves[0] - 1, -1.0))
    felt = _density(view, view.once(("sixths",), sixths), edges)
    felt = view.graph.reshape(felt, -1, n_parts, bands.N_PARTS // n_parts, n_octaves)
    L = view.log10(view.add("ReduceMean", felt, np.array([2]), keepdims=0))
    terms = fft.dct(np.eye(n_parts), axis=0)[1:] / n_parts
    highest_first = np.arange(n_octaves)[::-1].copy()
    course = view.add("MatMul", terms, view.add("Gather", L, highest_first, axis=2))
    return view.graph.reshape(course, 0, (n_parts - 1) * n_octaves)


def _octave_frames(view: GraphView) -> str:
    """Add the log10 power of frames in octaves, (n, n_frames, 5); see `bands.octave_courses`."""

    def make() -> str:
        size, n_octaves = bands.FRAME, len(bands.OCTAVES)
        n_frames = view.n_samples // size
        frames = view.graph.reshape(view.shifted(view.unit, 0, n_frames * size), -1, size)
        frames = view.add("Mul", frames, window_of("hann", size).astype(np.float64))
        square = power(view.graph, frames, size, size, size // 2 + 1)
        of_octave = np.zeros((size // 2 + 1, n_octaves))
        for octave in range(n_octaves):
            of_octave[(size >> octave + 2) + 1 : (size >> octave + 1) + 1, octave] = 1
        felt = view.graph.reshape(view.add("MatMul", square, of_octave), -1, n_frames, n_octaves)
        mean = view.add("ReduceMean", felt, np.array([1, 2]), keepdims=1)
        felt = view.add("Max", felt, view.add("Mul", mean, bands.FLOOR))
        return view.log10(view.where(view.add("Greater", mean, 0.0), felt))

    return str(view.once(("octave_frames",), make))


def _deviations(view: GraphView) -> tuple[str, str]:
    """Add how levels of octaves deviate from their mean, (n, n_frames, 5), and its square, (n, 1, 5)."""

    def make() -> tuple[str, str]:
        L = _octave_frames(view)
        away = view.add("Sub", L, view.mean(L, axis=1))
        return away, view.mean(view.add("Mul", away, away), axis=1)

    found: tuple[str, str] = view.once(("deviations",), make)
    return found


@graph_of("level_fluctuation")
def _level_fluctuation(view: GraphView) -> str:
    return view.graph.reshape(view.add("Sqrt", _deviations(view)[1]), 0, len(bands.OCTAVES))


@graph_of("level_persistence")
def _level_persistence(view: GraphView) -> str:
    away, variance = _deviations(view)
    n = view.n_samples // bands.FRAME - 1
    later, before = (view.graph.cut(away, at, at + n, axis=1) for at in (1, 0))
    together = view.mean(view.add("Mul", later, before), axis=1)
    variance = view.where(view.add("Greater", variance, 1e-12), variance)
    return view.graph.reshape(view.add("Div", together, variance), 0, len(bands.OCTAVES))


# Levels above the line of the vibration.


def _above_line(view: GraphView, levels: str, octaves: Samples, power: float) -> str:
    """Add levels minus `power` times the line at frequencies in octaves from fs/2; see `excess.line`."""
    at = octaves_of(slopes.LAGS)
    away = at - at.mean()
    # line(u) = mean of the levels + (u - mean u) (away @ levels) / (away @ away)
    weights = 1 / len(at) + np.outer(away, octaves - at.mean()) / (away @ away)
    line = view.add("MatMul", _slopes(view), power * weights)
    return view.add("Sub", levels, line)


def _slopes(view: GraphView) -> str:
    return str(view.once(("line",), lambda: _slope_level(view, slopes.LAGS)))


@graph_of("level_tilt")
def _level_tilt(view: GraphView) -> str:
    away = octaves_of(slopes.LAGS) - octaves_of(slopes.LAGS).mean()
    return view.add("MatMul", _slopes(view), (away / (away @ away))[:, None])


@graph_of("band_excess")
def _band_excess(view: GraphView, n_bands: int) -> str:
    middle = np.log2((np.arange(n_bands) + 0.5) / n_bands)
    return _above_line(view, _band_level(view, n_bands), middle, 2)


@graph_of("octave_excess")
def _octave_excess(view: GraphView, octaves: tuple[int, int], per_octave: int) -> str:
    n_bands = (octaves[1] - octaves[0]) * per_octave
    middle = -octaves[0] - (np.arange(n_bands) + 0.5) / per_octave
    return _above_line(view, _octave_level(view, octaves, per_octave), middle, 2)


@graph_of("slope_excess")
def _slope_excess(view: GraphView, lags: tuple[int, ...]) -> str:
    return _above_line(view, _slope_level(view, lags), octaves_of(lags), 1)


@graph_of("curvature_excess")
def _curvature_excess(view: GraphView, lags: tuple[int, ...]) -> str:
    return _above_line(view, _curvature_level(view, lags), octaves_of(lags), 1)


# Frames: cepstrum and fineness.


def _power_frames(
    view: GraphView, frame_s: float, hop_s: float, window: str, high_hz: float
) -> tuple[str, int, int, Samples]:
    """Add |X|^2 of windowed frames, (n * n_frames, n_bins); say n_frames, the transform's length, and f (Hz).

    See `texclass.features.spectra.power_frames`; bins at 0 and fs/2 count half, the unit is left out.
    """
    length, hop = (max(1, round(seconds * view.fs)) for seconds in (frame_s, hop_s))
    n_fft = 1 << (length - 1).bit_length()
    frequency = np.linspace(0, view.fs / 2, n_fft // 2 + 1)
    n_bins = int(np.searchsorted(frequency, high_hz, side="right"))
    starts = np.arange(0, view.n_samples - length + 1, hop)

    def make() -> str:
        at = (starts[:, None] + np.arange(length)).reshape(-1)
        frames = view.graph.reshape(view.add("Gather", view.unit, at, axis=1), -1, length)
        frames = view.add("Mul", frames, window_of(window, length).astype(np.float64))
        half = np.ones(n_bins)
        half[0] = half[n_fft // 2 :] = 0.5
        return view.add("Mul", power(view.graph, frames, length, n_fft, n_bins), half)

    square = str(view.once(("frames", length, hop, window, n_bins), make))
    return square, len(starts), n_fft, frequency[:n_bins]


def _log_energies(
    view: GraphView,
    n_filters: int,
    low_hz: float,
    high_hz: float,
    decay_hz: float,
    frame_s: float,
    hop_s: float,
) -> tuple[str, str, str]:
    """Add ln of the filters' energies (n, n_frames, n_filters), 0 where a frame is silent.

    And which are not, (n, n_frames, 1), as 1 or 0, and how many these are, (n, 1, 1), NaN if there is none.
    """

    def make() -> tuple[str, str, str]:
        square, n_frames, n_fft, frequency = _power_frames(view, frame_s, hop_s, "hamming", high_hz)
        filters = cepstrum.mel_filters(
            view.fs, n_fft, n_filters, low_hz, min(high_hz, view.fs / 2), decay_hz
        )[: frequency.size].astype(np.float64)
        energy = view.graph.reshape(view.add("MatMul", square, filters), -1, n_frames, n_filters)
        total = view.mean(energy, "ReduceSum")
        is_heard = view.add("Greater", total, 0.0)
        logs = view.add("Log", view.add("Max", energy, view.add("Mul", total, cepstrum.FLOOR)))
        heard = view.graph.cast(is_heard, np.float64)
        count = view.mean(heard, "ReduceSum", axis=1)
        count = view.where(view.add("Greater", count, 0.0), count)
        return view.add("Where", is_heard, logs, 0.0), heard, count

    key = ("log_energies", n_filters, low_hz, high_hz, decay_hz, frame_s, hop_s)
    found: tuple[str, str, str] = view.once(key, make)
    return found


def _cepstrum(view: GraphView, coefficients: tuple[int, ...], **frames: Any) -> tuple[str, str, str, str]:
    """Add the cepstra of frames (n, n_frames, n_coefficients), their mean, and as `_log_energies`."""
    energies, heard, count = _log_energies(view, **frames)
    transform = fft.dct(np.eye(frames["n_filters"]), axis=0, norm="ortho")[list(coefficients)].T.copy()
    cepstra = view.add("MatMul", energies, transform)
    return cepstra, view.add("Div", view.mean(cepstra, "ReduceSum", axis=1), count), heard, count


@graph_of("mfcc")
def _mfcc(view: GraphView, coefficients: tuple[int, ...], **frames: Any) -> str:
    energies, _, count = _log_energies(view, **frames)
    mean = view.add("Div", view.mean(energies, "ReduceSum", axis=1), count)
    transform = fft.dct(np.eye(frames["n_filters"]), axis=0, norm="ortho")[list(coefficients)].T.copy()
    return view.graph.reshape(view.add("MatMul", mean, transform), 0, len(coefficients))


@graph_of("mfcc_deviation")
def _mfcc_deviation(view: GraphView, coefficients: tuple[int, ...], **frames: Any) -> str:
    cepstra, mean, heard, count = _cepstrum(view, coefficients, **frames)
    away = view.add("Mul", view.add("Sub", cepstra, mean), heard)
    square = view.mean(view.add("Mul", away, away), "ReduceSum", axis=1)
    several = view.where(view.add("Greater", count, 1.0), count)
    deviation = view.add("Sqrt", view.add("Div", square, several))
    return view.graph.reshape(deviation, 0, len(coefficients))


def _spectral_moments(view: GraphView) -> tuple[str, str]:
    """Add the means over frames of centroid and deviation in Hz, (n, 1) each; see `spectral_moments`."""

    def make() -> tuple[str, str]:
        frame_s = min(LONG_FRAME_S, view.n_samples / view.fs)
        square, n_frames, _, frequency = _power_frames(view, frame_s, frame_s / 2, "hann", np.inf)
        f = frequency - frequency[-1] / 2
        sums = view.add("MatMul", square, np.stack([f**0, f, f**2], axis=1))
        total, first, second = (view.shifted(sums, k, 1) for k in range(3))
        is_heard = view.add("Greater", total, 0.0)
        count = view.mean(
            view.graph.reshape(view.graph.cast(is_heard, np.float64), -1, n_frames), "ReduceSum"
        )
        centroid = view.add("Div", first, total)
        variance = view.add("Sub", view.add("Div", second, total), view.add("Mul", centroid, centroid))
        both = []
        for values in (
            view.add("Add", centroid, frequency[-1] / 2),
            view.add("Sqrt", view.add("Max", variance, 0.0)),
        ):
            frames = view.graph.reshape(view.add("Where", is_heard, values, 0.0), -1, n_frames)
            both.append(view.add("Div", view.mean(frames, "ReduceSum"), count))
        return both[0], both[1]

    found: tuple[str, str] = view.once(("spectral_moments",), make)
    return found


@graph_of("fineness")
def _fineness(view: GraphView) -> str:
    return _spectral_moments(view)[0]


@graph_of("fineness_spread")
def _fineness_spread(view: GraphView) -> str:
    return _spectral_moments(view)[1]
