"""Every command and snippet of the pages for users is run, in the order of the page."""

import json
import re
import shutil
import sys
from glob import glob
from pathlib import Path

import numpy as np
import pytest

from texclass.cli import main
from texclass.features import load_feature
from texclass.features.contract import registered
from texclass.features.phase_view import PhaseView

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
BLOCK = re.compile(r"```(sh|python|toml)(?: (\S+))?\n(.*?)```", re.S)
"""Kind, file that the reader is to save it as (or none), text."""


def surface_recording(frequency_hz: float, seed: int) -> np.ndarray:
    """Four seconds of a movement at 10 kHz: a ringing tool on a surface of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(40_000) / 10_000
    return rng.standard_normal(t.size) * (1 + np.sin(2 * np.pi * frequency_hz * t))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with recordings of two surfaces, and one more recording."""
    place = tmp_path_factory.mktemp("recorded")
    for surface, frequency_hz in (("grid", 30.0), ("mesh", 90.0)):
        (place / "recordings" / surface).mkdir(parents=True)
        for i in range(6):
            name = place / "recordings" / surface / f"{surface}_{i}.txt"
            np.savetxt(name, surface_recording(frequency_hz, seed=i), fmt="%.6g")
    np.savetxt(place / "felt.txt", surface_recording(90.0, seed=99), fmt="%.6g")
    return place


@pytest.fixture
def folder(recorded, tmp_path, monkeypatch):
    """A copy of the folder, where a page works, and a cache of its own."""
    shutil.copytree(recorded, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    return tmp_path


def run(command: str, monkeypatch) -> None:
    words = (sorted(glob(word)) if "*" in word else [word] for word in command.split())
    monkeypatch.setattr(sys, "argv", [name for names in words for name in names])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code, command


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_and_snippet_of_a_page_works(page, folder, monkeypatch):
    monkeypatch.setattr("texclass.features.contract._REGISTRY", registered())
    names: dict = {}
    for kind, file, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if file:
            (folder / file).write_text(text)
        elif kind == "python":
            exec(text, names)
        else:
            for command in text.strip().splitlines():
                run(command, monkeypatch)


def test_the_new_feature_is_right_and_its_study_is_complete(folder, monkeypatch, capsys):
    page = (ROOT / "docs" / "new-feature.md").read_text(encoding="utf-8")
    blocks = BLOCK.findall(page)
    (folder / "crest.py").write_text(blocks[0][2])
    monkeypatch.setattr("texclass.features.contract._REGISTRY", registered())
    run(f"{blocks[1][2].strip()} --json found.json", monkeypatch)
    found = json.loads((folder / "found.json").read_text())
    assert found["rows"][-1]["name"] == "New: crest"
    paired = found["gains"]["groups"][0]["paired"]
    assert paired["test"].startswith(
        ("corrected resampled t-test", "exact McNemar test")
    )  # the latter if all folds agree
    assert paired["least"] > 0
    assert found["new_feature"]["gain_law"]["holds"]
    assert all(answer["kept"] for answer in found["new_feature"]["behaviour"])
    assert "17 of 17 answered as the contract asks" in capsys.readouterr().out
    view = PhaseView(np.sin(np.arange(10_000.0)), 1000.0)
    assert load_feature("crest.py:crest").function(view) == pytest.approx(np.sqrt(2), rel=1e-3)


@pytest.mark.parametrize(
    ("page", "link"),
    [(p, link) for p in PAGES for link in re.findall(r"\]\(([^)#]+)", p.read_text(encoding="utf-8"))],
)
def test_every_link_of_a_page_leads_somewhere(page, link):
    assert (page.parent / link).exists()
