import json
import sys

import abdulali2016
import oeztuerk2018
import pytest
import shared


@pytest.mark.parametrize("paper", [abdulali2016, oeztuerk2018])
def test_a_chapter_states_which_parts_are_simulated_or_skipped(paper, tmp_path, monkeypatch, capsys):
    out = tmp_path / "new"
    monkeypatch.setattr(sys, "argv", [paper.KEY, "--out", str(out), "--seed", "1", "--small"])
    paper.main()
    text = (out / f"{paper.KEY}.md").read_text(encoding="utf-8")
    assert "simulated" in text
    assert shared.ABSENT in text
    figures = [path for path in out.iterdir() if path.suffix == ".png"]
    assert len(figures) >= 4
    assert all(f"]({figure.name})" in text for figure in figures)
    numbers = json.loads((out / f"{paper.KEY}.json").read_text(encoding="utf-8"))
    assert numbers["seed"] == 1
    assert {"texclass", "numpy", "scipy"} <= set(numbers["versions"])
    assert f"wrote {out / paper.KEY}.md" in capsys.readouterr().out
