"""The battery can fail: deliberately wrong subjects are found out."""

import random
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from texclass.features.contract import Feature, Gain, UndefinedFeatureError
from texclass.features.sets import Member
from texclass.stability import exact, rules
from texclass.stability.exact import NoReferenceError
from texclass.stability.inputs import LONG, Case, inputs, plain
from texclass.stability.rules import Check, Mark, Subject, judge
from texclass.stability.subjects_features import LAW_GAINS, complete, inferred_laws, one_feature, under_gain

CASE = Case("some noise", "order", plain(64).copy(), order=2)
REQUIRED = Case("plain", "plain", plain(64).copy(), order=2, required=True)


def subject(run, checks=None):
    def attempt(x, case):
        result = run(x, case)
        yield result
        yield from checks(x, case, result) if checks else [rules.finite("result", result)]

    return Subject("tried", "models", lambda quick: [CASE], attempt)


def mark_of(run, checks=None, case=CASE):
    return judge(subject(run, checks), case)["mark"]


def raising(error):
    def run(x, case):
        raise error

    return run


@pytest.mark.parametrize(
    ("run", "mark", "reason"),
    [
        (lambda x, case: x.sum(), Mark.EXACT, ""),
        (lambda x, case: np.nan, Mark.SILENT, "not so: finite result"),
        (lambda x, case: np.negative(x, out=x), Mark.WRONG, "the input was written to"),
        (lambda x, case: 1 / 0, Mark.CRASH, "ZeroDivisionError"),
        (lambda x, case: {}[case.name], Mark.CRASH, "KeyError"),
        (lambda x, case: x @ np.ones(3), Mark.CRASH, "ValueError"),  # NumPy's own, from within
        (raising(ValueError("bad")), Mark.CRASH, "ValueError: bad"),
        (raising(ValueError("64 samples. Expected 100")), Mark.REFUSED, "ValueError: 64 samples"),
        (raising(UndefinedFeatureError("silence: all are 0")), Mark.DOCUMENTED, "UndefinedFeatureError"),
    ],
)
def test_a_result_or_an_exception_gets_its_mark_and_a_reason(run, mark, reason):
    case = replace(CASE, x=CASE.x.copy())
    cell = judge(subject(run), case)
    assert cell["mark"] is mark
    assert cell["reason"].startswith(reason)
    refused = mark in (Mark.REFUSED, Mark.DOCUMENTED)
    assert not refused or mark_of(run, case=REQUIRED) is Mark.WRONG  # nobody may refuse an ordinary input


def test_a_wrong_number_is_found_and_the_error_measured():
    def checks(x, case, result):
        yield rules.close("mean", result, x.mean(), 1e-12)

    cell = judge(subject(lambda x, case: x.mean() * (1 + 1e-6), checks), CASE)
    assert cell["mark"] is Mark.WRONG
    assert cell["error"] == pytest.approx(1e-6, rel=1e-3)
    assert cell["limit"] == 1e-12


def test_models_that_break_a_rule_are_found():
    def direct_form(x, case, a):
        yield from rules.stable_coefficients(a)

    def reflection(x, case, k):
        energy = exact.lattice_energies(x, k)[-1]
        yield rules.excess("Burg's optimum", energy, exact.burg_energies(x, case.order)[-1])

    def frequencies(x, case, lsf):
        yield from rules.line_spectrum(np.array([0.1, 0.2]), lsf, np.array([0.1, 0.2]))

    for result, checks in (
        ([1.0, -2.5, 1.2], direct_form),  # unstable
        ([0.1, 0.1], reflection),  # more energy left than the optimum
        ([2.0, 1.0], frequencies),  # out of order
    ):
        assert mark_of(lambda x, case, result=result: np.array(result), checks) is Mark.WRONG


def test_a_flag_explains_but_does_not_excuse_a_failed_check():
    def flagged(x, case, result):
        yield "order not reached"

    def flagged_and_wrong(x, case, result):
        yield "order not reached"
        yield Check("energy above the optimum", 2.0, 1.0)

    assert mark_of(lambda x, case: 0.0, flagged) is Mark.DOCUMENTED
    assert mark_of(lambda x, case: 0.0, flagged_and_wrong) is Mark.WRONG


