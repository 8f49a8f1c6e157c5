"""Subjects: every registered feature, whoever wrote it, from a recording to its values."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd

from texclass.features.contract import UndefinedFeatureError, registered
from texclass.features.examination import bare_view
from texclass.features.phase_view import Phase, Views
from texclass.features.sets import FeatureSet, Member
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.stability import rules
from texclass.stability.inputs import LONG, Case, battery, noise, plain, samples_of
from texclass.stability.judging import Attempt, Check, Subject, Trial

GAIN_ERROR = 1e-5
"""Relative error of the gain law; features work in single precision inside."""
STEADY = ("plain", "poles", "oversampled", "gain", "rate")
"""Families on which a change of the samples by 1e-13 may not be seen.

Symmetric signals may tip over, and for what stands on an offset that is no small change.
"""
SHAKEN = "change when samples change by 1e-13"
cases = partial(battery, n=LONG)
"""What a feature is given."""
Extract = Callable[[Any, Case], tuple[dict[str, Any], dict[str, str]]]


def subjects() -> list[Subject]:
    """Return one subject for each feature, and all features together as a library is judged."""
    members = tuple(Member(name, feature) for name, feature in registered().items())
    whole = FeatureSet("all", members).reading("tap", "movement", "friction")

    def extract(x: Any, case: Case) -> tuple[dict[str, Any], dict[str, str]]:
        values, reasons = whole.compute(views_of(x, case.fs))
        why = dict(reasons)
        told = {c: why[m.name] for m in members if m.name in why for c in m.columns}
        return dict(zip(whole.column_names, values.tolist(), strict=True)), told

    each = [Subject(m.name, "features", cases, partial(_feature, m)) for m in members]
    return [*each, Subject("all features", "features", cases, extraction(extract))]


def views_of(x: Any, fs: float, phase: Phase = "movement") -> Views:
    """Return the samples as a movement, as friction, and as taps with their contact after a quarter.

    One tap of few samples, four of many. For a pair: the samples, and the same backwards.
    """
    if phase == "pair":
        one, other = views_of(x, fs), views_of(x[::-1], fs)
        return replace(one, sides=(one, other))
    n = len(x)
    each = n // 4 if n >= LONG else n
    taps = tuple(Tap(i, i + min(each // 4, each - 1), i + each) for i in range(0, n - each + 1, max(each, 1)))
    phases = Phases(taps if n else (), (0, n))
    return Views(Recording(x, fs=fs, friction=x, phases=phases), phases)


def shaken(x: Samples) -> Samples:
    """Return the samples changed by 1e-13 of each."""
    return x * (1 + 1e-13 * noise(x.size, 6))


def _feature(member: Member, x: Any, case: Case) -> Attempt:
    feature, signal = member.feature, samples_of(x)
    if case.family == "broken":
        values = np.atleast_1d(
            np.asarray(feature.function(bare_view(feature.phase, signal, case.fs)), np.float64)
        )
    else:
        values = member.values(views_of(x, case.fs, feature.phase))
    yield rules.finite("value", values)
    yield Check("as many values as declared", abs(values.size - len(member.columns)), 0.0)
    if not np.any(signal):
        yield Check("a value for silence", np.inf, 0.0)
        return
    # 1.1 rounds every sample anew; 1.1 times 1e6 is rounded by 1e-10, which is 1e-7 of the noise on it
    limit = 1e-3 if case.family == "offset" else GAIN_ERROR
    louder = _values(member, 1.1 * signal, case.fs)
    yield _law("the declared gain law, at gain 1.1", louder, feature.gain.apply(values, 1.1), limit)
    if case.family in STEADY:
        size = np.maximum(np.abs(values), np.abs(_usual(member.name)))
        change = np.abs(_values(member, shaken(signal), case.fs) - values)
        change = np.divide(change, size, out=np.zeros_like(change), where=change > 0)
        yield Check(SHAKEN, float(np.max(change, initial=0.0)), rules.SENSITIVITY)
    if case.family in ("dtype", "layout"):
        yield rules.close("as of the float64 copy", values, _values(member, signal, case.fs), 0.0)
    if case.family == "gain":
        law = feature.gain.apply(_values(member, plain(LONG), case.fs), case.gain)
        yield _law("the declared gain law, from gain 1", values, law, GAIN_ERROR)
    match feature.name:  # those that can be had in many digits
        case "friction":
            right = math.fsum(np.abs(signal)) / signal.size
            yield rules.close("mean |x|, against exact sums", values[0], right, 1e-13)
        case "mean_magnitude":
            wide = signal.astype(np.longdouble)
            right = float(np.abs(wide - wide.mean()).mean())
            scale = 1e-4 * float(np.max(np.abs(signal)))
            yield rules.close("mean |x - mean|", values[0], right, 1e-13, scale=scale)
        case "variance":
            square = float(signal.astype(np.longdouble).var())
            if 1e-290 < square < 1e290:
                rounding = (1e-13 * float(np.max(np.abs(signal)))) ** 2 / square  # of an offset
                yield rules.close("variance, in 80-bit floats", values[0], square, 1e-13 + rounding)
        case "lpc_coefficients":
            yield from rules.stable_coefficients(np.concatenate([[1.0], -values]))


def _values(member: Member, samples: Any, fs: float) -> Samples:
    try:
        return member.values(views_of(samples, fs, member.feature.phase))
    except UndefinedFeatureError:
        return np.full(len(member.columns), np.nan)


def _law(what: str, given: Samples, expected: Any, limit: float) -> Check:
    """Check y(g x) = g^power y(x) + shift log10(g), apart from values near the end of float64's range.

    Outputs of one feature share a scale: 0 may come out as 1e-17.
    """
    right = np.asarray(expected, dtype=np.float64)
    size = np.maximum(np.maximum(np.abs(right), np.abs(given)), 1e-290)
    size = np.maximum(size, 1e-7 * size.max())
    counts = (np.abs(right) > 1e-290) & (np.abs(right) < 1e290)
    error = np.max(np.where(counts, np.abs(given - right) / size, 0.0), initial=0.0)
    return Check(what, float(error), limit)


@cache
def _usual(name: str) -> Samples:
    """Return the values for plain noise, which say what size counts as small."""
    return np.nan_to_num(_values(Member(name, registered()[name]), plain(LONG), 10_000.0))


def extraction(extract: Extract) -> Trial:
    """Return an attempt at a library of features, all outputs together.

    Parameters
    ----------
    extract
        Takes samples and case, returns outputs by name, and reasons by output.
    """

    def numbers(x: Any, case: Case) -> rules.Values:
        return as_numbers(extract(x, case)[0])

    @cache
    def of_noise(gain: float, fs: float) -> rules.Values:
        return numbers(gain * plain(LONG), Case("plain", "plain", plain(LONG), fs=fs))

    def attempt(x: Any, case: Case) -> Attempt:
        result, reasons = extract(x, case)
        yield result
        values, expected, signal = as_numbers(result), of_noise(1.0, case.fs), samples_of(x)
        yield from rules.features(values, reasons, expected)
        if case.family in STEADY:
            changed = numbers(shaken(signal), case)
            yield rules.same_values(SHAKEN, changed, values, rules.SENSITIVITY, expected)
        if case.family in ("dtype", "layout"):
            copy = numbers(signal, case)
            yield rules.same_values("as of the float64 copy", values, copy, 1e-4)
        if case.family == "gain":
            laws = rules.inferred_laws([of_noise(gain, case.fs) for gain in rules.LAW_GAINS])
            yield rules.under_gain(values, expected, laws, case.gain, 1e-4)
        if reasons and len(reasons) == len(values):
            yield next(iter(reasons.values()))

    return attempt


def as_numbers(outputs: dict[str, Any]) -> rules.Values:
    """Return outputs as floats, NaN where one is no number."""
    return pd.to_numeric(pd.Series(outputs), errors="coerce").astype(np.float64)
