"""Subjects: filters, streams of 10^8 samples, the transforms that features share; and every feature."""

import math
from collections.abc import Callable, Mapping, Sequence
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
from texclass.stability.rules import Attempt, Check, Subject, Trial, tried
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


# Features, ours one by one, and those of a library all together ---------------------------------------------


GAIN_ERROR = 1e-5
"""Relative error of a declared gain law; our features work in single precision inside."""
LAW_GAINS = (1e-6, 1e-3, 1.0, 1e3, 1e6)
"""A library that declares no gain law has one where an output follows it over these twelve decades."""
SENSITIVITY = 1e-3
"""Relative change of a feature that a relative change of the samples by 1e-13 may make."""
STEADY = ("plain", "poles", "oversampled", "gain", "rate")
"""Families on which a change of the samples by 1e-13 may not be seen.

Symmetric signals may tip over, and for what stands on an offset that is no small change.
"""
cases = partial(battery, n=LONG)
"""What a feature is given."""
Extract = Callable[[Any, Case], tuple[dict[str, Any], dict[str, str]]]
"""Takes samples and case, returns outputs by name, and reasons by output."""
Laws = Mapping[Any, tuple[float, float]]
"""Output -> (power, shift) of y(g x) = g^power y(x) + shift log10(g)."""
Values = pd.Series


def subjects() -> list[Subject]:
    """Return one subject for each feature, and all features together as a library is judged."""
    members = tuple(Member(name, feature) for name, feature in registered().items())
    whole = FeatureSet("all", members).reading("tap", "movement", "travel", "friction")

    def extract(x: Any, case: Case) -> tuple[dict[str, Any], dict[str, str]]:
        values, reasons = whole.compute(views_of(x, case.fs))
        why = dict(reasons)
        told = {c: why[m.name] for m in members if m.name in why for c in m.columns}
        return dict(zip(whole.column_names, values.tolist(), strict=True)), told

    def without_ribs(quick: bool) -> list[Case]:
        return [replace(case, required=False) for case in cases(quick)]  # even ordinary noise has none

    given = {"rib_density": without_ribs}
    each = [Subject(m.name, "features", given.get(m.name, cases), one_feature(m)) for m in members]
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


def one_feature(member: Member) -> Trial:
    """Return an attempt at one of our features: as a library of its outputs; then what else is known."""
    feature = member.feature
    law = feature.gain.power, feature.gain.shift

    def extract(x: Any, case: Case) -> tuple[dict[str, Any], dict[str, str]]:
        if case.family == "broken":  # a recording would refuse it
            given = feature.function(bare_view(feature.phase, samples_of(x), case.fs))
            values = np.atleast_1d(np.asarray(given, dtype=np.float64))
        else:
            values = member.values(views_of(x, case.fs, feature.phase))
        return dict(zip(member.columns, values.tolist(), strict=True)), {}

    as_of_a_library = extraction(extract, dict.fromkeys(member.columns, law))

    def attempt(x: Any, case: Case) -> Attempt:
        findings = as_of_a_library(x, case)
        values = next(findings)
        yield values
        yield from findings
        signal = samples_of(x)
        yield rules.holds("no value for silence", np.any(signal))
        yield from _in_many_digits(feature.name, signal, list(values.values()))

    return attempt


def _in_many_digits(name: str, signal: Samples, values: list[float]) -> Attempt:
    """Check the features that can be had in many digits."""
    wide = signal.astype(np.longdouble)
    match name:
        case "friction":
            right = math.fsum(np.abs(signal)) / signal.size
            yield rules.close("mean |x|, against exact sums", values[0], right, 1e-13)
        case "mean_magnitude":
            right = float(np.abs(wide - wide.mean()).mean())
            yield rules.close("mean |x - mean|", values[0], right, 1e-13, scale=1e-4 * largest(signal))
        case "variance":
            square = float(wide.var())
            if 1e-290 < square < 1e290:
                rounding = (1e-13 * largest(signal)) ** 2 / square  # of an offset
                yield rules.close("variance, in 80-bit floats", values[0], square, 1e-13 + rounding)
        case "lpc_coefficients":
            yield from rules.stable_coefficients(np.append(1.0, -np.array(values)))


