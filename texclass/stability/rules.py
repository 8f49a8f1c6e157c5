"""What "right" means, wherever ours and a public library do the same thing: one rule for both."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from texclass.recording import Samples
from texclass.stability import exact
from texclass.stability.judging import Check, Documented, Finding
from texclass.vibration.line_spectrum import log_spectrum

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


def finite(what: str, values: ArrayLike) -> Check:
    """Check that every number is finite; the error is how many are not."""
    bad = int(np.sum(~np.isfinite(np.asarray(values, dtype=np.float64))))
    return Check(f"finite {what}", np.inf if bad else 0.0, 0.0)


def close(what: str, value: ArrayLike, reference: ArrayLike, limit: float, *, scale: float = 0.0) -> Check:
    """Check the largest difference over the largest reference (or `scale`, if that is larger)."""
    given, right = np.asarray(value, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    if given.shape != right.shape:
        return Check(f"{what}: shape {given.shape} for {right.shape}", np.inf, limit)
    if right.size == 0:
        return Check(what, 0.0, limit)
    size = max(float(np.max(np.abs(right))), scale)
    difference = float(np.max(np.abs(given - right)))
    if difference == 0:
        return Check(what, 0.0, limit)
    return Check(what, difference / size if size > 0 else np.inf, limit)


def holds(what: str, condition: object) -> Check:
    """Check what has no size: it holds, or it does not."""
    return Check(what, 0.0 if condition else np.inf, 0.0)


def stable(k: Samples) -> Check:
    """Check that every |k| is below 1: a stable filter."""
    return holds(STABLE, np.all(np.abs(k) < 1))


def stable_coefficients(a: Samples) -> Iterator[Finding]:
    """Check that 1, a_1 ... a_p are finite and, by a 60-digit step-down, a stable filter."""
    yield finite("coefficients", a)
    if np.all(np.isfinite(a)):
        yield holds(STABLE, exact.is_stable(a))


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
) -> Iterator[Finding]:
    """Check that a linear predictor is finite, stable, and leaves no more energy than its method's optimum.

    Of Burg's method the optimum is his recursion, of the autocorrelation method Levinson's, in many digits.
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
    """Return the residual energy above the optimum, relative to it (0 where both are rounding)."""
    burg = method == "Burg"
    padding = 0 if burg else order
    best = (exact.burg_energies if burg else exact.autocorrelation_energies)(x, order)[-1]
    if k is not None:
        left = exact.lattice_energies(x, k, padding)[-1]
    else:
        assert a is not None
        left = exact.direct_energy(x, a, padding)
    return max(float((left - best) / (best + FLOOR)), 0.0) if np.isfinite(left) else np.inf


def line_spectrum(k: Samples, lsf: Samples, back: Samples | None) -> Iterator[Finding]:
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
        p = k.size
        difference = log_spectrum(back, OMEGA) - log_spectrum(k, OMEGA)
        limit = 1e-8 if p <= 128 else 1e-6 if p <= 400 else 1e-3
        yield Check("round trip, dB RMS of the spectrum", float(np.sqrt(np.mean(difference**2))), limit)


def response(what: str, out: Samples, k: Samples, excitation: Samples) -> Check:
    """Check the sound of a model against that of 60-digit arithmetic."""
    return close(f"{what}, against 60 digits", out, exact.all_pole_response(k, excitation), RESPONSE)


# Features ---------------------------------------------------------------------------------------------------

Values = Mapping[str, float]


def features(
    values: Values, reasons: Mapping[str, str], expected: Values, *, undefined_is: str
) -> Iterator[Finding]:
    """Check that every output that plain noise has is there, and is finite or has a reason.

    Parameters
    ----------
    values, reasons
        By output; a reason explains why a value is NaN.
    expected
        Of plain noise.
    undefined_is
        What a reader gets instead of a reason, in words.
    """
    missing = [name for name in expected if name not in values] + [n for n in values if n not in expected]
    yield Check(f"as many columns as for noise ({len(missing)} differ)", float(len(missing)), 0.0)
    unsaid = [name for name, value in values.items() if not np.isfinite(value) and name not in reasons]
    silent = [name for name in unsaid if np.isfinite(expected.get(name, 0.0))]
    what = f"finite outputs, or a reason: {len(silent)} of {len(values)} {undefined_is}"
    yield Check(f"{what}, {', '.join(silent[:3])}" if silent else what, np.inf if silent else 0.0, 0.0)
    if reasons:
        yield Documented(f"{len(reasons)} of {len(values)}: {next(iter(reasons.values()))}")


def _worst(what: str, errors: Mapping[str, float], limit: float) -> Check:
    """Check the largest of some outputs' errors, naming the output that exceeds its limit."""
    where = max(errors, key=lambda name: errors[name], default="")
    worst = float(errors.get(where, 0.0))
    return Check(f"{what} ({where})" if worst > limit else what, worst, limit)


def same_values(
    what: str, values: Values, reference: Values, limit: float, *, scale: Values | None = None
) -> Check:
    """Check the worst relative difference of outputs that both have a value; `scale` says what is small."""
    errors = {}
    for name, right in reference.items():
        given = values.get(name, np.nan)
        if np.isfinite(given) and np.isfinite(right) and given != right:
            small = abs((scale or {}).get(name, 0.0))
            size = max(abs(right), abs(given), small if np.isfinite(small) else 0.0)
            errors[name] = abs(given - right) / size
    return _worst(what, errors, limit)


def inferred_laws(outputs: Sequence[Values]) -> dict[str, tuple[float, float]]:
    """Return (power, shift) of outputs with y(g x) = g^power y(x) + shift log10(g) at all `LAW_GAINS`."""
    decades, laws = np.log10(LAW_GAINS), {}
    for name in outputs[0]:
        y = np.array([values.get(name, np.nan) for values in outputs])
        if not np.all(np.isfinite(y)):
            continue
        steps = np.diff(y) / np.diff(decades)
        shift = float(steps.mean())
        if np.ptp(steps) <= 1e-6 * np.max(np.abs(y)):
            laws[name] = 0.0, (shift if abs(shift) > 1e-6 * np.max(np.abs(y)) else 0.0)
        elif np.all(y > 0) or np.all(y < 0):
            powers = np.diff(np.log10(np.abs(y))) / np.diff(decades)
            if np.ptp(powers) <= 1e-6:
                laws[name] = float(powers.mean().round(6)), 0.0
    return laws


def under_gain(
    values: Values, once: Values, laws: Mapping[str, tuple[float, float]], gain: float, limit: float
) -> Check:
    """Check that outputs keep their law at any gain; values out of the range of float64 do not count."""
    errors = {}
    for name, (power, shift) in laws.items():
        exponent = power * np.log10(gain) + np.log10(abs(once[name])) if once[name] else 0.0
        given = values.get(name, np.nan)
        if np.isfinite(given) and abs(exponent) <= 290:
            y = once[name] * gain**power + shift * np.log10(gain)
            errors[name] = abs(given - y) / max(abs(y), abs(shift * np.log10(gain)), 1e-300)
    return _worst("the gain law it follows from 1e-6 to 1e6", errors, limit)


def plain_numbers(values: Any) -> dict[str, float]:
    """Return a mapping of outputs as floats, NaN where an output is no number."""
    out = {}
    for name, value in values.items():
        try:
            out[str(name)] = float(value)
        except (TypeError, ValueError):
            out[str(name)] = float("nan")
    return out
