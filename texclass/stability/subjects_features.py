"""Subjects: every registered feature, whoever wrote it, from a recording to its values."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from texclass.features.contract import Feature, UndefinedFeatureError, registered
from texclass.features.sets import FeatureSet, Member
from texclass.features.view import PhaseView, TapSignal, TapView
from texclass.features.views import Views
from texclass.recording import Phases, Recording, Samples, Tap
from texclass.stability import exact, rules
from texclass.stability.signals import (
    FORMS,
    LONG,
    VALUES,
    Case,
    in_families,
    lengths,
    noise,
    plain,
    rates,
    samples_of,
)
from texclass.stability.verdict import Check, Documented, Finding, Subject

GAIN_ERROR = 1e-5
"""Relative error of the gain law; features work in single precision inside."""
STEADY = ("plain", "poles", "oversampled", "gain", "rate")
"""Families on which a change of the samples by 1e-13 may not be seen.

Symmetric signals may tip over, and for what stands on an offset that is no small change.
"""


def subjects() -> list[Subject]:
    """Return one subject for each feature, and all features together as a library is judged."""
    each = [_feature_subject(feature) for feature in registered().values()]
    return [*each, everything()]


def cases(quick: bool) -> tuple[Case, ...]:
    """Return what a feature is given: the battery at `LONG` samples, lengths and rates."""
    values = in_families(*VALUES, *FORMS, quick=quick, n=LONG)
    return (*values, *lengths(quick), *rates(quick, LONG))


def views_of(x: Any, fs: float) -> Views:
    """Return the samples as a movement, as friction, and as taps with their contact after a quarter.

    One tap of few samples, four of many.
    """
    n = len(x)
    each = n // 4 if n >= LONG else n
    taps = tuple(Tap(i, i + min(each // 4, each - 1), i + each) for i in range(0, n - each + 1, max(each, 1)))
    phases = Phases(taps if n else (), (0, n))
    return Views(
        Recording(x, fs=fs, unit="arbitrary", recording_id="battery", friction=x, phases=phases), phases
    )


def bare_view(feature: Feature, x: Samples, fs: float) -> PhaseView | TapView:
    """Return the samples as the phase a feature reads, without a recording that would refuse them."""
    if feature.phase == "tap":
        contact = x.size // 4
        return TapView((TapSignal(x[:contact], x[contact:]),), fs)
    return PhaseView(x, fs)


def _feature_subject(feature: Feature) -> Subject:
    member = Member(feature.name, feature)

    def run(x: Any, case: Case) -> Samples:
        if case.family == "broken":
            view = bare_view(feature, samples_of(x), case.fs)
            return np.atleast_1d(np.asarray(feature.function(view), dtype=np.float64))
        return member.values(views_of(x, case.fs))

    def checks(x: Any, case: Case, values: Samples) -> Iterator[Finding]:
        yield rules.finite("value", values)
        yield Check("as many values as declared", abs(values.size - len(member.columns)), 0.0)
        signal = samples_of(x)
        if not np.any(signal):
            yield Check("a value for silence", np.inf, 0.0)
            return
        yield _gain_law(member, signal, case, values)
        if case.family in STEADY:
            yield _steadiness(member, signal, case, values)
        if case.family in ("dtype", "layout"):
            copy = _value(member, signal, case.fs)
            yield rules.close("as of the float64 copy", values, copy, 0.0)
        if feature.name in REFERENCES:
            yield from REFERENCES[feature.name](signal, values)
        if case.family == "gain":
            law = feature.gain.apply(_value(member, plain(LONG), case.fs), case.gain)
            yield _relative("the declared gain law, from gain 1", values, law)

    return Subject(feature.name, "features", "texclass", cases, run, checks)


def _value(member: Member, samples: Any, fs: float) -> Samples:
    try:
        return member.values(views_of(samples, fs))
    except UndefinedFeatureError:
        return np.full(len(member.columns), np.nan)


def _gain_law(member: Member, x: Samples, case: Case, values: Samples) -> Check:
    """y(1.1 x) = 1.1^power y(x) + shift log10(1.1): 1.1 rounds every sample anew."""
    expected = member.feature.gain.apply(values, 1.1)
    # 1.1 times 1e6 is rounded by 1e-10, which is 1e-7 of the noise on it
    limit = 1e-3 if case.family == "offset" else GAIN_ERROR
    return _relative("the declared gain law, at gain 1.1", _value(member, 1.1 * x, case.fs), expected, limit)


def _relative(what: str, given: Samples, expected: Any, limit: float = GAIN_ERROR) -> Check:
    """Largest relative difference; values near the end of float64's range do not count."""
    right = np.asarray(expected, dtype=np.float64)
    size = np.maximum(np.maximum(np.abs(right), np.abs(given)), 1e-290)
    size = np.maximum(
        size, 1e-7 * size.max()
    )  # outputs of one feature share a scale: 0 may come out as 1e-17
    counts = (np.abs(right) > 1e-290) & (np.abs(right) < 1e290)
    error = np.max(np.where(counts, np.abs(given - right) / size, 0.0), initial=0.0)
    return Check(what, float(error), limit)


