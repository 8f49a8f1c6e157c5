"""Tests of the evaluation: deliberately wrong subjects are detected."""

import random
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from texclass.features.contract import Feature, Gain, UndefinedFeatureError
from texclass.features.sets import Member
from texclass.stability import checks, references
from texclass.stability.checks import Check, Mark, Subject, evaluate
from texclass.stability.inputs import LONG, Case, inputs, plain
from texclass.stability.references import NoReferenceError
from texclass.stability.subjects_features import (
    LAW_GAINS,
    check_gain_law,
    complete,
    feature_trial,
    infer_gain_laws,
)

CASE = Case("some noise", "order", plain(64).copy(), order=2)
REQUIRED = Case("plain", "plain", plain(64).copy(), order=2, required=True)


def subject(run, findings=None):
    def attempt(x, case):
        result = run(x, case)
        yield result
        yield from findings(x, case, result) if findings else [checks.finite("result", result)]

    return Subject("example", "models", lambda quick: [CASE], attempt)


def mark_of(run, findings=None, case=CASE):
    return evaluate(subject(run, findings), case)["mark"]


def raising(error):
    def run(x, case):
        raise error

    return run


@pytest.mark.parametrize(
    ("run", "mark", "reason"),
    [
        (lambda x, case: x.sum(), Mark.EXACT, ""),
        (lambda x, case: np.nan, Mark.SILENT, "failed: finite result"),
        (lambda x, case: np.negative(x, out=x), Mark.WRONG, "the input was modified"),
        (lambda x, case: 1 / 0, Mark.CRASH, "ZeroDivisionError"),
        (lambda x, case: {}[case.name], Mark.CRASH, "KeyError"),
        (lambda x, case: x @ np.ones(3), Mark.CRASH, "ValueError"),  # raised inside NumPy
        (raising(ValueError("bad")), Mark.CRASH, "ValueError: bad"),
        (raising(ValueError("64 samples. Expected 100")), Mark.REFUSED, "ValueError: 64 samples"),
        (raising(UndefinedFeatureError("silence: all are 0")), Mark.DOCUMENTED, "UndefinedFeatureError"),
    ],
)
def test_results_and_exceptions_get_a_mark_and_a_reason(run, mark, reason):
    case = replace(CASE, x=CASE.x.copy())
    cell = evaluate(subject(run), case)
    assert cell["mark"] is mark
    assert cell["reason"].startswith(reason)
    is_rejected = mark in (Mark.REFUSED, Mark.DOCUMENTED)
    assert (
        not is_rejected or mark_of(run, case=REQUIRED) is Mark.WRONG
    )  # an ordinary input must not be rejected


def test_a_wrong_number_is_detected_and_its_error_measured():
    def findings(x, case, result):
        yield checks.close("mean", result, x.mean(), 1e-12)

    cell = evaluate(subject(lambda x, case: x.mean() * (1 + 1e-6), findings), CASE)
    assert cell["mark"] is Mark.WRONG
    assert cell["error"] == pytest.approx(1e-6, rel=1e-3)
    assert cell["limit"] == 1e-12


def test_invalid_models_are_detected():
    def direct_form(x, case, a):
        yield from checks.stable_coefficients(a)

    def reflection(x, case, k):
        energy = references.lattice_energies(x, k)[-1]
        yield checks.excess_energy("Burg's optimum", energy, references.burg_energies(x, case.order)[-1])

    def frequencies(x, case, lsf):
        yield from checks.line_spectrum(np.array([0.1, 0.2]), lsf, np.array([0.1, 0.2]))

    for result, findings in (
        ([1.0, -2.5, 1.2], direct_form),  # unstable
        ([0.1, 0.1], reflection),  # more energy left than the optimum
        ([2.0, 1.0], frequencies),  # out of order
    ):
        assert mark_of(lambda x, case, result=result: np.array(result), findings) is Mark.WRONG


def test_a_reason_does_not_excuse_a_failed_check():
    def flagged(x, case, result):
        yield "order not reached"

    def flagged_and_wrong(x, case, result):
        yield "order not reached"
        yield Check("energy above the optimum", 2.0, 1.0)

    assert mark_of(lambda x, case: 0.0, flagged) is Mark.DOCUMENTED
    assert mark_of(lambda x, case: 0.0, flagged_and_wrong) is Mark.WRONG


