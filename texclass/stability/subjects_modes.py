"""Subjects: decaying modes, Prony's method, taps, major frequencies and the scores of a model."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from texclass import vibration
from texclass.stability import exact, rules
from texclass.stability.inputs import (
    RATES_HZ,
    VALUES,
    Case,
    N,
    battery,
    in_families,
    noise,
    samples_of,
    with_orders,
)
from texclass.stability.judging import Attempt, Check, Documented, Subject, tried
from texclass.vibration import DecayingModes, TapModel

SUBJECTS: list[Subject] = []
SEGMENT = 200
"""Samples of a decaying segment: what the matrix pencil and Prony's method are given."""
LONGEST_TAP = 400
MODE = DecayingModes(*np.array([[90.0], [60.0], [2.0], [0.5]]))
TAP = TapModel(-1500.0, 80.0, 300.0)


def known(what: str, synthesize: Callable[[float], Any], rates_hz: Any, quick: bool) -> Iterator[Case]:
    """Yield what a model whose parameters are known sounds like, at sampling rates and at extreme gains."""
    for fs in rates_hz[:: 3 if quick else 1]:
        for gain in (1e-160, 1.0, 1e150):
            name = f"{what} at {fs:g} Hz, gain {gain:g}"
            yield Case(name, "rate", synthesize(fs) * gain, fs=fs, gain=gain)


# Modes ------------------------------------------------------------------------------------------------------


def _segments(quick: bool, longest: int, largest: int = 0) -> tuple[Case, ...]:
    decays = known("decay", lambda fs: MODE.synthesize(SEGMENT, fs), RATES_HZ, quick)
    at_orders = with_orders(in_families(*VALUES, quick=quick), quick, largest)
    return (*battery(quick, longest=longest, with_rates=False), *decays, *at_orders)


@tried(SUBJECTS, "models", "matrix pencil", partial(_segments, longest=300, largest=100))
def _matrix_pencil(x: Any, case: Case) -> Attempt:
    modes = vibration.fit_matrix_pencil(x[:SEGMENT], case.fs, order=case.order or None)
    segment = samples_of(x[:SEGMENT])
    for name in ("frequency_hz", "decay_per_s", "amplitude", "phase"):
        yield rules.finite(name, getattr(modes, name))
    slowest = float(np.min(modes.decay_per_s, initial=np.inf))
    yield Check("a decay rate that is not positive", 0.0 if slowest > 0 else 1.0, 0.0)
    yield rules.stable_sections(modes.sections(case.fs))
    size = float(np.max(np.abs(segment), initial=0.0))
    if size == 0:
        yield Check("modes found in silence", float(modes.n_modes), 0.0)
        return
    left = np.linalg.norm(modes.synthesize(segment.size, case.fs) / size - segment / size)
    yield rules.holds("no more left than there was", left / np.linalg.norm(segment / size) <= 1 + 1e-9)
    if case.name.startswith("decay at"):
        yield rules.close("decay rate of a known mode", modes.decay_per_s[:1], MODE.decay_per_s, 1e-6)
        yield rules.close("its frequency", modes.frequency_hz[:1], MODE.frequency_hz, 1e-6)
        yield rules.close("its amplitude", modes.amplitude[:1] / case.gain, MODE.amplitude, 1e-6)


@tried(SUBJECTS, "models", "Prony as published", partial(_segments, longest=60))
def _prony(x: Any, case: Case) -> Attempt:
    """Check what it says of itself; as published, it may be unstable."""
    segment = x[:SEGMENT]
    largest = float(np.max(np.abs(np.asarray(segment, dtype=np.float64)), initial=0.0))
    resolution = largest / 512 if np.isfinite(largest) and largest > 0 else 1.0
    fitted = vibration.fit_prony(segment, resolution, max_order=min(40, max(len(segment) - 1, 1)))
    yield rules.finite("coefficients", np.concatenate([fitted.a, fitted.b]))
    size = largest or 1.0
    response = fitted.synthesize(len(segment))
    error = float(np.mean(np.abs(response / size - samples_of(segment) / size)))
    if np.isfinite(fitted.error) or np.isfinite(error):
        yield rules.close("the error it states", fitted.error / size, error, 1e-6, scale=1e-9)
    if not fitted.is_stable:
        yield Documented("is_stable is False: the published method found an unstable filter")
    elif not fitted.resolved:
        yield Documented("resolved is False: no order met the resolution")
    if fitted.order <= 20 and abs(fitted.pole_radius - 1) > 1e-6:
        yield Check("stability as stated", float(exact.is_stable(fitted.a) != fitted.is_stable), 0.0)


# Taps -------------------------------------------------------------------------------------------------------


