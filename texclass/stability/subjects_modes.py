"""Subjects: decaying modes, Prony's method, taps, major frequencies and the scores of texclass."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from texclass import vibration
from texclass.recording import Samples
from texclass.stability import exact, exact_models, rules
from texclass.stability.signals import (
    FORMS,
    RATES_HZ,
    VALUES,
    Case,
    N,
    in_families,
    lengths,
    noise,
    rates,
    samples_of,
    with_orders,
)
from texclass.stability.verdict import Check, Documented, Finding, Subject
from texclass.vibration import DecayingModes, MajorFrequencies, PronyFilter, TapModel, scores

SEGMENT = 200
"""Samples of a decaying segment: what the matrix pencil and Prony's method are given."""
LONGEST_TAP = 400


def subjects() -> list[Subject]:
    """Return the models of short segments, taps and lines, and the scores."""
    pencil = _subject("matrix pencil", _segments, _pencil, _pencil_checks)
    prony = _subject("Prony as published", _few_segments, _prony, _prony_checks)
    taps = [
        _subject(f"tap model, {name}", _taps, _fitting(fit), _recovering(limit))
        for name, fit, limit in (
            ("Okamura", vibration.fit_okamura, 0.1),  # by eye: a spectral peak, and a line through some peaks
            ("maximum likelihood", vibration.fit_tap_model, 1e-6),
        )
    ]
    lines = _subject("major frequencies", _signals, _lines, _lines_checks)
    return [pencil, prony, *taps, lines, *(_score_subject(name) for name in SCORES)]


def _subject(name: str, cases: Any, run: Any, checks: Any) -> Subject:
    return Subject(name, "models", "texclass", cases, run, checks)


def _signals(quick: bool) -> tuple[Case, ...]:
    return (*in_families(*VALUES, *FORMS, quick=quick), *lengths(quick), *rates(quick))


def _segments(quick: bool) -> tuple[Case, ...]:
    automatic = (*in_families(*VALUES, *FORMS, quick=quick), *lengths(quick, 300), *decays(quick))
    return (*automatic, *with_orders(in_families(*VALUES, quick=quick), quick, 100))


def _few_segments(quick: bool) -> tuple[Case, ...]:
    return (*in_families(*VALUES, *FORMS, quick=quick), *lengths(quick, 60), *decays(quick))


def decays(quick: bool) -> tuple[Case, ...]:
    """Return one decaying sinusoid at each sampling rate and at extreme gains: the truth is known."""
    cases = []
    for fs in RATES_HZ[:: 3 if quick else 1]:
        for gain in (1e-160, 1.0, 1e150):
            x = TRUTH.synthesize(SEGMENT, fs) * gain
            cases.append(
                Case(f"decay at {fs:g} Hz, gain {gain:g}", "rate", lambda x=x: x, fs, gain=gain)  # type: ignore[misc]
            )
    return tuple(cases)


TRUTH = DecayingModes(*np.array([[90.0], [60.0], [2.0], [0.5]]))


# Modes ------------------------------------------------------------------------------------------------------


def _pencil(x: Any, case: Case) -> DecayingModes:
    return vibration.fit_matrix_pencil(x[:SEGMENT], case.fs, order=case.order or None)


def _pencil_checks(x: Any, case: Case, modes: DecayingModes) -> Iterator[Finding]:
    segment = samples_of(x[:SEGMENT])
    for name in ("frequency_hz", "decay_per_s", "amplitude", "phase"):
        yield rules.finite(name, getattr(modes, name))
    slowest = float(np.min(modes.decay_per_s, initial=np.inf))
    yield Check("a decay rate that is not positive", 0.0 if slowest > 0 else 1.0, 0.0)
    poles = modes.sections(case.fs)[:, 4:]
    inside = (np.abs(poles[:, 1]) < 1) & (np.abs(poles[:, 0]) < 1 + poles[:, 1])
    yield Check("sections that are not stable", float(np.sum(~inside)), 0.0)
    size = float(np.max(np.abs(segment), initial=0.0))
    if size == 0:
        yield Check("modes found in silence", float(modes.n_modes), 0.0)
        return
    left = np.linalg.norm(modes.synthesize(segment.size, case.fs) / size - segment / size)
    yield rules.holds("no more left than there was", left / np.linalg.norm(segment / size) <= 1 + 1e-9)
    if case.name.startswith("decay at"):
        yield rules.close("decay rate of a known mode", modes.decay_per_s[:1], TRUTH.decay_per_s, 1e-6)
        yield rules.close("its frequency", modes.frequency_hz[:1], TRUTH.frequency_hz, 1e-6)
        yield rules.close("its amplitude", modes.amplitude[:1] / case.gain, TRUTH.amplitude, 1e-6)


