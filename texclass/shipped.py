"""Find the TOML definitions that are shipped, or that other packages add; a user's own file may stand in."""

from pathlib import Path
from typing import Any, Literal

from texclass.plugins import definition_folders
from texclass.validation import read_toml

Kind = Literal["feature_defs", "pipelines", "datasets"]


def folder(kind: Kind) -> Path:
    """Return the folder of shipped definitions: inside an installed wheel, else beside the package."""
    package = Path(__file__).resolve().parent
    inside = package / "_shipped" / kind
    return inside if inside.is_dir() else package.parent / kind


def names(kind: Kind) -> tuple[str, ...]:
    """Return the names of the definitions of a kind, sorted."""
    return tuple(sorted(_files(kind)))


def _files(kind: Kind) -> dict[str, Path]:
    """Return the file of each name; where a package repeats one of ours, ours."""
    folders = [*(added / kind for added in definition_folders()), folder(kind)]
    return {path.stem: path for one in folders for path in one.glob("*.toml")}


def locate(kind: Kind, name_or_path: str | Path) -> Path:
    """Return the file of a known name, or the given path of a user's own TOML.

    Raises
    ------
    FileNotFoundError
        If there is neither; the message lists the shipped names.
    """
    if known := _files(kind).get(str(name_or_path)):
        return known
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
    return read_toml(locate(kind, name_or_path))
