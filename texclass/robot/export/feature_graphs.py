"""ONNX graphs of the features of a movement."""

from typing import Any

import numpy as np
from scipy import fft

from texclass.features import autoregression, bands, cepstrum, roughness, slopes
from texclass.features.residual_bands import log_frequency
from texclass.features.spectra import LONG_FRAME_S, window_of
from texclass.recording import Samples
from texclass.robot.export.fourier_graphs import band_limited, band_magnitude, low_passed, power
from texclass.robot.export.graph import Tensor
from texclass.robot.export.graph_view import GraphView, graph_of, once
from texclass.vibration.reflection import MAX_REFLECTION, MIN_RELATIVE_RESIDUAL

# Slopes and curvatures


@once
def _signs(view: GraphView, kind: str, lag: int) -> Tensor:
    """Add +1 where x rises over a lag (or is convex), and -1 elsewhere, in single precision."""
    x, n = view.unit32, view.n_samples
    if kind == "rising":
        is_positive = x.cut(lag, n) > x.cut(0, n - lag)
    else:
        ends = (x.cut(2 * lag, n) + x.cut(0, n - 2 * lag)) * np.array(0.5, dtype=np.float32)
        is_positive = ends > x.cut(lag, n - lag)
    return view.add("Where", is_positive, np.array(1, dtype=np.float32), np.array(-1, dtype=np.float32))


def _agreement(view: GraphView, kind: str, lags: tuple[int, ...], steps: tuple[int, ...]) -> Tensor:
    """Add the fraction of signs that agree with those `step` lags later, (1 + mean of their product) / 2."""
    sums, counts = [], []
    for lag in lags:
        signs, size = _signs(view, kind, lag), view.n_samples - lag * (1 if kind == "rising" else 2)
        for step in steps:
            sums.append((signs.cut(step * lag, size) * signs.cut(0, size - step * lag)).sum())
            counts.append(size - step * lag)
    n_both = np.array(counts, dtype=np.float64)
    return (view.graph.concatenate(*sums).cast(np.float64) + n_both) * 0.5 / n_both


graph_of("slope_agreement")(lambda view, lags, steps: _agreement(view, "rising", lags, steps))
graph_of("curvature_agreement")(lambda view, lags, steps: _agreement(view, "convex", lags, steps))


@once
def _mean_step(view: GraphView, lag: int) -> Tensor:
    """Add the mean of |x_(t+lag) - x_t|."""
    x, n = view.unit, view.n_samples
    return abs(x.cut(lag, n) - x.cut(0, n - lag)).mean()


@graph_of("slope_level")
def _slope_level(view: GraphView, lags: tuple[int, ...]) -> Tensor:
    return view.graph.concatenate(*(_mean_step(view, lag) for lag in lags)).log10() + view.log_level


@once
def _moments(view: GraphView, lag: int) -> tuple[Tensor, Tensor]:
    """Add the mean square (n, 1) and three shape features (n, 3) of half the second difference.

    If the lag is 0, the samples without their mean replace the second difference.
    """
    x, n = view.unit, view.n_samples
    if lag:
        return _shapes((x.cut(2 * lag, n) + x.cut(0, n - 2 * lag)) * 0.5 - x.cut(lag, n - lag))
    return _shapes(x - x.mean())


def _shapes(c: Tensor) -> tuple[Tensor, Tensor]:
    """Add the mean square (n, 1) and three shape features (n, 3) of samples."""
    size, square = abs(c), c * c
    first, signed = size.mean(), (c * size).mean()
    second, fourth = square.mean(), (square * square).mean()
    second = second.where(second > slopes.MIN_RMS**2)
    shapes = c.graph.concatenate(
        signed / second, (fourth / (second * second)).log10(), (first / second.sqrt()).log10()
    )
    return second, shapes


@graph_of("vibration_shape")
def _vibration_shape(view: GraphView) -> Tensor:
    return _moments(view, 0)[1]


@graph_of("curvature_shape")
def _curvature_shape(view: GraphView, lags: tuple[int, ...]) -> Tensor:
    return view.graph.concatenate(*(_moments(view, lag)[1] for lag in lags))


@graph_of("slope_shape")
def _slope_shape(view: GraphView, lags: tuple[int, ...]) -> Tensor:
    x, n = view.unit, view.n_samples
    return view.graph.concatenate(*(_shapes(x.cut(lag, n) - x.cut(0, n - lag))[1] for lag in lags))


@graph_of("curvature_level")
def _curvature_level(view: GraphView, lags: tuple[int, ...]) -> Tensor:
    squares = view.graph.concatenate(*(_moments(view, lag)[0] for lag in lags))
    return squares.log10() * 0.5 + view.log_level


