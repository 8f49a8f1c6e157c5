"""Versions of libraries, and hashes of the code that results depend on."""

import ast
import hashlib
import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from texclass import __version__

_PACKAGE = Path(__file__).resolve().parent


def versions(*libraries: str) -> dict[str, str]:
    """Return the versions of texclass, Python and these distributions; "not installed" if one is absent."""
    found = {"texclass": __version__, "python": platform.python_version()}
    for name in libraries:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def code_provenance(*places: str) -> dict[str, Any]:
    """Return the subpackages and modules that made a result, and the hash of their code without words.

    Parameters
    ----------
    *places : str
        As in `code_hash`.
    """
    return {"code_of": sorted(places), "code_hash": code_hash(*places, words=False)}


def code_hash(*places: str, files: Iterable[Path] = (), words: bool = True) -> str:
    """Return a digest of code, by which results of other code are recognised.

    Parameters
    ----------
    *places : str
        Subpackages ("phases": every module and table in it) and top-level modules ("signals") of texclass.
    files : iterable of Path, optional
        More source files; one that is absent counts by its name.
    words : bool
        False leaves out comments, docstrings and the modules that put results into words, which change no
        result.

    Returns
    -------
    str
        16 hexadecimal digits.

    Raises
    ------
    ValueError
        If a place does not exist, which would otherwise drop out of the digest unnoticed.
    """
    found = set(files)
    for place in places:
        package = _PACKAGE / place
        modules = set(package.rglob("*.py")) if package.is_dir() else {package.with_suffix(".py")}
        if not modules or not all(module.is_file() for module in modules):
            raise ValueError(f"texclass contains no {place!r}. Expected a subpackage or a top-level module")
        found |= modules | set(package.rglob("*.csv"))
    digest = hashlib.sha256()
    for file in sorted(found, key=lambda f: (f.name, str(f))):
        source = file.read_bytes() if file.is_file() else b""
        if not words and file.name.endswith("_document.py"):
            continue
        as_is = words or file.suffix != ".py"
        digest.update(file.name.encode() + (source if as_is else _without_words(source)))
    return digest.hexdigest()[:16]


@cache
def _without_words(source: bytes) -> bytes:
    tree = ast.parse(source)
    nodes: list[Any] = [tree]
    for node in nodes:  # statements alone: no expression holds a docstring
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            docstrings = (
                s for s in node.body if isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant)
            )
            for statement in docstrings:
                statement.value = ast.Constant("")
        for inside in ("body", "orelse", "handlers", "finalbody", "cases"):
            nodes += getattr(node, inside, ())
    return ast.unparse(tree).encode()
