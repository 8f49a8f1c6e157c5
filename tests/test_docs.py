"""Every command and snippet of the pages for users is run, in the order of the page."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from texclass.cli import main

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
BLOCK = re.compile(r"```(sh|python|toml)\n(.*?)```", re.S)


def surface_recording(frequency_hz: float, seed: int) -> np.ndarray:
    """Four seconds of a movement at 10 kHz: a ringing tool on a surface of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(40_000) / 10_000
    return rng.standard_normal(t.size) * (1 + np.sin(2 * np.pi * frequency_hz * t))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with recordings of two surfaces, and one more recording."""
    for surface, frequency_hz in (("grid", 30.0), ("mesh", 90.0)):
        (tmp_path / "recordings" / surface).mkdir(parents=True)
        for i in range(6):
            name = tmp_path / "recordings" / surface / f"{surface}_{i}.txt"
            np.savetxt(name, surface_recording(frequency_hz, seed=i), fmt="%.6g")
    np.savetxt(tmp_path / "felt.txt", surface_recording(90.0, seed=99), fmt="%.6g")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    return tmp_path


def run(command: str, monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", command.split())
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code, command


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_and_snippet_of_a_page_works(page, folder, monkeypatch):
    names: dict = {}
    for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if kind == "python":
            exec(text, names)
        elif kind == "toml":
            name = re.search(r'^name = "(.+)"', text, re.M).group(1)
            (folder / f"{name}.toml").write_text(text)
        else:
            for command in text.strip().splitlines():
                run(command, monkeypatch)


@pytest.mark.parametrize(
    ("page", "link"),
    [(p, link) for p in PAGES for link in re.findall(r"\]\(([^)#]+)", p.read_text(encoding="utf-8"))],
)
def test_every_link_of_a_page_leads_somewhere(page, link):
    assert (page.parent / link).exists()
