"""A small part of the battery on all subjects of texclass and on scipy."""

import builtins
from dataclasses import replace

import pytest

from texclass.baselines import extreme_inputs
from texclass.features import list_features
from texclass.stability import inputs, subjects_features, subjects_models, subjects_signals
from texclass.stability.checks import FAILURES, Check, Mark, evaluate
from texclass.stability.subjects_models import model_cases

ALL_SUBJECTS = [*subjects_models.SUBJECTS, *subjects_signals.SUBJECTS, *subjects_features.subjects()]
SUBJECTS = {subject.name: subject for subject in ALL_SUBJECTS}
CASE_NAMES = (
    "plain", "zeros", "constant -1e6", "pure sine", "DC 1e6 + noise 1e-3", "gain 1e-160", "int8",
    "every third sample", "one NaN", "3 samples", "all k = 0.9",
)  # fmt: skip


@pytest.mark.parametrize("name", SUBJECTS)
def test_subject_is_correct_or_gives_a_reason(name):
    subject = SUBJECTS[name]
    cases = [case for case in subject.cases(True) if case.order <= 18]
    selected = [case for case in cases if case.name.split(", p =")[0] in CASE_NAMES]
    cells = [evaluate(subject, case) for case in selected or list(subject.cases(True))[:2]]
    assert [cell for cell in cells if cell["mark"] in (*FAILURES, Mark.WARNED)] == []
    assert any(cell["mark"] in (Mark.EXACT, Mark.DOCUMENTED, Mark.REFUSED) for cell in cells)


def test_all_features_and_groups_are_tested_under_unique_names():
    assert set(list_features()) < set(SUBJECTS)
    assert len(SUBJECTS) == len(ALL_SUBJECTS)
    assert {subject.group for subject in SUBJECTS.values()} == {"models", "filters", "transforms", "features"}


def test_without_mpmath_nothing_fails_and_missing_checks_are_reported(monkeypatch):
    original_import = builtins.__import__

    def absent(name, *rest):
        if name == "mpmath":
            raise ImportError(name)
        return original_import(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    cell = evaluate(SUBJECTS["zero phase, lowpass"], inputs.cases_of("plain")[0])
    assert (cell["mark"], cell["reason"]) == (Mark.EXACT, "not checked (mpmath not installed)")


def test_other_libraries_are_evaluated_by_the_same_rules():
    case = next(case for case in model_cases(True, 18) if case.name == "low-passed by 20, p = 18")
    ours, (fit, synthesis, *_) = SUBJECTS["lattice synthesis"], extreme_inputs.scipy()
    for subject, mark in ((ours, Mark.EXACT), (synthesis, Mark.WRONG)):
        descriptions = [finding.what for finding in subject.trial(case.x, case) if isinstance(finding, Check)]
        assert "synthesis, against 60 digits" in descriptions
        assert evaluate(subject, case)["mark"] is mark
    plain = replace(inputs.cases_of("plain")[0].at_order(2), required=True)
    assert evaluate(fit, plain)["mark"] is Mark.EXACT


def test_libraries_that_are_not_tested_are_reported(monkeypatch):
    monkeypatch.setattr(extreme_inputs, "LIBRARIES", ("librosa", "pandas", "no_such_library"))
    places, skipped = extreme_inputs.installed(quick=True)
    assert places == {"librosa": "texclass.baselines.extreme_inputs:librosa"}
    assert skipped == ["no_such_library: not installed", "pandas: not in a quick run"]


@pytest.mark.parametrize(
    ("name", "case_name"),
    [("moving_average", "ramp, p = 3"), ("moving_average", "ramp, p = 100")]
    + [("shared, mean_spectrum", f"fs {fs} Hz") for fs in (2000, 4000)],
)
def test_running_sums_and_spectra_up_to_half_the_rate_are_correct(name, case_name):
    (case,) = (case for case in SUBJECTS[name].cases(False) if case.name == case_name)
    assert evaluate(SUBJECTS[name], case)["mark"] is Mark.EXACT
