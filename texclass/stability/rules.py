"""What "right" means, wherever ours and a public library do the same thing: one rule for both."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.stability import exact
from texclass.stability.judging import Check
from texclass.vibration import Autoregression

OMEGA: Samples = (np.arange(256) + 0.5) * np.pi / 256
EXCESS = 1e-6
"""Residual energy above the optimum of the method, relative to it."""
EXCESS_SINGLE = 1e-3
"""The same for samples that come in single precision, in which a library may go on."""
FLOOR = 1e-20
"""Residual energy over that of the signal that counts as 0: times `EXCESS`, the rounding of the samples."""
STABLE = "every |k| below 1 (stable)"
LAW_GAINS = (1e-6, 1e-3, 1.0, 1e3, 1e6)
"""A library that declares no gain law has one where an output follows it over these twelve decades."""
RESPONSE = 1e-9
"""Error of a response over its largest magnitude."""
SENSITIVITY = 1e-3
"""Relative change of a feature that a relative change of the samples by 1e-13 may make."""
Values = pd.Series


def holds(what: str, condition: object) -> Check:
    """Check what has no size: it holds, or it does not."""
    return Check(what, 0.0 if condition else np.inf, 0.0)


def finite(what: str, values: ArrayLike) -> Check:
    """Check that every number is finite."""
    return holds(f"finite {what}", np.all(np.isfinite(np.asarray(values, dtype=np.float64))))


def close(what: str, value: ArrayLike, reference: ArrayLike, limit: float, *, scale: float = 0.0) -> Check:
    """Check the largest difference over the largest reference (or `scale`, if that is larger)."""
    given, right = np.asarray(value, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    if given.shape != right.shape:
        return Check(f"{what}: shape {given.shape} for {right.shape}", np.inf, limit)
    difference = float(np.max(np.abs(given - right), initial=0.0))
    size = max(float(np.max(np.abs(right), initial=0.0)), scale)
    return Check(what, difference and (difference / size if size > 0 else np.inf), limit)


def stable(k: Samples) -> Check:
    """Check that every |k| is below 1: a stable filter."""
    return holds(STABLE, np.all(np.abs(k) < 1))


def stable_coefficients(a: Samples) -> Iterator[Check]:
    """Check that 1, a_1 ... a_p are finite and, by a 60-digit step-down, a stable filter."""
    yield finite("coefficients", a)
    if np.all(np.isfinite(a)):
        yield stable(exact.step_down(a))


def stable_sections(denominators: Samples) -> Check:
    """Check second-order sections by their last two coefficients, those of 1 + a_1 z^-1 + a_2 z^-2."""
    a_1, a_2 = denominators[:, -2], denominators[:, -1]
    inside = (np.abs(a_2) < 1) & (np.abs(a_1) < 1 + a_2)
    return Check("sections that are not stable", float(np.sum(~inside)), 0.0)


def predictor(
    x: Samples,
    order: int,
    method: str,
    *,
    k: Samples | None = None,
    a: Samples | None = None,
    limit: float = EXCESS,
) -> Iterator[Check]:
    """Check that a linear predictor is finite, stable, and leaves no more energy than its method's optimum.

    Coefficients of an order above 128 are not stepped down: in 60 digits that takes minutes for all inputs.
    """
    if k is not None:
        yield finite("reflection coefficients", k)
        yield stable(k)
    if np.any(x) and x.size > order and exact.EXTENDED:
        yield Check(f"residual energy above {method}'s optimum", excess(x, order, method, k=k, a=a), limit)
    if a is not None:
        yield from stable_coefficients(a) if order <= 128 else [finite("coefficients", a)]


def excess(
    x: Samples, order: int, method: str, *, k: Samples | None = None, a: Samples | None = None
) -> float:
    """Return the residual energy above the optimum, relative to it (0 where both are rounding).

    Of Burg's method the optimum is his recursion, of the autocorrelation method the same between zeros.
    """
    padding = 0 if method == "Burg" else order
    between = np.pad(x, max(order, exact.LARGEST_ORDER)) if padding else x
    best = exact.burg_energies(between, order)[-1]
    if k is not None:
        left = exact.lattice_energies(x, k, padding)[-1]
    else:
        assert a is not None
        left = exact.direct_energy(x, a, padding)
    return max(float((left - best) / (best + FLOOR)), 0.0) if np.isfinite(left) else np.inf


def line_spectrum(k: Samples, lsf: Samples, back: Samples | None) -> Iterator[Check]:
    """Check that frequencies increase in (0, pi), and that the way back is stable and has the same spectrum.

    `back` are reflection coefficients; None, if the way back has none (an unstable filter).
    """
    yield finite("frequencies", lsf)
    edges = np.concatenate([[0.0], lsf, [np.pi]])
    yield holds("frequencies strictly increasing in (0, pi)", np.all(np.diff(edges) > 0))
    if back is None or not np.all(np.isfinite(back)):
        yield holds("the way back is a stable filter", False)
        return
    yield stable(back)
    if np.all(np.abs(back) < 1):
        difference = spectrum_db(back) - spectrum_db(k)
        limit = 1e-8 if k.size <= 128 else 1e-6 if k.size <= 400 else 1e-3
        yield Check("round trip, dB RMS of the spectrum", float(np.sqrt(np.mean(difference**2))), limit)


def spectrum_db(k: Samples) -> Samples:
    """Return the power spectrum of a model at unit gain at the frequencies `OMEGA`, in dB."""
    return Autoregression(k, np.asarray(1.0)).log_spectrum_db(OMEGA)


def response(what: str, out: Samples, k: Samples, excitation: Samples) -> Check:
    """Check the sound of a model against that of 60-digit arithmetic."""
    return close(f"{what}, against 60 digits", out, exact.all_pole_response(k, excitation), RESPONSE)


# Features ---------------------------------------------------------------------------------------------------


def features(values: Values, reasons: Mapping[str, str], expected: Values) -> Iterator[Any]:
    """Check that every output that plain noise has is there, and is finite or has a reason."""
    n_differ = values.index.symmetric_difference(expected.index).size
    yield Check(f"as many columns as for noise ({n_differ} differ)", float(n_differ), 0.0)
    unsaid = values.index[~np.isfinite(values)].difference(list(reasons), sort=False)
    silent = [name for name in unsaid if np.isfinite(expected.get(name, 0.0))]
    first = f", {', '.join(silent[:3])}" if silent else ""
    what = f"finite outputs, or a reason: {len(silent)} of {len(values)} NaN without a reason{first}"
    yield holds(what, not silent)
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
    """Return (power, shift) of outputs with y(g x) = g^power y(x) + shift log10(g) at all `LAW_GAINS`."""
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
    values: Values, once: Values, laws: Mapping[Any, tuple[float, float]], gain: float, limit: float
) -> Check:
    """Check that outputs keep their law at any gain; values out of the range of float64 do not count."""
    errors = {}
    for name, (power, shift) in laws.items():
        exponent = power * np.log10(gain) + np.log10(abs(once[name])) if once[name] else 0.0
        given, added = values.get(name, np.nan), shift * np.log10(gain)
        if np.isfinite(given) and abs(exponent) <= 290:
            right = once[name] * gain**power + added
            errors[name] = abs(given - right) / max(abs(right), abs(added), 1e-300)
    return _worst("the gain law it follows from 1e-6 to 1e6", pd.Series(errors, dtype=float), limit)


def _worst(what: str, errors: Values, limit: float) -> Check:
    """Check the largest of some outputs' errors, naming the output that exceeds its limit."""
    worst = float(errors.fillna(0.0).max()) if len(errors) else 0.0
    return Check(f"{what} ({errors.idxmax()})" if worst > limit else what, worst, limit)
