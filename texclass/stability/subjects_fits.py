"""Subjects: the fits of autoregressive models, and the choice of their order."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from texclass import vibration
from texclass.recording import Samples
from texclass.stability import exact, exact_models, rules
from texclass.stability.signals import (
    FORMS,
    VALUES,
    Case,
    beyond,
    in_families,
    lengths,
    samples_of,
    with_orders,
)
from texclass.stability.verdict import Check, Documented, Finding, Subject, Unchecked
from texclass.vibration import Autoregression
from texclass.vibration.autoregressive import autocorrelation, from_autocorrelation

METHODS = {"burg": "Burg", "autocorrelation": "the autocorrelation method"}


def subjects() -> list[Subject]:
    """Return the three methods, the fit to an autocorrelation, and the choice of an order."""
    fits = [_fit_subject(method) for method in ("burg", "autocorrelation", "modified_covariance")]
    lags = Subject(
        "from_autocorrelation", "models", "texclass", lambda q: _cases(q, 400), _from_lags, _from_lags_checks
    )
    order = Subject("select_order", "models", "texclass", _few, _select, _select_checks)
    return [*fits, lags, order]


def _cases(quick: bool, largest: int) -> tuple[Case, ...]:
    chosen = in_families(*VALUES, *FORMS, quick=quick)
    return (*with_orders((*chosen, *lengths(quick)), quick, largest), *beyond(quick))


def _few(quick: bool) -> tuple[Case, ...]:
    return with_orders(in_families(*VALUES, *FORMS, quick=quick), quick, 50)


def _fit_subject(method: Any) -> Subject:
    def run(x: Any, case: Case) -> Autoregression:
        return vibration.fit(x, case.order, method=method)

    def cases(quick: bool) -> tuple[Case, ...]:
        if method in METHODS:
            return _cases(quick, 1000)
        largest = 18 if quick else 128  # O(n p^2)
        return tuple(case for case in _cases(quick, largest) if case.order <= largest)

    def checks(x: Any, case: Case, model: Autoregression) -> Iterator[Finding]:
        signal = samples_of(x)
        if method in METHODS:
            yield from rules.predictor(signal, case.order, METHODS[method], k=model.reflection)
        else:
            yield from _both_ways(signal, case.order, model)
        yield from _gain_checks(signal, model, method)
        louder = vibration.fit(np.ldexp(_unit(signal), 40), case.order, method=method)
        alone = vibration.fit(_unit(signal), case.order, method=method)
        yield rules.close("k free of gain", louder.reflection, alone.reflection, 0.0)
        if case.family in ("dtype", "layout"):
            copy = vibration.fit(signal, case.order, method=method)
            yield rules.close("k as of the float64 copy", model.reflection, copy.reflection, 0.0)

    return Subject(f"fit, {method.replace('_', ' ')}", "models", "texclass", cases, run, checks)


def _unit(x: Samples) -> Samples:
    return np.ldexp(x, -int(np.frexp(np.max(np.abs(x), initial=0.0))[1]))


def _gain_checks(x: Samples, model: Autoregression, method: str) -> Iterator[Finding]:
    yield rules.finite("gain", model.gain)
    if not np.any(x):
        yield Check("gain of silence", float(model.gain), 0.0)
        return
    rms = exact.root(exact.mean_square(x))
    if method in METHODS:
        yield rules.close("residual of order 0 = RMS", model.residual[0], rms, 1e-12)
    else:
        yield rules.holds("a gain no larger than the signal", model.gain <= 1.01 * np.sqrt(x.size) * rms)
    if method in METHODS and exact.EXTENDED:
        padding = 0 if method == "burg" else model.order
        energies = exact.lattice_energies(x, model.reflection, padding)
        m = min(model.order, energies.size - 1)
        samples = x.size - m if method == "burg" else x.size
        measured = float(rms * np.sqrt(energies[m] * x.size / samples))
        limit, floor = 1e-6, 1e-8 * rms  # of a residual below 1e-14 of the signal only that it is so small
        yield rules.close("residual as the samples give it", model.residual[m], measured, limit, scale=floor)


def _both_ways(x: Samples, order: int, model: Autoregression) -> Iterator[Finding]:
    """Check modified covariance: stable, and no more residual than Burg's, or Burg's fit itself."""
    yield rules.finite("reflection coefficients", model.reflection)
    yield rules.stable(model.reflection)
    if model.fallback:
        burg = vibration.fit(x, order, method="burg")
        yield rules.close("the fallback is Burg's fit", model.reflection, burg.reflection, 0.0)
        yield Documented(
            "fallback: modified covariance is unstable or undetermined here, Burg's fit returned"
        )
    elif np.any(x) and exact.EXTENDED:
        energy = exact.lattice_energies(x, model.reflection)[-1]
        best = exact.burg_energies(x, order)[-1]
        above = max((energy - best) / (best + rules.FLOOR), 0.0)
        yield Check("residual energy above Burg's", float(above), rules.EXCESS)


# From the autocorrelation -----------------------------------------------------------------------------------


def _from_lags(x: Any, case: Case) -> tuple[Samples, Autoregression]:
    samples = _unit(samples_of(x))
    if samples.size == 0:
        raise ValueError("from_autocorrelation got no sample in this battery; the rule is one")
    r = autocorrelation(samples[np.newaxis], case.order)[0] if np.all(np.isfinite(samples)) else samples
    return r, from_autocorrelation(r)


def _from_lags_checks(x: Any, case: Case, result: tuple[Samples, Autoregression]) -> Iterator[Finding]:
    """Check that the Yule-Walker equations hold for the lags given, as far as they were solved."""
    r, model = result
    fitted = int(model.fitted_order)
    yield rules.stable(model.reflection)
    yield rules.finite("gain", model.gain)
    if fitted < case.order:
        yield Documented(f"fitted_order: the lags determine {fitted} orders of {case.order}")
    if fitted > 18 or not np.any(r):
        return
    if not exact.available():
        yield Unchecked(exact.MISSING)
        return
    a = exact_models.coefficients(model.reflection[:fitted])
    size = sum(abs(c) for c in a)
    equations = [
        abs(sum(c * float(r[abs(m - i)]) for i, c in enumerate(a))) / (size * float(r[0]))
        for m in range(1, fitted + 1)
    ]
    yield Check("Yule-Walker equations", float(max(equations, default=0.0)), 1e-13)


# The choice of an order -----------------------------------------------------------------------------------


def _select(x: Any, case: Case) -> Any:
    return [vibration.select_order(x, case.order, criterion=c) for c in ("spectral_error", "aicc")]


def _select_checks(x: Any, case: Case, chosen: Any) -> Iterator[Finding]:
    for criterion, selection in zip(("spectral_error", "aicc"), chosen, strict=True):
        yield Check("orders looked at", abs(selection.values.size - case.order - 1), 0.0)
        yield Check(f"{criterion} is no number", float(np.isnan(selection.values).sum()), 0.0)
        yield Check("order of the model", abs(selection.model.order - selection.order), 0.0)
        quiet = np.ldexp(_unit(samples_of(x)), -300)
        same = vibration.select_order(quiet, case.order, criterion=criterion)  # type: ignore[arg-type]
        yield Check(f"{criterion}: the order is free of gain", abs(same.order - selection.order), 0.0)
