"""Subjects: every model of a vibration, its fits, what is derived from it, and its scores."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from texclass import vibration
from texclass.recording import Samples
from texclass.stability import exact, inputs, rules
from texclass.stability.inputs import Case, noise, samples_of
from texclass.stability.rules import Attempt, Check, Subject, tried
from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import autocorrelation, from_autocorrelation

SUBJECTS: list[Subject] = []
tried_on = partial(tried, SUBJECTS, "models")
EXCITATION = noise(192, 7)
SEGMENT = 200
"""Samples of a decaying segment: what the matrix pencil and Prony's method are given."""
LONGEST_TAP = 400
MODE = vibration.DecayingModes(*np.array([[90.0], [60.0], [2.0], [0.5]]))
TAP = vibration.TapModel(-1500.0, 80.0, 300.0)


# Inputs ----------------------------------------------------------------------------------------


def at_orders(quick: bool, largest: int) -> tuple[Case, ...]:
    """Return the battery at each order, and signals hardly longer than the order."""
    return (
        *inputs.with_orders(inputs.battery(quick, with_rates=False), quick, largest),
        *inputs.beyond(quick),
    )


def models(quick: bool, largest: int) -> tuple[Case, ...]:
    """Return models of each signal at each order, and some that no fit gives: |k| of one size, or near 1."""

    def handmade(p: int) -> dict[str, Samples]:
        return {
            "all k = 0.9": np.full(p, 0.9),
            "all k = -0.9": np.full(p, -0.9),
            "k = 0.999, alternating": 0.999 * np.where(np.arange(p) % 2, -1.0, 1.0),
            "k = 1 - 1e-12, random sign": (1 - 1e-12) * np.random.default_rng(p).choice([-1.0, 1.0], p),
            "k = 1 - 2^-53": np.full(p, 1 - 2.0**-53),
        }

    orders = [p for p in ((1, 2, 18, 128) if quick else inputs.ORDERS) if p <= largest]
    by_hand = [Case(name, "poles", k).at_order(p) for p in orders for name, k in handmade(p).items()]
    return (*inputs.with_orders(inputs.in_families(*inputs.VALUES, quick=quick), quick, largest), *by_hand)


def _known(what: str, synthesize: Callable[[float], Any], rates_hz: Any, quick: bool) -> Iterator[Case]:
    """Yield what a model whose parameters are known sounds like, at sampling rates and at extreme gains."""
    for fs in rates_hz[:: 3 if quick else 1]:
        for gain in (1e-160, 1.0, 1e150):
            name = f"{what} at {fs:g} Hz, gain {gain:g}"
            yield Case(name, "rate", synthesize(fs) * gain, fs=fs, gain=gain)


def _segments(quick: bool, longest: int, largest: int = 0) -> tuple[Case, ...]:
    decays = _known("decay", lambda fs: MODE.synthesize(SEGMENT, fs), inputs.RATES_HZ, quick)
    with_order = inputs.with_orders(inputs.in_families(*inputs.VALUES, quick=quick), quick, largest)
    return (*inputs.battery(quick, longest=longest, with_rates=False), *decays, *with_order)


def _taps(quick: bool) -> tuple[Case, ...]:
    taps = _known("tap", lambda fs: TAP.synthesize(1.0, LONGEST_TAP, fs), inputs.RATES_HZ[4:], quick)
    others = inputs.battery(quick, longest=120, with_rates=False)
    return (*taps, *(replace(case, required=False) for case in others))  # they need not decay


# Fits -------------------------------------------------------------------------------------------------------