def test_a_warning_explains_a_nan_and_of_floating_point_is_a_finding_even_if_the_result_is_right():
    def undefined(x, case):
        warnings.warn("input is constant, the result is undefined", stacklevel=1)
        return np.nan

    def noisy(x, case):
        np.log(np.zeros(1))
        return 1.0

    assert mark_of(undefined) is Mark.DOCUMENTED
    cell = judge(subject(noisy), CASE)
    assert cell["mark"] is Mark.WARNED
    assert "divide by zero" in cell["reason"]


def test_a_reference_that_cannot_be_had_is_not_checked():
    def checks(x, case, result):
        raise NoReferenceError("not checked (mpmath not installed)")
        yield

    assert mark_of(lambda x, case: 1.0, checks) is Mark.UNCHECKED


def test_a_reason_holds_no_colours_and_no_folders():
    def refuse(x, case):
        raise ValueError("\x1b[1mdefined at /home/me/lib/audio.py, 3/4 of it\x1b[0m")

    assert judge(subject(refuse), CASE)["reason"] == "ValueError: defined at audio.py, 3/4 of it"


def test_a_result_of_another_form_is_wrong():
    def checks(x, case, result):
        yield rules.finite("mean", result["mean"])

    assert mark_of(lambda x, case: 1.0, checks) is Mark.WRONG


def test_a_feature_without_a_reason_or_a_column_is_found():
    usual = {"a": 1.0, "b": 2.0}

    def holds(values, reasons=()):
        found = complete(pd.Series(values), dict(reasons), pd.Series(usual))
        return all(f.excess <= 1 for f in found if isinstance(f, Check))

    assert holds({"a": 1.0, "b": 3.0})
    assert holds({"a": 1.0, "b": np.nan}, {"b": "silence"})
    assert not holds({"a": 1.0, "b": np.nan})
    assert not holds({"a": 1.0})
    assert not holds({"a": 1.0, "b": 2.0, "c": 0.0})


def test_a_gain_law_is_inferred_and_its_breach_found():
    def outputs(g):
        level = 1 + 2 * np.log10(g)
        return pd.Series(
            {"rms": 3 * g, "level": level, "shape": 0.5, "odd": g + g**2, "large": g > 0.1}, dtype=float
        )

    laws = inferred_laws([outputs(g) for g in LAW_GAINS])
    assert set(laws) == {"rms", "level", "shape"}
    assert laws["rms"] == Gain(1.0)
    assert (laws["level"].power, laws["level"].shift) == pytest.approx((0.0, 2.0))
    assert under_gain("law", outputs(1e-100), outputs(1.0), laws, 1e-100, 1e-9).excess <= 1
    lost = outputs(1e-100)
    lost["shape"] = 0.0
    assert under_gain("law", lost, outputs(1.0), laws, 1e-100, 1e-9).excess > 1


def test_a_feature_of_ours_that_breaks_what_it_declares_is_found():
    cases = {case.name: case for case in inputs(LONG)}

    def mark(case, function, **law):
        made = Member("made", Feature("made", function, "movement", "1", "test", gain=Gain(**law)))
        subject = Subject("made", "features", lambda quick: [], one_feature(made))
        return judge(subject, cases[case])["mark"]

    def largest(view):
        return view.samples.max()

    assert mark("gain 1e+30", largest, power=1) is Mark.EXACT
    assert mark("gain 1e+30", lambda view: max(largest(view), 1e10), power=1) is Mark.WRONG  # a floor
    assert mark("impulse at 0", largest) is Mark.WRONG  # declared to be free of gain
    assert mark("plain", lambda view: random.random()) is Mark.WRONG
    assert mark("zeros", lambda view: 2.0) is Mark.WRONG
    assert mark("zeros", lambda view: np.inf) is Mark.DOCUMENTED
    assert mark("one NaN", largest) is Mark.SILENT
