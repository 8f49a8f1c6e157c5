"""Subjects of the battery: fits of vibration models, quantities derived from the models, and scores."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from texclass import vibration
from texclass.recording import Samples
from texclass.stability import checks, inputs, references
from texclass.stability.checks import Check, Findings, Subject, register
from texclass.stability.inputs import Case, noise, to_float64
from texclass.vibration import line_spectrum
from texclass.vibration.autoregressive import autocorrelation, from_autocorrelation

SUBJECTS: list[Subject] = []
model_subject = partial(register, SUBJECTS, "models")
EXCITATION = noise(192, 7)
SEGMENT = 200
"""Number of samples of a decaying segment for the matrix pencil and Prony's method."""
LONGEST_TAP = 400
MODE = vibration.DecayingModes(*np.array([[90.0], [60.0], [2.0], [0.5]]))
TAP = vibration.TapModel(-1500.0, 80.0, 300.0)


# Inputs ----------------------------------------------------------------------------------------


def signals_at_orders(quick: bool, largest: int) -> tuple[Case, ...]:
    """Return the battery at each model order, and signals with about as many samples as the order."""
    return (
        *inputs.with_orders(inputs.battery(quick, with_rates=False), quick, largest),
        *inputs.short_signals(quick),
    )


def model_cases(quick: bool, largest: int) -> tuple[Case, ...]:
    """Return signals at each model order, and sets of coefficients with equal |k| or |k| close to 1."""

    def coefficient_sets(p: int) -> dict[str, Samples]:
        return {
            "all k = 0.9": np.full(p, 0.9),
            "all k = -0.9": np.full(p, -0.9),
            "k = 0.999, alternating": 0.999 * np.where(np.arange(p) % 2, -1.0, 1.0),
            "k = 1 - 1e-12, random sign": (1 - 1e-12) * np.random.default_rng(p).choice([-1.0, 1.0], p),
            "k = 1 - 2^-53": np.full(p, 1 - 2.0**-53),
        }

    orders = [p for p in ((1, 2, 18, 128) if quick else inputs.ORDERS) if p <= largest]
    sets = [Case(name, "poles", k).at_order(p) for p in orders for name, k in coefficient_sets(p).items()]
    return (*inputs.with_orders(inputs.cases_of(*inputs.VALUES, quick=quick), quick, largest), *sets)


def _synthetic_cases(
    what: str, synthesize: Callable[[float], Any], rates_hz: Any, quick: bool
) -> Iterator[Case]:
    """Yield signals synthesised from a model with known parameters, at several sampling rates and gains."""
    for fs in rates_hz[:: 3 if quick else 1]:
        for gain in (1e-160, 1.0, 1e150):
            name = f"{what} at {fs:g} Hz, gain {gain:g}"
            yield Case(name, "rate", synthesize(fs) * gain, fs=fs, gain=gain)


def _segments(quick: bool, longest: int, largest: int = 0) -> tuple[Case, ...]:
    decays = _synthetic_cases("decay", lambda fs: MODE.synthesize(SEGMENT, fs), inputs.RATES_HZ, quick)
    with_order = inputs.with_orders(inputs.cases_of(*inputs.VALUES, quick=quick), quick, largest)
    return (*inputs.battery(quick, longest=longest, with_rates=False), *decays, *with_order)


def _taps(quick: bool) -> tuple[Case, ...]:
    taps = _synthetic_cases(
        "tap", lambda fs: TAP.synthesize(1.0, LONGEST_TAP, fs), inputs.RATES_HZ[4:], quick
    )
    others = inputs.battery(quick, longest=120, with_rates=False)
    return (*taps, *(replace(case, required=False) for case in others))  # these signals do not decay


# Fits -------------------------------------------------------------------------------------------------------


@model_subject(
    {"fit, burg": {"method": "burg"}, "fit, autocorrelation": {"method": "autocorrelation"}},
    partial(signals_at_orders, largest=1000),
)
def _fit(x: Any, case: Case, *, method: Any) -> Findings:
    model = vibration.fit(x, case.order, method=method)
    yield checks.finite("gain", model.gain)
    signal, p = to_float64(x), case.order
    yield from _reflection(signal, case, model, method)
    if not np.any(signal):
        yield Check("gain of silence", float(model.gain), 0.0)
        return
    rms = math.hypot(*signal) / math.sqrt(signal.size)
    yield checks.close("residual of order 0 = RMS", model.residual[0], rms, 1e-12)
    if references.EXTENDED:
        is_burg = method == "burg"
        padding = 0 if is_burg else p
        energies = references.lattice_energies(signal, model.reflection, padding)
        if signal.size > p:
            optimum = "Burg's optimum" if is_burg else "the autocorrelation method's optimum"
            yield checks.excess_energy(
                optimum, energies[-1], references.burg_energies(signal, p, padding)[-1]
            )
        m = min(p, energies.size - 1)
        n_samples = signal.size - m if is_burg else signal.size
        measured = rms * np.sqrt(energies[m] * signal.size / n_samples)
        floor = 1e-8 * rms  # accept an absolute error of 1e-14 of the RMS level
        yield checks.close("residual as the samples give it", model.residual[m], measured, 1e-6, scale=floor)