def test_a_warning_explains_nan_and_a_floating_point_warning_is_reported():
    def undefined(x, case):
        warnings.warn("input is constant, the result is undefined", stacklevel=1)
        return np.nan

    def with_numpy_warning(x, case):
        np.log(np.zeros(1))
        return 1.0

    assert mark_of(undefined) is Mark.DOCUMENTED
    cell = evaluate(subject(with_numpy_warning), CASE)
    assert cell["mark"] is Mark.WARNED
    assert "divide by zero" in cell["reason"]


def test_without_a_reference_the_mark_is_unchecked():
    def findings(x, case, result):
        raise NoReferenceError("not checked (mpmath not installed)")
        yield

    assert mark_of(lambda x, case: 1.0, findings) is Mark.UNCHECKED


def test_reasons_contain_no_colours_and_folders():
    def reject(x, case):
        raise ValueError("\x1b[1mdefined at /home/me/lib/audio.py, 3/4 of it\x1b[0m")

    assert evaluate(subject(reject), CASE)["reason"] == "ValueError: defined at audio.py, 3/4 of it"


def test_a_result_of_another_type_is_wrong():
    def findings(x, case, result):
        yield checks.finite("mean", result["mean"])

    assert mark_of(lambda x, case: 1.0, findings) is Mark.WRONG


def test_missing_columns_and_missing_reasons_are_detected():
    usual = {"a": 1.0, "b": 2.0}

    def holds(values, reasons=()):
        findings = complete(pd.Series(values), dict(reasons), pd.Series(usual))
        return all(f.ratio_to_limit <= 1 for f in findings if isinstance(f, Check))

    assert holds({"a": 1.0, "b": 3.0})
    assert holds({"a": 1.0, "b": np.nan}, {"b": "silence"})
    assert not holds({"a": 1.0, "b": np.nan})
    assert not holds({"a": 1.0})
    assert not holds({"a": 1.0, "b": 2.0, "c": 0.0})


def test_gain_laws_are_inferred_and_violations_detected():
    def outputs(g):
        level = 1 + 2 * np.log10(g)
        return pd.Series(
            {"rms": 3 * g, "level": level, "shape": 0.5, "odd": g + g**2, "large": g > 0.1}, dtype=float
        )

    laws = infer_gain_laws([outputs(g) for g in LAW_GAINS])
    assert set(laws) == {"rms", "level", "shape"}
    assert laws["rms"] == Gain(1.0)
    assert (laws["level"].power, laws["level"].shift) == pytest.approx((0.0, 2.0))
    assert check_gain_law("law", outputs(1e-100), outputs(1.0), laws, 1e-100, 1e-9).ratio_to_limit <= 1
    wrong_outputs = outputs(1e-100)
    wrong_outputs["shape"] = 0.0
    assert check_gain_law("law", wrong_outputs, outputs(1.0), laws, 1e-100, 1e-9).ratio_to_limit > 1


def test_a_feature_that_violates_its_declaration_is_detected():
    cases = {case.name: case for case in inputs(LONG)}

    def mark(case, function, **law):
        member = Member("example", Feature("example", function, "movement", "1", "test", gain=Gain(**law)))
        subject = Subject("example", "features", lambda quick: [], feature_trial(member))
        return evaluate(subject, cases[case])["mark"]

    def largest(view):
        return view.samples.max()

    assert mark("gain 1e+30", largest, power=1) is Mark.EXACT
    assert mark("gain 1e+30", lambda view: max(largest(view), 1e10), power=1) is Mark.WRONG  # a floor
    assert mark("impulse at 0", largest) is Mark.WRONG  # declared as independent of the gain
    assert mark("plain", lambda view: random.random()) is Mark.WRONG
    assert mark("zeros", lambda view: 2.0) is Mark.WRONG
    assert mark("zeros", lambda view: np.inf) is Mark.DOCUMENTED
    assert mark("one NaN", largest) is Mark.SILENT
