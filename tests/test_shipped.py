"""Definitions, features and readers by name, shipped or registered by an installed package."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import texclass as tx
from texclass import shipped
from texclass.features import contract, find_feature
from texclass.loaders import read_card

PACKAGE = Path(__file__).parent / "added_package"


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Put the package on the path, with the metadata that an installer would write."""
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]

    def install(groups):
        metadata = tmp_path / "texclass_toy-0.1.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
        entry_points = (
            f"[{group}]\n{name} = {of}\n" for group, names in groups.items() for name, of in names.items()
        )
        (metadata / "entry_points.txt").write_text("".join(entry_points))
        shipped.entry_point_modules.cache_clear()

    monkeypatch.setattr(contract, "_REGISTRY", contract.list_features())
    for place in (tmp_path, PACKAGE):
        monkeypatch.syspath_prepend(place)
    install.groups = project["entry-points"]
    yield install
    shipped.entry_point_modules.cache_clear()
    for name in [name for name in sys.modules if name.startswith("texclass_toy")]:
        del sys.modules[name]


def test_extensions_of_a_package_are_found_by_name(installed, tmp_path):
    installed(installed.groups)
    assert "toy" in shipped.names("feature_defs")
    assert find_feature("toy_crest").reference == "an example"
    x = np.random.default_rng(0).normal(size=(2, 1000))
    for surface, samples in zip(("oak", "pine"), x, strict=True):
        (tmp_path / "own" / surface).mkdir(parents=True)
        (tmp_path / "own" / surface / "a.toy").write_text("\n".join(["500", *map(str, samples)]))
    dataset = tx.open_dataset(tmp_path / "own", unit="m/s^2")
    assert [recording.fs for recording in dataset] == [500.0, 500.0]
    table = tx.extract(dataset, "toy")
    assert list(table.columns) == ["toy_crest"]
    assert np.isfinite(table.to_numpy()).all()


def test_a_command_that_a_package_adds_is_listed_and_runs(installed, tmp_path):
    installed(installed.groups)
    (tmp_path / "a.toy").write_text("500\n1\n-3\n1\n1\n")
    places = os.pathsep.join(map(str, (tmp_path, PACKAGE, *sys.path)))

    def texclass(*words):
        run = [sys.executable, "-m", "texclass", *words]
        return subprocess.run(
            run,
            env=os.environ | {"PYTHONPATH": places},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )

    assert "Print the crest factor of a recording." in texclass("--help").stdout
    done = texclass("crest", "a.toy", "--unit", "g")
    assert (done.stdout, done.stderr) == ("1.732\n", "")


def test_a_command_that_cannot_be_imported_is_named_and_the_others_run(installed, tmp_path):
    installed({"texclass.commands": {"toy": "nowhere_at_all"}})
    run = [sys.executable, "-m", "texclass", "--help"]
    places = os.pathsep.join(map(str, (tmp_path, *sys.path)))
    done = subprocess.run(
        run, env=os.environ | {"PYTHONPATH": places}, capture_output=True, text=True, check=True
    )
    assert "warning: entry point texclass.commands: toy = 'nowhere_at_all'" in done.stderr
    assert "benchmark" in done.stdout


@pytest.mark.parametrize(
    ("group", "use"),
    [
        ("features", lambda: find_feature("crest")),
        ("definitions", lambda: shipped.names("datasets")),
        ("readers", lambda: tx.load_recording(__file__, unit="g")),
    ],
)
def test_a_package_that_cannot_be_imported_is_named(installed, group, use):
    installed({f"texclass.{group}": {"py": "nowhere_at_all"}})
    with pytest.raises(ImportError, match=f"entry point texclass.{group}: py = 'nowhere_at_all'"):
        use()


def test_every_shipped_card_is_valid_and_names_its_source():
    promised = {"simulated", "simulated6", "simulated69", "biotac20", "taps5", "borealtc", "lmt_excerpts"}
    assert promised <= set(shipped.names("datasets"))
    for name in shipped.names("datasets"):
        card = read_card(name)
        assert card.name == name
        assert card.title
        assert card.source
        assert card.licence


def test_a_shipped_definition_takes_precedence_over_one_of_a_package(installed, tmp_path):
    (tmp_path / "repeats" / "datasets").mkdir(parents=True)
    (tmp_path / "repeats" / "__init__.py").touch()
    (tmp_path / "repeats" / "datasets" / "simulated.toml").touch()
    installed({"texclass.definitions": {"again": "repeats"}})
    assert shipped.locate("datasets", "simulated") == shipped.folder("datasets") / "simulated.toml"


def test_the_path_of_an_own_definition_is_returned(tmp_path):
    own = tmp_path / "mine.toml"
    own.write_text("title = 'mine'")
    assert shipped.locate("datasets", own) == own
    assert shipped.read("datasets", str(own)) == {"title": "mine"}


def test_an_unknown_name_is_an_error_that_lists_the_shipped_names():
    for name in ("nothing", "../datasets/simulated", "./simulated"):
        with pytest.raises(FileNotFoundError, match="simulated69"):
            shipped.locate("datasets", name)


def test_an_unregistered_name_is_an_import_error_with_its_group():
    with pytest.raises(
        ImportError, match=r"no installed package registers 'dds' in the entry point group texclass\.sources"
    ):
        shipped.module_of("sources", "dds")
