"""What a release says in several places agrees."""

import re
import tomllib
from pathlib import Path

import pytest

from texclass import __version__

ROOT = Path(__file__).parents[1]
yaml = pytest.importorskip("yaml")  # pre-commit brings it
RECIPE = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_version_is_one():
    released = re.search(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    cited = re.search(r"version = \{(.*)\}", (ROOT / "docs" / "cite.md").read_text(encoding="utf-8"))
    assert released[1] == CITATION["version"] == RECIPE["context"]["version"] == __version__ == cited[1]


def test_conda_installs_what_pip_does():
    named = {"soundfile": "pysoundfile", "matplotlib": "matplotlib-base"}
    needed = {f"python{PROJECT['requires-python']}"}
    for needs in PROJECT["dependencies"]:
        name, rule = re.fullmatch(r"([\w-]+)(.*)", needs).groups()
        needed.add(named.get(name, name.lower()) + rule)
    assert {needs.replace(" ", "") for needs in RECIPE["requirements"]["run"]} == needed
