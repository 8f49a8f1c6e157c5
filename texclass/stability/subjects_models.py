"""Subjects: every model of a vibration, its fits, what is derived from it, and its scores."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from texclass import vibration
from texclass.recording import Samples
from texclass.stability import exact, rules
from texclass.stability.inputs import (
    RATES_HZ,
    VALUES,
    Case,
    N,
    battery,
    beyond,
    in_families,
    noise,
    samples_of,
    with_orders,
)
from texclass.stability.judging import Attempt, Check, Documented, Finding, Subject, tried
from texclass.vibration import (
    Autoregression,
    DecayingModes,
    LatticeInverse,
    LatticeSynthesis,
    TapModel,
    line_spectrum,
)
from texclass.vibration.autoregressive import autocorrelation, from_autocorrelation

SUBJECTS: list[Subject] = []
METHODS = {"burg": "Burg", "autocorrelation": "the autocorrelation method"}
"""Those with an optimum that can be had in many digits."""
EXCITATION = noise(192, 7)
Derivation = Callable[[Samples, Case], Attempt]
OMEGA_FEW = np.array([1e-6, 0.05, 0.3, 0.7, 1.5, 2.9, np.pi])
SEGMENT = 200
"""Samples of a decaying segment: what the matrix pencil and Prony's method are given."""
LONGEST_TAP = 400
MODE = DecayingModes(*np.array([[90.0], [60.0], [2.0], [0.5]]))
TAP = TapModel(-1500.0, 80.0, 300.0)


def at_orders(quick: bool, largest: int) -> tuple[Case, ...]:
    """Return the battery at each order, and signals hardly longer than the order."""
    return (*with_orders(battery(quick, with_rates=False), quick, largest), *beyond(quick))


# Fits -------------------------------------------------------------------------------------------------------


@tried(
    SUBJECTS,
    "models",
    {f"fit, {name}": {"method": name} for name in METHODS},
    partial(at_orders, largest=1000),
)
def _fit(x: Any, case: Case, *, method: Any) -> Attempt:
    model = vibration.fit(x, case.order, method=method)
    yield rules.finite("gain", model.gain)
    signal = samples_of(x)
    yield from rules.predictor(signal, case.order, METHODS[method], k=model.reflection)
    yield from _free_of_gain(signal, case, model, method)
    if not np.any(signal):
        yield Check("gain of silence", float(model.gain), 0.0)
        return
    rms = exact.root(exact.mean_square(signal))
    yield rules.close("residual of order 0 = RMS", model.residual[0], rms, 1e-12)
    if exact.EXTENDED:
        padding = 0 if method == "burg" else model.order
        energies = exact.lattice_energies(signal, model.reflection, padding)
        m = min(model.order, energies.size - 1)
        samples = signal.size - m if method == "burg" else signal.size
        measured = float(rms * np.sqrt(energies[m] * signal.size / samples))
        limit, floor = 1e-6, 1e-8 * rms  # of a residual below 1e-14 of the signal only that it is so small
        yield rules.close("residual as the samples give it", model.residual[m], measured, limit, scale=floor)


@tried(
    SUBJECTS,
    "models",
    "fit, modified covariance",
    lambda quick: (case for case in at_orders(quick, 18 if quick else 128) if case.order <= 128),  # O(n p^2)
)
def _fit_both_ways(x: Any, case: Case) -> Attempt:
    """Check that it is stable, and leaves no more residual than Burg's, or is Burg's fit itself."""
    model = vibration.fit(x, case.order, method="modified_covariance")
    yield rules.finite("gain", model.gain)
    signal = samples_of(x)
    yield rules.finite("reflection coefficients", model.reflection)
    yield rules.stable(model.reflection)
    yield from _free_of_gain(signal, case, model, "modified_covariance")
    if not np.any(signal):
        yield Check("gain of silence", float(model.gain), 0.0)
    else:
        most = 1.01 * np.sqrt(x.size) * exact.root(exact.mean_square(signal))
        yield rules.holds("a gain no larger than the signal", model.gain <= most)
    if model.fallback:
        burg = vibration.fit(signal, case.order, method="burg")
        yield rules.close("the fallback is Burg's fit", model.reflection, burg.reflection, 0.0)
        yield Documented(
            "fallback: modified covariance is unstable or undetermined here, Burg's fit returned"
        )
    elif np.any(signal) and exact.EXTENDED:
        above = rules.excess(signal, case.order, "Burg", k=model.reflection)
        yield Check("residual energy above Burg's", above, rules.EXCESS)


def _free_of_gain(x: Samples, case: Case, model: Autoregression, method: Any) -> Iterator[Finding]:
    louder = vibration.fit(np.ldexp(_unit(x), 40), case.order, method=method)
    alone = vibration.fit(_unit(x), case.order, method=method)
    yield rules.close("k free of gain", louder.reflection, alone.reflection, 0.0)
    if case.family in ("dtype", "layout"):
        copy = vibration.fit(x, case.order, method=method)
        yield rules.close("k as of the float64 copy", model.reflection, copy.reflection, 0.0)


