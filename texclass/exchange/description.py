"""The JSON that describes a texture: parsed within limits, checked by the schema, with a checksum."""

import hashlib
import json
import math
import re
from collections.abc import Mapping
from typing import Any

from texclass.exchange.limited import checked_name
from texclass.exchange.npy import DTYPE
from texclass.recording import ACCELERATION_UNITS, SCALELESS_UNITS

SCHEMA = "texclass-texture"
VERSION = 1
"""Of the schema; a file of a newer one is refused."""
UNITS = (*ACCELERATION_UNITS, *SCALELESS_UNITS)
LARGEST_JSON = 1 << 20
HIGHEST_FS = 1e9
DEEPEST = 32
MOST_DIMENSIONS = 4
_KEYS = {"schema", "version", "texclass", "family", "name", "unit", "fs", "parameters", "arrays", "sha256"}
_ARRAY_KEYS = {"dtype", "shape", "sha256"}
_STRING = re.compile(rb'"(?:[^"\\]|\\.)*+"', re.DOTALL)


def encode(description: Mapping[str, Any]) -> bytes:
    """Return the JSON of a description, its checksum added.

    Raises
    ------
    ValueError
        If something in it has no JSON, or is NaN or infinite.
    """
    try:
        body = _canonical(description)
        return _canonical({**description, "sha256": hashlib.sha256(body).hexdigest()})
    except (TypeError, RecursionError) as error:
        raise ValueError(f"no JSON for the parameters ({error}); the rule is numbers, text, lists") from error


def decode(data: bytes, where: str) -> dict[str, Any]:
    """Return the description, checked.

    Raises
    ------
    ValueError
        If it is not JSON, too large or too deep, or breaks a rule of the schema.
    """
    found = parse_json(data, where)
    _check_keys(found, where)
    body = {key: value for key, value in found.items() if key != "sha256"}
    if hashlib.sha256(_canonical(body)).hexdigest() != found["sha256"]:
        raise ValueError(f"{where}: does not fit its checksum; the rule is an unchanged description")
    fs = found["fs"]
    if fs is not None and (type(fs) not in (int, float) or not 0 < fs <= HIGHEST_FS):
        raise ValueError(
            f"{where}: fs is {fs!r:.80}; the rule is null, or above 0, at most {HIGHEST_FS:g} Hz"
        )
    if found["unit"] not in UNITS:
        raise ValueError(f"{where}: unit is {found['unit']!r:.80}; the rule is one of {UNITS}")
    for key in ("family", "texclass", "name"):
        checked_name(found[key], f"{where}: {key}")
    if not isinstance(found["parameters"], dict) or not isinstance(found["arrays"], dict):
        raise ValueError(f"{where}: parameters and arrays are no maps; the rule is a map each")
    for name, announced in found["arrays"].items():
        _check_array(announced, f"{where}: array {name!r:.80}")
    return dict(found)


def parse_json(data: bytes, where: str) -> Any:
    """Return what JSON says: no NaN or infinity, no key twice, limited in length and depth."""
    if len(data) > LARGEST_JSON:
        raise ValueError(f"{where}: holds {len(data)} bytes; the rule is at most {LARGEST_JSON}")
    if _depth(data) > DEEPEST:
        raise ValueError(f"{where}: is nested {_depth(data)} deep; the rule is at most {DEEPEST}")
    try:
        return json.loads(
            data.decode("utf-8"),
            object_pairs_hook=_unique,
            parse_constant=_refuse,
            parse_float=_finite,
        )
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{where}: is not the JSON it should be ({error})") from error


def _check_keys(found: Any, where: str) -> None:
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        raise ValueError(f"{where}: is no texture description; the rule is schema {SCHEMA!r}")
    version = found.get("version")
    if type(version) is not int or version < 1:
        raise ValueError(f"{where}: version is {version!r:.80}; the rule is a number from 1 on")
    if version > VERSION:
        raise ValueError(
            f"{where}: version is {version}; the rule is at most {VERSION}: a newer texclass is needed"
        )
    if set(found) != _KEYS:
        raise ValueError(f"{where}: keys are {sorted(found)!s:.300}; the rule is {sorted(_KEYS)}")


def _check_array(announced: Any, where: str) -> None:
    if not isinstance(announced, dict) or set(announced) != _ARRAY_KEYS:
        raise ValueError(f"{where} is {announced!s:.80}; the rule is a map of {sorted(_ARRAY_KEYS)}")
    if announced["dtype"] != DTYPE:
        raise ValueError(f"{where} has dtype {announced['dtype']!r:.80}; the rule is {DTYPE!r}")
    shape = announced["shape"]
    sound = isinstance(shape, list) and len(shape) <= MOST_DIMENSIONS
    if not sound or not all(type(n) is int and 0 <= n < 1 << 40 for n in shape):
        raise ValueError(f"{where} has shape {shape!s:.80}; the rule is at most {MOST_DIMENSIONS} counts")


def _canonical(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, indent=1, allow_nan=False).encode("ascii")


def _depth(data: bytes) -> int:
    """Return how deep maps and lists are nested; what stands in strings does not count."""
    depth = deepest = 0
    for bracket in re.findall(rb"[\[\]{}]", _STRING.sub(b"", data)):
        depth += 1 if bracket in b"[{" else -1
        deepest = max(deepest, depth)
    return deepest


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key stands twice; the rule is once")
    return found


def _refuse(constant: str) -> float:
    raise ValueError(f"holds {constant}; the rule is finite numbers")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"holds {text:.40}; the rule is finite numbers")
    return value
