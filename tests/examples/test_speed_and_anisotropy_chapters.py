import json
import sys

import abdulali2016
import oeztuerk2018
import pytest
import shared


@pytest.mark.parametrize("paper", [abdulali2016, oeztuerk2018])
def test_a_chapter_says_what_is_simulated_and_what_was_skipped(paper, tmp_path, monkeypatch, capsys):
    out = tmp_path / "new"
    monkeypatch.setattr(sys, "argv", [paper.KEY, "--out", str(out), "--seed", "1", "--small"])
    paper.main()
    text = (out / f"{paper.KEY}.md").read_text(encoding="utf-8")
    assert "simulated" in text
    assert shared.ABSENT in text
    pictures = [name for name in out.iterdir() if name.suffix == ".png"]
    assert len(pictures) >= 4
    assert all(f"]({picture.name})" in text for picture in pictures)
    numbers = json.loads((out / f"{paper.KEY}.json").read_text(encoding="utf-8"))
    assert numbers["seed"] == 1
    assert {"texclass", "numpy", "scipy"} <= set(numbers["versions"])
    assert f"wrote {out / paper.KEY}.md" in capsys.readouterr().out
