"""Comparison of a recomputed cell with a table."""

import pytest
from recompute_leaderboard import can_run, compared


@pytest.fixture
def cell(table):
    return table[(table["method"] == "coarse") & (table["question"] == "later")]


def test_the_same_accuracy_is_no_error(table, cell, capsys):
    assert not compared(table, cell)
    assert capsys.readouterr().out.strip().endswith(": same")


def test_another_accuracy_is_an_error(table, cell, capsys):
    assert compared(table, cell.assign(accuracy=cell["accuracy"] - 0.1))
    assert capsys.readouterr().out.strip().endswith(": DIFFERS")


def test_another_accuracy_of_other_code_is_printed(table, cell, capsys):
    assert not compared(table, cell.assign(accuracy=cell["accuracy"] - 0.1, code_hash="new"))
    assert capsys.readouterr().out.strip().endswith(": other code")


def test_methods_of_users_and_missing_libraries_are_left_out():
    assert can_run("coarse")
    assert can_run("bands")
    assert not can_run("mine")
    assert not can_run("surfaces+crest")