def extraction(extract: Extract, laws: Laws | None = None) -> Trial:
    """Return an attempt at a library of features, all outputs together.

    Parameters
    ----------
    extract
        What is tried.
    laws
        Gain laws that it declares; else it is held to those that it follows (see `inferred_laws`).
    """
    limit, copied = (1e-4, 1e-4) if laws is None else (GAIN_ERROR, 0.0)

    def numbers(x: Any, case: Case) -> Values:
        try:
            return as_numbers(extract(x, case)[0])
        except UndefinedFeatureError:
            return pd.Series(np.nan, index=pd.Index(list(laws or ())))

    @cache
    def of_noise(gain: float, fs: float) -> Values:
        return numbers(gain * plain(LONG), Case("plain", "plain", plain(LONG), fs=fs))

    def attempt(x: Any, case: Case) -> Attempt:
        result, reasons = extract(x, case)
        yield result
        values, expected, signal = as_numbers(result), of_noise(1.0, case.fs), samples_of(x)
        yield from whole(values, reasons, expected)
        if case.family in STEADY:
            changed = numbers(signal * (1 + 1e-13 * noise(signal.size, 6)), case)
            what = "change when samples change by 1e-13"
            yield same_values(what, changed, values, SENSITIVITY, expected)
        if case.family in ("dtype", "layout"):
            yield same_values("as of the float64 copy", values, numbers(signal, case), copied)
        if laws is not None:
            # 1.1 rounds every sample anew: 1.1 times 1e6 by 1e-10, which is 1e-7 of the noise on it
            louder, allowed = numbers(1.1 * signal, case), 1e-3 if case.family == "offset" else limit
            yield rules.holds("a value at gain 1.1", np.isfinite(louder).all())
            # outputs of one feature share a scale: 0 may come out as 1e-17
            shared = 1e-7 * louder.abs().max()
            yield under_gain("the declared gain law, at gain 1.1", louder, values, laws, 1.1, allowed, shared)
        if case.family == "gain":
            what, of, least = "the declared gain law, from gain 1", laws, 1e-7 * values.abs().max()
            if of is None:
                what, least = "the gain law it follows from 1e-6 to 1e6", None
                of = inferred_laws([of_noise(gain, case.fs) for gain in LAW_GAINS])
            yield under_gain(what, values, expected, of, case.gain, limit, least)
        if reasons and len(reasons) == len(values):
            yield next(iter(reasons.values()))

    return attempt


def as_numbers(outputs: dict[str, Any]) -> Values:
    """Return outputs as floats, NaN where one is no number."""
    return pd.to_numeric(pd.Series(outputs), errors="coerce").astype(np.float64)


def whole(values: Values, reasons: Mapping[str, str], expected: Values) -> Attempt:
    """Check that every output that plain noise has is there, and is finite or has a reason."""
    n_differ = values.index.symmetric_difference(expected.index).size
    yield Check(f"as many columns as for noise ({n_differ} differ)", float(n_differ), 0.0)
    unsaid = values.index[~np.isfinite(values)].difference(list(reasons), sort=False)
    silent = [name for name in unsaid if np.isfinite(expected.get(name, 0.0))]
    first = f", {', '.join(silent[:3])}" if silent else ""
    what = f"finite outputs, or a reason: {len(silent)} of {len(values)} NaN without a reason{first}"
    yield rules.holds(what, not silent)
    if reasons:
        yield f"{len(reasons)} of {len(values)}: {next(iter(reasons.values()))}"


def same_values(
    what: str, values: Values, reference: Values, limit: float, scale: Values | None = None
) -> Check:
    """Check the worst relative difference of outputs that both have a value; `scale` says what is small."""
    both = pd.concat({"given": values, "right": reference, "scale": scale}, axis=1)
    both = both[np.isfinite(both["given"]) & np.isfinite(both["right"])]
    size = both.abs().replace(np.inf, 0.0).max(axis=1)
    return _worst(what, (both["given"] - both["right"]).abs() / size, limit)


def inferred_laws(outputs: Sequence[Values]) -> dict[Any, tuple[float, float]]:
    """Return the laws that outputs of noise follow at all `LAW_GAINS`."""
    decades, laws = np.diff(np.log10(LAW_GAINS)), {}
    for name, y in pd.concat(outputs, axis=1).T.dropna(axis=1).items():
        if not np.all(np.isfinite(y)):
            continue
        steps, rounding = np.diff(y) / decades, 1e-6 * y.abs().max()
        if np.ptp(steps) <= rounding:
            shift = float(steps.mean())
            laws[name] = 0.0, (shift if abs(shift) > rounding else 0.0)
        elif np.all(y > 0) or np.all(y < 0):
            powers = np.diff(np.log10(np.abs(y))) / decades
            if np.ptp(powers) <= 1e-6:
                laws[name] = float(powers.mean().round(6)), 0.0
    return laws


def under_gain(
    what: str, values: Values, once: Values, laws: Laws, gain: float, limit: float, least: float | None = None
) -> Check:
    """Check that outputs keep their law at any gain; values out of the range of float64 do not count.

    Errors are over the output as it should be, over `least` if it is smaller (by default over what is added).
    """
    errors = {}
    for name, (power, shift) in laws.items():
        exponent = power * np.log10(gain) + np.log10(abs(once[name])) if once[name] else 0.0
        given, added = values.get(name, np.nan), shift * np.log10(gain)
        if np.isfinite(given) and abs(exponent) <= 290:
            right = once[name] * gain**power + added
            small = abs(added) if least is None else least
            errors[name] = abs(given - right) / max(abs(right), small, 1e-300)
    return _worst(what, pd.Series(errors, dtype=float), limit)


def _worst(what: str, errors: Values, limit: float) -> Check:
    """Check the largest of some outputs' errors, naming the output that exceeds its limit."""
    worst = float(errors.fillna(0.0).max()) if len(errors) else 0.0
    return Check(f"{what} ({errors.idxmax()})" if worst > limit else what, worst, limit)
