"""A feature that the user names: from an importable module, or from a file."""

import hashlib
import importlib
import importlib.util
import inspect
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from texclass.features.contract import Feature, registered

PREFIX = "texclass_own_"
"""Begins the name of every module loaded from a file, so that no file shadows an installed module."""


@dataclass(frozen=True)
class FileFeature(Feature):
    """A feature from a file, which no worker process can import by name: it travels as its path.

    Attributes
    ----------
    named
        "path:function", with an absolute path.
    """

    named: str = ""

    def __reduce__(self) -> tuple[Any, ...]:
        return load_feature, (self.named,)


def load_feature(named: str) -> Feature:
    """Import the feature that a user names. This runs the code of its module.

    Parameters
    ----------
    named : str
        "module:function" with an importable module, or "path/to/file.py:function".

    Returns
    -------
    Feature
        Ready for a `Member` of a feature set, in worker processes too.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the name has another form, the module cannot be imported, or the function is not a decorated
        feature whose parameters have defaults.
    """
    place, _, name = named.rpartition(":")
    if not place or not name.isidentifier():
        raise ValueError(f"feature {named!r}: the rule is module:function or path/to/file.py:function")
    path = Path(place).expanduser().resolve() if place.endswith(".py") else None
    try:
        module = importlib.import_module(place) if path is None else _module_of(path)
    except OSError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"feature {named!r}: {place} cannot be imported ({reason})") from error
    function = getattr(module, name, None)
    feature = next((f for f in registered().values() if f.function is function), None)
    if feature is None:
        what = "is not decorated" if callable(function) else "is not a function of it"
        raise ValueError(f"feature {named!r}: {name} {what}; the rule is a function under @feature(...)")
    if bare := [key for key, value in feature.defaults.items() if value is inspect.Parameter.empty]:
        raise ValueError(f"feature {named!r}: parameter {bare[0]!r} has no default; the rule is one each")
    return feature if path is None else FileFeature(**vars(feature), named=f"{path}:{name}")


def _module_of(path: Path) -> ModuleType:
    """Run a file as a module, once for each content; what lies beside it can be imported by it."""
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    name = PREFIX + path.stem
    known = sys.modules.get(name)
    if known is not None and (known.__file__, known.__dict__.get("digest_")) == (str(path), digest):
        return known
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is no Python source")
    module = importlib.util.module_from_spec(spec)
    module.__dict__["digest_"] = digest
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