@model_subject(  # no orders above 128, because the cost is O(n p^2)
    "fit, modified covariance",
    lambda quick: [case for case in signals_at_orders(quick, 18 if quick else 128) if case.order <= 128],
)
def _fit_modified_covariance(x: Any, case: Case) -> Findings:
    """Check that the model is stable with a residual no larger than Burg's, or is Burg's fit."""
    model = vibration.fit(x, case.order, method="modified_covariance")
    yield checks.finite("gain", model.gain)
    signal = to_float64(x)
    yield from _reflection(signal, case, model, "modified_covariance")
    max_gain = 1.01 * math.hypot(*signal)  # 0 for silence
    yield checks.condition("a gain no larger than the signal", model.gain <= max_gain)
    if model.is_fallback:
        burg = vibration.fit(signal, case.order, method="burg")
        yield checks.close("the fallback is Burg's fit", model.reflection, burg.reflection, 0.0)
        yield "fallback: modified covariance is unstable or undetermined here, Burg's fit returned"
    elif np.any(signal) and references.EXTENDED:
        energy = references.lattice_energies(signal, model.reflection)[-1]
        yield checks.excess_energy("Burg's", energy, references.burg_energies(signal, case.order)[-1])


def _reflection(x: Samples, case: Case, model: vibration.Autoregression, method: Any) -> Iterator[Check]:
    """Check that k is finite, stable, and independent of gain, dtype and layout."""
    yield checks.finite("reflection coefficients", model.reflection)
    yield checks.stable(model.reflection)
    louder = vibration.fit(np.ldexp(references.scale_to_unit(x), 40), case.order, method=method)
    alone = vibration.fit(references.scale_to_unit(x), case.order, method=method)
    yield checks.close("k free of gain", louder.reflection, alone.reflection, 0.0)
    if case.family in ("dtype", "layout"):
        copy = vibration.fit(x, case.order, method=method)
        yield checks.close("k as of the float64 copy", model.reflection, copy.reflection, 0.0)


@model_subject("from_autocorrelation", partial(signals_at_orders, largest=400))
def _from_lags(x: Any, case: Case) -> Findings:
    """Check that the Yule-Walker equations hold up to the fitted order."""
    samples = references.scale_to_unit(to_float64(x))
    if samples.size == 0:
        raise ValueError("cannot compute an autocorrelation: expected at least one sample, got none")
    r = autocorrelation(samples[np.newaxis], case.order)[0] if np.all(np.isfinite(samples)) else samples
    model = from_autocorrelation(r)
    yield checks.finite("gain", model.gain)
    fitted = int(model.fitted_order)
    yield checks.stable(model.reflection)
    if fitted < case.order:
        yield f"fitted_order: the lags determine {fitted} orders of {case.order}"
    if 0 < fitted <= 18 and np.any(r):
        a = references.coefficients(model.reflection[:fitted])
        lags = references.digits(r)[np.abs(np.arange(1, fitted + 1)[:, np.newaxis] - np.arange(fitted + 1))]
        error = np.max(np.abs(lags @ a)) / (np.sum(np.abs(a)) * lags[0, 1])
        yield Check("Yule-Walker equations", float(error), 1e-13)


@model_subject(
    "select_order",
    lambda quick: inputs.with_orders(inputs.battery(quick, longest=0, with_rates=False), quick, 50),
)
def _select_order(x: Any, case: Case) -> Findings:
    criteria: Any = ("spectral_error", "aicc")
    selections = {c: vibration.select_order(x, case.order, criterion=c) for c in criteria}
    for criterion, selection in selections.items():
        yield Check("number of orders", abs(selection.values.size - case.order - 1), 0.0)
        yield Check(f"{criterion} is not a number", float(np.isnan(selection.values).sum()), 0.0)
        yield Check("order of the model", abs(selection.model.order - selection.order), 0.0)
        quiet = np.ldexp(references.scale_to_unit(to_float64(x)), -300)
        same = vibration.select_order(quiet, case.order, criterion=criterion)
        yield Check(f"{criterion}: the order is free of gain", abs(same.order - selection.order), 0.0)


