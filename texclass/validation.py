"""Validate TOML and JSON files (cards, pipelines, feature sets, scenes, results), with readable messages.

Each kind of file is a pydantic model derived from `StrictModel`. The fields of the model are the keys of the
file.
"""

import difflib
import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, RootModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

M = TypeVar("M", bound=BaseModel)
MAX_TOML = 1 << 20
"""Largest size of a TOML file in bytes; shipped definitions are less than a hundredth of it."""
_DEEP = re.compile(rb"""(?:[\w"'-]++[ \t]*+\.[ \t]*+){32}""")
"""Keys with 32 or more parts, for which parsing time is quadratic."""
_CONTROL = re.compile(r"(?<!\\)(?:\\\\)*(\\[bf]|\\u00(?:0[0-8be-f]|1[0-9a-f]|[89][0-9a-f])|\x7f)")
"""Control characters in JSON that could manipulate a terminal; tabs and line ends are allowed."""
_EXPECTED = {
    "bool_type": "true or false",
    "dict_type": "a table",
    "finite_number": "a finite number",
    "float_type": "a number",
    "greater_than": "a number above {gt}",
    "greater_than_equal": "a number of at least {ge}",
    "int_from_float": "a whole number",
    "int_type": "a whole number",
    "less_than": "a number below {lt}",
    "less_than_equal": "a number of at most {le}",
    "list_type": "a list",
    "path_type": "the path of a file",
    "string_too_long": "text of at most {max_length} characters",
    "string_too_short": "text of at least {min_length} characters",
    "string_type": "text",
    "too_long": "at most {max_length} of them",
    "too_short": "at least {min_length} of them",
    "tuple_type": "a list",
}
"""Expected value by error type of pydantic, where the text of pydantic is written for programmers."""


class StrictModel(BaseModel):
    """Immutable base class of all file models; unknown keys and values of the wrong type are errors.

    Text is not converted to numbers, but lists are accepted for tuples and integers for floats.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; damaged and malicious files raise an error.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the file is not valid TOML, is larger than `MAX_TOML`, or has keys of 32 or more parts.
    """
    with path.open("rb") as file:
        data = file.read(MAX_TOML + 1)
    if len(data) > MAX_TOML or _DEEP.search(data):
        raise ValueError(
            f"{path}: refused as TOML. Expected at most {MAX_TOML} bytes, and keys of fewer than 32 parts"
        )
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: not valid TOML ({error})") from error


def check_positive(**values: float | None) -> None:
    """Raise an error for arguments that are not positive and finite; None is accepted.

    Raises
    ------
    ValueError
        If a value is zero, negative, infinite or NaN.
    """
    for name, value in values.items():
        if value is not None and not 0 < value < math.inf:
            raise ValueError(f"{name} must be positive and finite, got {value!r}")


def validate(model: type[M], content: Any, where: object, *, context: object = None) -> M:
    """Validate the content of a file.

    Parameters
    ----------
    model : type of BaseModel
        Model of the file, usually a `StrictModel`.
    content : mapping
        Content from a TOML or JSON parser.
    where : str or Path
        File, or file and key of a table, named in messages.
    context : object, optional
        Context for the validators of the model, such as the file to which paths are relative.

    Returns
    -------
    BaseModel
        Instance of `model`.

    Raises
    ------
    ValueError
        If the content is invalid. The message names the first invalid value and all missing and unknown keys.

    Examples
    --------
    >>> class Sensor(StrictModel):
    ...     fs_hz: float
    >>> validate(Sensor, {"fs_hz": 1000}, "card.toml").fs_hz
    1000.0
    >>> validate(Sensor, {"fs_khz": 1}, "card.toml")
    Traceback (most recent call last):
    ValueError: card.toml: missing key fs_hz; unknown key fs_khz (did you mean fs_hz?)
    """
    if not isinstance(content, Mapping):
        raise ValueError(
            f"{where} contains {_shorten(content)}. Expected a table with the keys "
            f"{', '.join(_keys([*_models_in(model)]))}"
        )
    try:
        # In JSON mode, lists are accepted for tuples and everything else stays strict.
        text = json.dumps(content, default=str)
        if match := _CONTROL.search(text):
            raise ValueError(f"{where}: contains the control character {match[1]}. Expected printable text")
        return model.model_validate_json(text, context=context)
    except ValidationError as error:
        errors = error.errors()
        key_errors, value_errors = (
            [item for item in errors if _is_key_error(item) == is_key] for is_key in (True, False)
        )
        reported = [*value_errors[:1], *key_errors[:20]]
        n_more = len(errors) - len(reported)
        suffix = f" (and {n_more} more)" if n_more else ""
        messages = dict.fromkeys(_describe(item, model) for item in reported)
        raise ValueError(f"{where}: {'; '.join(messages)}{suffix}") from None