def _prony(x: Any, case: Case) -> PronyFilter:
    segment = x[:SEGMENT]
    largest = float(np.max(np.abs(np.asarray(segment, dtype=np.float64)), initial=0.0))
    resolution = largest / 512 if np.isfinite(largest) and largest > 0 else 1.0
    return vibration.fit_prony(segment, resolution, max_order=min(40, max(len(segment) - 1, 1)))


def _prony_checks(x: Any, case: Case, fitted: PronyFilter) -> Iterator[Finding]:
    """Check what it says of itself; as published, it may be unstable."""
    segment = samples_of(x[:SEGMENT])
    yield rules.finite("coefficients", np.concatenate([fitted.a, fitted.b]))
    size = float(np.max(np.abs(segment), initial=0.0)) or 1.0
    response = fitted.synthesize(segment.size)
    error = float(np.mean(np.abs(response / size - segment / size)))
    if np.isfinite(fitted.error) or np.isfinite(error):
        yield rules.close("the error it states", fitted.error / size, error, 1e-6, scale=1e-9)
    if exact.available() and fitted.order <= 20 and abs(fitted.pole_radius - 1) > 1e-6:
        yield Check("stability as stated", float(exact_models.is_stable(fitted.a) != fitted.is_stable), 0.0)
    if not fitted.is_stable:
        yield Documented("is_stable is False: the published method found an unstable filter")
    elif not fitted.resolved:
        yield Documented("resolved is False: no order met the resolution")


# Taps -------------------------------------------------------------------------------------------------------


def _taps(quick: bool) -> tuple[Case, ...]:
    others = (*in_families(*VALUES, *FORMS, quick=quick), *lengths(quick, 120))
    return (*_known_taps(quick), *(replace(case, required=False) for case in others))  # they need not decay


def _known_taps(quick: bool) -> tuple[Case, ...]:
    cases = []
    for fs in RATES_HZ[4 :: 3 if quick else 1]:
        for gain in (1e-160, 1.0, 1e150):
            x = gain * TapModel(-1500.0, 80.0, 300.0).synthesize(1.0, LONGEST_TAP, fs)
            cases.append(
                Case(f"tap at {fs:g} Hz, gain {gain:g}", "rate", lambda x=x: x, fs, gain=gain)  # type: ignore[misc]
            )
    return tuple(cases)


