"""Check what people write (cards, pipelines, feature sets, scenes, results): one reader, one form of message.

A kind of file is a pydantic model derived from `Written`; its fields are the keys of the file.
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
LARGEST_TOML = 1 << 20
"""Bytes; the shipped definitions have a hundredth."""
_DEEP = re.compile(rb"""(?:[\w"'-]++[ \t]*+\.[ \t]*+){32}""")
"""Keys of so many parts cost the parser the square of their number."""
_STEERING = re.compile(r"(?<!\\)(?:\\\\)*(\\[bf]|\\u00(?:0[0-8be-f]|1[0-9a-f]|[89][0-9a-f])|\x7f)")
"""What steers a terminal, in JSON: control characters but tabs and ends of lines."""
_WORDS = {
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
"""Kind of a fault -> rule, where pydantic's own words are those of a programmer."""


class StrictModel(BaseModel):
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
            f"{path}: not valid TOML (at most {LARGEST_TOML} bytes, and keys of 32 parts, are read)"
        )
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: not valid TOML ({error})") from error


def check_positive(**named: float | None) -> None:
    """Refuse arguments that are not above 0, or not finite; None stands for one that is not given.

    Raises
    ------
    ValueError
        The message names argument, value and rule.
    """
    for name, value in named.items():
        if value is not None and not 0 < value < math.inf:
            raise ValueError(f"{name} is {value!r}. Expected a positive, finite number")


def validate(model: type[M], content: Any, where: object, *, context: object = None) -> M:
    """Return the content of a file as a model.

    Parameters
    ----------
    model : type of BaseModel
        What its keys must be, usually a `Written`.
    content : mapping
        As a TOML or JSON parser returns it.
    where : str or Path
        The file, for messages; of a part of it, file and key.
    context : object, optional
        What the model's validators are told, as the file that other paths are relative to.

    Raises
    ------
    ValueError
        Naming the file, the first wrong value, and all missing and unknown keys; further faults are counted.
    """
    if not isinstance(content, Mapping):
        raise ValueError(
            f"{where}: {_shorten(content)}. Expected a table of {', '.join(_keys([*_models_in(model)]))}"
        )
    try:
        # Under the rules for JSON a list is good for a tuple, and all else stays strict.
        text = json.dumps(content, default=str)
        if steering := _STEERING.search(text):
            raise ValueError(f"{where}: holds the control character {steering[1]}. Expected printable text")
        return model.model_validate_json(text, context=context)
    except ValidationError as error:
        faults = error.errors()
        keys, others = ([f for f in faults if _is_of_key(f) == of_key] for of_key in (True, False))
        shown = [*others[:1], *keys[:20]]
        more = f" (and {len(faults) - len(shown)} more)" if len(faults) > len(shown) else ""
        words = dict.fromkeys(_describe(fault, model) for fault in shown)
        raise ValueError(f"{where}: {'; '.join(words)}{more}") from None


def _is_of_key(error: ErrorDetails) -> bool:
    """Whether a key is missing or unknown."""
    return error["type"] in ("missing", "union_tag_not_found", "extra_forbidden") or (
        error["type"] == "literal_error" and error["loc"][-1] == "[key]"
    )


def _describe(error: ErrorDetails, model: type[BaseModel]) -> str:
    """Return one fault in words: the key as people write it, the value, the rule."""
    kind, place, context = error["type"], error["loc"], error.get("ctx", {})
    key, field, tables = _follow(model, place)
    if kind in ("missing", "union_tag_not_found"):
        tag = _split_quoted(context["discriminator"]) if context else []
        return f"missing key {'.'.join(filter(None, [key, *tag]))}"
    if _is_of_key(error):
        known = _split_quoted(context["expected"]) if kind == "literal_error" else [*_keys(tables)]
        near = difflib.get_close_matches(key.rpartition(".")[2], known, n=1)
        beside = f"{key.rpartition('.')[0]}." if "." in key else ""
        rule = f"expected one of {', '.join(known)}" if known else "expected no key at all"
        return f"unknown key {key} ({f'did you mean {beside}{near[0]}?' if near else rule})"
    if kind == "union_tag_invalid":
        key = ".".join(filter(None, [key, *_split_quoted(context["discriminator"])]))
        tags = ", ".join(_split_quoted(context["expected_tags"]))
        return f"{key} is {context['tag']!r}. Expected one of {tags}"
    if kind in ("value_error", "json_invalid"):
        said = str(context["error"])
        return f"{key}: {said}" if key else said
    rule = (field.description if field else None) or _rule(error, tables)
    return f"{key} is {_shorten(error['input'])}. Expected {rule}" if key else f"expected {rule}"


def _rule(error: ErrorDetails, tables: list[type[BaseModel]]) -> str:
    """Return what pydantic asks for in plain words."""
    context = error.get("ctx", {})
    match error["type"]:
        case "model_type":
            return f"a table of {', '.join(_keys(tables))}"
        case "literal_error" | "enum":
            return f"one of {', '.join(_split_quoted(context['expected']))}"
        case "string_pattern_mismatch":
            return f"text like {context['pattern']}"
    words = _WORDS.get(error["type"])
    return words.format_map(context) if words else error["msg"].removeprefix("Input should be ")


def _follow(
    model: type[BaseModel], place: tuple[int | str, ...]
) -> tuple[str, FieldInfo | None, list[type[BaseModel]]]:
    """Follow the place of a fault through nested tables.

    Returns
    -------
    key : str
        As people write it: "rows.2.name", lists counted from 1.
    field : FieldInfo or None
        The last field on the way.
    tables : list of type
        Models that may stand at the place; for a key that none of them knows, the models it is missing in.
    """
    shown: list[str] = []
    field: FieldInfo | None = None
    tables = list(_models_in(model))
    for part in place:
        tagged = [table for table in tables if len(tables) > 1 and _has_tag(table, part)]
        if tagged:  # of the kinds of a table, the one that its tag names; people do not write it
            tables = tagged
            continue
        holder = next((table for table in tables if part in table.model_fields), None)
        if holder is not None:
            field = holder.model_fields[str(part)]
            tables = list(_models_in(field.annotation))
        if part != "[key]":
            shown.append(str(part + 1 if isinstance(part, int) else part))
    return ".".join(shown), field, tables


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models in a type, those inside a `RootModel` in its place."""
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


def _split_quoted(listed: str) -> list[str]:
    """Return the values in what pydantic lists as "'a', 'b' or 'c'"; all of it where these are no texts."""
    return re.findall(r"'([^']*)'", listed) or [listed]


def _shorten(value: Any) -> str:
    """Return a wrong value as messages show it, in at most 60 characters."""
    shown = json.dumps(value, default=repr) if isinstance(value, dict | list) else repr(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}..."
