"""Find definitions that are shipped with texclass, stored by the user, or registered by other packages.

The subpackages `texclass.haptics` and `texclass.robot`, and other packages, register extensions as entry
points:

| group | name | value |
|---|---|---|
| `texclass.definitions` | any | package with `feature_defs`, `pipelines` or `datasets` |
| `texclass.features` | any | module with decorated features |
| `texclass.readers` | suffix | module with `names(path, settings)` and `read(path, wanted, settings)` |
| `texclass.dataset_formats` | `format` of a card | module with `open_models(card, root, **attributes)` |
| `texclass.sources` | "ros2" | module with `topic_blocks`, `AnswerPublisher` and `SurfacePublisher` |
| `texclass.exporters` | "onnx" | module with `features_without_graph(feature_set)` |
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


def folder(kind: Kind | Literal["texclass_msgs"]) -> Path:
    """Return the folder of shipped definitions, in the installed package or next to it in the repository."""
    package = Path(__file__).resolve().parent
    installed = package / "_shipped" / kind
    if installed.is_dir():
        return installed
    return package.parent / ("ros2/texclass_msgs/msg" if kind == "texclass_msgs" else kind)


def leaderboard_folder() -> Path:
    """Return the folder of the published leaderboard, in the installed package or in the repository."""
    package = Path(__file__).resolve().parent
    installed = package / "_shipped" / "leaderboard"
    return installed if installed.is_dir() else package.parent / "reports" / "leaderboard"


def names(kind: Kind) -> tuple[str, ...]:
    """Return the sorted names of all definitions of a kind.

    Examples
    --------
    >>> "strese2015" in names("pipelines")
    True
    """
    return tuple(sorted(_files(kind)))


def locate(kind: Kind, name_or_path: str | Path) -> Path:
    """Return the file of a definition, given its name or the path of a TOML file.

    Raises
    ------
    FileNotFoundError
        If there is neither a definition with this name nor such a file; the message lists all names.
    """
    if shipped_file := _files(kind).get(str(name_or_path)):
        return shipped_file
    path = Path(name_or_path).expanduser()
    if path.suffix == ".toml" and path.is_file():
        return path
    raise FileNotFoundError(
        f"{name_or_path} is neither a TOML file nor one of the shipped {kind}: {', '.join(names(kind))}"
    )


def read(kind: Kind, name_or_path: str | Path) -> dict[str, Any]:
    """Read a definition.

    Raises
    ------
    FileNotFoundError
        If the definition does not exist.
    ValueError
        If the file is not valid TOML.
    """
    from texclass.validation import read_toml  # pydantic: slow import

    return read_toml(locate(kind, name_or_path))


@cache
def entry_point_modules(group: str) -> dict[str, str]:
    """Return the modules that packages register in the entry point group texclass.<group>, by name."""
    _warn_unless_installed()
    return {entry.name: entry.value for entry in entry_points(group=f"texclass.{group}")}


def module_of(group: str, name: str) -> ModuleType:
    """Import the module that a package registers under a name.

    Raises
    ------
    ImportError
        If no package registers the name, or the module cannot be imported.
    """
    if name not in entry_point_modules(group):
        raise ImportError(
            f"no installed package registers {name!r} in the entry point group texclass.{group}. Install "
            "the package that provides it"
        )
    try:
        return importlib.import_module(entry_point_modules(group)[name])
    except Exception as error:
        raise ImportError(f"{_entry_point(group, name)} ({type(error).__name__}: {error})") from error


@cache
def _warn_unless_installed() -> None:
    """Warn once if texclass runs from its source folder without an installation."""
    try:
        distribution("texclass")
    except PackageNotFoundError:
        root = Path(__file__).resolve().parents[1]
        warnings.warn(
            "texclass is not installed, so commands, readers and formats of its areas are missing. "
            f"Install it with `pip install -e {root}`",
            stacklevel=2,
        )


def _files(kind: Kind) -> dict[str, Path]:
    """Return the file of each definition. Shipped definitions take precedence; packages are not imported."""
    folders = []
    for name, package in entry_point_modules("definitions").items():
        spec = find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            raise ImportError(f"{_entry_point('definitions', name)} is not a package")
        folders.append(Path(spec.submodule_search_locations[0]) / kind)
    return {path.stem: path for root in (*folders, folder(kind)) for path in root.glob("*.toml")}


def _entry_point(group: str, name: str) -> str:
    """Describe an entry point for messages."""
    return f"entry point texclass.{group}: {name} = {entry_point_modules(group)[name]!r}"
