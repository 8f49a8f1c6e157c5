"""Subjects of the battery: each registered feature, and all features together, tested like a library."""

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
from texclass.stability import checks
from texclass.stability.checks import Check, Findings, Subject, Trial, largest
from texclass.stability.inputs import LONG, Case, battery, noise, plain, to_float64

LAW_GAINS = (1e-6, 1e-3, 1.0, 1e3, 1e6)
"""Gains from which the gain law of an output is inferred if its library declares no gain law."""
cases = partial(battery, n=LONG)
"""Inputs of features."""
Extract = Callable[[Any, Case], tuple[dict[str, Any], dict[str, str]]]
"""Function that takes samples and case, and returns outputs by name and the reasons for undefined outputs."""


def subjects() -> list[Subject]:
    """Return one subject for each registered feature, and one for all features together."""
    members = tuple(Member(name, feature) for name, feature in list_features().items())
    all_features = FeatureSet("all", members).with_phases("tap", "movement", "travel", "friction")

    def extract(x: Any, case: Case) -> tuple[dict[str, Any], dict[str, str]]:
        values, reasons = all_features.compute(make_views(x, case.fs))
        by_feature = dict(reasons)
        by_column = {c: by_feature[m.name] for m in members if m.name in by_feature for c in m.columns}
        return dict(zip(all_features.column_names, values.tolist(), strict=True)), by_column

    def none_required(quick: bool) -> list[Case]:
        return [replace(case, required=False) for case in cases(quick)]

    special_cases = {"ridge_density": none_required}  # ordinary noise has no ridges
    single = [
        Subject(m.name, "features", special_cases.get(m.name, cases), feature_trial(m)) for m in members
    ]
    return [*single, Subject("all features", "features", cases, library_trial(extract))]