def _is_key_error(error: ErrorDetails) -> bool:
    """Return whether an error is a missing or unknown key."""
    return error["type"] in ("missing", "union_tag_not_found", "extra_forbidden") or (
        error["type"] == "literal_error" and error["loc"][-1] == "[key]"
    )


def _describe(error: ErrorDetails, model: type[BaseModel]) -> str:
    """Return the message of one error: key, value, and what was expected."""
    kind, place, context = error["type"], error["loc"], error.get("ctx", {})
    key, field, tables = _follow(model, place)
    if kind in ("missing", "union_tag_not_found"):
        tag = _split_quoted(context["discriminator"]) if context else []
        return f"missing key {'.'.join(filter(None, [key, *tag]))}"
    if _is_key_error(error):
        valid_keys = _split_quoted(context["expected"]) if kind == "literal_error" else [*_keys(tables)]
        closest = difflib.get_close_matches(key.rpartition(".")[2], valid_keys, n=1)
        prefix = f"{key.rpartition('.')[0]}." if "." in key else ""
        expected = f"expected one of {', '.join(valid_keys)}" if valid_keys else "expected no key at all"
        return f"unknown key {key} ({f'did you mean {prefix}{closest[0]}?' if closest else expected})"
    if kind == "union_tag_invalid":
        key = ".".join(filter(None, [key, *_split_quoted(context["discriminator"])]))
        tags = ", ".join(_split_quoted(context["expected_tags"]))
        return f"{key} is {context['tag']!r}. Expected one of {tags}"
    if kind in ("value_error", "json_invalid"):
        message = str(context["error"])
        return f"{key}: {message}" if key else message
    expected = (field.description if field else None) or _expected_value(error, tables)
    return f"{key} is {_shorten(error['input'])}. Expected {expected}" if key else f"expected {expected}"


def _expected_value(error: ErrorDetails, tables: list[type[BaseModel]]) -> str:
    """Describe in plain words what pydantic expected."""
    context = error.get("ctx", {})
    match error["type"]:
        case "model_type":
            return f"a table with the keys {', '.join(_keys(tables))}"
        case "literal_error" | "enum":
            return f"one of {', '.join(_split_quoted(context['expected']))}"
        case "string_pattern_mismatch":
            return f"text that matches {context['pattern']}"
    template = _EXPECTED.get(error["type"])
    return template.format_map(context) if template else error["msg"].removeprefix("Input should be ")


def _follow(
    model: type[BaseModel], place: tuple[int | str, ...]
) -> tuple[str, FieldInfo | None, list[type[BaseModel]]]:
    """Follow the location of an error through nested tables.

    Returns
    -------
    key : str
        Key as in the file, such as "rows.2.name", where items of lists are counted from 1.
    field : FieldInfo or None
        Innermost field that contains the location.
    tables : list of type
        Models that are valid at the location; for an unknown key, the models that lack it.
    """
    parts: list[str] = []
    field: FieldInfo | None = None
    tables = list(_models_in(model))
    for part in place:
        tagged = [table for table in tables if len(tables) > 1 and _has_tag(table, part)]
        if tagged:  # the tag of a union selects a model; it is not part of the key
            tables = tagged
            continue
        holder = next((table for table in tables if part in table.model_fields), None)
        if holder is not None:
            field = holder.model_fields[str(part)]
            tables = list(_models_in(field.annotation))
        if part != "[key]":
            parts.append(str(part + 1 if isinstance(part, int) else part))
    return ".".join(parts), field, tables


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models in a type; a `RootModel` is replaced by its content."""
    if isinstance(annotation, type) and issubclass(annotation, RootModel):
        yield from _models_in(annotation.model_fields["root"].annotation)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        for argument in get_args(annotation):
            yield from _models_in(argument)


def _has_tag(table: type[BaseModel], part: int | str) -> bool:
    return isinstance(part, str) and any(part in get_args(f.annotation) for f in table.model_fields.values())


def _keys(tables: list[type[BaseModel]]) -> dict[str, None]:
    return dict.fromkeys(key for table in tables for key in table.model_fields)


def _split_quoted(text: str) -> list[str]:
    """Return the quoted values in a text such as "'a', 'b' or 'c'", or the text itself if there are none."""
    return re.findall(r"'([^']*)'", text) or [text]


def _shorten(value: Any) -> str:
    """Format an invalid value for a message, in at most 60 characters."""
    text = json.dumps(value, default=repr) if isinstance(value, dict | list) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