# From reflection coefficients -------------------------------------------------------------------------------


def case_reflection(x: Any, case: Case) -> Samples:
    """Return the reflection coefficients of a case: its samples, or the result of Burg's method for them."""
    has_coefficients = case.name.startswith(("k =", "all k ="))
    return to_float64(x) if has_coefficients else vibration.fit(to_float64(x), case.order).reflection


def unit_model(k: Samples) -> vibration.Autoregression:
    """Return the model with given reflection coefficients and unit gain."""
    return vibration.Autoregression(k, np.asarray(1.0))


@model_subject("line spectrum, there and back", partial(model_cases, largest=1000))
def _line_spectrum(x: Any, case: Case) -> Findings:
    k = case_reflection(x, case)
    lsf = line_spectrum.from_reflection(k)
    back = line_spectrum.to_reflection(lsf)
    yield from checks.line_spectrum(k, lsf, back)
    if line_spectrum.conditioning(lsf) >= 1:
        yield "conditioning >= 1: two frequencies that float64 cannot distinguish"
    if case.order <= 50:
        yield Check("frequencies, against 60 digits", references.line_spectrum_error(k, lsf), 1e-12)


@model_subject("lattice synthesis", partial(model_cases, largest=1000))
def _lattice_synthesis(x: Any, case: Case) -> Findings:
    k = case_reflection(x, case)
    model = unit_model(k)
    level = float(model.level) if np.isfinite(model.level) else 1.0
    out: Samples = np.asarray(vibration.LatticeSynthesis(model, level=level).process(EXCITATION), np.float64)
    lattice = vibration.LatticeSynthesis(model, level=level)
    blocks = [lattice.process(block) for block in np.split(EXCITATION, [50, 51, 51])]
    single = np.asarray(vibration.LatticeSynthesis(model, level=1.0, dtype=np.float32).process(EXCITATION))
    yield checks.finite("synthesis", out)
    size = float(np.linalg.norm(EXCITATION))  # rotations: no state has more energy than the input
    yield checks.condition("bounded in float64", np.max(np.abs(out)) <= level * size)
    yield checks.condition("bounded in float32", np.max(np.abs(single)) <= size)
    yield checks.close("blocks = whole", np.concatenate(blocks), out, 0.0)
    if float(model.prediction_gain_db) < 60:
        yield checks.close("float32 against float64", single * level, out, 1e-6 * case.order + 1e-4)
    if case.order <= 50 and np.isfinite(model.level):
        yield checks.response("synthesis", out, k, EXCITATION)


@model_subject("lattice inverse filter", lambda quick: model_cases(quick, 128 if quick else 400))
def _lattice_inverse(x: Any, case: Case) -> Findings:
    """Check that inverting the synthesis loses no more digits than the prediction gain implies."""
    k = case_reflection(x, case)
    model = unit_model(k)
    level = None if np.isfinite(model.level) else 1.0
    out = vibration.LatticeSynthesis(model, level=level).process(EXCITATION)
    back = np.asarray(vibration.LatticeInverse(model, level=level).process(out))
    yield back
    rounding = 1e-15 * case.order * 10 ** (min(float(model.prediction_gain_db), 400.0) / 20)
    if rounding > 1e-4:
        yield Check("a prediction gain that float64 cannot invert", 0.0, 0.0)
    else:
        yield checks.close("recovered excitation", back, EXCITATION, 1000 * rounding + 1e-12)


@model_subject("log spectrum", partial(model_cases, largest=1000))
def _log_spectrum(x: Any, case: Case) -> Findings:
    k = case_reflection(x, case)
    omega = np.array([1e-6, 0.05, 0.3, 0.7, 1.5, 2.9, np.pi])
    db = unit_model(k).log_spectrum_db(omega)
    yield checks.finite("log spectrum", db)
    right = references.log_spectrum_db(k, omega)
    yield checks.close("log spectrum, against 60 digits", db, right, 1e-9, scale=10.0)