def make_views(x: Any, fs: float, phase: Phase = "movement") -> Views:
    """Return views of the samples as movement, friction and taps.

    There are four taps if the input has at least `LONG` samples, otherwise one. The impact is after a quarter
    of each tap. The speed of the movement is 1 m/s. A pair consists of the samples and the reversed samples.
    """
    if phase == "pair":
        first, second = make_views(x, fs), make_views(x[::-1], fs)
        return replace(first, sides=(first, second))
    n = len(x)
    size = n // 4 if n >= LONG else n
    taps = tuple(Tap(i, i + min(size // 4, size - 1), i + size) for i in range(0, n - size + 1, max(size, 1)))
    phases = Phases(taps if n else (), (0, n))
    return Views(Recording(x, fs=fs, friction=x, speed=np.full(n, 1000.0), phases=phases), phases)


def feature_trial(member: Member) -> Trial:
    """Return the trial of one feature: the checks of `library_trial`, and comparisons with references."""
    feature = member.feature

    def extract(x: Any, case: Case) -> tuple[dict[str, Any], dict[str, str]]:
        if case.family == "broken":  # `Recording` rejects such samples
            view = view_without_recording(feature.phase, to_float64(x), case.fs)
            values = np.atleast_1d(np.asarray(feature.function(view), dtype=np.float64))
        else:
            values = member.values(make_views(x, case.fs, feature.phase))
        return dict(zip(member.columns, values.tolist(), strict=True)), {}

    trial = library_trial(extract, dict.fromkeys(member.columns, feature.gain))

    def attempt(x: Any, case: Case) -> Findings:
        values = yield from trial(x, case)
        signal = to_float64(x)
        yield checks.condition("no value for silence", np.any(signal))
        yield from _check_references(feature.name, signal, values.tolist())

    return attempt


def _check_references(name: str, signal: Samples, values: list[float]) -> Findings:
    """Check the features for which references of high precision exist."""
    wide = signal.astype(np.longdouble)
    match name:
        case "friction":
            right = math.fsum(np.abs(signal)) / signal.size
            yield checks.close("mean |x|, against exact sums", values[0], right, 1e-13)
        case "mean_magnitude":
            right = float(np.abs(wide - wide.mean()).mean())
            yield checks.close("mean |x - mean|", values[0], right, 1e-13, scale=1e-4 * largest(signal))
        case "variance":
            square = float(wide.var())
            if 1e-290 < square < 1e290:
                rounding = (1e-13 * largest(signal)) ** 2 / square  # rounding caused by an offset
                yield checks.close("variance, in 80-bit floats", values[0], square, 1e-13 + rounding)
        case "lpc_coefficients":
            yield from checks.stable_coefficients(np.append(1.0, -np.array(values)))


def library_trial(extract: Extract, laws: Mapping[Any, Gain] | None = None) -> Trial:
    """Return a trial that checks all outputs of a feature library.

    Parameters
    ----------
    extract : callable
        Function under test, which returns outputs and reasons.
    laws : mapping of str to Gain, optional
        Declared gain law of each output (default: inferred by `infer_gain_laws`).

    Returns
    -------
    callable
        Generator function that yields findings and returns the output values.
    """
    # Our features are computed in single precision. Other libraries use the precision of the input.
    limit, copy_limit = (1e-4, 1e-4) if laws is None else (1e-5, 0.0)

    def numbers(x: Any, case: Case) -> pd.Series:
        try:
            return to_series(extract(x, case)[0])
        except UndefinedFeatureError:
            return pd.Series(np.nan, index=pd.Index(list(laws or ())))

    @cache
    def noise_outputs(gain: float, fs: float) -> pd.Series:
        return numbers(gain * plain(LONG), Case("plain", "plain", plain(LONG), fs=fs))

    def attempt(x: Any, case: Case) -> Findings:
        outputs, reasons = extract(x, case)
        yield outputs
        values, expected, signal = to_series(outputs), noise_outputs(1.0, case.fs), to_float64(x)
        yield from complete(values, reasons, expected)
        # Other families are excluded. Symmetric signals are sensitive to small changes. With a large offset,
        # 1e-13 of the samples is a large change relative to the vibration.
        if case.family in ("plain", "poles", "oversampled", "gain", "rate"):
            changed = numbers(signal * (1 + 1e-13 * noise(signal.size, 6)), case)
            yield same_values("change when samples change by 1e-13", changed, values, 1e-3, expected)
        if case.family in ("dtype", "layout"):
            yield same_values("as of the float64 copy", values, numbers(signal, case), copy_limit)
        if laws is not None:
            # Multiplying by 1.1 rounds every sample: by 1e-10 at an offset of 1e6, or 1e-7 of the noise.
            louder, tolerance = numbers(1.1 * signal, case), 1e-3 if case.family == "offset" else limit
            yield checks.condition("a value at gain 1.1", np.isfinite(louder).all())
            # Outputs of one feature share a scale, because rounding may turn an output of 0 into 1e-17.
            shared = 1e-7 * louder.abs().max()
            yield check_gain_law(
                "the declared gain law, at gain 1.1", louder, values, laws, 1.1, tolerance, shared
            )
        if case.family == "gain" and laws is not None:
            what, shared = "the declared gain law, from gain 1", 1e-7 * values.abs().max()
            yield check_gain_law(what, values, expected, laws, case.gain, limit, shared)
        elif case.family == "gain":
            inferred = infer_gain_laws([noise_outputs(gain, case.fs) for gain in LAW_GAINS])
            what = "the gain law it follows from 1e-6 to 1e6"
            yield check_gain_law(what, values, expected, inferred, case.gain, limit)
        if reasons and len(reasons) == len(values):
            yield next(iter(reasons.values()))
        return values

    return attempt


def to_series(outputs: dict[str, Any]) -> pd.Series:
    """Convert outputs to floats; NaN if an output is not a number."""
    return pd.to_numeric(pd.Series(outputs), errors="coerce").astype(np.float64)


def complete(values: pd.Series, reasons: Mapping[str, str], expected: pd.Series) -> Findings:
    """Check that the outputs have the same names as for plain noise, and are finite or have a reason."""
    n_differ = values.index.symmetric_difference(expected.index).size
    yield Check(f"as many columns as for noise ({n_differ} differ)", float(n_differ), 0.0)
    unexplained = values.index[~np.isfinite(values)].difference(list(reasons), sort=False)
    silent = [name for name in unexplained if np.isfinite(expected.get(name, 0.0))]
    first = f", {', '.join(silent[:3])}" if silent else ""
    what = f"finite outputs, or a reason: {len(silent)} of {len(values)} NaN without a reason{first}"
    yield checks.condition(what, not silent)
    if reasons:
        yield f"{len(reasons)} of {len(values)}: {next(iter(reasons.values()))}"


def same_values(
    what: str, values: pd.Series, reference: pd.Series, limit: float, scale: pd.Series | None = None
) -> Check:
    """Check the largest relative difference between outputs that are finite in both series.

    `scale` is a minimum for the size to which differences are relative.
    """
    table = pd.concat({"value": values, "reference": reference, "scale": scale}, axis=1)
    table = table[np.isfinite(table["value"]) & np.isfinite(table["reference"])]
    size = table.abs().replace(np.inf, 0.0).max(axis=1)
    return _worst(what, (table["value"] - table["reference"]).abs() / size, limit)


def infer_gain_laws(outputs: Sequence[pd.Series]) -> dict[Any, Gain]:
    """Return a gain law for each output that follows it for noise at all `LAW_GAINS`."""
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


def check_gain_law(
    what: str,
    values: pd.Series,
    reference: pd.Series,
    laws: Mapping[Any, Gain],
    gain: float,
    limit: float,
    min_size: float | None = None,
) -> Check:
    """Check that outputs follow their gain laws. Values outside the range of float64 are ignored.

    Errors are relative to the expected output, or to `min_size` if it is larger (default: the shift of the
    gain law).
    """
    errors = {}
    for name, law in laws.items():
        exponent = law.power * np.log10(gain) + np.log10(abs(reference[name])) if reference[name] else 0.0
        if np.isfinite(value := values.get(name, np.nan)) and abs(exponent) <= 290:
            expected = float(law.apply(reference[name], gain))
            small = abs(law.shift * np.log10(gain)) if min_size is None else min_size
            errors[name] = abs(value - expected) / max(abs(expected), small, 1e-300)
    return _worst(what, pd.Series(errors, dtype=float), limit)


def _worst(what: str, errors: pd.Series, limit: float) -> Check:
    """Check the largest error of several outputs, and name the output if the error exceeds the limit."""
    worst = float(errors.fillna(0.0).max()) if len(errors) else 0.0
    return Check(f"{what} ({errors.idxmax()})" if worst > limit else what, worst, limit)
