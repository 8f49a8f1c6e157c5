"""SECURITY.md states the limits that the code has."""

from pathlib import Path

import pytest

from texclass.evaluation import allowed_estimators, trusted
from texclass.loaders import filesets, readers, text_layout

TEXT = (Path(__file__).parents[1] / "SECURITY.md").read_text(encoding="utf-8")


def test_the_stated_limits_are_those_of_the_code():
    for stated in (
        f"{readers.MAX_VALUES:,} values in one recording",
        f"a first line of {text_layout.LONGEST_LINE:,} characters and {text_layout.MOST_COLUMNS:,} columns",
        f"expand at most {readers.MOST_EXPANSION} times",
        f"may take {filesets.LONGEST_MATCH_S:g} s of CPU time",
        f"whole numbers up to {allowed_estimators.LIMITS.integer}",
        f"{allowed_estimators.LIMITS.models} models in nested ensembles",
        f"{allowed_estimators.LIMITS.weights:,} weights between hidden layers",
        f"{allowed_estimators.LIMITS.nesting} nested estimators",
        f"lists of {allowed_estimators.LIMITS.members} members",
        f"{trusted.MOST_BYTES >> 30} GiB; a schema of {trusted.MOST_SCHEMA_BYTES >> 20} MiB",
    ):
        assert stated in TEXT, stated


def test_the_stated_limits_of_workbooks_are_those_of_the_code():
    pytest.importorskip("openpyxl", reason="the extra `formats` is not installed")
    from texclass.loaders import workbooks

    stated = (
        f"workbooks {workbooks.MOST_EXPANSION} times (or to 64 MB)",
        f"a sheet has {workbooks.MOST_ROWS:,} rows and {workbooks.MOST_CELLS:,} cells",
    )
    assert [text for text in stated if text not in TEXT] == []
