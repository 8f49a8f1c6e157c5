"""A small part of the battery, on every subject of texclass and on scipy."""

import builtins
from dataclasses import replace

import pytest

from texclass.baselines import extreme_inputs
from texclass.features import list_features
from texclass.stability import inputs, subjects_features, subjects_models, subjects_signals
from texclass.stability.rules import BAD, Check, Mark, judge
from texclass.stability.subjects_models import models

EVERY = [*subjects_models.SUBJECTS, *subjects_signals.SUBJECTS, *subjects_features.subjects()]
SUBJECTS = {subject.name: subject for subject in EVERY}
HARD = (
    "plain", "zeros", "constant -1e6", "pure sine", "DC 1e6 + noise 1e-3", "gain 1e-160", "int8",
    "every third sample", "one NaN", "3 samples", "all k = 0.9",
)  # fmt: skip


@pytest.mark.parametrize("name", SUBJECTS)
def test_it_is_right_or_says_why_not(name):
    subject = SUBJECTS[name]
    cases = [case for case in subject.cases(True) if case.order <= 18]
    hard = [case for case in cases if case.name.split(", p =")[0] in HARD]
    cells = [judge(subject, case) for case in hard or list(subject.cases(True))[:2]]
    assert [cell for cell in cells if cell["mark"] in (*BAD, Mark.WARNED)] == []
    assert any(cell["mark"] in (Mark.EXACT, Mark.DOCUMENTED, Mark.REFUSED) for cell in cells)


def test_every_registered_feature_and_every_group_is_tried_under_a_name_of_its_own():
    assert set(list_features()) < set(SUBJECTS)
    assert len(SUBJECTS) == len(EVERY)
    assert {subject.group for subject in SUBJECTS.values()} == {"models", "filters", "transforms", "features"}


def test_without_mpmath_nothing_is_wrong_and_what_was_not_checked_is_said(monkeypatch):
    find = builtins.__import__

    def absent(name, *rest):
        if name == "mpmath":
            raise ImportError(name)
        return find(name, *rest)

    monkeypatch.setattr(builtins, "__import__", absent)
    cell = judge(SUBJECTS["zero phase, lowpass"], inputs.in_families("plain")[0])
    assert (cell["mark"], cell["reason"]) == (Mark.EXACT, "not checked (mpmath not installed)")


def test_public_libraries_are_judged_by_the_rule_that_ours_are_and_fail_where_they_are_known_to():
    case = next(case for case in models(True, 18) if case.name == "low-passed by 20, p = 18")
    ours, (fit, synthesis, *_) = SUBJECTS["lattice synthesis"], extreme_inputs.scipy()
    for subject, mark in ((ours, Mark.EXACT), (synthesis, Mark.WRONG)):
        told = [found.what for found in subject.trial(case.x, case) if isinstance(found, Check)]
        assert "synthesis, against 60 digits" in told
        assert judge(subject, case)["mark"] is mark
    plain = replace(inputs.in_families("plain")[0].at_order(2), required=True)
    assert judge(fit, plain)["mark"] is Mark.EXACT


def test_what_is_not_tried_is_said(monkeypatch):
    monkeypatch.setattr(extreme_inputs, "LIBRARIES", ("librosa", "pandas", "no_such_library"))
    places, left_out = extreme_inputs.installed(quick=True)
    assert places == {"librosa": "texclass.baselines.extreme_inputs:librosa"}
    assert left_out == ["no_such_library: not installed", "pandas: not in a quick run"]
