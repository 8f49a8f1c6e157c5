"""SECURITY.md states the limits that the code has."""

from pathlib import Path

from texclass.experiment import allowed_estimators, trusted
from texclass.loaders import columns, filesets, text_layout, workbooks

TEXT = (Path(__file__).parents[1] / "SECURITY.md").read_text(encoding="utf-8")


def test_the_stated_limits_are_those_of_the_code():
    for stated in (
        f"{columns.MAX_VALUES:,} values in one recording",
        f"a first line of {text_layout.LONGEST_LINE:,} characters and {text_layout.MOST_COLUMNS:,} columns",
        f"expand at most {columns.MOST_EXPANSION} times, workbooks {workbooks.MOST_EXPANSION} times",
        f"may take {filesets.LONGEST_MATCH_S:g} s of CPU time",
        f"whole numbers up to {allowed_estimators.MOST_INTEGER}",
        f"{allowed_estimators.MOST_MODELS} models in nested ensembles",
        f"{allowed_estimators.MOST_WEIGHTS:,} weights between hidden layers",
        f"{allowed_estimators.MOST_NESTED} nested estimators",
        f"lists of {allowed_estimators.MOST_LISTED} members",
        f"{trusted.MOST_BYTES >> 30} GiB; a schema of {trusted.MOST_SCHEMA_BYTES >> 20} MiB",
    ):
        assert stated in TEXT, stated