def _unit(x: Samples) -> Samples:
    return np.ldexp(x, -int(np.frexp(np.max(np.abs(x), initial=0.0))[1]))


@tried(SUBJECTS, "models", "from_autocorrelation", partial(at_orders, largest=400))
def _from_lags(x: Any, case: Case) -> Attempt:
    """Check that the Yule-Walker equations hold for the lags given, as far as they were solved."""
    samples = _unit(samples_of(x))
    if samples.size == 0:
        raise ValueError("from_autocorrelation got no sample in this battery; the rule is one")
    r = autocorrelation(samples[np.newaxis], case.order)[0] if np.all(np.isfinite(samples)) else samples
    model = from_autocorrelation(r)
    yield rules.finite("gain", model.gain)
    fitted = int(model.fitted_order)
    yield rules.stable(model.reflection)
    if fitted < case.order:
        yield Documented(f"fitted_order: the lags determine {fitted} orders of {case.order}")
    if fitted > 18 or not np.any(r):
        return
    a = exact.coefficients(model.reflection[:fitted])
    size = sum(abs(c) for c in a)
    equations = [
        abs(sum(c * float(r[abs(m - i)]) for i, c in enumerate(a))) / (size * float(r[0]))
        for m in range(1, fitted + 1)
    ]
    yield Check("Yule-Walker equations", float(max(equations, default=0.0)), 1e-13)


@tried(
    SUBJECTS,
    "models",
    "select_order",
    lambda quick: with_orders(battery(quick, longest=0, with_rates=False), quick, 50),
)
def _select_order(x: Any, case: Case) -> Attempt:
    criteria: Any = ("spectral_error", "aicc")
    chosen = {c: vibration.select_order(x, case.order, criterion=c) for c in criteria}
    for criterion, selection in chosen.items():
        yield Check("orders looked at", abs(selection.values.size - case.order - 1), 0.0)
        yield Check(f"{criterion} is no number", float(np.isnan(selection.values).sum()), 0.0)
        yield Check("order of the model", abs(selection.model.order - selection.order), 0.0)
        quiet = np.ldexp(_unit(samples_of(x)), -300)
        same = vibration.select_order(quiet, case.order, criterion=criterion)
        yield Check(f"{criterion}: the order is free of gain", abs(same.order - selection.order), 0.0)


# From reflection coefficients -------------------------------------------------------------------------------


def handmade(quick: bool, largest: int) -> Iterator[Case]:
    """Yield models that no fit gives: every reflection coefficient of one size, or next to 1."""
    orders = (1, 2, 18, 128) if quick else (1, 2, 10, 18, 50, 100, 128, 256, 400, 1000)
    for p in (p for p in orders if p <= largest):
        sign = np.where(np.arange(p) % 2, -1.0, 1.0)
        random = np.random.default_rng(p).choice([-1.0, 1.0], p)
        for name, k in {
            "all k = 0.9": np.full(p, 0.9),
            "all k = -0.9": np.full(p, -0.9),
            "k = 0.999, alternating": 0.999 * sign,
            "k = 1 - 1e-12, random sign": (1 - 1e-12) * random,
            "k = 1 - 2^-53": np.full(p, 1 - 2.0**-53),
        }.items():
            yield Case(name, "poles", k).at_order(p)


def models(quick: bool, largest: int) -> tuple[Case, ...]:
    """Return the models by hand, and one at each order for each signal."""
    signals = with_orders(in_families(*VALUES, quick=quick), quick, largest)
    return (*signals, *handmade(quick, largest))


def k_of(x: Any, case: Case) -> Samples:
    """Return the reflection coefficients a case stands for: those given by hand, or Burg's of its signal."""
    is_given = case.name.startswith(("k =", "all k ="))
    return samples_of(x) if is_given else vibration.fit(samples_of(x), case.order).reflection


def unit_model(k: Samples) -> Autoregression:
    """Return the model of reflection coefficients at unit gain."""
    return Autoregression(k, np.asarray(1.0))


def derived(name: str, largest: int) -> Callable[[Derivation], Derivation]:
    """Return a decorator: what is derived from reflection coefficients is a subject, given `models`."""

    def cases(quick: bool) -> tuple[Case, ...]:
        return models(quick, min(largest, 400 if largest == 1000 else 128) if quick else largest)

    def add(derivation: Derivation) -> Derivation:
        @tried(SUBJECTS, "models", name, cases)
        def attempt(x: Any, case: Case) -> Attempt:
            yield from derivation(k_of(x, case), case)

        return derivation

    return add


