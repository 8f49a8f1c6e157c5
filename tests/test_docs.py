"""Every command and snippet of README and pages is run, in order, in an empty folder; docstrings are, too."""

import doctest
import importlib
import json
import re
import shlex
import sys
from functools import cache
from glob import glob
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from every_command import PROGRAM

import texclass
from texclass.cli import main
from texclass.features import load_feature
from texclass.features.contract import list_features
from texclass.features.phase_view import PhaseView
from texclass.haptics.scene import pages
from texclass.simulate.recipe import Recipe
from texclass.tradeoff import trade_off

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NEW_FEATURE = ROOT / "docs" / "evaluate-feature.md"
BLOCK = re.compile(r"```(sh|python|toml|csv|text output)(?: (\S+))?\n(.*?)```", re.S)
"""Kind, file that the reader is to save it as (or none), text."""
BLOCK_OF_ANY_KIND = re.compile(r"^```.*?^```", re.S | re.M)


@pytest.fixture(autouse=True, scope="module")
def _once():
    """Simulate each recording of `texclass sample` once for all pages, repeat no cross-validation, and hold
    one value a slider."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Recipe, "record", cache(Recipe.record))
        patch.setitem(trade_off.__kwdefaults__, "n_repeats", 1)
        patch.setattr(pages, "SLIDER_VALUES", (7.0,))
        yield


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder, where a page works; what it computes of recordings that another has, too, is kept."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(command: str, monkeypatch) -> None:
    words = (sorted(glob(w)) if "*" in w else [w] for w in shlex.split(command, comments=True))
    monkeypatch.setattr(sys, "argv", [name for names in words for name in names])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code, command


def normalized(text: str) -> str:
    """Return text without the rules of tables, and with single spaces."""
    return " ".join(text.replace("─", " ").split())


def follow(page, folder, monkeypatch, capsys) -> str:
    """Save the files of a page, run its commands and snippets, and check the output that it shows.

    Return the output of the last commands. Where a page shows "...", the output may vary.
    """
    monkeypatch.setenv("COLUMNS", "110")
    printed = of_commands = ""
    monkeypatch.setattr("texclass.features.contract._REGISTRY", list_features())
    names: dict = {}
    for kind, file, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if file:
            (folder / file).write_text(text)
        elif kind == "python":
            exec(text, names)
            printed = normalized("".join(capsys.readouterr())) or printed
        elif kind == "text output":
            for part in text.split("..."):
                assert normalized(part) in printed, page
        else:
            for command in text.strip().splitlines():
                if "pip install" not in command:
                    run(command, monkeypatch)
            printed = of_commands = normalized("".join(capsys.readouterr()))
    return of_commands


@pytest.mark.parametrize("page", [page for page in PAGES if page != NEW_FEATURE], ids=lambda page: page.stem)
def test_every_command_and_snippet_of_a_page_works(page, folder, monkeypatch, capsys):
    if page.stem == "ros":  # its bags
        from bag_writer import write_drives, write_touches

        write_drives(folder / "drives")
        write_touches(folder / "touches")
    follow(page, folder, monkeypatch, capsys)


def test_the_page_of_the_new_feature_works_and_its_study_is_complete(folder, monkeypatch, capsys):
    printed = follow(NEW_FEATURE, folder, monkeypatch, capsys)
    (file,) = folder.glob("reports/*-feature.json")
    found = json.loads(file.read_text())
    assert found["rows"][-1]["name"] == "New: crest"
    comparison = found["ablation"]["groups"][0]["comparison"]
    # The latter if all folds agree.
    assert comparison["test"].startswith(("corrected resampled t-test", "exact McNemar test"))
    assert comparison["minimum_detectable"] > 0
    assert found["new_feature"]["gain_law"]["holds"]
    assert all(answer["is_valid"] for answer in found["new_feature"]["degenerate_inputs"])
    assert "17 of 17 results meet the feature contract" in printed
    view = PhaseView(np.sin(np.arange(10_000.0)), 1000.0)
    assert load_feature("crest.py:crest").function(view) == pytest.approx(np.sqrt(2), rel=1e-3)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_link_of_a_page_leads_somewhere(page):
    links = re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8"))
    assert not [link for link in links if not (page.parent / link).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_that_a_page_names_exists(page):
    prose = BLOCK_OF_ANY_KIND.sub("", page.read_text(encoding="utf-8"))
    named = [words.split() for words in re.findall(r"`([^`\n]+)`", prose) if not words.startswith("python ")]
    commands = {words[1] for words in named if words[0] == "texclass" and len(words) > 1}
    assert {name for name in commands if not name.startswith("--")} <= set(PROGRAM.commands)


PACKAGE = Path(texclass.__file__).parent
WITH_EXAMPLES = sorted(
    ".".join(("texclass", *file.relative_to(PACKAGE).with_suffix("").parts))
    for file in PACKAGE.rglob("*.py")
    if ">>>" in file.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("module", WITH_EXAMPLES)
def test_every_example_of_a_module_gives_what_it_says(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert (
        doctest.testmod(importlib.import_module(module), optionflags=doctest.NORMALIZE_WHITESPACE).failed == 0
    )


def test_the_guide_states_the_measured_traffic_of_a_cluster():
    study = json.loads((ROOT / "reports/studies/cluster.json").read_text(encoding="utf-8"))
    runs = pd.DataFrame(study["runs"])
    moved, caller = (runs.pivot_table(what, "n", "way") for what in ("moved_mb", "caller_mb"))
    text = " ".join((ROOT / "docs/classify.md").read_text(encoding="utf-8").split())
    assert "partitions of 100 recordings move a fifth of the bytes" in text
    assert moved.partitions[5000] / moved.table[5000] == pytest.approx(1 / 5, abs=0.05)
    assert caller.partitions[5000] < 1.05 * caller.partitions[500]