def _fitting(fit: Callable[..., TapModel]) -> Callable[[Any, Case], TapModel]:
    return lambda x, case: fit([x[:LONGEST_TAP], x[: LONGEST_TAP // 2]], [1.0, 1.0], case.fs)


def _recovering(limit: float) -> Callable[[Any, Case, TapModel], Iterator[Finding]]:
    return lambda x, case, tap: _tap_checks(case, tap, limit)


def _tap_checks(case: Case, tap: TapModel, limit: float) -> Iterator[Finding]:
    values = [tap.amplitude_slope, tap.decay_per_s, tap.frequency_hz]
    yield rules.finite("parameters", values)
    yield Check("decay rate or frequency not above 0", float(min(values[1:]) <= 0), 0.0)
    yield rules.holds("frequency up to fs/2", tap.frequency_hz <= case.fs / 2)
    if case.name.startswith("tap at"):
        truth = [-1500.0, 80.0, 300.0]
        yield rules.close("slope of a known tap", tap.amplitude_slope / case.gain, truth[0], limit)
        yield rules.close("its decay rate", tap.decay_per_s, truth[1], limit)
        yield rules.close("its frequency", tap.frequency_hz, truth[2], limit)


# Lines ------------------------------------------------------------------------------------------------------


def _lines(x: Any, case: Case) -> MajorFrequencies:
    return vibration.fit_major_frequencies(x, case.fs)


def _lines_checks(x: Any, case: Case, lines: MajorFrequencies) -> Iterator[Finding]:
    signal = samples_of(x)
    for name in ("frequency_hz", "amplitude", "phase"):
        yield rules.finite(name, getattr(lines, name))
    f = lines.frequency_hz
    yield rules.holds("frequencies up to 1400 Hz and fs/2", np.all(f <= min(1400.0, case.fs / 2)))
    gaps = np.diff(f) - vibration.major_frequencies.beat_threshold_hz(f[:-1]) if f.size > 1 else np.zeros(1)
    yield Check("lines closer than their beat threshold", float(np.sum(gaps < 0)), 0.0)
    if np.ptp(signal) == 0:
        yield Check("lines in a constant", float(f.size), 0.0)
        return
    if lines.frequency_hz.size:
        yield from _line_amplitudes(signal, case, lines)


def _line_amplitudes(x: Samples, case: Case, lines: MajorFrequencies) -> Iterator[Finding]:
    """Check that each amplitude is that of the Fourier transform at its frequency, in 80-bit floats."""
    scale = float(np.max(np.abs(x)))
    wide = (x / scale).astype(np.longdouble)
    wide = wide - wide.mean()
    t = np.arange(x.size, dtype=np.longdouble)
    cycles = np.round(lines.frequency_hz * x.size / case.fs).astype(np.longdouble)
    turns = (cycles[:, np.newaxis] * t) % x.size
    angle = turns * (2 * np.arctan2(np.longdouble(0), np.longdouble(-1)) / x.size)
    transform = (np.cos(angle) @ wide) + 1j * (np.sin(angle) @ wide)
    amplitude = np.abs(transform).astype(np.float64) * 2 / x.size
    yield rules.close("amplitudes", lines.amplitude / scale, amplitude, 1e-12, scale=1.0)


# Scores -----------------------------------------------------------------------------------------------------

SCORES: dict[str, tuple[Callable[..., float], float]] = {
    "rms_spectral_error": (scores.rms_spectral_error, 0.0),
    "goodness_of_fit": (scores.goodness_of_fit, 1.0),
    "mean_absolute_difference": (scores.mean_absolute_difference, 0.0),
    "log_spectral_distance": (scores.log_spectral_distance, 0.0),
    "band_energy_distance": (scores.band_energy_distance, 0.0),
}


def _score_subject(name: str) -> Subject:
    score, perfect = SCORES[name]

    def rated(a: Any, b: Any, case: Case) -> float:
        return score(a, b, case.fs) if name == "band_energy_distance" else score(a, b)

    def run(x: Any, case: Case) -> tuple[float, float]:
        other = samples_of(x) * (1 + 0.1 * noise(N, 5)[: len(x)])
        return rated(x, x, case), rated(x, other, case)

    def checks(x: Any, case: Case, rating: tuple[float, float]) -> Iterator[Finding]:
        yield rules.finite("score", rating)
        yield Check("score of a signal against itself", abs(rating[0] - perfect), 1e-12)
        signal = samples_of(x)
        if name == "mean_absolute_difference":
            difference = np.abs(signal - signal * (1 + 0.1 * noise(N, 5)[: signal.size]))
            yield rules.close("mean of |difference|", rating[1], exact.mean(difference), 1e-14)
        elif np.any(signal):
            other = signal * (1 + 0.1 * noise(N, 5)[: signal.size])
            exponent = int(np.frexp(np.max(np.abs(signal)))[1])
            louder = rated(np.ldexp(signal, 60 - exponent), np.ldexp(other, 60 - exponent), case)
            yield rules.close("free of a common gain", louder, rating[1], 1e-9, scale=1.0)

    return _subject(f"score, {name}", _signals, run, checks)