@derived("line spectrum, there and back", 1000)
def _line_spectrum(k: Samples, case: Case) -> Attempt:
    lsf = line_spectrum.from_reflection(k)
    back = line_spectrum.to_reflection(lsf)
    yield from rules.line_spectrum(k, lsf, back)
    if line_spectrum.conditioning(lsf) >= 1:
        yield Documented("conditioning >= 1: two frequencies that float64 cannot tell apart")
    if case.order <= 50:
        yield Check("frequencies, against 60 digits", exact.line_spectrum_error(k, lsf), 1e-12)


@derived("lattice synthesis", 1000)
def _lattice_synthesis(k: Samples, case: Case) -> Attempt:
    model = unit_model(k)
    level = float(model.level) if np.isfinite(model.level) else 1.0
    out: Samples = np.asarray(LatticeSynthesis(model, level=level).process(EXCITATION), np.float64)
    pieces = LatticeSynthesis(model, level=level)
    cut = [EXCITATION[:50], EXCITATION[50:51], EXCITATION[51:51], EXCITATION[51:]]
    pieced = np.concatenate([pieces.process(piece) for piece in cut])
    single = np.asarray(LatticeSynthesis(model, level=1.0, dtype=np.float32).process(EXCITATION))
    yield rules.finite("synthesis", out)
    size = float(np.linalg.norm(EXCITATION))  # rotations: no state exceeds the energy that went in
    yield rules.holds("bounded in float64", np.max(np.abs(out)) <= level * size)
    yield rules.holds("bounded in float32", np.max(np.abs(single)) <= size)
    yield rules.close("pieces = whole", pieced, out, 0.0)
    if float(model.prediction_gain_db) < 60:
        limit = 1e-6 * case.order + 1e-4
        yield rules.close("float32 against float64", single * level, out, limit)
    if case.order <= 50 and np.isfinite(model.level):
        yield rules.response("synthesis", out, k, EXCITATION)


@derived("lattice inverse filter", 400)
def _lattice_inverse(k: Samples, case: Case) -> Attempt:
    """Check that undoing the synthesis loses the prediction gain (level / gain) in digits, and no more."""
    model = unit_model(k)
    level = None if np.isfinite(model.level) else 1.0
    out = LatticeSynthesis(model, level=level).process(EXCITATION)
    back = np.asarray(LatticeInverse(model, level=level).process(out))
    yield back
    lost = 1e-15 * case.order * 10 ** (min(float(model.prediction_gain_db), 400.0) / 20)
    if lost > 1e-4:
        yield Check("a prediction gain beyond what float64 can undo", 0.0, 0.0)
    else:
        yield rules.close("the excitation comes back", back, EXCITATION, 1000 * lost + 1e-12)


@derived("log spectrum", 1000)
def _log_spectrum(k: Samples, case: Case) -> Attempt:
    db = unit_model(k).log_spectrum_db(OMEGA_FEW)
    yield rules.finite("log spectrum", db)
    right = exact.log_spectrum_db(k, OMEGA_FEW)
    yield rules.close("log spectrum, against 60 digits", db, right, 1e-9, scale=10.0)


@derived("poles", 256)
def _poles(k: Samples, case: Case) -> Attempt:
    """Check that they lie inside the unit circle, and that their product has the spectrum of the model."""
    poles = unit_model(k).poles()
    yield rules.finite("poles", np.abs(poles))
    yield rules.holds("poles inside the unit circle", np.max(np.abs(poles)) < 1)
    at = rules.OMEGA[:, np.newaxis]
    product = -20 * np.log10(np.abs(1 - poles * np.exp(-1j * at))).sum(axis=1)
    error = float(np.sqrt(np.mean((product - line_spectrum.log_spectrum(k, rules.OMEGA)) ** 2)))
    yield Check("dB RMS of the spectrum of their product", error, 1e-6)


@derived("cepstrum", 128)
def _cepstrum(k: Samples, case: Case) -> Attempt:
    c = unit_model(k).cepstrum(20)[1:]
    yield rules.finite("cepstrum", c)
    yield rules.close("cepstrum, against 60 digits", c, exact.cepstrum(k, 20), 1e-9, scale=1.0)


@derived("direct form, or its refusal", 256)
def _direct_form(k: Samples, case: Case) -> Attempt:
    a = unit_model(k).direct_form()
    yield rules.finite("coefficients", a)
    back = exact.step_down(a)
    yield rules.holds(rules.STABLE, not np.isnan(back).any())
    if case.order <= 128:
        yield rules.close("k of the coefficients", back, k, 2e-6, scale=1.0)


@derived("log area ratios", 1000)
def _log_area_ratios(k: Samples, case: Case) -> Attempt:
    areas = unit_model(k).log_area_ratios
    yield rules.finite("log area ratios", areas)
    right = np.log((1 + k.astype(np.longdouble)) / (1 - k.astype(np.longdouble)))
    error = np.max(np.abs(areas - right) / np.maximum(np.abs(right), 1e-300), initial=0.0)
    yield Check("log area ratios, relative", float(error), 1e-14)


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