def _taps(quick: bool) -> tuple[Case, ...]:
    taps = known("tap", lambda fs: TAP.synthesize(1.0, LONGEST_TAP, fs), RATES_HZ[4:], quick)
    others = battery(quick, longest=120, with_rates=False)
    return (*taps, *(replace(case, required=False) for case in others))  # they need not decay


# Okamura's fit is one by eye: a spectral peak, and a line through some peaks.
TAP_FITS = {
    "tap model, Okamura": {"fit": vibration.fit_okamura, "limit": 0.1},
    "tap model, maximum likelihood": {"fit": vibration.fit_tap_model, "limit": 1e-6},
}


@tried(SUBJECTS, "models", TAP_FITS, _taps)
def _tap(x: Any, case: Case, *, fit: Callable[..., TapModel], limit: float) -> Attempt:
    tap = fit([x[:LONGEST_TAP], x[: LONGEST_TAP // 2]], [1.0, 1.0], case.fs)
    yield rules.finite("parameters", [tap.amplitude_slope, tap.decay_per_s, tap.frequency_hz])
    least = min(tap.decay_per_s, tap.frequency_hz)
    yield Check("decay rate or frequency not above 0", float(least <= 0), 0.0)
    yield rules.holds("frequency up to fs/2", tap.frequency_hz <= case.fs / 2)
    if case.name.startswith("tap at"):
        yield rules.close("slope of a known tap", tap.amplitude_slope / case.gain, TAP.amplitude_slope, limit)
        yield rules.close("its decay rate", tap.decay_per_s, TAP.decay_per_s, limit)
        yield rules.close("its frequency", tap.frequency_hz, TAP.frequency_hz, limit)


# Lines ------------------------------------------------------------------------------------------------------


@tried(SUBJECTS, "models", "major frequencies", battery)
def _major_frequencies(x: Any, case: Case) -> Attempt:
    lines = vibration.fit_major_frequencies(x, case.fs)
    for name in ("frequency_hz", "amplitude", "phase"):
        yield rules.finite(name, getattr(lines, name))
    f = lines.frequency_hz
    yield rules.holds("frequencies up to 1400 Hz and fs/2", np.all(f <= min(1400.0, case.fs / 2)))
    gaps = np.diff(f) - vibration.major_frequencies.beat_threshold_hz(f[:-1]) if f.size > 1 else np.zeros(1)
    yield Check("lines closer than their beat threshold", float(np.sum(gaps < 0)), 0.0)
    signal = samples_of(x)
    if np.ptp(signal) == 0:
        yield Check("lines in a constant", float(f.size), 0.0)
    elif f.size:
        scale = float(np.max(np.abs(signal)))
        # the Fourier transform at each frequency, in 80-bit floats
        wide = (signal / scale).astype(np.longdouble)
        t = np.arange(signal.size, dtype=np.longdouble)
        cycles = np.round(f / case.fs * signal.size).astype(np.longdouble)
        turns = (cycles[:, np.newaxis] * t) % signal.size
        angle = turns * (2 * np.arctan2(np.longdouble(0), np.longdouble(-1)) / signal.size)
        transform = np.exp(1j * angle) @ (wide - wide.mean())
        right = np.abs(transform).astype(np.float64) * 2 / signal.size
        yield rules.close("amplitudes", lines.amplitude / scale, right, 1e-12, scale=1.0)


# Scores -----------------------------------------------------------------------------------------------------


PERFECT = {
    "rms_spectral_error": 0.0,
    "goodness_of_fit": 1.0,
    "mean_absolute_difference": 0.0,
    "log_spectral_distance": 0.0,
    "band_energy_distance": 0.0,
}
"""Scores, and what a signal gets against itself."""


@tried(SUBJECTS, "models", {f"score, {name}": {"name": name} for name in PERFECT}, battery)
def _score(x: Any, case: Case, *, name: str) -> Attempt:
    def rated(a: Any, b: Any) -> float:
        rate = (case.fs,) if name == "band_energy_distance" else ()
        return float(getattr(vibration.scores, name)(a, b, *rate))

    def other(signal: Any) -> Any:
        return signal * (1 + 0.1 * noise(N, 5)[: len(signal)])

    alone, rating = rated(x, x), rated(x, other(samples_of(x)))
    yield rules.finite("score", (alone, rating))
    yield Check("score of a signal against itself", abs(alone - PERFECT[name]), 1e-12)
    signal = samples_of(x)
    if name == "mean_absolute_difference":
        right = exact.mean(np.abs(signal - other(signal)))
        yield rules.close("mean of |difference|", rating, right, 1e-14)
    elif np.any(signal):
        shift = 60 - int(np.frexp(np.max(np.abs(signal)))[1])
        louder = rated(np.ldexp(signal, shift), np.ldexp(other(signal), shift))
        yield rules.close("free of a common gain", louder, rating, 1e-9, scale=1.0)