@graph_of("vibration_level")
def _vibration_level(view: GraphView) -> Tensor:
    return _curvature_level(view, (0,))


# Band levels


@once
def _periodogram(view: GraphView, n_parts: int = 1) -> tuple[Tensor, int, float]:
    """Add the cumulative periodogram of `n_parts` equal parts; see `texclass.features.bands.periodogram`.

    Returns
    -------
    running : Tensor
        Cumulative sums, shape (n_rows, n_bins + 1).
    n_bins : int
        Number of bins.
    step_hz : float
        Spacing of the bins in Hz.
    """
    n = view.n_samples // n_parts
    rows = view.unit if n_parts == 1 else view.unit.cut(0, n * n_parts).reshape(-1, n)
    d = rows.cut(1, n) - rows.cut(0, n - 1)
    size = n - 1
    n_taper = max(1, round(bands.TAPER * size))
    fade = 0.5 - 0.5 * np.cos(np.pi * (np.arange(n_taper) + 0.5) / n_taper)
    window = np.concatenate([fade, np.ones(size - 2 * n_taper), fade[::-1]])
    n_fft = int(fft.next_fast_len(size, real=True))
    n_bins = n_fft // 2 + 1
    square = power(d * window, size, n_fft, n_bins)
    square = square * (2 / (view.fs * (size - 2 * n_taper + 2 * float(fade @ fade))))
    return view.running(square), n_bins, view.fs / n_fft


def _density(view: GraphView, periodogram: tuple[Tensor, int, float], edges_hz: Samples) -> Tensor:
    """Add the mean power density between neighbouring edges, (n_rows, n_edges - 1); see `bands.density`."""
    running, n_bins, step_hz = periodogram
    edges = np.minimum(edges_hz / step_hz, n_bins)
    below = np.minimum(edges.astype(np.int64), n_bins - 1)
    low, high = (running.take(indices) for indices in (below, below + 1))
    sums, n = low + (high - low) * (edges - below), edges.size
    means = (sums.cut(1, n) - sums.cut(0, n - 1)) / (edges[1:] - edges[:-1])
    total = running.cut(n_bins, n_bins + 1)
    means = view.add("Max", means, total * (bands.FLOOR / n_bins))
    return means.where(total > 0.0)


def _levels(view: GraphView, edges_hz: Samples) -> Tensor:
    """Add the log10 power density in the bands between neighbouring edges."""
    middle = (edges_hz[:-1] + edges_hz[1:]) / 2
    density = _density(view, _periodogram(view), edges_hz) / (4 * np.sin(np.pi * middle / view.fs) ** 2)
    return density.log10() + view.log_level * 2.0


@graph_of("band_level")
def _band_level(view: GraphView, n_bands: int) -> Tensor:
    return _levels(view, np.linspace(0, view.fs / 2, n_bands + 1))


@graph_of("octave_level")
def _octave_level(view: GraphView, octaves: tuple[int, int], per_octave: int) -> Tensor:
    first, stop = octaves
    octave = first + np.arange((stop - first) * per_octave, -1, -1) / per_octave
    levels = _levels(view, view.fs / 2 * 2.0**-octave)
    return levels.take(np.arange(octave.size - 1)[::-1].copy())


