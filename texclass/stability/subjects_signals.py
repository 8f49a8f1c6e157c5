"""Subjects of the battery: filters, streams of 10^8 samples, and transforms that features share."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from scipy import fft

from texclass import signals
from texclass.features import movement_filters, spectra
from texclass.features.phase_view import PhaseView
from texclass.recording import Samples
from texclass.stability import checks, references
from texclass.stability.checks import Check, Findings, Subject, largest, register
from texclass.stability.inputs import RATES_HZ, Case, battery, lengths, noise, to_float64
from texclass.vibration import Autoregression, LatticeInverse, LatticeSynthesis

SUBJECTS: list[Subject] = []
filters = partial(register, SUBJECTS, "filters")
transforms = partial(register, SUBJECTS, "transforms")
SHORT = 400
"""Number of samples to filter, limited by the run time of 60-digit arithmetic."""
BANDS: dict[Any, Any] = {"lowpass": 100.0, "highpass": 20.0, "bandpass": (50.0, 200.0)}
BLOCK = 1_000_000
STREAM_MODEL = Autoregression(np.linspace(0.9, -0.5, 18), np.asarray(1.0))

# Filters ----------------------------------------------------------------------------------------------------


def _designs(quick: bool) -> list[Case]:
    """Return designs with cut-offs from 1e-5 fs to 0.4999 fs and orders 1 to 16, and invalid designs."""
    shares = (1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.4, 0.4999)

    def design(name: str, family: str, share: float, fs: float, order: int, kind: str = "lowpass") -> Case:
        return Case(name, family, np.array([share, kind == "highpass"]), fs=fs, order=order)

    return [
        *(
            design(f"{kind} at {s:g} fs, fs = {fs:g} Hz, order {order}", "rate", s, fs, order, kind)
            for fs in (RATES_HZ[0], RATES_HZ[-1])
            for kind in ("lowpass", "highpass")
            for s in (shares[::3] if quick else shares)
            for order in ((2, 8) if quick else (1, 2, 4, 8, 16))
        ),
        *(design(f"cut-off {s:g} fs", "broken", s, 1e4, 4) for s in (0.0, -0.1, 0.5, 0.7, np.nan, np.inf)),
        *(design(f"order {order}", "broken", 0.1, 1e4, order) for order in (0, -1)),
        *(design(f"fs {fs:g}", "broken", 0.1, fs, 4) for fs in (np.nan, np.inf, 0.0, -1.0)),
    ]


@filters("butterworth", _designs)
def _butterworth(x: Samples, case: Case) -> Findings:
    """Check the stability, and compare the response around the cut-off with its closed form."""
    share, kind = float(x[0]), "highpass" if x[1] else "lowpass"
    sos = signals.butterworth(kind, share * case.fs, case.fs, order=case.order)  # type: ignore[arg-type]
    yield checks.finite("sections", sos)
    yield checks.stable_sections(sos[:, 3:])
    f = np.array([0.5, 0.9, 1.0, 1.1, 2.0]) * share * case.fs
    f = f[f < case.fs / 2]
    right = references.butterworth_gain(kind, share * case.fs, case.fs, case.order, f)
    # A pole at the distance 2 pi share from z = 1 is rounded by 1e-16. In second-order sections, the relative
    # error of the response grows with the inverse square of this distance.
    limit = 1e-12 + 1e-15 * case.order / min(share, 0.5 - share) ** 2
    yield checks.close(
        "response, against 60 digits", references.sections_gain(sos, f / case.fs), right, limit
    )


def _sections(kind: Any, fs: float) -> Samples:
    """Return the filter of a kind. Its band is lower if fs is low."""
    return signals.butterworth(kind, np.multiply(BANDS[kind], min(1.0, fs / 1000)).tolist(), fs)


def _has_reference(case: Case) -> bool:
    """Return whether to compute a 60-digit reference: for lengths up to 40, and for multiples of 20."""
    n = len(case.x)
    return case.family != "length" or n <= 40 or n % 20 == 0


@filters({f"zero phase, {kind}": {"kind": kind} for kind in BANDS}, battery)
def _zero_phase(x: Any, case: Case, *, kind: str) -> Findings:
    sos = _sections(kind, case.fs)
    out = signals.zero_phase(sos, x[:SHORT])
    yield checks.finite("output", out)
    signal = to_float64(x[:SHORT])
    if _has_reference(case):
        right = references.zero_phase(sos, signal, min(3 * (2 * len(sos) + 1), signal.size - 1))
        yield checks.close(
            "output, against 60 digits", out, right, checks.MAX_RESPONSE_ERROR, scale=largest(signal)
        )


@filters("causal", battery)
def _causal(x: Any, case: Case) -> Findings:
    sos = _sections("bandpass", case.fs)
    out, _ = signals.causal(sos, x[:SHORT])
    first, state = signals.causal(sos, x[:7])
    empty, state = signals.causal(sos, x[:0], state)
    last, _ = signals.causal(sos, x[7:SHORT], state)
    yield checks.finite("output", out)
    signal = to_float64(x[:SHORT])
    blocks = np.concatenate([first, empty, last])
    if not signal.size:
        yield checks.condition("an empty signal gives an empty output", out.size == blocks.size == 0)
        return
    yield checks.close("blocks = whole", blocks, out, checks.MAX_RESPONSE_ERROR, scale=largest(signal))
    if _has_reference(case):
        right = references.causal(sos, signal)
        yield checks.close(
            "output, against 60 digits", out, right, checks.MAX_RESPONSE_ERROR, scale=largest(signal)
        )


# Streams ----------------------------------------------------------------------------------------------------


def _band_pass() -> Callable[[Samples], Any]:
    sos, state = _sections("bandpass", 10_000.0), None

    def process(x: Samples) -> Any:
        nonlocal state
        out, state = signals.causal(sos, x, state)
        return out

    return process


def _synthesis() -> Callable[[Samples], Any]:
    return LatticeSynthesis(STREAM_MODEL).process


def _synthesis_and_inverse() -> Callable[[Samples], Any]:
    lattice, inverse = LatticeSynthesis(STREAM_MODEL), LatticeInverse(STREAM_MODEL)
    return lambda x: inverse.process(lattice.process(x))


def _stream_cases(quick: bool) -> list[Case]:
    n = 2_000_000 if quick else 100_000_000
    return [Case(f"{n:.0e} samples in a stream", "stream", noise(BLOCK, 8), order=n)]


@filters(
    {
        "stream: causal": {"start": _band_pass},
        "stream: lattice synthesis, p = 18": {"start": _synthesis},
        "stream: lattice inverse, p = 18": {"start": _synthesis_and_inverse},
    },
    _stream_cases,
)
def _stream(x: Samples, case: Case, *, start: Callable[[], Callable[[Samples], Any]]) -> Findings:
    """Check for drift: the last block must equal the output of a new filter after its transient."""
    process, last = start(), x
    for _ in range(case.order // BLOCK):
        last = np.asarray(process(x))
    expected = x if start is _synthesis_and_inverse else np.asarray(start()(x))
    second_half = slice(BLOCK // 2, None)
    error = largest((last - expected)[second_half]) / largest(expected[second_half])
    yield Check("the last block, against a new filter", error, 1e-9)


# Conditioning -----------------------------------------------------------------------------------------------


@transforms("dft321", battery)
def _dft321(x: Any, case: Case) -> Findings:
    """Check in 80-bit floats that the energy of each bin is the sum of the energies of all axes."""
    axes = np.stack([x, x[::-1], np.roll(x, 3)], axis=1)
    out = signals.dft321(axes)
    yield checks.finite("output", out)
    axes = to_float64(axes)
    scale = largest(axes)
    if scale == 0 or np.ptp(axes, axis=0).max() == 0:
        yield Check("output for constants, over them", largest(out) / (scale or 1.0), 1e-15)
        return
    wide = (axes / scale).astype(np.longdouble)
    right = np.linalg.norm(np.abs(fft.rfft(wide - wide.mean(axis=0), axis=0)).astype(np.float64), axis=1)
    right[0] = 0
    magnitude = np.abs(fft.rfft((out / scale).astype(np.longdouble)))
    if out.size % 2 == 0:  # the bin at fs/2 of a real signal has no phase
        right, magnitude = right[:-1], magnitude[:-1]
    yield checks.close("magnitude of each bin", magnitude, right, 1e-12, scale=1e-3 * out.size**0.5)


def _windows(quick: bool) -> list[Case]:
    full_length = battery(quick, longest=0, with_rates=False)
    cases = [case.at_order(n) for case in full_length for n in (1, 2, 3, 100, 5000)]
    return [*cases, *(case.at_order(100) for case in lengths(quick))]


@transforms("moving_average", _windows)
def _moving_average(x: Any, case: Case) -> Findings:
    out = signals.moving_average(x, case.order)
    yield checks.finite("output", out)
    signal = to_float64(x)
    right = references.moving_average(signal, case.order)
    rounding = np.finfo(float).eps * signal.size  # a running sum rounds once per sample
    yield checks.close("means, against exact sums", out, right, 4e-15 + rounding, scale=largest(signal))


@transforms("remove_hand_motion", battery)
def _remove_hand_motion(x: Any, case: Case) -> Findings:
    out = signals.remove_hand_motion(x, case.fs)
    yield checks.finite("output", out)
    signal = to_float64(x)
    right = signal - references.moving_average(
        signal, max(2 * round(signals.HAND_WINDOW_S * case.fs / 2) + 1, 3)
    )
    yield checks.close("output, against exact sums", out, right, 4e-15, scale=largest(signal))


# Transforms that features share: comparison with 80-bit floats if feasible, and independence of gain --------


def _spectrum(x: Any, fs: float) -> Any:
    factor = movement_filters.MAX_DECIMATION
    return fft.rfft(x, factor * fft.next_fast_len(-(-x.size // factor)))


def _autocorrelation(x: Any, fs: float) -> Any:
    padded = fft.rfft(x, 2 * x.size)
    return fft.irfft(padded.real**2 + padded.imag**2)[: x.size]


def _spectral_changes(x: Any, fs: float) -> Any:
    transformed = fft.dct(sliding_window_view(x, 256)[::64], axis=1, norm="ortho")
    return np.mean(np.diff(np.abs(transformed), axis=0) ** 2, axis=1)


def _power_frames(x: Any, fs: float) -> Any:
    w = scipy.signal.get_window("hann", 128).astype(np.longdouble)
    power = np.abs(fft.rfft(sliding_window_view(x, 128)[::64] * w, axis=1)) ** 2 * 2 / (fs * (w @ w))
    power[:, [0, -1]] /= 2
    return power


def _mean_spectrum(x: Any, fs: float) -> Any:
    power = np.abs(_spectrum(x, fs)) ** 2 * 2 / (fs * x.size)
    weights, step = np.ones(power.size), fs / (2 * (power.size - 1))
    top, width = min(spectra.BAND_HZ, fs / 2), max(1.0, step)
    n_bins, is_full_band = int(top / width), top == fs / 2
    if is_full_band:  # the bin at fs/2 has no mirror image
        power[-1], weights[-1] = power[-1] / 2, 0
        n_bins = power.size if width == step else int(np.ceil(top - 1e-6))
    edges = np.ceil(np.arange(n_bins + 1) * (width / step) - 1e-6).astype(int)
    edges[-1] = power.size if is_full_band else edges[-1]
    return np.array([power[i:j].sum() / max(weights[i:j].sum(), 1) for i, j in pairwise(edges)])


def _cutoff(view: PhaseView) -> float:
    return min(100.0, 0.1 * view.fs)


SHARED: dict[str, tuple[Callable[[PhaseView], Any], Callable[[Any, float], Any] | None]] = {
    "spectrum": (movement_filters.spectrum, _spectrum),
    "low_spectrum": (movement_filters.low_spectrum, lambda x, fs: np.array_split(_spectrum(x, fs), 2)[0]),
    "autocorrelation": (spectra.autocorrelation, _autocorrelation),
    "spectral_changes (DCT)": (lambda v: spectra.spectral_changes(v, 256, 64), _spectral_changes),
    "power_frames": (lambda v: spectra.power_frames(v, 128 / v.fs, 64 / v.fs, "hann")[0], _power_frames),
    "mean_spectrum": (lambda v: spectra.mean_spectrum(v)[1], _mean_spectrum),
    "high_passed": (lambda v: movement_filters.high_passed(v, _cutoff(v)), None),
    "low_passed": (lambda v: movement_filters.low_passed(v, _cutoff(v))[0], None),
    "band_passed": (lambda v: movement_filters.band_passed(v, _cutoff(v), 2 * _cutoff(v), v.fs), None),
    "details": (lambda v: np.concatenate(movement_filters.details(v, _cutoff(v), "coif3", 3)), None),
}
"""Transform that several features use -> function, and its reference in 80-bit floats (or None)."""


@transforms({f"shared, {name}": {"name": name} for name in SHARED}, battery)
def _shared(x: Any, case: Case, *, name: str) -> Findings:
    transform, reference = SHARED[name]
    out = np.abs(np.asarray(transform(PhaseView(np.asarray(x, dtype=np.float64), case.fs))))
    yield checks.finite("output", out)
    signal = to_float64(x)
    if reference:
        right = np.abs(reference((signal / largest(signal)).astype(np.longdouble), case.fs))
        yield checks.close("in 80-bit floats", out, right, 5e-6, scale=1e-6)  # computed in single precision
    other = np.abs(np.asarray(transform(PhaseView(references.scale_to_unit(signal) * 1.1, case.fs))))
    scale = 1e-3 if name == "band_passed" else 1e-2  # relative to the movement, whose largest magnitude is 1
    yield checks.close("free of gain", other, out, 1e-5, scale=scale)
