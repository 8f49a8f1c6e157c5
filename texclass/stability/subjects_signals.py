"""Subjects: filters, streams of 10^8 samples, the transforms that features share; and every feature."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from scipy import fft
from scipy.signal import get_window

from texclass import signals
from texclass.features import conditioning, spectra
from texclass.features.contract import UndefinedFeatureError, registered
from texclass.features.examination import bare_view
from texclass.features.phase_view import Phase, PhaseView, Views
from texclass.features.sets import FeatureSet, Member
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.stability import exact, rules
from texclass.stability.inputs import LONG, RATES_HZ, Case, battery, lengths, noise, plain, samples_of
from texclass.stability.judging import Attempt, Check, Subject, Trial, tried
from texclass.vibration import Autoregression, LatticeInverse, LatticeSynthesis

SUBJECTS: list[Subject] = []
filters = partial(tried, SUBJECTS, "filters")
transforms = partial(tried, SUBJECTS, "transforms")
SHORT = 400
"""Samples that are filtered: as many as 60-digit arithmetic does in reasonable time."""
BANDS: dict[Any, Any] = {"lowpass": 100.0, "highpass": 20.0, "bandpass": (50.0, 200.0)}
BLOCK = 1_000_000
STREAM_MODEL = Autoregression(np.linspace(0.9, -0.5, 18), np.asarray(1.0))
SINGLE = 5e-6
"""Error of what is computed in single precision, over its largest value."""


def largest(x: Any) -> float:
    """Return the largest magnitude."""
    return float(np.max(np.abs(x)))


# Filters ----------------------------------------------------------------------------------------------------


def _designs(quick: bool) -> list[Case]:
    """Return cut-offs from 1e-5 to 0.4999 of fs, orders 1 to 16, and parameters that must be refused."""
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
def _butterworth(x: Samples, case: Case) -> Attempt:
    """Check that it is stable, and has the closed form of the Butterworth response around the cut-off."""
    share, kind = float(x[0]), "highpass" if x[1] else "lowpass"
    sos = signals.butterworth(kind, share * case.fs, case.fs, order=case.order)  # type: ignore[arg-type]
    yield rules.finite("sections", sos)
    yield rules.stable_sections(sos[:, 3:])
    f = np.array([0.5, 0.9, 1.0, 1.1, 2.0]) * share * case.fs
    f = f[f < case.fs / 2]
    right = exact.butterworth_gain(kind, share * case.fs, case.fs, case.order, f)
    # a pole 2 pi share from z = 1 is rounded by 1e-16: in second-order sections, squared
    limit = 1e-12 + 1e-15 * case.order / min(share, 0.5 - share) ** 2
    yield rules.close("response, against 60 digits", exact.sections_gain(sos, f / case.fs), right, limit)


def _sections(kind: Any, fs: float) -> Samples:
    """Return the filter of a kind that is tried, its band moved down where fs is low."""
    return signals.butterworth(kind, np.multiply(BANDS[kind], min(1.0, fs / 1000)).tolist(), fs)


def _referenced(case: Case) -> bool:
    """Whether 60 digits are spent on a case: of the lengths on all up to 40, then on every twentieth."""
    n = len(case.x)
    return case.family != "length" or n <= 40 or n % 20 == 0


@filters({f"zero phase, {kind}": {"kind": kind} for kind in BANDS}, battery)
def _zero_phase(x: Any, case: Case, *, kind: str) -> Attempt:
    sos = _sections(kind, case.fs)
    out = signals.zero_phase(sos, x[:SHORT])
    yield rules.finite("output", out)
    signal = samples_of(x[:SHORT])
    if _referenced(case):
        right = exact.zero_phase(sos, signal, min(3 * (2 * len(sos) + 1), signal.size - 1))
        yield rules.close("output, against 60 digits", out, right, rules.RESPONSE, scale=largest(signal))


@filters("causal", battery)
def _causal(x: Any, case: Case) -> Attempt:
    sos = _sections("bandpass", case.fs)
    out, _ = signals.causal(sos, x[:SHORT])
    first, state = signals.causal(sos, x[:7])
    none, state = signals.causal(sos, x[:0], state)
    rest, _ = signals.causal(sos, x[7:SHORT], state)
    yield rules.finite("output", out)
    signal = samples_of(x[:SHORT])
    pieces = np.concatenate([first, none, rest])
    if not signal.size:
        yield rules.holds("no sample gives none", out.size == pieces.size == 0)
        return
    yield rules.close("pieces = whole", pieces, out, rules.RESPONSE, scale=largest(signal))
    if _referenced(case):
        right = exact.causal(sos, signal)
        yield rules.close("output, against 60 digits", out, right, rules.RESPONSE, scale=largest(signal))


# Streams ----------------------------------------------------------------------------------------------------


def _causal_blocks() -> Callable[[Samples], Any]:
    sos, state = _sections("bandpass", 10_000.0), None

    def process(x: Samples) -> Any:
        nonlocal state
        out, state = signals.causal(sos, x, state)
        return out

    return process


def _inverse_blocks() -> Callable[[Samples], Any]:
    lattice, inverse = LatticeSynthesis(STREAM_MODEL), LatticeInverse(STREAM_MODEL)
    return lambda x: inverse.process(lattice.process(x))


STREAMS: dict[str, Callable[[], Callable[[Samples], Any]]] = {
    "causal": _causal_blocks,
    "lattice synthesis, p = 18": lambda: LatticeSynthesis(STREAM_MODEL).process,
    "lattice inverse, p = 18": _inverse_blocks,
}


def _in_a_stream(quick: bool) -> list[Case]:
    n = 2_000_000 if quick else 100_000_000
    return [Case(f"{n:.0e} samples in a stream", "stream", noise(BLOCK, 8), order=n)]


@filters({f"stream: {name}": {"start": start} for name, start in STREAMS.items()}, _in_a_stream)
def _stream(x: Samples, case: Case, *, start: Callable[[], Callable[[Samples], Any]]) -> Attempt:
    """Check that nothing drifts: the last block is what a fresh start makes of it, once that has settled."""
    process, last = start(), x
    for _ in range(case.order // BLOCK):
        last = np.asarray(process(x))
    fresh = x if start is _inverse_blocks else np.asarray(start()(x))
    settled = slice(BLOCK // 2, None)
    error = largest((last - fresh)[settled]) / largest(fresh[settled])
    yield Check("the last block, against a fresh start", error, 1e-9)


# Conditioning -----------------------------------------------------------------------------------------------


@transforms("dft321", battery)
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
    right = np.linalg.norm(np.abs(fft.rfft(wide - wide.mean(axis=0), axis=0)).astype(np.float64), axis=1)
    right[0] = 0
    given = np.abs(fft.rfft((out / scale).astype(np.longdouble)))
    if out.size % 2 == 0:  # at fs/2 a real signal has a sign for a phase
        right, given = right[:-1], given[:-1]
    yield rules.close("magnitude of each bin", given, right, 1e-12, scale=1e-3 * out.size**0.5)


def _windows(quick: bool) -> list[Case]:
    whole = battery(quick, longest=0, with_rates=False)
    each = [case.at_order(n) for case in whole for n in (1, 2, 3, 100, 5000)]
    return [*each, *(case.at_order(100) for case in lengths(quick))]


@transforms("moving_average", _windows)
def _moving_average(x: Any, case: Case) -> Attempt:
    out = signals.moving_average(x, case.order)
    yield rules.finite("output", out)
    signal = samples_of(x)
    right = exact.moving_average(signal, case.order)
    yield rules.close("means, against exact sums", out, right, 4e-15, scale=largest(signal))


@transforms("remove_hand_motion", battery)
def _remove_hand_motion(x: Any, case: Case) -> Attempt:
    out = signals.remove_hand_motion(x, case.fs)
    yield rules.finite("output", out)
    signal = samples_of(x)
    right = signal - exact.moving_average(signal, max(2 * round(signals.HAND_SPAN_S * case.fs / 2) + 1, 3))
    yield rules.close("output, against exact sums", out, right, 4e-15, scale=largest(signal))


# Shared by features: against 80-bit floats where that is feasible, and always free of gain ------------------


def _spectrum(x: Any) -> Any:
    return fft.rfft(x, conditioning.FINEST * fft.next_fast_len(-(-x.size // conditioning.FINEST)))


def _autocorrelation(x: Any, fs: float) -> Any:
    padded = fft.rfft(x, 2 * x.size)
    return fft.irfft(padded.real**2 + padded.imag**2)[: x.size]


def _spectral_changes(x: Any, fs: float) -> Any:
    transformed = fft.dct(sliding_window_view(x, 256)[::64], axis=1, norm="ortho")
    return np.mean(np.diff(np.abs(transformed), axis=0) ** 2, axis=1)


def _power_frames(x: Any, fs: float) -> Any:
    w = get_window("hann", 128).astype(np.longdouble)
    power = np.abs(fft.rfft(sliding_window_view(x, 128)[::64] * w, axis=1)) ** 2 * 2 / (fs * (w @ w))
    power[:, [0, -1]] /= 2
    return power


def _mean_spectrum(x: Any, fs: float) -> Any:
    power = np.abs(_spectrum(x)) ** 2 * 2 / (fs * x.size)
    step = fs / (2 * (power.size - 1))
    width = max(1.0, step)
    n_bins = int(min(spectra.BAND_HZ, fs / 2) / width)
    edges = np.ceil(np.arange(n_bins + 1) * (width / step) - 1e-6).astype(int)
    return np.array([power[i:j].mean() for i, j in pairwise(edges)])


def _cutoff(view: PhaseView) -> float:
    return min(100.0, 0.1 * view.fs)


SHARED: dict[str, tuple[Callable[[PhaseView], Any], Callable[[Any, float], Any] | None]] = {
    "spectrum": (conditioning.spectrum, lambda x, fs: _spectrum(x)),
    "low_spectrum": (conditioning.low_spectrum, lambda x, fs: np.array_split(_spectrum(x), 2)[0]),
    "autocorrelation": (spectra.autocorrelation, _autocorrelation),
    "spectral_changes (DCT)": (lambda v: spectra.spectral_changes(v, 256, 64), _spectral_changes),
    "power_frames": (lambda v: spectra.power_frames(v, 128 / v.fs, 64 / v.fs, "hann")[0], _power_frames),
    "mean_spectrum": (lambda v: spectra.mean_spectrum(v)[1], _mean_spectrum),
    "high_passed": (lambda v: conditioning.high_passed(v, _cutoff(v)), None),
    "low_passed": (lambda v: conditioning.low_passed(v, _cutoff(v))[0], None),
    "band_passed": (lambda v: conditioning.band_passed(v, _cutoff(v), 2 * _cutoff(v), v.fs), None),
    "details": (lambda v: np.concatenate(conditioning.details(v, _cutoff(v), "coif3", 3)), None),
}
"""What several features read: the transform, and what it is of 80-bit samples at a rate."""


@transforms({f"shared, {name}": {"name": name} for name in SHARED}, battery)
def _shared(x: Any, case: Case, *, name: str) -> Attempt:
    transform, reference = SHARED[name]
    out = np.abs(np.asarray(transform(PhaseView(np.asarray(x, dtype=np.float64), case.fs))))
    yield rules.finite("output", out)
    signal = samples_of(x)
    if reference:
        right = np.abs(reference((signal / largest(signal)).astype(np.longdouble), case.fs))
        yield rules.close("in 80-bit floats", out, right, SINGLE, scale=1e-6)
    other = np.abs(np.asarray(transform(PhaseView(exact.unit(signal) * 1.1, case.fs))))
    scale = 1e-3 if name == "band_passed" else 1e-2  # of the movement, whose largest magnitude is 1
    yield rules.close("free of gain", other, out, 1e-5, scale=scale)


GAIN_ERROR = 1e-5
"""Relative error of the gain law; features work in single precision inside."""
STEADY = ("plain", "poles", "oversampled", "gain", "rate")
"""Families on which a change of the samples by 1e-13 may not be seen.

