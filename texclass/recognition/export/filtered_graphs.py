"""Features of filtered and resampled movements, and of autoregressive models, as graphs."""

import numpy as np
from scipy import fft

from texclass.features import autoregression, conditioning, roughness
from texclass.recognition.export.fourier_graphs import irfft, rfft
from texclass.recognition.export.graph import Tensor
from texclass.recognition.export.graph_view import GraphView, graph_of, once
from texclass.recording import Samples
from texclass.vibration.reflection import EXHAUSTED, LARGEST

# Filters, as in `texclass.features.conditioning`: a response times the spectrum.


def _padded(view: GraphView) -> int:
    return conditioning.FINEST * int(fft.next_fast_len(-(-view.n_samples // conditioning.FINEST)))


@once
def _spectrum(view: GraphView, n_bins: int) -> tuple[Tensor, Tensor]:
    return rfft(view.unit, view.n_samples, _padded(view), n_bins)


def _filtered(view: GraphView, response: Samples, n: int) -> Tensor:
    """Add the first bins of the spectrum times a response, back in time at n samples: (n_rows, n)."""
    real, imaginary = _spectrum(view, n // 2 + 1)
    bins = np.arange(n // 2 + 1)
    scale = response * n / _padded(view)
    return irfft(real * scale, imaginary * np.where((bins == 0) | (2 * bins == n), 0.0, scale), n)


@once
def _low_passed(view: GraphView, cutoff_hz: float) -> tuple[Tensor, int, int]:
    """Add the low-passed movement, and say by which factor its rate is lower, and its length."""
    n_fft, rate = _padded(view), cutoff_hz * 10
    factor = next((k for k in (conditioning.FINEST, 10, 5, 4, 2) if view.fs / k >= rate), 1)
    size = -(-view.n_samples // factor)
    f = np.arange(n_fft // factor // 2 + 1) * (view.fs / n_fft)
    slow = _filtered(view, 1 / (1 + (f / cutoff_hz) ** 4), n_fft // factor).cut(0, size)
    return slow, factor, size


@once
def _band_magnitude(view: GraphView, band_hz: tuple[float, float], rate_hz: float) -> Tensor:
    """Add the magnitude of the movement in a band; see `conditioning.band_passed`."""
    low_hz, high_hz = band_hz
    n_fft = _padded(view)
    n = 2 * int(fft.next_fast_len(int(np.ceil(n_fft * rate_hz / view.fs / 2)), real=True))
    n = min(n_fft, n)
    f = np.arange(n // 2 + 1) * (view.fs / n_fft)
    through, beside = (f * (high_hz - low_hz)) ** 4, (f**2 - low_hz * high_hz) ** 4
    return abs(_filtered(view, through / (through + beside), n).cut(0, view.n_samples * n // n_fft))


# Roughness.


@graph_of("temporal_roughness")
def _temporal_roughness(
    view: GraphView, fine_hz: tuple[float, float], coarse_hz: tuple[float, float]
) -> Tensor:
    rate_hz = roughness.PERIOD * fine_hz[1]
    fine, coarse = (_band_magnitude(view, band, rate_hz) for band in (fine_hz, coarse_hz))
    ratio = fine.mean() / coarse.mean()
    return abs(fine - coarse * ratio).mean().log10() + view.log_level


@graph_of("roughness_ratio")
def _roughness_ratio(view: GraphView, fine_hz: tuple[float, float], coarse_hz: tuple[float, float]) -> Tensor:
    rate_hz = roughness.PERIOD * fine_hz[1]
    fine, coarse = (_band_magnitude(view, band, rate_hz).mean() for band in (fine_hz, coarse_hz))
    return fine.log10() - coarse.log10()


@graph_of("waviness")
def _waviness(view: GraphView, cutoff_hz: float, frame_s: float, average_s: float) -> Tensor:
    slow, factor, _ = _low_passed(view, cutoff_hz)
    frame, average = max(1, round(frame_s * view.fs)), max(1, round(average_s / frame_s))
    edges = np.append(np.arange(0, view.n_samples - frame + 1, frame), 0) // factor
    edges[-1] = (view.n_samples // frame) * frame // factor
    running = view.running(abs(slow))
    low, high = (running.take(at.astype(np.int64)) for at in (edges[:-1], edges[1:]))
    m = (high - low) / np.diff(edges).astype(np.float64)
    return _deviation(m - view.moving_average(m, edges.size - 1, average)).log10() + view.log_level


@graph_of("spikiness")
def _spikiness(view: GraphView, cutoff_hz: float, average_s: float, floor: float) -> Tensor:
    x, factor, size = _low_passed(view, cutoff_hz)
    average = max(1, max(1, round(average_s * view.fs)) // factor)
    sigma = _deviation(x)
    threshold = sigma * 2.0 + x.mean()
    above = x - view.moving_average(x, size, average) - threshold
    excess = view.add("Max", above, 0.0).mean() + sigma * floor
    return excess.log10() + view.log_level


def _deviation(x: Tensor) -> Tensor:
    away = x - x.mean()
    return (away * away).mean().sqrt()


# Autoregressive models.


@graph_of("log_area_ratios")
@once
def _log_area_ratios(view: GraphView, order: int, frame_s: float, band_hz: float) -> Tensor:
    """Add the log-area ratios of the mean model, (n, order); see `autoregression.mean_model`.

    Where a frame holds nothing but the ringing of a filter, the rounding of single precision is what the
    function finds that cannot be predicted; here there is none.
    """
    x, n, fs = _banded(view, band_hz)
    length = min(n, max(round(frame_s * fs), 4 * order))
    n_frames = n // length
    frames = x.cut(0, n_frames * length).reshape(-1, n_frames, length)
    power = frames.reduced("ReduceSumSquare", -1)
    loudest = power.reduced("ReduceMax", 1)
    heard = power > loudest * autoregression.SILENT
    ratios = view.graph.beside(*_burg(frames.reshape(-1, length), length, order))
    total = ratios.reshape(-1, n_frames, order).where(heard, 0.0).sum(1)
    count = heard.cast(np.float64).sum(1)
    return (total / count.where(count > 0.0)).reshape(0, order)


@once
def _banded(view: GraphView, band_hz: float) -> tuple[Tensor, int, float]:
    """Add the movement at twice the band, and say its length and rate; see `conditioning.banded`."""
    if view.fs <= 2 * band_hz:
        return view.unit, view.n_samples, view.fs
    n_fft = _padded(view)
    n = 2 * int(band_hz * n_fft / view.fs)
    size = view.n_samples * n // n_fft
    return _filtered(view, np.ones(n // 2 + 1), n).cut(0, size), size, view.fs * n / n_fft


def _burg(x: Tensor, n: int, order: int) -> list[Tensor]:
    """Add ln((1 + k) / (1 - k)) of each order, (n_frames, 1), of frames (n_frames, n), by Burg's method."""
    add = x.graph.add
    f, b = x.cut(1, n), x.cut(0, n - 1)
    least = (x * x).mean() * (2 * EXHAUSTED**2)
    goes_on, found = None, []
    for m in range(1, order + 1):
        product = (f * b).sum()
        total = f.reduced("ReduceSumSquare", -1) + b.reduced("ReduceSumSquare", -1)
        left = total > least * float(n - m)
        goes_on = left if goes_on is None else add("And", goes_on, left)
        k = product * -2.0 / total
        k = add("Max", add("Min", k, LARGEST), -LARGEST).where(goes_on, 0.0)
        found.append(add("Log", (k + 1.0) / (1.0 - k)))
        if m < order:
            ahead, behind = f + b * k, b + f * k
            f, b = ahead.cut(1, n - m), behind.cut(0, n - m - 1)
    return found


@graph_of("prediction_gain")
def _prediction_gain(
    view: GraphView, orders: tuple[int, ...], order: int, frame_s: float, band_hz: float
) -> Tensor:
    # 1 - k^2 with k = tanh(g / 2); gains of orders 1, 2, ... add up
    k = view.add("Tanh", _log_area_ratios(view, order, frame_s, band_hz) * 0.5)
    lost = ((1.0 - k) * (k + 1.0)).log10()
    gain = view.add("CumSum", lost, np.array(1)) * -10.0
    return gain.take(np.array(orders) - 1)