@model_subject("poles", partial(model_cases, largest=256))
def _poles(x: Any, case: Case) -> Findings:
    """Check that the poles are inside the unit circle, and that their product has the model's spectrum."""
    k = case_reflection(x, case)
    poles = unit_model(k).poles()
    yield checks.finite("poles", np.abs(poles))
    yield checks.condition("poles inside the unit circle", np.max(np.abs(poles)) < 1)
    product = -20 * np.log10(np.abs(1 - poles * np.exp(-1j * checks.OMEGA[:, np.newaxis]))).sum(axis=1)
    error = float(np.sqrt(np.mean((product - checks.spectrum_db(k)) ** 2)))
    yield Check("dB RMS of the spectrum of their product", error, 1e-6)


@model_subject("cepstrum", partial(model_cases, largest=128))
def _cepstrum(x: Any, case: Case) -> Findings:
    k = case_reflection(x, case)
    c = unit_model(k).cepstrum(20)[1:]
    yield checks.finite("cepstrum", c)
    yield checks.close("cepstrum, against 60 digits", c, references.cepstrum(k, 20), 1e-9, scale=1.0)


@model_subject("direct form, or its refusal", partial(model_cases, largest=256))
def _direct_form(x: Any, case: Case) -> Findings:
    k = case_reflection(x, case)
    a = unit_model(k).direct_form()
    yield checks.finite("coefficients", a)
    back = references.step_down(a)
    yield checks.stable(back)
    if case.order <= 128:
        yield checks.close("k of the coefficients", back, k, 2e-6, scale=1.0)


@model_subject("log area ratios", partial(model_cases, largest=1000))
def _log_area_ratios(x: Any, case: Case) -> Findings:
    k = case_reflection(x, case)
    areas = unit_model(k).log_area_ratios
    yield checks.finite("log area ratios", areas)
    right = np.log((1 + k.astype(np.longdouble)) / (1 - k.astype(np.longdouble)))
    error = np.max(np.abs(areas - right) / np.maximum(np.abs(right), 1e-300), initial=0.0)
    yield Check("log area ratios, relative", float(error), 1e-14)


# Modes, taps and lines --------------------------------------------------------------------------------------


@model_subject("matrix pencil", partial(_segments, longest=300, largest=100))
def _matrix_pencil(x: Any, case: Case) -> Findings:
    modes = vibration.fit_matrix_pencil(x[:SEGMENT], case.fs, order=case.order or None)
    segment = to_float64(x[:SEGMENT])
    for name in ("frequency_hz", "decay_per_s", "amplitude", "phase"):
        yield checks.finite(name, getattr(modes, name))
    yield Check("a decay rate that is not positive", float(np.any(modes.decay_per_s <= 0)), 0.0)
    yield checks.stable_sections(modes.sections(case.fs))
    size = float(np.max(np.abs(segment), initial=0.0))
    if size == 0:
        yield Check("modes found in silence", float(modes.n_modes), 0.0)
        return
    residual = np.linalg.norm(modes.synthesize(segment.size, case.fs) / size - segment / size)
    is_smaller = residual / np.linalg.norm(segment / size) <= 1 + 1e-9
    yield checks.condition("a residual no larger than the signal", is_smaller)
    if case.name.startswith("decay at"):
        yield checks.close("decay rate of a known mode", modes.decay_per_s[:1], MODE.decay_per_s, 1e-6)
        yield checks.close("its frequency", modes.frequency_hz[:1], MODE.frequency_hz, 1e-6)
        yield checks.close("its amplitude", modes.amplitude[:1] / case.gain, MODE.amplitude, 1e-6)


@model_subject("Prony as published", partial(_segments, longest=60))
def _prony(x: Any, case: Case) -> Findings:
    """Check the reported error and stability; filters of the published method may be unstable."""
    segment = x[:SEGMENT]
    size = float(np.max(np.abs(to_float64(segment)), initial=0.0)) or 1.0
    resolution = size / 512 if np.isfinite(size) and np.any(segment) else 1.0
    fitted = vibration.fit_prony(segment, resolution, max_order=min(40, max(len(segment) - 1, 1)))
    yield checks.finite("coefficients", np.concatenate([fitted.a, fitted.b]))
    difference = fitted.synthesize(len(segment)) / size - to_float64(segment) / size
    error = float(np.mean(np.abs(difference)))
    if np.isfinite(fitted.error) or np.isfinite(error):
        yield checks.close("reported error", fitted.error / size, error, 1e-6, scale=1e-9)
    if not fitted.is_stable:
        yield "is_stable is False: the published method gave an unstable filter"
    elif not fitted.is_resolved:
        yield "is_resolved is False: no order reached the resolution"
    if fitted.order <= 20 and abs(fitted.pole_radius - 1) > 1e-6:
        is_stable = np.all(np.isfinite(references.step_down(fitted.a)))
        yield Check("reported stability", float(is_stable != fitted.is_stable), 0.0)


