"""A package that adds a feature, a set and a reader of files, as if it were installed."""

import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import texclass as tx
from texclass import shipped
from texclass.features import contract, find

PACKAGE = Path(__file__).parent / "added_package"


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Put the package on the path, with the metadata that an installer would write."""
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]

    def install(groups):
        metadata = tmp_path / "texclass_toy-0.1.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
        said = (
            f"[{group}]\n{name} = {of}\n" for group, names in groups.items() for name, of in names.items()
        )
        (metadata / "entry_points.txt").write_text("".join(said))
        shipped.added.cache_clear()

    monkeypatch.setattr(contract, "_REGISTRY", contract.registered())
    for place in (tmp_path, PACKAGE):
        monkeypatch.syspath_prepend(place)
    install.groups = project["entry-points"]
    yield install
    shipped.added.cache_clear()
    for name in [name for name in sys.modules if name.startswith("texclass_toy")]:
        del sys.modules[name]


def test_what_a_package_adds_is_known_by_name(installed, tmp_path):
    installed(installed.groups)
    assert "toy" in shipped.names("feature_defs")
    assert find("toy_crest").reference == "an example"
    x = np.random.default_rng(0).normal(size=(2, 1000))
    for material, samples in zip(("oak", "pine"), x, strict=True):
        (tmp_path / "felt" / material).mkdir(parents=True)
        (tmp_path / "felt" / material / "a.toy").write_text("\n".join(["500", *map(str, samples)]))
    dataset = tx.open_dataset(tmp_path / "felt", unit="m/s^2")
    assert [recording.fs for recording in dataset] == [500.0, 500.0]
    table = tx.extract(dataset, "toy")
    assert list(table.columns) == ["toy_crest"]
    assert np.isfinite(table.to_numpy()).all()


@pytest.mark.parametrize(
    ("group", "asked"),
    [
        ("features", lambda: find("crest")),
        ("definitions", lambda: shipped.names("datasets")),
        ("readers", lambda: tx.load_recording(__file__, unit="g")),
    ],
)
def test_a_package_that_cannot_be_imported_is_named(installed, group, asked):
    installed({f"texclass.{group}": {"py": "nowhere_at_all"}})
    with pytest.raises(ImportError, match=f"entry point texclass.{group}: py = 'nowhere_at_all'"):
        asked()
