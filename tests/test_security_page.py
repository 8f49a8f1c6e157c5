"""SECURITY.md states the limits that the code has."""

from pathlib import Path

import pytest

from texclass.evaluation import allowed_estimators, skops_archive
from texclass.loaders import filesets, readers, text_layout

TEXT = (Path(__file__).parents[1] / "SECURITY.md").read_text(encoding="utf-8")


def test_the_documented_limits_equal_those_of_the_code():
    for limit in (
        f"{readers.MAX_VALUES:,} values in one recording",
        f"a first line of {text_layout.MAX_LINE:,} characters and {text_layout.MAX_COLUMNS:,} columns",
        f"expand at most {readers.MAX_EXPANSION} times",
        f"may take {filesets.MATCH_TIMEOUT_S:g} s of CPU time",
        f"integers up to {allowed_estimators.LIMITS.integer}",
        f"{allowed_estimators.LIMITS.models} models in nested ensembles",
        f"{allowed_estimators.LIMITS.weights:,} weights between hidden layers",
        f"{allowed_estimators.LIMITS.nesting} nested estimators",
        f"lists of at most {allowed_estimators.LIMITS.members} items",
        f"{skops_archive.MAX_BYTES >> 30} GiB; a schema of {skops_archive.MAX_SCHEMA_BYTES >> 20} MiB",
    ):
        assert limit in TEXT, limit


def test_the_documented_limits_of_workbooks_equal_those_of_the_code():
    pytest.importorskip("openpyxl", reason="the extra `formats` is not installed")
    from texclass.loaders import workbooks

    limits = (
        f"workbooks {workbooks.MAX_EXPANSION} times (or to 64 MB)",
        f"a sheet has {workbooks.MAX_ROWS:,} rows and {workbooks.MAX_CELLS:,} cells",
    )
    assert [text for text in limits if text not in TEXT] == []
