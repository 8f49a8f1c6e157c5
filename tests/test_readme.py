import re
from pathlib import Path

import numpy as np
import pytest

from texclass.features.contract import find, registered
from texclass.features.view import PhaseView

README = Path(__file__).parents[1] / "README.md"
PYTHON = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.S)


def test_the_feature_of_the_readme_is_registered_and_right(monkeypatch):
    monkeypatch.setattr("texclass.features.contract._REGISTRY", registered())
    exec(PYTHON[0], {"__name__": "readme"})
    crest = find("crest")
    view = PhaseView(np.sin(np.arange(10_000.0)), 1000.0)
    assert crest.function(view) == pytest.approx(np.sqrt(2), rel=1e-3)
    assert crest.gain.apply(3.0, 7.0) == 3.0


def test_the_table_of_the_readme_can_be_computed(tmp_path, monkeypatch):
    (tmp_path / "my_set.toml").write_text('name = "mine"\n[features.friction]\n')
    (tmp_path / "tiny.toml").write_text(
        'title = "t"\nformat = "simulated"\n[recipe]\nn_surfaces = 2\nn_recordings = 2\nn_operators = 1\n'
        "duration_s = 4.0\nfs = 10000\nseed = 1\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXCLASS_CACHE", str(tmp_path / "cache"))
    names: dict = {}
    exec(PYTHON[1].replace('"simulated"', '"tiny.toml"').replace("n_jobs=2", "n_jobs=1"), names)
    assert names["table"].values.shape == (4, 1)


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#]+)\)", README.read_text(encoding="utf-8")))
def test_every_link_leads_somewhere(link):
    assert (README.parent / link).exists()