@graph_of("band_course")
def _band_course(view: GraphView, n_parts: int, octaves: tuple[int, int]) -> Tensor:
    n_octaves = octaves[1] - octaves[0]
    edges = view.fs / 2 * np.exp2(-np.arange(octaves[1], octaves[0] - 1, -1.0))
    density = _density(view, _periodogram(view, bands.N_PARTS), edges)
    density = density.reshape(-1, n_parts, bands.N_PARTS // n_parts, n_octaves)
    L = density.reduced("ReduceMean", 2, keepdims=False).log10()
    terms = fft.dct(np.eye(n_parts), axis=0)[1:] / n_parts
    highest_first = np.arange(n_octaves)[::-1].copy()
    course = terms @ L.take(highest_first, axis=2)
    return course.reshape(0, (n_parts - 1) * n_octaves)


@once
def _deviations(view: GraphView) -> tuple[Tensor, Tensor]:
    """Add the deviations of octave levels from their mean (n, n_frames, 5), and the variance (n, 1, 5).

    A level is the log10 power of a frame in an octave; see `bands.octave_courses`.
    """
    size, n_octaves = bands.FRAME, len(bands.OCTAVES)
    n_frames = view.n_samples // size
    frames = view.unit.cut(0, n_frames * size).reshape(-1, size) * window_of("hann", size).astype(np.float64)
    square = power(frames, size, size, size // 2 + 1)
    octave_bins = np.zeros((size // 2 + 1, n_octaves))
    for octave in range(n_octaves):
        octave_bins[(size >> octave + 2) + 1 : (size >> octave + 1) + 1, octave] = 1
    octave_power = (square @ octave_bins).reshape(-1, n_frames, n_octaves)
    mean = octave_power.reduced("ReduceMean", 1, 2)
    octave_power = view.add("Max", octave_power, mean * bands.FLOOR)
    levels = octave_power.where(mean > 0.0).log10()
    deviations = levels - levels.mean(1)
    return deviations, (deviations * deviations).mean(1)


@graph_of("level_fluctuation")
def _level_fluctuation(view: GraphView) -> Tensor:
    return _deviations(view)[1].sqrt().reshape(0, len(bands.OCTAVES))


@graph_of("level_persistence")
def _level_persistence(view: GraphView) -> Tensor:
    deviations, variance = _deviations(view)
    n = view.n_samples // bands.FRAME
    covariance = (deviations.cut(1, n, axis=1) * deviations.cut(0, n - 1, axis=1)).mean(1)
    return (covariance / variance.where(variance > 1e-12)).reshape(0, len(bands.OCTAVES))


# Residual levels (after removing the spectral tilt)


def _residual_level(view: GraphView, levels: Tensor, octaves: Samples, power: float) -> Tensor:
    """Add levels minus `power` times the regression line of the slope levels.

    The line is evaluated at the frequencies of the levels, `octaves`, which are relative to fs/2.
    """
    u = log_frequency(slopes.LAGS)
    d = u - u.mean()
    # line(octaves) = mean level + (octaves - mean u) (d @ levels) / (d @ d)
    weights = 1 / len(u) + np.outer(d, octaves - u.mean()) / (d @ d)
    line: Tensor = _slopes(view) @ (power * weights)
    return levels - line


@once
def _slopes(view: GraphView) -> Tensor:
    return _slope_level(view, slopes.LAGS)


@graph_of("level_tilt")
def _level_tilt(view: GraphView) -> Tensor:
    d = log_frequency(slopes.LAGS) - log_frequency(slopes.LAGS).mean()
    tilt: Tensor = _slopes(view) @ (d / (d @ d))[:, None]
    return tilt


@graph_of("band_residual_level")
def _band_residual_level(view: GraphView, n_bands: int) -> Tensor:
    middle = np.log2((np.arange(n_bands) + 0.5) / n_bands)
    return _residual_level(view, _band_level(view, n_bands), middle, 2)


@graph_of("octave_residual_level")
def _octave_residual_level(view: GraphView, octaves: tuple[int, int], per_octave: int) -> Tensor:
    n_bands = (octaves[1] - octaves[0]) * per_octave
    middle = -octaves[0] - (np.arange(n_bands) + 0.5) / per_octave
    return _residual_level(view, _octave_level(view, octaves, per_octave), middle, 2)


@graph_of("slope_residual_level")
def _slope_residual_level(view: GraphView, lags: tuple[int, ...]) -> Tensor:
    return _residual_level(view, _slope_level(view, lags), log_frequency(lags), 1)


@graph_of("curvature_residual_level")
def _curvature_residual_level(view: GraphView, lags: tuple[int, ...]) -> Tensor:
    return _residual_level(view, _curvature_level(view, lags), log_frequency(lags), 1)


# Frames: cepstrum and fineness


@once
def _power_frames(
    view: GraphView, frame_s: float, hop_s: float, window: str, high_hz: float
) -> tuple[Tensor, int, int, Samples]:
    """Add the power spectra |X|^2 of windowed frames; see `texclass.features.spectra.power_frames`.

    Bins at 0 and fs/2 are halved, and the spectra are not scaled to a physical unit.

    Returns
    -------
    spectra : Tensor
        Power spectra, shape (n * n_frames, n_bins).
    n_frames, n_fft : int
        Number of frames of a movement, and length of the transform.
    frequency : ndarray of shape (n_bins,)
        Frequencies of the bins in Hz.
    """
    length, hop = (max(1, round(seconds * view.fs)) for seconds in (frame_s, hop_s))
    n_fft = 1 << (length - 1).bit_length()
    frequency = np.linspace(0, view.fs / 2, n_fft // 2 + 1)
    n_bins = int(np.searchsorted(frequency, high_hz, side="right"))
    starts = np.arange(0, view.n_samples - length + 1, hop)
    indices = (starts[:, None] + np.arange(length)).reshape(-1)
    frames = view.unit.take(indices).reshape(-1, length) * window_of(window, length).astype(np.float64)
    weights = np.ones(n_bins)
    weights[0] = weights[n_fft // 2 :] = 0.5
    return power(frames, length, n_fft, n_bins) * weights, len(starts), n_fft, frequency[:n_bins]


@once
def _log_energies(
    view: GraphView,
    n_filters: int,
    low_hz: float,
    high_hz: float,
    decay_hz: float,
    frame_s: float,
    hop_s: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """Add the logarithmic energies of mel filters.

    Returns
    -------
    energies : Tensor
        Natural logarithms (n, n_frames, n_filters); 0 for silent frames.
    is_audible : Tensor
        1 for audible frames, 0 for silent ones, shape (n, n_frames, 1).
    count : Tensor
        Number of audible frames, shape (n, 1, 1); NaN if there are none.
    """
    square, n_frames, n_fft, frequency = _power_frames(view, frame_s, hop_s, "hamming", high_hz)
    filters = cepstrum.mel_filters(view.fs, n_fft, n_filters, low_hz, min(high_hz, view.fs / 2), decay_hz)
    filters = filters[: frequency.size].astype(np.float64)
    energy = (square @ filters).reshape(-1, n_frames, n_filters)
    total = energy.sum()
    is_positive = total > 0.0
    logs = view.add("Log", view.add("Max", energy, total * cepstrum.FLOOR))
    is_audible = is_positive.cast(np.float64)
    count = is_audible.sum(1)
    count = count.where(count > 0.0)
    return logs.where(is_positive, 0.0), is_audible, count


def _cosines(n_filters: int, coefficients: tuple[int, ...]) -> Samples:
    """Return columns of the matrix of an orthonormal cosine transform, shape (n_filters, n_coefficients)."""
    return np.asarray(fft.dct(np.eye(n_filters), axis=0, norm="ortho")[list(coefficients)].T.copy())


@graph_of("mfcc")
def _mfcc(view: GraphView, coefficients: tuple[int, ...], **frames: Any) -> Tensor:
    energies, _, count = _log_energies(view, **frames)
    mean = energies.sum(1) / count
    return (mean @ _cosines(frames["n_filters"], coefficients)).reshape(0, len(coefficients))


@graph_of("mfcc_deviation")
def _mfcc_deviation(view: GraphView, coefficients: tuple[int, ...], **frames: Any) -> Tensor:
    energies, is_audible, count = _log_energies(view, **frames)
    cepstra = energies @ _cosines(frames["n_filters"], coefficients)
    deviations = (cepstra - cepstra.sum(1) / count) * is_audible
    square = (deviations * deviations).sum(1)
    return (square / count.where(count > 1.0)).sqrt().reshape(0, len(coefficients))


@once
def _spectral_moments(view: GraphView) -> tuple[Tensor, Tensor]:
    """Add the spectral centroid and spread in Hz, averaged over frames, each of shape (n, 1)."""
    frame_s = min(LONG_FRAME_S, view.n_samples / view.fs)
    square, n_frames, _, frequency = _power_frames(view, frame_s, frame_s / 2, "hann", np.inf)
    f = frequency - frequency[-1] / 2
    sums = square @ np.stack([f**0, f, f**2], axis=1)
    total, first, second = (sums.cut(k, k + 1) for k in range(3))
    is_audible = total > 0.0
    count = is_audible.cast(np.float64).reshape(-1, n_frames).sum()
    centroid = first / total
    variance = second / total - centroid * centroid

    def mean(values: Tensor) -> Tensor:
        return values.where(is_audible, 0.0).reshape(-1, n_frames).sum() / count

    return mean(centroid + frequency[-1] / 2), mean(view.add("Max", variance, 0.0).sqrt())


@graph_of("fineness")
def _fineness(view: GraphView) -> Tensor:
    return _spectral_moments(view)[0]


@graph_of("fineness_spread")
def _fineness_spread(view: GraphView) -> Tensor:
    return _spectral_moments(view)[1]


# Roughness


@graph_of("temporal_roughness")
def _temporal_roughness(
    view: GraphView, fine_hz: tuple[float, float], coarse_hz: tuple[float, float]
) -> Tensor:
    rate_hz = roughness.PERIOD * fine_hz[1]
    fine, coarse = (band_magnitude(view, band, rate_hz) for band in (fine_hz, coarse_hz))
    ratio = fine.mean() / coarse.mean()
    return abs(fine - coarse * ratio).mean().log10() + view.log_level


@graph_of("roughness_ratio")
def _roughness_ratio(view: GraphView, fine_hz: tuple[float, float], coarse_hz: tuple[float, float]) -> Tensor:
    rate_hz = roughness.PERIOD * fine_hz[1]
    fine, coarse = (band_magnitude(view, band, rate_hz).mean() for band in (fine_hz, coarse_hz))
    return fine.log10() - coarse.log10()


@graph_of("waviness")
def _waviness(view: GraphView, cutoff_hz: float, frame_s: float, average_s: float) -> Tensor:
    slow, factor, _ = low_passed(view, cutoff_hz)
    frame, average = max(1, round(frame_s * view.fs)), max(1, round(average_s / frame_s))
    edges = np.append(np.arange(0, view.n_samples - frame + 1, frame), 0) // factor
    edges[-1] = (view.n_samples // frame) * frame // factor
    running = view.running(abs(slow))
    low, high = (running.take(indices.astype(np.int64)) for indices in (edges[:-1], edges[1:]))
    m = (high - low) / np.diff(edges).astype(np.float64)
    return _deviation(m - view.moving_average(m, edges.size - 1, average)).log10() + view.log_level


@graph_of("spikiness")
def _spikiness(view: GraphView, cutoff_hz: float, average_s: float, floor: float) -> Tensor:
    x, factor, size = low_passed(view, cutoff_hz)
    average = max(1, max(1, round(average_s * view.fs)) // factor)
    sigma = _deviation(x)
    threshold = sigma * 2.0 + x.mean()
    above = x - view.moving_average(x, size, average) - threshold
    excess = view.add("Max", above, 0.0).mean() + sigma * floor
    return excess.log10() + view.log_level


def _deviation(x: Tensor) -> Tensor:
    deviations = x - x.mean()
    return (deviations * deviations).mean().sqrt()


# Autoregressive models


@graph_of("log_area_ratios")
@once
def _log_area_ratios(view: GraphView, order: int, frame_s: float, band_hz: float) -> Tensor:
    """Add the log-area ratios of the mean model, (n, order); see `autoregression.mean_model`.

    For frames that contain only the ringing of a filter, the result differs from that of the feature
    function, because the latter depends on rounding in single precision.
    """
    x, n, fs = band_limited(view, band_hz)
    length = min(n, max(round(frame_s * fs), 4 * order))
    n_frames = n // length
    frames = x.cut(0, n_frames * length).reshape(-1, n_frames, length)
    energy = frames.reduced("ReduceSumSquare", -1)
    is_audible = energy > energy.reduced("ReduceMax", 1) * autoregression.MIN_POWER
    ratios = view.graph.concatenate(*_burg(frames.reshape(-1, length), length, order))
    total = ratios.reshape(-1, n_frames, order).where(is_audible, 0.0).sum(1)
    count = is_audible.cast(np.float64).sum(1)
    return (total / count.where(count > 0.0)).reshape(0, order)


def _burg(x: Tensor, n: int, order: int) -> list[Tensor]:
    """Add the log-area ratio ln((1 + k) / (1 - k)) of each order by Burg's method, shape (n_frames, 1)."""
    add = x.graph.add
    f, b = x.cut(1, n), x.cut(0, n - 1)
    min_power = (x * x).mean() * (2 * MIN_RELATIVE_RESIDUAL**2)
    has_residual, ratios = None, []
    for m in range(1, order + 1):
        product = (f * b).sum()
        total = f.reduced("ReduceSumSquare", -1) + b.reduced("ReduceSumSquare", -1)
        is_above = total > min_power * float(n - m)
        has_residual = is_above if has_residual is None else add("And", has_residual, is_above)
        k = product * -2.0 / total
        k = add("Max", add("Min", k, MAX_REFLECTION), -MAX_REFLECTION).where(has_residual, 0.0)
        ratios.append(add("Log", (k + 1.0) / (1.0 - k)))
        if m < order:
            forward, backward = f + b * k, b + f * k
            f, b = forward.cut(1, n - m), backward.cut(0, n - m - 1)
    return ratios


@graph_of("prediction_gain")
def _prediction_gain(
    view: GraphView, orders: tuple[int, ...], order: int, frame_s: float, band_hz: float
) -> Tensor:
    # The residual power of each order is reduced by 1 - k^2, with k = tanh(g / 2).
    k = view.add("Tanh", _log_area_ratios(view, order, frame_s, band_hz) * 0.5)
    log_residual = ((1.0 - k) * (k + 1.0)).log10()
    gain = view.add("CumSum", log_residual, np.array(1)) * -10.0
    return gain.take(np.array(orders) - 1)
