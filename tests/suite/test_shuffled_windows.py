"""Claims of the study on shuffled windows, and of the pages that name it."""

import json
from pathlib import Path

import pytest

STUDY = Path(__file__).parents[2] / "reports" / "studies" / "shuffled_windows.json"


@pytest.fixture(scope="module")
def leakage():
    """Return the leakage of each dataset, by classifier, in datasets with and without similar windows."""
    study = json.loads(STUDY.read_text(encoding="utf-8"))
    ratio = {line["dataset"]: line["same_run"] / line["by_chance"] for line in study["neighbours"]}
    return {
        is_similar: [line for line in study["lines"] if (ratio[line["dataset"]] > 2) == is_similar]
        for is_similar in (True, False)
    }


def test_shuffled_windows_add_much_where_windows_of_a_recording_are_similar(leakage):
    assert {line["dataset"] for line in leakage[True]} == {"borealtc", "simulated"}
    assert all(line["low"] > 0.03 and line["leakage"] >= 0.049 for line in leakage[True])


def test_shuffled_windows_add_little_elsewhere(leakage):
    assert {line["dataset"] for line in leakage[False]} == {"dogsurf", "floors10", "biotac20"}
    small = [line for line in leakage[False] if line["leakage"] < 0.01]
    assert len(small) == 8  # all but the random forest on dogsurf
