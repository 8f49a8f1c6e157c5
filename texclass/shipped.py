"""Find definitions by name: shipped ones, a user's own, and those that other installed packages register.

The areas `texclass.haptics` and `texclass.robot`, and other packages, register what they add by entry points:

| group | name | value |
|---|---|---|
| `texclass.definitions` | any | package with `feature_defs`, `pipelines` or `datasets` |
| `texclass.features` | any | module with decorated features |
| `texclass.readers` | suffix | module with `names(path, settings)` and `read(path, wanted, settings)` |
| `texclass.dataset_formats` | `format` of a card | module with `open_models(card, root, **about)` |
| `texclass.sources` | "ros2" | module with `topic_blocks` and `AnswerPublisher` |
| `texclass.exporters` | "onnx" | module with `without_graph(feature_set)` |
| `texclass.commands` | any | module that registers commands with `texclass.cli.app.app.command()` |

    [project.entry-points."texclass.readers"]
    rec = "mine.rec_files"
"""

import importlib
import warnings
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, entry_points
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

Kind = Literal["feature_defs", "pipelines", "datasets"]


def folder(kind: Kind) -> Path:
    """Return the folder of shipped definitions: inside an installed wheel, else beside the package."""
    package = Path(__file__).resolve().parent
    inside = package / "_shipped" / kind
    return inside if inside.is_dir() else package.parent / kind


def names(kind: Kind) -> tuple[str, ...]:
    """Return the names of the definitions of a kind, sorted."""
    return tuple(sorted(_files(kind)))


def locate(kind: Kind, name_or_path: str | Path) -> Path:
    """Return the file of a known name, or the given path of a user's own TOML.

    Raises
    ------
    FileNotFoundError
        If there is neither; the message lists the shipped names.
    """
    if registered := _files(kind).get(str(name_or_path)):
        return registered
    path = Path(name_or_path).expanduser()
    if path.suffix == ".toml" and path.is_file():
        return path
    raise FileNotFoundError(
        f"{name_or_path}: no TOML file and none of the shipped {kind} ({', '.join(names(kind))})"
    )


def read(kind: Kind, name_or_path: str | Path) -> dict[str, Any]:
    """Read a definition.

    Raises
    ------
    FileNotFoundError
        If it does not exist.
    ValueError
        If it is not valid TOML; the message names the file and the place.
    """
    from texclass.validation import read_toml  # pydantic: a recording is loaded sooner without it

    return read_toml(locate(kind, name_or_path))


@cache
def entry_point_modules(group: str) -> dict[str, str]:
    """Return what packages register under texclass.<group>: name -> module."""
    _warn_unless_installed()
    return {entry.name: entry.value for entry in entry_points(group=f"texclass.{group}")}


def module_of(group: str, name: str) -> ModuleType:
    """Import the module that a package registers.

    Raises
    ------
    ImportError
        If nothing has the name, or it cannot be imported; the message names the entry point.
    """
    if name not in entry_point_modules(group):
        raise ImportError(f"no installed package registers {name!r} under texclass.{group}")
    try:
        return importlib.import_module(entry_point_modules(group)[name])
    except Exception as error:
        raise ImportError(f"{_entry_point(group, name)} ({type(error).__name__}: {error})") from error


@cache
def _warn_unless_installed() -> None:
    """Warn once where texclass runs from a folder of its sources without an installation."""
    try:
        distribution("texclass")
    except PackageNotFoundError:
        root = Path(__file__).resolve().parents[1]
        warnings.warn(
            "texclass is not installed: commands, readers and formats of its areas are missing. "
            f"Install it with `pip install -e {root}`",
            stacklevel=2,
        )


def _files(kind: Kind) -> dict[str, Path]:
    """Return the file of each name; where a package repeats one of ours, ours.

    Packages are found without importing them.
    """
    folders = []
    for name, package in entry_point_modules("definitions").items():
        found = find_spec(package)
        if found is None or not found.submodule_search_locations:
            raise ImportError(f"{_entry_point('definitions', name)} is no package")
        folders.append(Path(found.submodule_search_locations[0]) / kind)
    return {path.stem: path for one in (*folders, folder(kind)) for path in one.glob("*.toml")}


def _entry_point(group: str, name: str) -> str:
    """Return an entry point as messages show it."""
    return f"entry point texclass.{group}: {name} = {entry_point_modules(group)[name]!r}"
