"""Subjects: every registered feature, and all together as a public library of features is judged."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd

from texclass.features.contract import Gain, UndefinedFeatureError, list_features
from texclass.features.contract_checks import view_without_recording
from texclass.features.phase_view import Phase, Views
from texclass.features.sets import FeatureSet, Member
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.stability import rules
from texclass.stability.inputs import LONG, Case, battery, noise, plain, samples_of
from texclass.stability.rules import Attempt, Check, Subject, Trial, largest

LAW_GAINS = (1e-6, 1e-3, 1.0, 1e3, 1e6)
"""A library that declares no gain law has one where an output follows it over these twelve decades."""
cases = partial(battery, n=LONG)
"""What a feature is given."""
Extract = Callable[[Any, Case], tuple[dict[str, Any], dict[str, str]]]
"""Takes samples and case, returns outputs by name, and the reasons of those without a value."""


def subjects() -> list[Subject]:
    """Return one subject for each registered feature, and all together as a library is judged."""
    members = tuple(Member(name, feature) for name, feature in list_features().items())
    every = FeatureSet("all", members).with_phases("tap", "movement", "travel", "friction")

    def extract(x: Any, case: Case) -> tuple[dict[str, Any], dict[str, str]]:
        values, reasons = every.compute(views_of(x, case.fs))
        by_feature = dict(reasons)
        by_column = {c: by_feature[m.name] for m in members if m.name in by_feature for c in m.columns}
        return dict(zip(every.column_names, values.tolist(), strict=True)), by_column

    def none_required(quick: bool) -> list[Case]:
        return [replace(case, required=False) for case in cases(quick)]

    given = {"ridge_density": none_required}  # even ordinary noise has no ribs
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
    """Return the trial of one of our features: that of a library of its outputs, and its own references."""
    feature = member.feature

    def extract(x: Any, case: Case) -> tuple[dict[str, Any], dict[str, str]]:
        if case.family == "broken":  # a recording would refuse it
            view = view_without_recording(feature.phase, samples_of(x), case.fs)
            values = np.atleast_1d(np.asarray(feature.function(view), dtype=np.float64))
        else:
            values = member.values(views_of(x, case.fs, feature.phase))
        return dict(zip(member.columns, values.tolist(), strict=True)), {}

    as_library = extraction(extract, dict.fromkeys(member.columns, feature.gain))

    def attempt(x: Any, case: Case) -> Attempt:
        values = yield from as_library(x, case)
        signal = samples_of(x)
        yield rules.holds("no value for silence", np.any(signal))
        yield from _in_many_digits(feature.name, signal, values.tolist())

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


def extraction(extract: Extract, laws: Mapping[Any, Gain] | None = None) -> Trial:
    """Return the trial of a library of features, all outputs together.

    Parameters
    ----------
    extract : callable
        What is tried.
    laws : mapping of str to Gain, optional
        Gain law that each output declares; by default those that it follows, see `inferred_laws`.

    Returns
    -------
    callable
        Yields the findings, and returns the values.
    """
    # our features work in single precision inside, and libraries in whatever they are given
    limit, copy_limit = (1e-4, 1e-4) if laws is None else (1e-5, 0.0)

    def numbers(x: Any, case: Case) -> pd.Series:
        try:
            return as_numbers(extract(x, case)[0])
        except UndefinedFeatureError:
            return pd.Series(np.nan, index=pd.Index(list(laws or ())))

    @cache
    def of_noise(gain: float, fs: float) -> pd.Series:
        return numbers(gain * plain(LONG), Case("plain", "plain", plain(LONG), fs=fs))

    def attempt(x: Any, case: Case) -> Attempt:
        outputs, reasons = extract(x, case)
        yield outputs
        values, expected, signal = as_numbers(outputs), of_noise(1.0, case.fs), samples_of(x)
        yield from complete(values, reasons, expected)
        # symmetric signals may tip over, and of what stands on an offset 1e-13 is no small change
        if case.family in ("plain", "poles", "oversampled", "gain", "rate"):
            changed = numbers(signal * (1 + 1e-13 * noise(signal.size, 6)), case)
            yield same_values("change when samples change by 1e-13", changed, values, 1e-3, expected)
        if case.family in ("dtype", "layout"):
            yield same_values("as of the float64 copy", values, numbers(signal, case), copy_limit)
        if laws is not None:
            # 1.1 rounds every sample anew: 1.1 times 1e6 by 1e-10, which is 1e-7 of the noise on it
            louder, allowed = numbers(1.1 * signal, case), 1e-3 if case.family == "offset" else limit
            yield rules.holds("a value at gain 1.1", np.isfinite(louder).all())
            # outputs of one feature share a scale: 0 may come out as 1e-17
            shared = 1e-7 * louder.abs().max()
            yield under_gain("the declared gain law, at gain 1.1", louder, values, laws, 1.1, allowed, shared)
        if case.family == "gain" and laws is not None:
            what, shared = "the declared gain law, from gain 1", 1e-7 * values.abs().max()
            yield under_gain(what, values, expected, laws, case.gain, limit, shared)
        elif case.family == "gain":
            inferred = inferred_laws([of_noise(gain, case.fs) for gain in LAW_GAINS])
            what = "the gain law it follows from 1e-6 to 1e6"
            yield under_gain(what, values, expected, inferred, case.gain, limit)
        if reasons and len(reasons) == len(values):
            yield next(iter(reasons.values()))
        return values

    return attempt


def as_numbers(outputs: dict[str, Any]) -> pd.Series:
    """Return outputs as floats, NaN where one is no number."""
    return pd.to_numeric(pd.Series(outputs), errors="coerce").astype(np.float64)


def complete(values: pd.Series, reasons: Mapping[str, str], expected: pd.Series) -> Attempt:
    """Check that every output that plain noise has is there, and is finite or has a reason."""
    n_differ = values.index.symmetric_difference(expected.index).size
    yield Check(f"as many columns as for noise ({n_differ} differ)", float(n_differ), 0.0)
    unexplained = values.index[~np.isfinite(values)].difference(list(reasons), sort=False)
    silent = [name for name in unexplained if np.isfinite(expected.get(name, 0.0))]
    first = f", {', '.join(silent[:3])}" if silent else ""
    what = f"finite outputs, or a reason: {len(silent)} of {len(values)} NaN without a reason{first}"
    yield rules.holds(what, not silent)
    if reasons:
        yield f"{len(reasons)} of {len(values)}: {next(iter(reasons.values()))}"


def same_values(
    what: str, values: pd.Series, reference: pd.Series, limit: float, scale: pd.Series | None = None
) -> Check:
    """Check the worst relative difference of outputs that both have a value; `scale` says what is small."""
    both = pd.concat({"given": values, "right": reference, "scale": scale}, axis=1)
    both = both[np.isfinite(both["given"]) & np.isfinite(both["right"])]
    size = both.abs().replace(np.inf, 0.0).max(axis=1)
    return _worst(what, (both["given"] - both["right"]).abs() / size, limit)


def inferred_laws(outputs: Sequence[pd.Series]) -> dict[Any, Gain]:
    """Return the laws that outputs of noise follow at all `LAW_GAINS`."""
    decades, laws = np.diff(np.log10(LAW_GAINS)), {}
    for name, y in pd.concat(outputs, axis=1).T.dropna(axis=1).items():
        if not np.all(np.isfinite(y)):
            continue
        steps, rounding = np.diff(y) / decades, 1e-6 * y.abs().max()
        if np.ptp(steps) <= rounding:
            shift = float(steps.mean())
            laws[name] = Gain(shift=shift if abs(shift) > rounding else 0.0)
        elif np.all(y > 0) or np.all(y < 0):
            powers = np.diff(np.log10(np.abs(y))) / decades
            if np.ptp(powers) <= 1e-6:
                laws[name] = Gain(float(powers.mean().round(6)))
    return laws


def under_gain(
    what: str,
    values: pd.Series,
    once: pd.Series,
    laws: Mapping[Any, Gain],
    gain: float,
    limit: float,
    least: float | None = None,
) -> Check:
    """Check that outputs keep their law at any gain; values out of the range of float64 do not count.

    Errors are over the output as it should be, over `least` if it is smaller (by default over what is added).
    """
    errors = {}
    for name, law in laws.items():
        exponent = law.power * np.log10(gain) + np.log10(abs(once[name])) if once[name] else 0.0
        if np.isfinite(value := values.get(name, np.nan)) and abs(exponent) <= 290:
            right = float(law.apply(once[name], gain))
            small = abs(law.shift * np.log10(gain)) if least is None else least
            errors[name] = abs(value - right) / max(abs(right), small, 1e-300)
    return _worst(what, pd.Series(errors, dtype=float), limit)


def _worst(what: str, errors: pd.Series, limit: float) -> Check:
    """Check the largest of some outputs' errors, naming the output that exceeds its limit."""
    worst = float(errors.fillna(0.0).max()) if len(errors) else 0.0
    return Check(f"{what} ({errors.idxmax()})" if worst > limit else what, worst, limit)