@tried_on(
    {"fit, burg": {"method": "burg"}, "fit, autocorrelation": {"method": "autocorrelation"}},
    partial(at_orders, largest=1000),
)
def _fit(x: Any, case: Case, *, method: Any) -> Attempt:
    model = vibration.fit(x, case.order, method=method)
    yield rules.finite("gain", model.gain)
    signal, p = samples_of(x), case.order
    yield from _reflection(signal, case, model, method)
    if not np.any(signal):
        yield Check("gain of silence", float(model.gain), 0.0)
        return
    rms = math.hypot(*signal) / math.sqrt(signal.size)
    yield rules.close("residual of order 0 = RMS", model.residual[0], rms, 1e-12)
    if exact.EXTENDED:
        is_burg = method == "burg"
        padding = 0 if is_burg else p
        energies = exact.lattice_energies(signal, model.reflection, padding)
        if signal.size > p:
            whose = "Burg's optimum" if is_burg else "the autocorrelation method's optimum"
            yield rules.excess(whose, energies[-1], exact.burg_energies(signal, p, padding)[-1])
        m = min(p, energies.size - 1)
        n_samples = signal.size - m if is_burg else signal.size
        measured = rms * np.sqrt(energies[m] * signal.size / n_samples)
        floor = 1e-8 * rms  # of a residual below 1e-14 of the signal only that it is so small
        yield rules.close("residual as the samples give it", model.residual[m], measured, 1e-6, scale=floor)


@tried_on(  # O(n p^2): no order above 128
    "fit, modified covariance",
    lambda quick: [case for case in at_orders(quick, 18 if quick else 128) if case.order <= 128],
)
def _fit_both_ways(x: Any, case: Case) -> Attempt:
    """Check that it is stable, and leaves no more residual than Burg's, or is Burg's fit itself."""
    model = vibration.fit(x, case.order, method="modified_covariance")
    yield rules.finite("gain", model.gain)
    signal = samples_of(x)
    yield from _reflection(signal, case, model, "modified_covariance")
    most = 1.01 * math.hypot(*signal)  # 0 for silence
    yield rules.holds("a gain no larger than the signal", model.gain <= most)
    if model.is_fallback:
        burg = vibration.fit(signal, case.order, method="burg")
        yield rules.close("the fallback is Burg's fit", model.reflection, burg.reflection, 0.0)
        yield "fallback: modified covariance is unstable or undetermined here, Burg's fit returned"
    elif np.any(signal) and exact.EXTENDED:
        left = exact.lattice_energies(signal, model.reflection)[-1]
        yield rules.excess("Burg's", left, exact.burg_energies(signal, case.order)[-1])


def _reflection(x: Samples, case: Case, model: vibration.Autoregression, method: Any) -> Iterator[Check]:
    """Check that k is finite and stable, and does not depend on gain, dtype and layout."""
    yield rules.finite("reflection coefficients", model.reflection)
    yield rules.stable(model.reflection)
    louder = vibration.fit(np.ldexp(exact.unit(x), 40), case.order, method=method)
    alone = vibration.fit(exact.unit(x), case.order, method=method)
    yield rules.close("k free of gain", louder.reflection, alone.reflection, 0.0)
    if case.family in ("dtype", "layout"):
        copy = vibration.fit(x, case.order, method=method)
        yield rules.close("k as of the float64 copy", model.reflection, copy.reflection, 0.0)


@tried_on("from_autocorrelation", partial(at_orders, largest=400))
def _from_lags(x: Any, case: Case) -> Attempt:
    """Check that the Yule-Walker equations hold for the lags given, as far as they were solved."""
    samples = exact.unit(samples_of(x))
    if samples.size == 0:
        raise ValueError("from_autocorrelation got no sample in this battery. Expected one")
    r = autocorrelation(samples[np.newaxis], case.order)[0] if np.all(np.isfinite(samples)) else samples
    model = from_autocorrelation(r)
    yield rules.finite("gain", model.gain)
    fitted = int(model.fitted_order)
    yield rules.stable(model.reflection)
    if fitted < case.order:
        yield f"fitted_order: the lags determine {fitted} orders of {case.order}"
    if 0 < fitted <= 18 and np.any(r):
        a = exact.coefficients(model.reflection[:fitted])
        lags = exact.digits(r)[np.abs(np.arange(1, fitted + 1)[:, np.newaxis] - np.arange(fitted + 1))]
        error = np.max(np.abs(lags @ a)) / (np.sum(np.abs(a)) * lags[0, 1])
        yield Check("Yule-Walker equations", float(error), 1e-13)


