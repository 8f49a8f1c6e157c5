import json

import pytest

from texclass.reporting.reproductions import oeztuerk2018
from texclass.textures.oeztuerk2018 import prediction
from texclass.textures.oeztuerk2018 import study as speed_study


@pytest.fixture
def short(monkeypatch):
    """No real recordings, little of what is simulated, no pictures (`texclass reproduce` draws them)."""
    for chapter in (oeztuerk2018,):
        monkeypatch.setattr(chapter, "_real", lambda *_: ({}, ""))
        monkeypatch.setattr(chapter.figures, "draw", lambda *_: [])
    monkeypatch.setattr(speed_study, "N_SURFACES", 1)
    monkeypatch.setattr(speed_study, "N_PATHS", 2)
    monkeypatch.setattr(prediction, "N_DRAWS", 1)


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("chapter", [oeztuerk2018])
def test_a_report_says_what_is_simulated_and_what_was_skipped(chapter, tmp_path):
    paths = chapter.reproduce(tmp_path / "new", seed=1)
    assert all(path.stat().st_size > 0 for path in paths)
    text = paths[0].read_text(encoding="utf-8")
    assert "simulated" in text
    assert "Skipped: the recordings are not on this machine" in text
    numbers = json.loads(paths[1].read_text(encoding="utf-8"))
    assert (numbers["seed"], numbers["input_hash"]) == (1, {})
    assert {"texclass", "numpy", "scipy"} <= set(numbers["versions"])
