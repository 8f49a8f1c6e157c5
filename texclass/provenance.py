"""Versions of libraries, and hashes of the code that computed a result."""

import ast
import hashlib
import platform
import sys
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from texclass import __version__

_PACKAGE = Path(__file__).resolve().parent
_INDEPENDENT = {"cli", "front_door", "provenance", "reporting", "_version"}
"""Subpackages and modules that do not affect results."""


def versions(*libraries: str) -> dict[str, str]:
    """Return the versions of texclass, Python and the given distributions ("not installed" if missing)."""
    result = {"texclass": __version__, "python": platform.python_version()}
    for name in libraries:
        try:
            result[name] = version(name)
        except PackageNotFoundError:
            result[name] = "not installed"
    return result


def code_provenance(*places: str) -> dict[str, Any]:
    """Return the subpackages and modules that computed a result, and the hash of their code.

    Parameters
    ----------
    *places : str
        Subpackages and modules, as in `code_hash`. Comments and docstrings do not change the hash.
    """
    return {"code_of": sorted(places), "code_hash": code_hash(*places, words=False)}


def loaded_places() -> set[str]:
    """Return the imported subpackages and modules of texclass that can affect results."""
    loaded = {name.split(".")[1] for name in sys.modules if name.startswith("texclass.")}
    return loaded - _INDEPENDENT


def code_hash(*places: str, files: Iterable[Path] = (), words: bool = True) -> str:
    """Return a hash of code, which shows whether the code has changed since a result was computed.

    Parameters
    ----------
    *places : str
        Subpackages ("phases": all its modules and tables) and top-level modules ("signals") of texclass.
    files : iterable of Path, optional
        Further source files; for a missing file, only the name is hashed.
    words : bool
        Include comments, docstrings and report modules, which do not change results (default True).

    Returns
    -------
    str
        Hash of 16 hexadecimal digits.

    Raises
    ------
    ValueError
        If a place does not exist.

    Examples
    --------
    >>> len(code_hash("phases", "signals"))
    16
    """
    sources = set(files)
    for place in places:
        package = _PACKAGE / place
        modules = set(package.rglob("*.py")) if package.is_dir() else {package.with_suffix(".py")}
        if not modules or not all(module.is_file() for module in modules):
            raise ValueError(
                f"texclass has no {place!r}. Expected the name of a subpackage or top-level module"
            )
        sources |= modules | set(package.rglob("*.csv"))
    digest = hashlib.sha256()
    for file in sorted(sources, key=lambda f: (f.name, str(f))):
        source = file.read_bytes() if file.is_file() else b""
        if not words and file.name.endswith("_document.py"):
            continue
        is_whole = words or file.suffix != ".py"
        digest.update(file.name.encode() + (source if is_whole else _strip_docstrings(source)))
    return digest.hexdigest()[:16]


@cache
def _strip_docstrings(source: bytes) -> bytes:
    tree = ast.parse(source)
    nodes: list[Any] = [tree]
    for node in nodes:  # only statements contain docstrings
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            docstrings = (
                s for s in node.body if isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant)
            )
            for statement in docstrings:
                statement.value = ast.Constant("")
        for block in ("body", "orelse", "handlers", "finalbody", "cases"):
            nodes += getattr(node, block, ())
    return ast.unparse(tree).encode()
