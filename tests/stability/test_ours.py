"""A small part of the battery, on every subject of texclass and on librosa and scipy."""

from dataclasses import replace

import pytest

from texclass.stability import (
    exact,
    peers_models,
    signals,
    subjects_autoregression,
    subjects_features,
    subjects_filters,
    subjects_fits,
    subjects_modes,
    subjects_transforms,
)
from texclass.stability.verdict import BAD, Mark, judge

OURS = (
    subjects_fits,
    subjects_autoregression,
    subjects_modes,
    subjects_filters,
    subjects_transforms,
    subjects_features,
)
SUBJECTS = [subject for module in OURS for subject in module.subjects()]
HARD = ("plain", "zeros", "gain 1e-160", "int8", "one NaN", "3 samples")


def small_part(subject, names=HARD):
    cases = [case for case in subject.cases(True) if case.order <= 18]
    return [case for case in cases if case.name.split(", p =")[0] in names]


@pytest.mark.parametrize("subject", SUBJECTS, ids=lambda s: s.name)
def test_it_is_right_or_says_why_not(subject):
    cells = [judge(subject, case) for case in small_part(subject) or list(subject.cases(True))[:2]]
    assert [cell for cell in cells if cell.mark in (*BAD, Mark.WARNED)] == []
    assert any(cell.mark in (Mark.EXACT, Mark.DOCUMENTED, Mark.REFUSED) for cell in cells)


def test_names_of_subjects_are_unique():
    assert len({subject.name for subject in SUBJECTS}) == len(SUBJECTS)


def test_every_registered_feature_is_tried():
    from texclass.features import registered

    assert set(registered()) <= {subject.name for subject in subjects_features.subjects()}


def test_without_mpmath_nothing_is_wrong_and_what_was_not_checked_is_said(monkeypatch):
    monkeypatch.setattr(exact, "available", lambda: False)
    subject = next(s for s in subjects_filters.subjects() if s.name == "zero phase, lowpass")
    cell = judge(subject, signals.in_families("plain")[0])
    assert cell.mark is Mark.EXACT
    assert cell.reason == "not checked (mpmath not installed)"


def test_public_libraries_fail_where_they_are_known_to():
    burg = next(s for s in peers_models.librosa() if s.name.startswith("lpc"))
    by_name = {case.name: case.at_order(2) for case in signals.inputs()}
    assert judge(burg, by_name["plain"]).mark is Mark.EXACT
    assert judge(burg, by_name["constant -1e6"]).mark is Mark.WRONG  # |k| = 1


def test_the_rule_is_the_same_for_both_sides():
    ours = next(s for s in subjects_fits.subjects() if s.name == "fit, burg")
    theirs = next(s for s in peers_models.librosa() if s.name.startswith("lpc"))
    case = replace(signals.in_families("plain")[0].at_order(10), required=True)
    what = {judge(subject, case).what for subject in (ours, theirs)}
    assert what & {"residual energy above Burg's optimum", "every |k| below 1 (stable)"}
