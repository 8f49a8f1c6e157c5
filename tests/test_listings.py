"""Lists of features and datasets fit the terminal and can be filtered."""

import pytest

from texclass.features import load_feature_set
from texclass.features.contract import list_features


def words(text):
    return "".join(text.split())


@pytest.mark.parametrize("width", [40, 80, 120])
@pytest.mark.parametrize(
    "arguments", [("features",), ("features", "strese2015"), ("datasets",)], ids=" ".join
)
def test_no_line_is_longer_than_the_terminal_and_nothing_is_cut(command, monkeypatch, width, arguments):
    monkeypatch.setenv("COLUMNS", str(width))
    code, out, _ = command(*arguments)
    assert code == 0
    assert max(map(len, out.splitlines())) <= width
    monkeypatch.setenv("COLUMNS", "1000")
    wide = command(*arguments)[1]
    assert sorted(words(out.replace("─", ""))) == sorted(words(wide.replace("─", "")))


def test_features_are_listed_with_phase_columns_unit_summary_and_reference(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "300")
    out = command("features")[1]
    for name, feature in list_features().items():
        for text in (name, feature.phase, feature.unit, feature.summary, feature.reference):
            assert text in out
    assert out.startswith(f"All features\n{len(list_features())} features.")


def test_features_are_filtered_by_set_and_phase(command):
    def listed(*arguments):
        code, out, err = command("features", *arguments)
        assert code == 0, err
        return {line.split()[0] for line in out.splitlines() if line.split()[:1]} & set(list_features())

    members = load_feature_set("texclass").members
    taps = {one.name for one in members if one.feature.phase == "tap"}
    assert listed("texclass", "--phase", "tap") == listed("--set", "texclass", "--phase", "tap") == taps
    assert 0 < len(taps) < len(members)
    both = listed("coarse", "--set", "strese2015")
    assert both == listed("coarse") | listed("strese2015")
    assert "No feature is computed from the phase 'tap'" in command("features", "coarse", "--phase", "tap")[1]


def test_an_unknown_set_or_phase_lists_the_valid_names(command):
    code, _, err = command("features", "--set", "nosuch")
    assert (code, "strese2015" in err, "texclass" in err) == (1, True, True)
    code, _, err = command("features", "--phase", "nosuch")
    assert (code, "'tap'" in err, "'friction'" in err) == (2, True, True)