@tried_on(
    "select_order",
    lambda quick: inputs.with_orders(inputs.battery(quick, longest=0, with_rates=False), quick, 50),
)
def _select_order(x: Any, case: Case) -> Attempt:
    criteria: Any = ("spectral_error", "aicc")
    chosen = {c: vibration.select_order(x, case.order, criterion=c) for c in criteria}
    for criterion, selection in chosen.items():
        yield Check("orders looked at", abs(selection.values.size - case.order - 1), 0.0)
        yield Check(f"{criterion} is no number", float(np.isnan(selection.values).sum()), 0.0)
        yield Check("order of the model", abs(selection.model.order - selection.order), 0.0)
        quiet = np.ldexp(exact.unit(samples_of(x)), -300)
        same = vibration.select_order(quiet, case.order, criterion=criterion)
        yield Check(f"{criterion}: the order is free of gain", abs(same.order - selection.order), 0.0)


# From reflection coefficients -------------------------------------------------------------------------------


def k_of(x: Any, case: Case) -> Samples:
    """Return the reflection coefficients a case stands for: those given by hand, or Burg's of its signal."""
    is_given = case.name.startswith(("k =", "all k ="))
    return samples_of(x) if is_given else vibration.fit(samples_of(x), case.order).reflection


def unit_model(k: Samples) -> vibration.Autoregression:
    """Return the model of reflection coefficients at unit gain."""
    return vibration.Autoregression(k, np.asarray(1.0))


@tried_on("line spectrum, there and back", partial(models, largest=1000))
def _line_spectrum(x: Any, case: Case) -> Attempt:
    k = k_of(x, case)
    lsf = line_spectrum.from_reflection(k)
    back = line_spectrum.to_reflection(lsf)
    yield from rules.line_spectrum(k, lsf, back)
    if line_spectrum.conditioning(lsf) >= 1:
        yield "conditioning >= 1: two frequencies that float64 cannot tell apart"
    if case.order <= 50:
        yield Check("frequencies, against 60 digits", exact.line_spectrum_error(k, lsf), 1e-12)


@tried_on("lattice synthesis", partial(models, largest=1000))
def _lattice_synthesis(x: Any, case: Case) -> Attempt:
    k = k_of(x, case)
    model = unit_model(k)
    level = float(model.level) if np.isfinite(model.level) else 1.0
    out: Samples = np.asarray(vibration.LatticeSynthesis(model, level=level).process(EXCITATION), np.float64)
    pieces = vibration.LatticeSynthesis(model, level=level)
    pieced = [pieces.process(piece) for piece in np.split(EXCITATION, [50, 51, 51])]
    single = np.asarray(vibration.LatticeSynthesis(model, level=1.0, dtype=np.float32).process(EXCITATION))
    yield rules.finite("synthesis", out)
    size = float(np.linalg.norm(EXCITATION))  # rotations: no state exceeds the energy that went in
    yield rules.holds("bounded in float64", np.max(np.abs(out)) <= level * size)
    yield rules.holds("bounded in float32", np.max(np.abs(single)) <= size)
    yield rules.close("pieces = whole", np.concatenate(pieced), out, 0.0)
    if float(model.prediction_gain_db) < 60:
        yield rules.close("float32 against float64", single * level, out, 1e-6 * case.order + 1e-4)
    if case.order <= 50 and np.isfinite(model.level):
        yield rules.response("synthesis", out, k, EXCITATION)


@tried_on("lattice inverse filter", lambda quick: models(quick, 128 if quick else 400))
def _lattice_inverse(x: Any, case: Case) -> Attempt:
    """Check that undoing the synthesis loses the prediction gain (level / gain) in digits, and no more."""
    k = k_of(x, case)
    model = unit_model(k)
    level = None if np.isfinite(model.level) else 1.0
    out = vibration.LatticeSynthesis(model, level=level).process(EXCITATION)
    back = np.asarray(vibration.LatticeInverse(model, level=level).process(out))
    yield back
    lost = 1e-15 * case.order * 10 ** (min(float(model.prediction_gain_db), 400.0) / 20)
    if lost > 1e-4:
        yield Check("a prediction gain beyond what float64 can undo", 0.0, 0.0)
    else:
        yield rules.close("the excitation comes back", back, EXCITATION, 1000 * lost + 1e-12)


@tried_on("log spectrum", partial(models, largest=1000))
def _log_spectrum(x: Any, case: Case) -> Attempt:
    k = k_of(x, case)
    omega = np.array([1e-6, 0.05, 0.3, 0.7, 1.5, 2.9, np.pi])
    db = unit_model(k).log_spectrum_db(omega)
    yield rules.finite("log spectrum", db)
    right = exact.log_spectrum_db(k, omega)
    yield rules.close("log spectrum, against 60 digits", db, right, 1e-9, scale=10.0)


