"""Tests of supervised processes: a crash or a hang is an outcome of one cell."""

import textwrap
from collections import Counter

import pytest

from texclass.stability import Limits, supervise
from texclass.stability.checks import Mark

SUBJECTS = """
    import os
    import time

    from texclass.stability.inputs import Case, noise
    from texclass.stability.checks import Check, Subject


    def _case(name):
        return Case(name, "plain", noise())


    def _attempt(x, case):
        print("noise on standard output")
        if case.name == "dies":
            os._exit(3)
        if case.name == "hangs":
            time.sleep(600)
        yield x.sum()
        yield Check("a number", 0.0, 0.0)


    def subjects():
        names = ("fine", "hangs", "fine again")
        stubborn = [_case("dies")] * 5
        return [
            Subject("mixed", "models", lambda quick: map(_case, names), _attempt),
            Subject("elsewhere", "filters", lambda quick: map(_case, names), _attempt),
            Subject("stubborn", "models", lambda quick: stubborn, _attempt),
        ]
"""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("work")
    (folder / "deliberate.py").write_text(textwrap.dedent(SUBJECTS), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        skipped, calls = [], []
        cells = supervise(
            "deliberate:subjects",
            "models",
            quick=True,
            limits=Limits(cell_s=0.5),
            progress=lambda *call: calls.append(call),
            skipped=skipped,
        )
    return cells, skipped, calls


def test_every_cell_has_its_mark(outcomes):
    cells, _, _ = outcomes
    marks = {cell["case"]: cell["mark"] for cell in cells if cell["subject"] == "mixed"}
    assert marks == {
        "fine": Mark.EXACT,
        "hangs": Mark.HANG,
        "fine again": Mark.EXACT,
    }
    reasons = {cell["case"]: cell["reason"] for cell in cells if cell["mark"] is not Mark.EXACT}
    assert "no answer within 0.5 s" in reasons["hangs"]


def test_a_subject_that_keeps_crashing_is_abandoned_and_reported(outcomes):
    cells, skipped, _ = outcomes
    assert Counter(cell["mark"] for cell in cells if cell["subject"] == "stubborn") == {Mark.CRASH: 3}
    assert all("ended with 3" in cell["reason"] for cell in cells if cell["subject"] == "stubborn")
    assert skipped == ["texclass stubborn: abandoned after 3 crashes or hangs"]


def test_progress_is_reported(outcomes):
    _, _, calls = outcomes
    assert calls[0] == (1, 8, "texclass models")
    assert calls[2][:2] == (3, 8)


def test_a_module_that_cannot_be_imported_is_named():
    with pytest.raises(ValueError, match="no_such_module"):
        supervise("no_such_module:subjects", "models", quick=True)
