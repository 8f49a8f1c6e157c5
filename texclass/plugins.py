"""What other installed packages add to texclass, by their entry points.

Under `texclass.definitions` stands a package with `feature_defs`, `pipelines` or `datasets`, known by name
as the shipped ones are. Under `texclass.features` stands a module with decorated features, and under
`texclass.readers` a suffix and the module that reads such files by `names(path, options)` and
`read(path, wanted, options)`, as `texclass.loaders.tables` does:

    [project.entry-points."texclass.readers"]
    rec = "mine.rec_files"
"""

import importlib
from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType


@cache
def added(group: str) -> dict[str, str]:
    """Return what packages say under texclass.<group>: name -> module."""
    return {entry.name: entry.value for entry in entry_points(group=f"texclass.{group}")}


def module_of(group: str, name: str) -> ModuleType:
    """Import what a package names.

    Raises
    ------
    ImportError
        If it cannot be imported; the message names the entry point.
    """
    try:
        return importlib.import_module(added(group)[name])
    except Exception as error:
        raise ImportError(f"{_said(group, name)} ({type(error).__name__}: {error})") from error


def definition_folders() -> list[Path]:
    """Return the folders of packages that add definitions, without importing them.

    Raises
    ------
    ImportError
        If there is no such package.
    """
    folders = []
    for name, package in added("definitions").items():
        found = find_spec(package)
        if found is None or not found.submodule_search_locations:
            raise ImportError(f"{_said('definitions', name)} is no package")
        folders.append(Path(found.submodule_search_locations[0]))
    return folders


def _said(group: str, name: str) -> str:
    return f"entry point texclass.{group}: {name} = {added(group)[name]!r}"
