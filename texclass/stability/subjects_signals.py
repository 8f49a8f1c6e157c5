"""Subjects: filters, what comes in a stream of 10^8 samples, and the transforms that features share."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import fft
from scipy.signal import get_window

from texclass import signals
from texclass.features import conditioning, spectra
from texclass.features.phase_view import PhaseView
from texclass.recording import Samples
from texclass.stability import exact, rules
from texclass.stability.inputs import RATES_HZ, Case, battery, lengths, noise, samples_of
from texclass.stability.judging import Attempt, Check, Subject, tried
from texclass.vibration import Autoregression, LatticeInverse, LatticeSynthesis

SUBJECTS: list[Subject] = []
SHORT = 400
"""Samples that are filtered: as many as 60-digit arithmetic does in reasonable time."""
BANDS: dict[str, Any] = {"lowpass": 100.0, "highpass": 20.0, "bandpass": (50.0, 200.0)}
BLOCK = 1_000_000
STREAM = {True: 2_000_000, False: 100_000_000}
"""Samples of a stream, in a quick run and in a full one."""
SINGLE = 5e-6
"""Error of what is computed in single precision, over its largest value."""


def largest(x: Any) -> float:
    """Return the largest magnitude."""
    return float(np.max(np.abs(x)))


# Designs ----------------------------------------------------------------------------------------------------


def _designs(quick: bool) -> list[Case]:
    """Return cut-offs from 1e-5 to 0.4999 of fs, orders 1 to 16, and parameters that must be refused."""
    shares = (1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.4, 0.4999)
    designs: list[tuple[str, str, float, float, int]] = [
        (f"{kind} at {s:g} fs, fs = {fs:g} Hz, order {order}", kind, s, fs, order)
        for fs in (RATES_HZ[0], RATES_HZ[-1])
        for kind in ("lowpass", "highpass")
        for s in (shares[::3] if quick else shares)
        for order in ((2, 8) if quick else (1, 2, 4, 8, 16))
    ]
    n = len(designs)
    designs += [(f"cut-off {s:g} fs", "lowpass", s, 1e4, 4) for s in (0.0, -0.1, 0.5, 0.7, np.nan, np.inf)]
    designs += [(f"order {order}", "lowpass", 0.1, 1e4, order) for order in (0, -1)]
    designs += [(f"fs {fs:g}", "lowpass", 0.1, fs, 4) for fs in (np.nan, np.inf, 0.0, -1.0)]
    return [
        Case(name, "rate" if i < n else "broken", np.array([share, kind == "highpass"]), fs=fs, order=order)
        for i, (name, kind, share, fs, order) in enumerate(designs)
    ]


@tried(SUBJECTS, "filters", "butterworth", _designs)
def _butterworth(x: Samples, case: Case) -> Attempt:
    """Check that it is stable, and has the closed form of the Butterworth response around the cut-off."""
    share, kind = float(x[0]), "highpass" if x[1] else "lowpass"
    sos = signals.butterworth(kind, share * case.fs, case.fs, order=case.order)  # type: ignore[arg-type]
    yield rules.finite("sections", sos)
    yield rules.stable_sections(sos[:, 3:])
    f = np.array([0.5, 0.9, 1.0, 1.1, 2.0]) * share * case.fs
    f = f[f < case.fs / 2]
    right = exact.butterworth_gain(kind, (share * case.fs,), case.fs, case.order, f)
    # a pole 2 pi share from z = 1 is rounded by 1e-16: in second-order sections, squared
    limit = 1e-12 + 1e-15 * case.order / min(share, 0.5 - share) ** 2
    given = exact.sections_gain(sos, f / case.fs)
    yield rules.close("response, against 60 digits", given, right, limit)


# Filters ----------------------------------------------------------------------------------------------------


def sections_of(kind: Any, fs: float) -> Samples:
    """Return the filter of a kind that is tried, its band moved down where fs is low."""
    return signals.butterworth(kind, np.multiply(BANDS[kind], min(1.0, fs / 1000)).tolist(), fs)


def _referenced(case: Case) -> bool:
    """Whether 60 digits are spent on a case: of the lengths on all up to 40, then on every twentieth."""
    n = len(case.x)
    return case.family != "length" or n <= 40 or n % 20 == 0


@tried(SUBJECTS, "filters", {f"zero phase, {kind}": {"kind": kind} for kind in BANDS}, battery)
def _zero_phase(x: Any, case: Case, *, kind: str) -> Attempt:
    sos = sections_of(kind, case.fs)
    out = signals.zero_phase(sos, x[:SHORT])
    yield rules.finite("output", out)
    signal = samples_of(x[:SHORT])
    if _referenced(case):
        padding = min(3 * (2 * len(sos) + 1), signal.size - 1)
        right = exact.zero_phase(sos, signal, padding)
        yield rules.close("output, against 60 digits", out, right, rules.RESPONSE, scale=largest(signal))


@tried(SUBJECTS, "filters", "causal", battery)
def _causal(x: Any, case: Case) -> Attempt:
    sos = sections_of("bandpass", case.fs)
    out, _ = signals.causal(sos, x[:SHORT])
    first, state = signals.causal(sos, x[:7])
    none, state = signals.causal(sos, x[:0], state)
    rest, _ = signals.causal(sos, x[7:SHORT], state)
    yield rules.finite("output", out)
    signal = samples_of(x[:SHORT])
    yield rules.close("pieces = whole", np.concatenate([first, none, rest]), out, 0.0)
    if signal.size and _referenced(case):
        right = exact.causal(sos, signal)
        yield rules.close("output, against 60 digits", out, right, rules.RESPONSE, scale=largest(signal))


@tried(SUBJECTS, "filters", "highpass_fir", battery)
def _highpass_fir(x: Any, case: Case) -> Attempt:
    """Compare with the same filter in 80-bit floats, on the signal continued by hand."""
    out = signals.highpass_fir(x[:SHORT], 0.01 * case.fs, case.fs)
    yield rules.finite("output", out)
    signal = samples_of(x[:SHORT])
    half = int(np.ceil(3.3 * case.fs / (0.01 * case.fs) / 2))
    mirrored = min(half, signal.size - 1)
    before = 2 * signal[0] - signal[1 : mirrored + 1][::-1]
    after = 2 * signal[-1] - signal[-mirrored - 1 : -1][::-1]
    ends = [np.full(half - mirrored, (before if mirrored else signal)[0])]
    tail = [np.full(half - mirrored, (after if mirrored else signal)[-1])]
    wide = np.concatenate([*ends, before, signal, after, *tail]).astype(np.longdouble)
    n = np.arange(-half, half + 1, dtype=np.longdouble)
    smooth = np.sinc(0.02 * n) * (0.54 + 0.46 * np.cos(np.pi * n / half))
    right = signal - np.convolve(wide, smooth / smooth.sum(), "valid")
    yield rules.close("output, in 80-bit floats", out, right.astype(np.float64), 1e-9, scale=largest(signal))


# Streams: nothing drifts, the last block is what a fresh start makes of it ----------------------------------

STREAM_MODEL = Autoregression(np.linspace(0.9, -0.5, 18), np.asarray(1.0))
TAIL = slice(BLOCK // 2, None)
"""By then a filter that started differently has forgotten it."""


def _causal_blocks() -> Callable[[Samples], Any]:
    sos, state = sections_of("bandpass", 10_000.0), None

    def process(x: Samples) -> Any:
        nonlocal state
        out, state = signals.causal(sos, x, state)
        return out

    return process


def _inverse_blocks() -> Callable[[Samples], Any]:
    lattice, inverse = LatticeSynthesis(STREAM_MODEL), LatticeInverse(STREAM_MODEL)
    return lambda x: inverse.process(lattice.process(x))


STREAMS: dict[str, Callable[[], Callable[[Samples], Any]]] = {
    "stream: causal": _causal_blocks,
    "stream: lattice synthesis, p = 18": lambda: LatticeSynthesis(STREAM_MODEL).process,
    "stream: lattice inverse, p = 18": _inverse_blocks,
}


@tried(
    SUBJECTS,
    "filters",
    {name: {"start": start} for name, start in STREAMS.items()},
    lambda quick: [
        Case(f"{STREAM[quick]:.0e} samples in a stream", "stream", noise(BLOCK, 8), order=STREAM[quick])
    ],
)
def _stream(x: Samples, case: Case, *, start: Callable[[], Callable[[Samples], Any]]) -> Attempt:
    process, last = start(), x
    for _ in range(case.order // BLOCK):
        last = np.asarray(process(x))
    fresh = x if start is _inverse_blocks else np.asarray(start()(x))
    error = largest((last - fresh)[TAIL]) / largest(fresh[TAIL])
    yield Check("the last block, against a fresh start", error, 1e-9)


# Conditioning -----------------------------------------------------------------------------------------------


@tried(SUBJECTS, "transforms", "dft321", battery)
def _dft321(x: Any, case: Case) -> Attempt:
    """Check that the energy of each bin is that of all axes together, in 80-bit floats."""
    axes = np.stack([x, x[::-1], np.roll(x, 3)], axis=1)
    out = signals.dft321(axes)
    yield rules.finite("output", out)
    axes = samples_of(axes)
    scale = largest(axes)
    if scale == 0 or np.ptp(axes, axis=0).max() == 0:
        yield Check("output for constants, over them", largest(out) / (scale or 1.0), 1e-15)
        return
    wide = (axes / scale).astype(np.longdouble)
    wide -= wide.mean(axis=0)
    energy = np.sum(np.abs(fft.rfft(wide, axis=0)) ** 2, axis=1)
    energy[0] = 0
    given = np.abs(fft.rfft((out / scale).astype(np.longdouble)))
    right, given = np.sqrt(energy).astype(np.float64), given.astype(np.float64)
    if out.size % 2 == 0 and energy.size > 1:  # at fs/2 a real signal has a sign for a phase
        right, given = right[:-1], given[:-1]
    yield rules.close("magnitude of each bin", given, right, 1e-12, scale=1e-3 * axes.shape[0] ** 0.5)


def _windows(quick: bool) -> tuple[Case, ...]:
    wide = battery(quick, longest=0, with_rates=False)
    widths = (1, 2, 3, 100, 5000)
    return (
        *(case.at_order(n) for case in wide for n in widths),
        *(case.at_order(100) for case in lengths(quick)),
    )


@tried(SUBJECTS, "transforms", "moving_average", _windows)
def _moving_average(x: Any, case: Case) -> Attempt:
    out = signals.moving_average(x, case.order)
    yield rules.finite("output", out)
    right = exact.moving_average(samples_of(x), case.order)
    yield rules.close("means, against exact sums", out, right, 4e-15, scale=largest(samples_of(x)))


@tried(SUBJECTS, "transforms", "remove_hand_motion", battery)
def _remove_hand_motion(x: Any, case: Case) -> Attempt:
    out = signals.remove_hand_motion(x, case.fs)
    yield rules.finite("output", out)
    signal = samples_of(x)
    right = signal - exact.moving_average(signal, max(2 * round(signals.HAND_SPAN_S * case.fs / 2) + 1, 3))
    yield rules.close("output, against exact sums", out, right, 4e-15, scale=largest(signal))


def _long_too(quick: bool) -> tuple[Case, ...]:
    long = () if quick else (Case("5e+06 samples", "stream", 1e3 + noise(5_000_000, 9)),)
    return (*battery(quick), *long)


@tried(SUBJECTS, "transforms", "rms", _long_too)
def _rms(x: Any, case: Case) -> Attempt:
    value = signals.rms(x)
    yield rules.finite("rms", value)
    yield rules.close("rms, against exact sums", value, exact.root(exact.mean_square(samples_of(x))), 1e-14)


@tried(SUBJECTS, "transforms", "frame", battery)
def _frame(x: Any, case: Case) -> Attempt:
    framed = signals.frame(x, 64, 16)
    yield Check("a view that can be written to", float(framed.flags.writeable), 0.0)
    signal = samples_of(x)
    right = np.stack([signal[i : i + 64] for i in range(0, signal.size - 63, 16)])
    same = framed.shape == right.shape and np.array_equal(framed, right, equal_nan=True)
    yield rules.holds("the samples themselves", same)


# Shared by features: against 80-bit floats where that is feasible, and always free of gain ------------------


def _cutoff(view: PhaseView) -> float:
    return min(100.0, 0.1 * view.fs)


SHARED: dict[str, Callable[[PhaseView], Any]] = {
    "spectrum": conditioning.spectrum,
    "low_spectrum": conditioning.low_spectrum,
    "autocorrelation": spectra.autocorrelation,
    "spectral_changes (DCT)": lambda v: spectra.spectral_changes(v, 256, 64),
    "power_frames": lambda v: spectra.power_frames(v, 128 / v.fs, 64 / v.fs, "hann")[0],
    "mean_spectrum": lambda v: spectra.mean_spectrum(v)[1],
    "high_passed": lambda v: conditioning.high_passed(v, _cutoff(v)),
    "low_passed": lambda v: conditioning.low_passed(v, _cutoff(v))[0],
    "band_passed": lambda v: conditioning.band_passed(v, _cutoff(v), 2 * _cutoff(v), v.fs),
    "details": lambda v: np.concatenate(conditioning.details(v, _cutoff(v), "coif3", 3)),
}


def _in_80_bits(name: str, x: Any, fs: float) -> Any:
    """Return what a transform of 80-bit samples is; None where that is not feasible."""
    spectrum = fft.rfft(x, conditioning.FINEST * fft.next_fast_len(-(-x.size // conditioning.FINEST)))
    right: Any = None
    match name:
        case "spectrum":
            right = spectrum
        case "low_spectrum":
            right = spectrum[: (spectrum.size + 1) // 2]
        case "autocorrelation":
            padded = fft.rfft(x, 2 * x.size)
            right = fft.irfft(padded.real**2 + padded.imag**2)[: x.size]
        case "spectral_changes (DCT)":
            framed = np.stack([x[i : i + 256] for i in range(0, x.size - 255, 64)])
            change = np.diff(np.abs(fft.dct(framed, axis=1, norm="ortho")), axis=0)
            right = np.mean(change**2, axis=1)
        case "power_frames":
            w = get_window("hann", 128).astype(np.longdouble)
            framed = np.stack([x[i : i + 128] for i in range(0, x.size - 127, 64)])
            power = np.abs(fft.rfft(framed * w, axis=1)) ** 2 * 2 / (fs * (w @ w))
            power[:, [0, -1]] /= 2
            right = power
        case "mean_spectrum":
            step = fs / (2 * (spectrum.size - 1))
            width = max(1.0, step)
            n_bins = int(min(spectra.BAND_HZ, fs / 2) / width)
            edges = np.ceil(np.arange(n_bins + 1) * (width / step) - 1e-6).astype(int)
            power = np.abs(spectrum) ** 2
            right = np.array([power[i:j].mean() for i, j in pairwise(edges)]) * 2 / (fs * x.size)
    return right


@tried(SUBJECTS, "transforms", {f"shared, {name}": {"name": name} for name in SHARED}, battery)
def _shared(x: Any, case: Case, *, name: str) -> Attempt:
    transform = SHARED[name]
    out = np.asarray(transform(PhaseView(np.asarray(x, dtype=np.float64), case.fs)))
    yield rules.finite("output", np.abs(out))
    signal = samples_of(x)
    right = _in_80_bits(name, (signal / largest(signal)).astype(np.longdouble), case.fs)
    if right is not None:
        wide = np.abs(right).astype(np.float64)
        yield rules.close("in 80-bit floats", np.abs(out), wide, SINGLE, scale=1e-6)
    unit = np.ldexp(signal, -int(np.frexp(largest(signal))[1]))
    other = np.asarray(transform(PhaseView(unit * 1.1, case.fs)))
    scale = 1e-3 if name == "band_passed" else 1e-2  # of the movement, whose largest magnitude is 1
    yield rules.close("free of gain", np.abs(other), np.abs(out), 1e-5, scale=scale)
