import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from texclass.cli import main
from texclass.features.contract import find, registered
from texclass.features.view import PhaseView

README = Path(__file__).parents[1] / "README.md"
TEXT = README.read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", TEXT, flags=re.S)
TINY = (
    'title = "t"\nformat = "simulated"\n[recipe]\nn_surfaces = 2\nn_recordings = 2\nn_operators = 1\n'
    "duration_s = 4.0\nfs = 10000\nseed = 1\n"
)


def test_the_feature_of_the_readme_is_registered_and_right(monkeypatch):
    monkeypatch.setattr("texclass.features.contract._REGISTRY", registered())
    exec(PYTHON[0], {"__name__": "readme"})
    crest = find("crest")
    view = PhaseView(np.sin(np.arange(10_000.0)), 1000.0)
    assert crest.function(view) == pytest.approx(np.sqrt(2), rel=1e-3)
    assert crest.gain.apply(3.0, 7.0) == 3.0


PIPELINE = """
features = "strese2015"
seed = 1
[protocol]
folds = 2
[[steps]]
use = "sklearn.impute.SimpleImputer"
keep_empty_features = true
[classifiers.naive_bayes]
use = "sklearn.naive_bayes.GaussianNB"
[[rows]]
name = "Variance"
features = ["variance"]
[gain]
repeats = 2
"""


def test_the_feature_of_the_readme_is_put_against_the_table(tmp_path, monkeypatch, capsys):
    (tmp_path / "crest.py").write_text(PYTHON[0])
    (tmp_path / "small.toml").write_text(PIPELINE)
    (tmp_path / "tiny.toml").write_text(TINY)
    command = next(c for c in re.findall(r"^texclass (.*?)(?: +#.*)?$", TEXT, re.M) if "--feature" in c)
    command = command.replace("simulated", "tiny.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("texclass.features.contract._REGISTRY", registered())
    # Two processes: the workers never import crest.py by name.
    arguments = f"{command} --pipeline small.toml --jobs 2 --json found.json"
    monkeypatch.setattr(sys, "argv", ["texclass", *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    found = json.loads((tmp_path / "found.json").read_text())
    assert [row["name"] for row in found["rows"]] == ["Variance", "New: crest"]
    assert found["gains"]["groups"][0]["paired"]["test"].startswith("corrected resampled t-test")
    assert found["new_feature"]["gain_law"]["holds"]
    assert all(answer["kept"] for answer in found["new_feature"]["behaviour"])
    assert "17 of 17 answered as the contract asks" in capsys.readouterr().out


def test_the_table_of_the_readme_can_be_computed(tmp_path, monkeypatch):
    (tmp_path / "my_set.toml").write_text('name = "mine"\n[features.friction]\n')
    (tmp_path / "tiny.toml").write_text(TINY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    names: dict = {}
    exec(PYTHON[1].replace('"simulated"', '"tiny.toml"').replace("n_jobs=2", "n_jobs=1"), names)
    assert names["table"].values.shape == (4, 1)


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#]+)\)", README.read_text(encoding="utf-8")))
def test_every_link_leads_somewhere(link):
    assert (README.parent / link).exists()
