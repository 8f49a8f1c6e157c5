"""Features of filtered and resampled movements, and of autoregressive models, as graphs."""

import numpy as np
from scipy import fft

from texclass.features import autoregression, conditioning, roughness
from texclass.recognition.export.fourier_graphs import irfft, rfft
from texclass.recognition.export.graph_view import GraphView, graph_of
from texclass.recording import Samples
from texclass.vibration.autoregressive import EXHAUSTED, LARGEST

# Filters, as in `texclass.features.conditioning`: a response times the spectrum.


def _padded(view: GraphView) -> int:
    return conditioning.FINEST * int(fft.next_fast_len(-(-view.n_samples // conditioning.FINEST)))


def _filtered(view: GraphView, response: Samples, n: int) -> str:
    """Add the first bins of the spectrum times a response, back in time at n samples: (n_rows, n)."""
    n_fft, n_bins = _padded(view), n // 2 + 1

    def spectrum() -> tuple[str, str]:
        return rfft(view.graph, view.unit, view.n_samples, n_fft, n_bins)

    real, imaginary = view.once(("spectrum", n_bins), spectrum)
    bins = np.arange(n_bins)
    scale = response * n / n_fft
    real = view.add("Mul", real, scale)
    imaginary = view.add("Mul", imaginary, np.where((bins == 0) | (2 * bins == n), 0.0, scale))
    return irfft(view.graph, real, imaginary, n)


def _low_passed(view: GraphView, cutoff_hz: float) -> tuple[str, int, int]:
    """Add the low-passed movement, and say by which factor its rate is lower, and its length."""
    n_fft, rate = _padded(view), cutoff_hz * 10
    factor = next((k for k in (conditioning.FINEST, 10, 5, 4, 2) if view.fs / k >= rate), 1)
    size = -(-view.n_samples // factor)

    def make() -> str:
        f = np.arange(n_fft // factor // 2 + 1) * (view.fs / n_fft)
        slow = _filtered(view, 1 / (1 + (f / cutoff_hz) ** 4), n_fft // factor)
        return view.shifted(slow, 0, size)

    return str(view.once(("low_passed", cutoff_hz), make)), factor, size


def _banded(view: GraphView, band_hz: float) -> tuple[str, int, float]:
    """Add the movement at twice the band, and say its length and rate; see `conditioning.banded`."""
    if view.fs <= 2 * band_hz:
        return view.unit, view.n_samples, view.fs
    n_fft = _padded(view)
    n = 2 * int(band_hz * n_fft / view.fs)
    size = view.n_samples * n // n_fft
    slow = view.once(
        ("banded", band_hz), lambda: view.shifted(_filtered(view, np.ones(n // 2 + 1), n), 0, size)
    )
    return str(slow), size, view.fs * n / n_fft


def _band_magnitude(view: GraphView, band_hz: tuple[float, float], rate_hz: float) -> str:
    """Add the magnitude of the movement in a band; see `conditioning.band_passed`."""
    low_hz, high_hz = band_hz

    def make() -> str:
        n_fft = _padded(view)
        n = 2 * int(fft.next_fast_len(int(np.ceil(n_fft * rate_hz / view.fs / 2)), real=True))
        n = min(n_fft, n)
        f = np.arange(n // 2 + 1) * (view.fs / n_fft)
        through, beside = (f * (high_hz - low_hz)) ** 4, (f**2 - low_hz * high_hz) ** 4
        slow = _filtered(view, through / (through + beside), n)
        return view.add("Abs", view.shifted(slow, 0, view.n_samples * n // n_fft))

    return str(view.once(("magnitude", band_hz, rate_hz), make))


# Roughness.


@graph_of("temporal_roughness")
def _temporal_roughness(view: GraphView, fine_hz: tuple[float, float], coarse_hz: tuple[float, float]) -> str:
    rate_hz = roughness.PERIOD * fine_hz[1]
    fine, coarse = (_band_magnitude(view, band, rate_hz) for band in (fine_hz, coarse_hz))
    ratio = view.add("Div", view.mean(fine), view.mean(coarse))
    apart = view.add("Abs", view.add("Sub", fine, view.add("Mul", coarse, ratio)))
    return view.add("Add", view.log10(view.mean(apart)), view.log_level)


@graph_of("roughness_ratio")
def _roughness_ratio(view: GraphView, fine_hz: tuple[float, float], coarse_hz: tuple[float, float]) -> str:
    rate_hz = roughness.PERIOD * fine_hz[1]
    fine, coarse = (view.mean(_band_magnitude(view, band, rate_hz)) for band in (fine_hz, coarse_hz))
    return view.add("Sub", view.log10(fine), view.log10(coarse))


@graph_of("waviness")
def _waviness(view: GraphView, cutoff_hz: float, frame_s: float, average_s: float) -> str:
    slow, factor, _ = _low_passed(view, cutoff_hz)
    frame, average = max(1, round(frame_s * view.fs)), max(1, round(average_s / frame_s))
    edges = np.append(np.arange(0, view.n_samples - frame + 1, frame), 0) // factor
    edges[-1] = (view.n_samples // frame) * frame // factor
    running = view.running(view.add("Abs", slow))
    low, high = (view.add("Gather", running, at.astype(np.int64), axis=1) for at in (edges[:-1], edges[1:]))
    m = view.add("Div", view.add("Sub", high, low), np.diff(edges).astype(np.float64))
    away = view.add("Sub", m, view.moving_average(m, edges.size - 1, average))
    return view.add("Add", view.log10(_deviation(view, away)), view.log_level)


@graph_of("spikiness")
def _spikiness(view: GraphView, cutoff_hz: float, average_s: float, floor: float) -> str:
    x, factor, size = _low_passed(view, cutoff_hz)
    average = max(1, max(1, round(average_s * view.fs)) // factor)
    sigma = _deviation(view, x)
    threshold = view.add("Add", view.add("Mul", sigma, 2.0), view.mean(x))
    above = view.add("Sub", view.add("Sub", x, view.moving_average(x, size, average)), threshold)
    excess = view.mean(view.add("Max", above, 0.0))
    excess = view.add("Add", excess, view.add("Mul", sigma, floor))
    return view.add("Add", view.log10(excess), view.log_level)


def _deviation(view: GraphView, x: str) -> str:
    away = view.add("Sub", x, view.mean(x))
    return view.add("Sqrt", view.mean(view.add("Mul", away, away)))


# Autoregressive models.


@graph_of("log_area_ratios")
def _reflection(view: GraphView, order: int, frame_s: float, band_hz: float) -> str:
    """Add the log-area ratios of the mean model, (n, order); see `autoregression.mean_model`.

    Where a frame holds nothing but the ringing of a filter, the rounding of single precision is what the
    function finds that cannot be predicted; here there is none.
    """

    def make() -> str:
        x, n, fs = _banded(view, band_hz)
        length = min(n, max(round(frame_s * fs), 4 * order))
        n_frames = n // length
        frames = view.graph.reshape(view.shifted(x, 0, n_frames * length), -1, n_frames, length)
        power = view.mean(frames, "ReduceSumSquare")
        loudest = view.mean(power, "ReduceMax", axis=1)
        heard = view.add("Greater", power, view.add("Mul", loudest, autoregression.SILENT))
        ratios = view.beside(*_burg(view, view.graph.reshape(frames, -1, length), length, order))
        ratios = view.graph.reshape(ratios, -1, n_frames, order)
        total = view.mean(view.add("Where", heard, ratios, 0.0), "ReduceSum", axis=1)
        count = view.mean(view.graph.cast(heard, np.float64), "ReduceSum", axis=1)
        count = view.where(view.add("Greater", count, 0.0), count)
        return view.graph.reshape(view.add("Div", total, count), 0, order)

    return str(view.once(("log_area_ratios", order, frame_s, band_hz), make))


def _burg(view: GraphView, x: str, n: int, order: int) -> list[str]:
    """Add ln((1 + k) / (1 - k)) of each order, (n_frames, 1), of frames (n_frames, n), by Burg's method."""
    f, b = view.shifted(x, 1, n - 1), view.shifted(x, 0, n - 1)
    least = view.add("Mul", view.mean(view.add("Mul", x, x)), 2 * EXHAUSTED**2)
    goes_on, found = None, []
    for m in range(1, order + 1):
        product = view.mean(view.add("Mul", f, b), "ReduceSum")
        total = view.add("Add", view.mean(f, "ReduceSumSquare"), view.mean(b, "ReduceSumSquare"))
        left = view.add("Greater", total, view.add("Mul", least, float(n - m)))
        goes_on = left if goes_on is None else view.add("And", goes_on, left)
        k = view.add("Div", view.add("Mul", product, -2.0), total)
        k = view.add("Max", view.add("Min", k, LARGEST), -LARGEST)
        k = view.add("Where", goes_on, k, 0.0)
        found.append(view.add("Log", view.add("Div", view.add("Add", k, 1.0), view.add("Sub", 1.0, k))))
        if m < order:
            size = n - m - 1
            ahead, behind = (
                view.add("Add", f, view.add("Mul", b, k)),
                view.add("Add", b, view.add("Mul", f, k)),
            )
            f, b = view.shifted(ahead, 1, size), view.shifted(behind, 0, size)
    return found


@graph_of("prediction_gain")
def _prediction_gain(
    view: GraphView, orders: tuple[int, ...], order: int, frame_s: float, band_hz: float
) -> str:
    # 1 - k^2 with k = tanh(g / 2); gains of orders 1, 2, ... add up
    k = view.add("Tanh", view.add("Mul", _reflection(view, order, frame_s, band_hz), 0.5))
    lost = view.log10(view.add("Mul", view.add("Sub", 1.0, k), view.add("Add", k, 1.0)))
    gain = view.add("Mul", view.add("CumSum", lost, np.array(1)), -10.0)
    return view.add("Gather", gain, np.array(orders) - 1, axis=1)
