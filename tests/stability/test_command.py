import json

import pandas as pd
import pytest

from texclass.reporting import render_markdown
from texclass.stability import Mark, StabilityResult
from texclass.stability.battery import summary


def cell(subject, family, mark, *, library="texclass", group="models", reason="", error=None, limit=None):
    names = {"library": library, "group": group, "subject": subject, "family": family}
    measured = {"error": error, "limit": limit, "what": "a check"}
    return names | {"case": f"an input of {family}", "mark": mark, "reason": reason} | measured


RIGHT = [
    cell("fit", "plain", Mark.EXACT, error=1e-15, limit=1e-9),
    cell("fit", "silent", Mark.DOCUMENTED, reason="all 0"),
    cell("hardness", "length", Mark.REFUSED, group="features", reason="too short | by far"),
]
WRONG = [
    cell("fit", "poles", Mark.WRONG, reason="a check: 2; the limit is 1", error=2.0, limit=1.0),
    cell("fit", "poles", Mark.EXACT),
]
THEIRS = [
    cell(
        "lpc", "poles", Mark.WRONG, library="librosa", group="baselines", reason="failed", error=float("inf")
    ),
    cell("lpc", "poles", Mark.HANG, library="librosa", group="baselines", reason="no answer"),
]


def result(*cells):
    table = pd.DataFrame(cells)
    facts = {"quick": True, "versions": {"texclass": "0"}, "battery": "abc", "seed": 0}
    return StabilityResult(facts | {"skipped": ["tsfel: not installed"]} | summary(table), table)


@pytest.mark.parametrize(("cells", "code"), [((*RIGHT, *THEIRS), 0), ((*RIGHT, *WRONG), 1)])
def test_exit_code_is_1_if_texclass_has_a_failure(cells, code, monkeypatch, tmp_path, command):
    monkeypatch.setattr("texclass.stability.run_stability", lambda **_: result(*cells))
    options = ["--quick", "--output", tmp_path / "out", "--json", tmp_path / "there" / "r.json"]
    exit_code, out, _ = command("stability", *options)
    assert exit_code == code
    assert {"stability.md", "stability.json"} < {p.name for p in (tmp_path / "out").iterdir()}
    written = json.loads((tmp_path / "there" / "r.json").read_text(encoding="utf-8"))
    assert written["battery"] == "abc"
    assert written == json.loads((tmp_path / "out" / "stability.json").read_text(encoding="utf-8"))
    assert "tsfel: not installed" in out
    assert ("WRONG: fit, an input of poles (poles): a check: 2; the limit is 1" in out) == bool(code)


def test_the_report_shows_texclass_and_other_libraries():
    document = result(*RIGHT, *WRONG, *THEIRS).document()
    assert document.finding.value == "1"
    assert "of 5 pairs of subject and input are wrong in texclass" in document.finding.sentence
    assert document.finding.comparison.endswith("2 of 2.")
    ours, features, libraries = (block for block in document.blocks if hasattr(block, "columns"))
    assert [shade.text for shade in ours.rows["fit"]] == ["\N{CHECK MARK}", "\N{MIDDLE DOT}", "1"]
    assert list(features.rows) == ["hardness"]
    assert [(s.text, s.colour) for s in libraries.rows["librosa: lpc"]] == [("2", "e5")]
    text = render_markdown(document)
    assert "| fit | 4 | 2 | 1 |" in text
    assert "too short \\| by far" not in text


def test_the_summary_counts_every_cell():
    data = result(*RIGHT, *WRONG, *THEIRS).data
    assert sum(tally["cells"] for tally in data["tallies"]) == 7
    fit = next(t for t in data["tallies"] if (t["subject"], t["family"]) == ("fit", "poles"))
    assert fit["marks"] == {"WRONG": 1, "exact": 1}
    assert data["tallies"][0]["worst_over_limit"] == pytest.approx(1e-6)
    assert [cell["reason"] for cell in data["reasons"]] == ["all 0", "too short | by far"]
    assert [row["mark"] for row in data["library_failures"]] == ["WRONG", "hang"]
    assert data["closest_to_limit"][0]["subject"] == "fit"
