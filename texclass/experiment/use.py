"""What a TOML may name with `use`: an estimator class of scikit-learn or texclass, and its arguments."""

import importlib
import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

from sklearn.base import BaseEstimator, is_classifier

from texclass.features.sets import refuse_unknown

ALLOWED = ("sklearn", "texclass")
"""Packages whose classes a TOML may name; nothing else is ever imported."""

TESTS = frozenset({"tests", "conftest"})
"""Modules of scikit-learn that run for long when they are imported."""


@dataclass(frozen=True)
class Use:
    """One scikit-learn object of a TOML: the class it names and the arguments of its constructor."""

    path: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def make(self) -> Any:
        """Return a new, unfitted object."""
        return resolve(self.path)(**self.parameters)


def resolve(path: str) -> type[BaseEstimator]:
    """Return the scikit-learn estimator class of a dotted path into sklearn or texclass.

    Raises
    ------
    ValueError
        If the path leads anywhere else, or to something that is not an estimator.
    """
    parts = path.split(".")
    named = all(part.isidentifier() for part in parts) and TESTS.isdisjoint(parts)
    if parts[0] not in ALLOWED or len(parts) < 3 or not named:
        raise ValueError(f"use = {path!r} is refused; the rule is a class of sklearn or texclass")
    try:
        found = getattr(importlib.import_module(".".join(parts[:-1])), parts[-1])
    except (ImportError, AttributeError) as error:
        raise ValueError(f"use = {path!r} does not exist ({error})") from None
    own = inspect.isclass(found) and found.__module__.split(".")[0] in ALLOWED
    if not own or not issubclass(found, BaseEstimator) or inspect.isabstract(found):
        raise ValueError(f"use = {path!r} is refused; the rule is a scikit-learn estimator class")
    return cast(type[BaseEstimator], found)


def read_use(table: Any, where: str, *, classifier: bool = False) -> Use:
    """Return the object that a TOML table with a key `use` names.

    Raises
    ------
    ValueError
        If it may not be named, does not exist, or is not what is asked for; the message begins with `where`.
    """
    if not isinstance(table, dict) or not isinstance(table.get("use"), str):
        raise ValueError(f"{where}: the rule is a table with a key `use`")
    parameters = {key: value for key, value in table.items() if key != "use"}
    try:
        kind = resolve(table["use"])
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    refuse_unknown(parameters, frozenset(inspect.signature(kind).parameters), where)
    try:
        made = kind(**parameters)
        made._validate_params()
        fits = is_classifier(made) is classifier and (classifier or hasattr(made, "transform"))
    except Exception as error:  # estimators raise almost anything of parameters they do not expect
        raise ValueError(f"{where}: {error}") from None
    if not fits:
        raise ValueError(f"{where}: {table['use']} is not a {'classifier' if classifier else 'transformer'}")
    return Use(table["use"], parameters)