def _steadiness(member: Member, x: Samples, case: Case, values: Samples) -> Check:
    shaken = _value(member, x * (1 + 1e-13 * noise(x.size, 6)), case.fs)
    size = np.maximum(np.abs(values), np.abs(_scale(member.name)))
    error = float(np.max(np.abs(shaken - values) / size, initial=0.0))
    return Check("change when samples change by 1e-13", error, rules.SENSITIVITY)


@lru_cache(maxsize=256)
def _scale(name: str) -> Samples:
    """Return the values for plain noise, which say what size counts as small."""
    member = Member(name, registered()[name])
    return np.nan_to_num(_value(member, plain(LONG), 10_000.0))


# References -------------------------------------------------------------------------------------------------


def _mean_of_magnitude(x: Samples, values: Samples) -> Iterator[Finding]:
    yield rules.close("mean |x|, against exact sums", values[0], exact.mean(np.abs(x)), 1e-13)


def _mean_of_deviation(x: Samples, values: Samples) -> Iterator[Finding]:
    wide = x.astype(np.longdouble)
    right = float(np.abs(wide - wide.mean()).mean())
    yield rules.close("mean |x - mean|", values[0], right, 1e-13, scale=1e-4 * float(np.max(np.abs(x))))


def _variance(x: Samples, values: Samples) -> Iterator[Finding]:
    right = exact.variance(x)
    if 1e-290 < right < 1e290:
        rounding = (1e-13 * float(np.max(np.abs(x)))) ** 2 / float(right)  # of an offset, in the deviation
        yield rules.close("variance, against exact sums", values[0], float(right), 1e-13 + rounding)


def _stable_predictor(x: Samples, values: Samples) -> Iterator[Finding]:
    yield from rules.stable_coefficients(np.concatenate([[1.0], -values]))


REFERENCES: dict[str, Any] = {
    "friction": _mean_of_magnitude,
    "mean_magnitude": _mean_of_deviation,
    "variance": _variance,
    "lpc_coefficients": _stable_predictor,
}
"""Features whose value, or an invariant of it, can be had in many digits."""


# All features as one library --------------------------------------------------------------------------------


def everything() -> Subject:
    """Return all features as one extraction, judged by the rule public feature libraries are judged by."""
    members = tuple(Member(name, feature) for name, feature in registered().items())
    whole = FeatureSet("all", members)

    def extract(x: Any, case: Case) -> tuple[dict[str, float], dict[str, str]]:
        values, reasons = whole.compute(views_of(x, case.fs))
        named = dict(zip(whole.column_names, values.tolist(), strict=True))
        why = dict(reasons)
        return named, {c: why[m.name] for m in whole.members if m.name in why for c in m.columns}

    return extraction("all features", "texclass", extract, "features")


def extraction(
    name: str,
    library: str,
    extract: Any,
    group: str,
    *,
    given: Any = cases,
    exempt: frozenset[str] = frozenset(),
) -> Subject:
    """Return a subject for a feature library: one cell an input, all outputs together.

    Parameters
    ----------
    extract
        Takes samples and case, returns outputs by name, and reasons by output.
    given
        The inputs.
    exempt
        Families it is not given.
    """
    memory: dict[Any, dict[str, float]] = {}

    def of(quick: bool) -> list[Case]:
        return [case for case in given(quick) if case.family not in exempt]

    def values_of(x: Any, case: Case, key: Any) -> dict[str, float]:
        if key not in memory:
            memory[key] = rules.plain_numbers(extract(x, case)[0])
        return memory[key]

    def run(x: Any, case: Case) -> Any:
        return extract(x, case)

    def checks(x: Any, case: Case, result: Any) -> Iterator[Finding]:
        values, reasons = rules.plain_numbers(result[0]), result[1]
        usual = plain(LONG)
        reference = Case("plain", "plain", lambda: usual, case.fs)
        expected = values_of(usual, reference, case.fs)
        yield from rules.features(values, reasons, expected, undefined_is="NaN without a reason")
        signal = samples_of(x)
        if case.family in STEADY:
            shaken = rules.plain_numbers(extract(signal * (1 + 1e-13 * noise(signal.size, 6)), case)[0])
            what = "change when samples change by 1e-13"
            yield rules.same_values(what, shaken, values, rules.SENSITIVITY, scale=expected)
        if case.family in ("dtype", "layout"):
            copy = rules.plain_numbers(extract(signal, case)[0])
            yield rules.same_values("as of the float64 copy", values, copy, 1e-4)
        if case.family == "gain":
            laws = rules.inferred_laws(
                [values_of(g * usual, reference, ("gain", g)) for g in rules.LAW_GAINS]
            )
            yield rules.under_gain(values, expected, laws, case.gain, 1e-4)
        if reasons and len(reasons) == len(values):
            yield Documented(next(iter(reasons.values())))

    return Subject(name, group, library, of, run, checks)