Symmetric signals may tip over, and for what stands on an offset that is no small change.
"""
SHAKEN = "change when samples change by 1e-13"
cases = partial(battery, n=LONG)
"""What a feature is given."""
Extract = Callable[[Any, Case], tuple[dict[str, Any], dict[str, str]]]


def without_ribs(quick: bool) -> list[Case]:
    """Return the cases as inputs that may be refused: even ordinary noise has no ribs."""
    return [replace(case, required=False) for case in cases(quick)]


def subjects() -> list[Subject]:
    """Return one subject for each feature, and all features together as a library is judged."""
    members = tuple(Member(name, feature) for name, feature in registered().items())
    whole = FeatureSet("all", members).reading("tap", "movement", "travel", "friction")

    def extract(x: Any, case: Case) -> tuple[dict[str, Any], dict[str, str]]:
        values, reasons = whole.compute(views_of(x, case.fs))
        why = dict(reasons)
        told = {c: why[m.name] for m in members if m.name in why for c in m.columns}
        return dict(zip(whole.column_names, values.tolist(), strict=True)), told

    given = {"rib_density": without_ribs}
    each = [Subject(m.name, "features", given.get(m.name, cases), partial(_feature, m)) for m in members]
    return [*each, Subject("all features", "features", cases, extraction(extract))]


def views_of(x: Any, fs: float, phase: Phase = "movement") -> Views:
    """Return the samples as a movement, as friction, and as taps with their contact after a quarter.

    One tap of few samples, four of many. Over its way, the samples of a movement are a tenth of a mm apart at
    10 kHz. For a pair: the samples, and the same backwards.
    """
    if phase == "pair":
        one, other = views_of(x, fs), views_of(x[::-1], fs)
        return replace(one, sides=(one, other))
    n = len(x)
    each = n // 4 if n >= LONG else n
    taps = tuple(Tap(i, i + min(each // 4, each - 1), i + each) for i in range(0, n - each + 1, max(each, 1)))
    phases = Phases(taps if n else (), (0, n))
    return Views(Recording(x, fs=fs, friction=x, speed=np.full(n, 1000.0), phases=phases), phases)


def shaken(x: Samples) -> Samples:
    """Return the samples changed by 1e-13 of each."""
    return x * (1 + 1e-13 * noise(x.size, 6))


def _feature(member: Member, x: Any, case: Case) -> Attempt:
    feature, signal = member.feature, samples_of(x)
    if case.family == "broken":
        values = np.atleast_1d(
            np.asarray(feature.function(bare_view(feature.phase, signal, case.fs)), np.float64)
        )
    else:
        values = member.values(views_of(x, case.fs, feature.phase))
    yield rules.finite("value", values)
    yield Check("as many values as declared", abs(values.size - len(member.columns)), 0.0)
    if not np.any(signal):
        yield Check("a value for silence", np.inf, 0.0)
        return
    # 1.1 rounds every sample anew; 1.1 times 1e6 is rounded by 1e-10, which is 1e-7 of the noise on it
    limit = 1e-3 if case.family == "offset" else GAIN_ERROR
    louder = _values(member, 1.1 * signal, case.fs)
    yield _law("the declared gain law, at gain 1.1", louder, feature.gain.apply(values, 1.1), limit)
    if case.family in STEADY:
        size = np.maximum(np.abs(values), np.abs(_usual(member.name)))
        change = np.abs(_values(member, shaken(signal), case.fs) - values)
        change = np.divide(change, size, out=np.zeros_like(change), where=change > 0)
        yield Check(SHAKEN, float(np.max(change, initial=0.0)), rules.SENSITIVITY)
    if case.family in ("dtype", "layout"):
        yield rules.close("as of the float64 copy", values, _values(member, signal, case.fs), 0.0)
    if case.family == "gain":
        law = feature.gain.apply(_values(member, plain(LONG), case.fs), case.gain)
        yield _law("the declared gain law, from gain 1", values, law, GAIN_ERROR)
    match feature.name:  # those that can be had in many digits
        case "friction":
            right = math.fsum(np.abs(signal)) / signal.size
            yield rules.close("mean |x|, against exact sums", values[0], right, 1e-13)
        case "mean_magnitude":
            wide = signal.astype(np.longdouble)
            right = float(np.abs(wide - wide.mean()).mean())
            scale = 1e-4 * float(np.max(np.abs(signal)))
            yield rules.close("mean |x - mean|", values[0], right, 1e-13, scale=scale)
        case "variance":
            square = float(signal.astype(np.longdouble).var())
            if 1e-290 < square < 1e290:
                rounding = (1e-13 * float(np.max(np.abs(signal)))) ** 2 / square  # of an offset
                yield rules.close("variance, in 80-bit floats", values[0], square, 1e-13 + rounding)
        case "lpc_coefficients":
            yield from rules.stable_coefficients(np.concatenate([[1.0], -values]))


def _values(member: Member, samples: Any, fs: float) -> Samples:
    try:
        return member.values(views_of(samples, fs, member.feature.phase))
    except UndefinedFeatureError:
        return np.full(len(member.columns), np.nan)


def _law(what: str, given: Samples, expected: Any, limit: float) -> Check:
    """Check y(g x) = g^power y(x) + shift log10(g), apart from values near the end of float64's range.

    Outputs of one feature share a scale: 0 may come out as 1e-17.
    """
    right = np.asarray(expected, dtype=np.float64)
    size = np.maximum(np.maximum(np.abs(right), np.abs(given)), 1e-290)
    size = np.maximum(size, 1e-7 * size.max())
    counts = (np.abs(right) > 1e-290) & (np.abs(right) < 1e290)
    error = np.max(np.where(counts, np.abs(given - right) / size, 0.0), initial=0.0)
    return Check(what, float(error), limit)


@cache
def _usual(name: str) -> Samples:
    """Return the values for plain noise, which say what size counts as small."""
    return np.nan_to_num(_values(Member(name, registered()[name]), plain(LONG), 10_000.0))


def extraction(extract: Extract) -> Trial:
    """Return an attempt at a library of features, all outputs together.

    Parameters
    ----------
    extract
        Takes samples and case, returns outputs by name, and reasons by output.
    """

    def numbers(x: Any, case: Case) -> rules.Values:
        return as_numbers(extract(x, case)[0])

    @cache
    def of_noise(gain: float, fs: float) -> rules.Values:
        return numbers(gain * plain(LONG), Case("plain", "plain", plain(LONG), fs=fs))

    def attempt(x: Any, case: Case) -> Attempt:
        result, reasons = extract(x, case)
        yield result
        values, expected, signal = as_numbers(result), of_noise(1.0, case.fs), samples_of(x)
        yield from rules.features(values, reasons, expected)
        if case.family in STEADY:
            changed = numbers(shaken(signal), case)
            yield rules.same_values(SHAKEN, changed, values, rules.SENSITIVITY, expected)
        if case.family in ("dtype", "layout"):
            copy = numbers(signal, case)
            yield rules.same_values("as of the float64 copy", values, copy, 1e-4)
        if case.family == "gain":
            laws = rules.inferred_laws([of_noise(gain, case.fs) for gain in rules.LAW_GAINS])
            yield rules.under_gain(values, expected, laws, case.gain, 1e-4)
        if reasons and len(reasons) == len(values):
            yield next(iter(reasons.values()))

    return attempt


def as_numbers(outputs: dict[str, Any]) -> rules.Values:
    """Return outputs as floats, NaN where one is no number."""
    return pd.to_numeric(pd.Series(outputs), errors="coerce").astype(np.float64)