@model_subject(
    {  # Okamura's fit is approximate: it uses a spectral peak, and a line through some peaks of the envelope
        "tap model, Okamura": {"fit": vibration.fit_okamura, "limit": 0.1},
        "tap model, maximum likelihood": {"fit": vibration.fit_tap_model, "limit": 1e-6},
    },
    _taps,
)
def _tap(x: Any, case: Case, *, fit: Callable[..., vibration.TapModel], limit: float) -> Findings:
    tap = fit([x[:LONGEST_TAP], x[: LONGEST_TAP // 2]], [1.0, 1.0], case.fs)
    yield checks.finite("parameters", [tap.amplitude_slope, tap.decay_per_s, tap.frequency_hz])
    smallest = min(tap.decay_per_s, tap.frequency_hz)
    yield Check("decay rate or frequency not positive", float(smallest <= 0), 0.0)
    yield checks.condition("frequency up to fs/2", tap.frequency_hz <= case.fs / 2)
    if case.name.startswith("tap at"):
        yield checks.close(
            "slope of a known tap", tap.amplitude_slope / case.gain, TAP.amplitude_slope, limit
        )
        yield checks.close("its decay rate", tap.decay_per_s, TAP.decay_per_s, limit)
        yield checks.close("its frequency", tap.frequency_hz, TAP.frequency_hz, limit)


@model_subject("major frequencies", inputs.battery)
def _major_frequencies(x: Any, case: Case) -> Findings:
    """Compare amplitudes with the Fourier transform at each frequency, computed in 80-bit floats."""
    lines = vibration.fit_major_frequencies(x, case.fs)
    for name in ("frequency_hz", "amplitude", "phase"):
        yield checks.finite(name, getattr(lines, name))
    f = lines.frequency_hz
    yield checks.condition("frequencies up to 1400 Hz and fs/2", np.all(f <= min(1400.0, case.fs / 2)))
    too_close = np.diff(f) < vibration.major_frequencies.beat_threshold_hz(f[:-1]) if f.size > 1 else False
    yield Check("lines closer than their beat threshold", float(np.sum(too_close)), 0.0)
    signal = to_float64(x)
    n = signal.size
    if np.ptp(signal) == 0:
        yield Check("lines in a constant", float(f.size), 0.0)
    elif f.size:
        scale = float(np.max(np.abs(signal)))
        wide = (signal / scale).astype(np.longdouble)
        turns = np.outer(np.round(f / case.fs * n), np.arange(n)) % n
        angle = turns.astype(np.longdouble) * (8 * np.arctan(np.longdouble(1)) / n)
        right = np.abs(np.exp(1j * angle) @ (wide - wide.mean())) * 2 / n
        yield checks.close("amplitudes", lines.amplitude / scale, right, 1e-12, scale=1.0)


# Scores -----------------------------------------------------------------------------------------------------


SCORES = {
    "rms_spectral_error": 0.0,
    "goodness_of_fit": 1.0,
    "mean_absolute_difference": 0.0,
    "log_spectral_distance": 0.0,
    "band_energy_distance": 0.0,
}
"""Score -> its value for a signal compared with itself."""


@model_subject(
    {f"score, {name}": {"name": name, "perfect": value} for name, value in SCORES.items()}, inputs.battery
)
def _score(x: Any, case: Case, *, name: str, perfect: float) -> Findings:
    rate = (case.fs,) if name == "band_energy_distance" else ()
    score = getattr(vibration.scores, name)
    signal = to_float64(x)
    other = signal * (1 + 0.1 * noise(inputs.N, 5)[: signal.size])
    alone, rating = float(score(x, x, *rate)), float(score(x, other, *rate))
    yield checks.finite("score", (alone, rating))
    yield Check("score of a signal against itself", abs(alone - perfect), 1e-12)
    if name == "mean_absolute_difference":
        right = math.fsum(np.abs(signal - other)) / signal.size
        yield checks.close("mean of |difference|", rating, right, 1e-14)
    elif np.any(signal):
        shift = 60 - int(np.frexp(np.max(np.abs(signal)))[1])
        louder = score(np.ldexp(signal, shift), np.ldexp(other, shift), *rate)
        yield checks.close("free of a common gain", louder, rating, 1e-9, scale=1.0)