@tried_on("poles", partial(models, largest=256))
def _poles(x: Any, case: Case) -> Attempt:
    """Check that they lie inside the unit circle, and that their product has the spectrum of the model."""
    k = k_of(x, case)
    poles = unit_model(k).poles()
    yield rules.finite("poles", np.abs(poles))
    yield rules.holds("poles inside the unit circle", np.max(np.abs(poles)) < 1)
    product = -20 * np.log10(np.abs(1 - poles * np.exp(-1j * rules.OMEGA[:, np.newaxis]))).sum(axis=1)
    error = float(np.sqrt(np.mean((product - rules.spectrum_db(k)) ** 2)))
    yield Check("dB RMS of the spectrum of their product", error, 1e-6)


@tried_on("cepstrum", partial(models, largest=128))
def _cepstrum(x: Any, case: Case) -> Attempt:
    k = k_of(x, case)
    c = unit_model(k).cepstrum(20)[1:]
    yield rules.finite("cepstrum", c)
    yield rules.close("cepstrum, against 60 digits", c, exact.cepstrum(k, 20), 1e-9, scale=1.0)


@tried_on("direct form, or its refusal", partial(models, largest=256))
def _direct_form(x: Any, case: Case) -> Attempt:
    k = k_of(x, case)
    a = unit_model(k).direct_form()
    yield rules.finite("coefficients", a)
    back = exact.step_down(a)
    yield rules.stable(back)
    if case.order <= 128:
        yield rules.close("k of the coefficients", back, k, 2e-6, scale=1.0)


@tried_on("log area ratios", partial(models, largest=1000))
def _log_area_ratios(x: Any, case: Case) -> Attempt:
    k = k_of(x, case)
    areas = unit_model(k).log_area_ratios
    yield rules.finite("log area ratios", areas)
    right = np.log((1 + k.astype(np.longdouble)) / (1 - k.astype(np.longdouble)))
    error = np.max(np.abs(areas - right) / np.maximum(np.abs(right), 1e-300), initial=0.0)
    yield Check("log area ratios, relative", float(error), 1e-14)


# Modes, taps and lines --------------------------------------------------------------------------------------


@tried_on("matrix pencil", partial(_segments, longest=300, largest=100))
def _matrix_pencil(x: Any, case: Case) -> Attempt:
    modes = vibration.fit_matrix_pencil(x[:SEGMENT], case.fs, order=case.order or None)
    segment = samples_of(x[:SEGMENT])
    for name in ("frequency_hz", "decay_per_s", "amplitude", "phase"):
        yield rules.finite(name, getattr(modes, name))
    yield Check("a decay rate that is not positive", float(np.any(modes.decay_per_s <= 0)), 0.0)
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


@tried_on("Prony as published", partial(_segments, longest=60))
def _prony(x: Any, case: Case) -> Attempt:
    """Check what it says of itself; as published, it may be unstable."""
    segment = x[:SEGMENT]
    size = float(np.max(np.abs(samples_of(segment)), initial=0.0)) or 1.0
    resolution = size / 512 if np.isfinite(size) and np.any(segment) else 1.0
    fitted = vibration.fit_prony(segment, resolution, max_order=min(40, max(len(segment) - 1, 1)))
    yield rules.finite("coefficients", np.concatenate([fitted.a, fitted.b]))
    difference = fitted.synthesize(len(segment)) / size - samples_of(segment) / size
    error = float(np.mean(np.abs(difference)))
    if np.isfinite(fitted.error) or np.isfinite(error):
        yield rules.close("the error it states", fitted.error / size, error, 1e-6, scale=1e-9)
    if not fitted.is_stable:
        yield "is_stable is False: the published method found an unstable filter"
    elif not fitted.is_resolved:
        yield "resolved is False: no order met the resolution"
    if fitted.order <= 20 and abs(fitted.pole_radius - 1) > 1e-6:
        stable = np.all(np.isfinite(exact.step_down(fitted.a)))
        yield Check("stability as stated", float(stable != fitted.is_stable), 0.0)


