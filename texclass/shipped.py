"""Find the TOML definitions shipped with texclass, and let a user's own file stand in for any of them."""

from pathlib import Path
from typing import Any, Literal

from texclass.validation import read_toml

Kind = Literal["feature_defs", "pipelines", "datasets"]


def folder(kind: Kind) -> Path:
    """Return the folder of shipped definitions: inside an installed wheel, else beside the package."""
    package = Path(__file__).resolve().parent
    inside = package / "_shipped" / kind
    return inside if inside.is_dir() else package.parent / kind


def names(kind: Kind) -> tuple[str, ...]:
    """Return the names of the shipped definitions of a kind, sorted."""
    return tuple(sorted(path.stem for path in folder(kind).glob("*.toml")))


def locate(kind: Kind, name_or_path: str | Path) -> Path:
    """Return the file of a shipped name, or the given path of a user's own TOML.

    Raises
    ------
    FileNotFoundError
        If there is neither; the message lists the shipped names.
    """
    shipped = folder(kind) / f"{name_or_path}.toml"
    if shipped.is_file() and Path(name_or_path).name == str(name_or_path):
        return shipped
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
