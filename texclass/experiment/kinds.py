"""Values of a pipeline TOML: of the kind that is asked for, or a ValueError that begins with their place."""

from collections.abc import Iterable, Mapping
from typing import Any


def at_least(least: int, value: Any, where: str) -> int:
    """Return a whole number of at least so much."""
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ValueError(f"{where} is {value!r:.80}; the rule is a whole number of at least {least}")
    return value


def typed(value: Any, kind: type, where: str) -> Any:
    """Return a value of a kind."""
    if not isinstance(value, kind):
        raise ValueError(f"{where} is {value!r:.80}; the rule is a {kind.__name__}")
    return value


def texts(value: Any, where: str) -> tuple[str, ...]:
    """Return a list of texts."""
    if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        raise ValueError(f"{where} is {value!r:.80}; the rule is a list of texts")
    return tuple(value)


def require(given: Mapping[str, Any], keys: Iterable[str], where: str) -> None:
    """Refuse a table without one of the keys."""
    if missing := [key for key in keys if key not in given]:
        raise ValueError(f"{where}: no key {missing[0]!r}; the rule is that it is given")


def refuse_repeated(names: list[str], where: str, what: str) -> None:
    """Refuse a name that stands twice."""
    if repeated := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"{where}: two {what} are named {repeated[0]!r}; the rule is one a name")