@tried_on(
    {  # Okamura's fit is one by eye: a spectral peak, and a line through some peaks
        "tap model, Okamura": {"fit": vibration.fit_okamura, "limit": 0.1},
        "tap model, maximum likelihood": {"fit": vibration.fit_tap_model, "limit": 1e-6},
    },
    _taps,
)
def _tap(x: Any, case: Case, *, fit: Callable[..., vibration.TapModel], limit: float) -> Attempt:
    tap = fit([x[:LONGEST_TAP], x[: LONGEST_TAP // 2]], [1.0, 1.0], case.fs)
    yield rules.finite("parameters", [tap.amplitude_slope, tap.decay_per_s, tap.frequency_hz])
    least = min(tap.decay_per_s, tap.frequency_hz)
    yield Check("decay rate or frequency not above 0", float(least <= 0), 0.0)
    yield rules.holds("frequency up to fs/2", tap.frequency_hz <= case.fs / 2)
    if case.name.startswith("tap at"):
        yield rules.close("slope of a known tap", tap.amplitude_slope / case.gain, TAP.amplitude_slope, limit)
        yield rules.close("its decay rate", tap.decay_per_s, TAP.decay_per_s, limit)
        yield rules.close("its frequency", tap.frequency_hz, TAP.frequency_hz, limit)


@tried_on("major frequencies", inputs.battery)
def _major_frequencies(x: Any, case: Case) -> Attempt:
    """Compare amplitudes with the Fourier transform at each frequency, in 80-bit floats."""
    lines = vibration.fit_major_frequencies(x, case.fs)
    for name in ("frequency_hz", "amplitude", "phase"):
        yield rules.finite(name, getattr(lines, name))
    f = lines.frequency_hz
    yield rules.holds("frequencies up to 1400 Hz and fs/2", np.all(f <= min(1400.0, case.fs / 2)))
    too_close = np.diff(f) < vibration.major_frequencies.beat_threshold_hz(f[:-1]) if f.size > 1 else False
    yield Check("lines closer than their beat threshold", float(np.sum(too_close)), 0.0)
    signal = samples_of(x)
    n = signal.size
    if np.ptp(signal) == 0:
        yield Check("lines in a constant", float(f.size), 0.0)
    elif f.size:
        scale = float(np.max(np.abs(signal)))
        wide = (signal / scale).astype(np.longdouble)
        turns = np.outer(np.round(f / case.fs * n), np.arange(n)) % n
        angle = turns.astype(np.longdouble) * (8 * np.arctan(np.longdouble(1)) / n)
        right = np.abs(np.exp(1j * angle) @ (wide - wide.mean())) * 2 / n
        yield rules.close("amplitudes", lines.amplitude / scale, right, 1e-12, scale=1.0)


# Scores -----------------------------------------------------------------------------------------------------


SCORES = {
    "rms_spectral_error": 0.0,
    "goodness_of_fit": 1.0,
    "mean_absolute_difference": 0.0,
    "log_spectral_distance": 0.0,
    "band_energy_distance": 0.0,
}
"""Score -> value of a signal against itself."""


@tried_on(
    {f"score, {name}": {"name": name, "perfect": value} for name, value in SCORES.items()}, inputs.battery
)
def _score(x: Any, case: Case, *, name: str, perfect: float) -> Attempt:
    rate = (case.fs,) if name == "band_energy_distance" else ()
    score = getattr(vibration.scores, name)
    signal = samples_of(x)
    other = signal * (1 + 0.1 * noise(inputs.N, 5)[: signal.size])
    alone, rating = float(score(x, x, *rate)), float(score(x, other, *rate))
    yield rules.finite("score", (alone, rating))
    yield Check("score of a signal against itself", abs(alone - perfect), 1e-12)
    if name == "mean_absolute_difference":
        right = math.fsum(np.abs(signal - other)) / signal.size
        yield rules.close("mean of |difference|", rating, right, 1e-14)
    elif np.any(signal):
        shift = 60 - int(np.frexp(np.max(np.abs(signal)))[1])
        louder = score(np.ldexp(signal, shift), np.ldexp(other, shift), *rate)
        yield rules.close("free of a common gain", louder, rating, 1e-9, scale=1.0)
