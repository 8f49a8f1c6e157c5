"""How a texture is written down and made again: its fields, arrays apart from what JSON knows."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

_RULES = {"unexpected_keyword_argument": "no such key", "missing_argument": "that each key is given"}


class StoredFields:
    """Gives a dataclass the three methods of `contract.Stored`: what its fields hold is what is written.

    Fields may be numbers, texts, arrays, dataclasses, tuples and mappings of these; what is not an argument
    of the constructor is left out. A stored object is made by its own types and its own `__post_init__`, so
    that a file can hold nothing that a program could not make.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Hum(StoredFields):
    ...     family = "hum"
    ...     name: str
    ...     tones: np.ndarray
    >>> hum = Hum("low", np.array([50.0, 120.5]))
    >>> hum.parameters(), hum.arrays()
    ({'name': 'low', 'tones': None}, {'tones': array([ 50. , 120.5])})
    >>> Hum.restore(hum.parameters(), hum.arrays()).name
    'low'
    """

    family: ClassVar[str]
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(
        arbitrary_types_allowed=True, extra="forbid", allow_inf_nan=False
    )

    def parameters(self) -> dict[str, Any]:
        """Return what is not an array, as JSON knows it; None where an array belongs."""
        return {name: _apart(value, name, {}) for name, value in _arguments(self).items()}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays; "mesh.speed" is that of the field `mesh`, "models.0.k" that of its first."""
        found: dict[str, NDArray[Any]] = {}
        for name, value in _arguments(self).items():
            _apart(value, name, found)
        return found

    @classmethod
    def restore(cls, parameters: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the object of what `parameters` and `arrays` returned.

        Raises
        ------
        ValueError
            If something is missing, superfluous, of the wrong kind or shape, or breaks a rule of the object.
        """
        left = dict(arrays)
        tree = {name: _together(value, name, left) for name, value in parameters.items()}
        if left:
            raise ValueError(f"{cls.family}: array {min(left)!r:.80} has no place; the rule is one for each")
        try:
            return TypeAdapter(cls).validate_python(tree)
        except ValidationError as error:
            first = error.errors()[0]
            raise ValueError(f"{cls.family}: {_told(first)}") from None


def _arguments(value: Any) -> dict[str, Any]:
    return {each.name: getattr(value, each.name) for each in fields(value) if each.init}


def _apart(value: Any, place: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return a value as JSON knows it, its arrays put among `arrays` under where they stand."""
    if isinstance(value, np.ndarray):
        arrays[place] = value
        return None
    if is_dataclass(value) or isinstance(value, Mapping):
        inner = value if isinstance(value, Mapping) else _arguments(value)
        return {name: _apart(each, f"{place}.{name}", arrays) for name, each in inner.items()}
    if isinstance(value, tuple | list):
        return [_apart(each, f"{place}.{i}", arrays) for i, each in enumerate(value)]
    return value.item() if isinstance(value, np.generic) else value


def _together(value: Any, place: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return a value with its arrays where they belong, taken out of `arrays`."""
    if value is None:
        return arrays.pop(place, None)
    if isinstance(value, Mapping):
        return {name: _together(each, f"{place}.{name}", arrays) for name, each in value.items()}
    if isinstance(value, list):
        return [_together(each, f"{place}.{i}", arrays) for i, each in enumerate(value)]
    return value


def _told(error: Any) -> str:
    """Return what pydantic found as place, value and rule."""
    place = ".".join(map(str, error["loc"]))
    if error["type"] == "value_error":
        return f"{place}: {error['ctx']['error']}" if place else str(error["ctx"]["error"])
    rule = _RULES.get(error["type"], error["msg"].removeprefix("Input should be "))
    return f"{place} is {error['input']!r:.80}; the rule is {rule}"
