"""Check what people write (cards, pipelines, feature sets, scenes, results): one reader, one form of message.

A kind of file is a pydantic model derived from `Written`; its fields are the keys of the file.
"""

import difflib
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

M = TypeVar("M", bound=BaseModel)
LARGEST_TOML = 1 << 20
"""Bytes; the shipped definitions have a hundredth."""
_DEEP = re.compile(rb"""(?:[\w"'-]++[ \t]*+\.[ \t]*+){32}""")
"""Keys of so many parts cost the parser the square of their number."""
_SHOWN = 60
"""Characters of a wrong value that a message shows."""


class Written(BaseModel):
    """A table that people write: frozen; unknown keys and values of another kind are errors.

    Types are taken strictly (no text for a number), but a list may stand where a tuple is declared, and a
    whole number where a float is.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file that may be damaged or hostile.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is not valid TOML, longer than `LARGEST_TOML` or nested deeper than any definition; the message
        names the file and the place.
    """
    with path.open("rb") as file:
        data = file.read(LARGEST_TOML + 1)
    if len(data) > LARGEST_TOML or _DEEP.search(data):
        raise ValueError(
            f"{path}: not valid TOML (the rule is {LARGEST_TOML} bytes, keys of 32 parts at most)"
        )
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: not valid TOML ({error})") from error


def checked(model: type[M], content: Any, where: object) -> M:
    """Return the content of a file as a model.

    Parameters
    ----------
    model : type of BaseModel
        What its keys must be, usually a `Written`.
    content : mapping
        As a TOML or JSON parser returns it.
    where : str or Path
        The file, for messages; of a part of it, file and key.

    Raises
    ------
    ValueError
        Naming the file, the key, the value and the rule; further faults are counted.
    """
    if not isinstance(content, Mapping):
        raise ValueError(
            f"{where}: {_short(content)}; the rule is a table of {', '.join(model.model_fields)}"
        )
    try:
        # Under the rules for JSON a list is good for a tuple, and all else stays strict.
        return model.model_validate_json(json.dumps(content, default=str))
    except ValidationError as error:
        first, *others = error.errors()
        more = f" (and {len(others)} more)" if others else ""
        raise ValueError(f"{where}: {_told(first, model)}{more}") from None


def _told(error: ErrorDetails, model: type[BaseModel]) -> str:
    key = ".".join(str(part + 1 if isinstance(part, int) else part) for part in error["loc"])
    match error["type"]:
        case "extra_forbidden":
            known = list(_keys_beside(model, error["loc"]))
            near = difflib.get_close_matches(str(error["loc"][-1]), known, n=1)
            rule = f"did you mean {near[0]}?" if near else f"the rule is one of {', '.join(known)}"
            return f"unknown key {key}; {rule}"
        case "missing":
            return f"lacks the key {key}; the rule is that it is given"
        case "value_error" if not key:
            return str(error["ctx"]["error"])
        case "value_error":
            return f"{key}: {error['ctx']['error']}"
    return f"{key} is {_short(error['input'])}; the rule is {error['msg'].removeprefix('Input should be ')}"


def _keys_beside(model: type[BaseModel], place: tuple[int | str, ...]) -> Iterator[str]:
    """Yield the keys that a table may hold, found by following the place of an unknown one."""
    for part in place[:-1]:
        field = model.model_fields.get(str(part))
        if field is not None:
            model = next(_models_in(field.annotation), model)
    yield from model.model_fields


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _short(value: Any) -> str:
    shown = json.dumps(value, default=repr) if isinstance(value, dict | list) else repr(value)
    return shown if len(shown) <= _SHOWN else f"{shown[: _SHOWN - 3]}..."
