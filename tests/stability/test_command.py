import json

import pytest
from typer.testing import CliRunner

from texclass.cli import app
from texclass.reporting.stability import stability_markdown, stability_table, wrong_lines
from texclass.reporting.stability_figure import draw_stability
from texclass.stability import Cell, Mark, StabilityResult


def cell(subject, family, mark, *, library="texclass", group="models", reason="", error=None, limit=None):
    return Cell(
        library, group, subject, family, f"an input of {family}", mark, error, limit, "a check", reason
    )


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
    cell("lpc", "poles", Mark.WRONG, library="librosa", group="peers", reason="not so", error=float("inf")),
    cell("lpc", "poles", Mark.HANG, library="librosa", group="peers", reason="no answer"),
]


def result(*cells):
    return StabilityResult(
        tuple(cells), True, {"texclass": "0"}, "abc", 1.0, left_out=("tsfel: not installed",)
    )


@pytest.mark.parametrize(("cells", "code"), [((*RIGHT, *THEIRS), 0), ((*RIGHT, *WRONG), 1)])
def test_exit_code_is_1_if_one_of_ours_is_wrong(cells, code, monkeypatch, tmp_path):
    monkeypatch.setattr("texclass.stability.run_stability", lambda **_: result(*cells))
    options = ["--quick", "--out", str(tmp_path / "out"), "--json", str(tmp_path / "there" / "r.json")]
    done = CliRunner().invoke(app, ["stability", *options])
    assert done.exit_code == code
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        f"stability.{kind}" for kind in ("md", "json", "png")
    }
    found = json.loads((tmp_path / "there" / "r.json").read_text(encoding="utf-8"))
    assert found["battery"] == "abc"
    assert found == json.loads((tmp_path / "out" / "stability.json").read_text(encoding="utf-8"))
    assert "left out: tsfel" in done.stdout
    if code:
        assert "WRONG: fit, an input of poles (poles): a check: 2; the limit is 1" in done.stdout


def test_the_report_shows_both_sides_by_one_legend():
    text = stability_markdown(result(*RIGHT, *WRONG, *THEIRS))
    assert "**texclass: 1 of 5 cells wrong. Public libraries: 2 of 2.**" in text
    assert "| fit | ✓ | . | ✗1/2 |" in text
    assert "| **librosa** lpc | ✗1/2 ∞1/2 |" in text
    assert "- WRONG: fit, an input of poles" in text
    assert "tsfel: not installed" in text


def test_every_row_of_every_table_has_as_many_cells_as_its_header():
    blocks = stability_markdown(result(*RIGHT, *WRONG, *THEIRS)).split("\n\n")
    tables = [block.splitlines() for block in blocks if block.startswith("|")]
    assert len(tables) >= 5
    for lines in tables:
        assert len({line.replace("\\|", "").count("|") for line in lines}) == 1


def test_the_picture_counts_what_is_wrong_and_names_every_subject():
    (axes,) = draw_stability(result(*RIGHT, *WRONG, *THEIRS)).axes
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["fit", "hardness", "librosa: lpc"]


def test_nothing_wrong_is_said_so():
    assert "None: no wrong cell" in stability_markdown(result(*RIGHT))
    assert wrong_lines(result(*RIGHT)) == []


def test_the_table_counts_each_kind():
    table = stability_table(result(*RIGHT, *WRONG, *THEIRS))
    columns = [column.header for column in table.columns]
    assert columns == ["subject", "exact", "documented", "error", "WRONG"]
    rows = list(zip(*(list(column.cells) for column in table.columns), strict=True))
    assert rows[0] == ("fit", "2", "1", "", "1")
    assert rows[-1] == ("librosa: lpc", "", "", "", "2")
