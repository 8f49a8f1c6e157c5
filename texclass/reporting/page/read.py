"""Read a result that a command wrote, and refuse what is none."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from texclass.reporting.page.shapes import SHAPES, kind_of

WRITERS = (
    "JSON of texclass benchmark (also --peers, --feature), tradeoff, stability or the study of invariance"
)

LONGEST_INTEGER = 300
"""Characters; a longer number has no logarithm and no place in a figure."""


@dataclass(frozen=True, eq=False)
class Result:
    """A result as JSON values.

    Attributes
    ----------
    file
        Name of the file it was read from.
    kind
        "benchmark", "feature", "tradeoff", "peers", "invariance" or "stability".
    data
        What the file holds.
    """

    file: str
    kind: str
    data: dict[str, Any]


def read_result(path: str | Path) -> Result:
    """Read one result.

    Parameters
    ----------
    path : str or path
        A JSON file.

    Raises
    ------
    ValueError
        If it is no JSON, no result, or lacks what such a result has; the message names file and rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    try:
        document = json.loads(
            path.read_text(encoding="utf-8"), parse_constant=_no_number, parse_float=_finite, parse_int=_whole
        )
    except (UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: {error}; the rule is {WRITERS}") from error
    except ValueError as error:
        raise ValueError(f"{path}: no JSON ({error}); the rule is {WRITERS}") from error
    kind = kind_of(document)
    if kind is None:
        keys = ", ".join(list(document)[:6]) if isinstance(document, dict) else type(document).__name__
        raise ValueError(f"{path}: holds no result ({keys or 'nothing'}); the rule is {WRITERS}")
    try:
        SHAPES[kind](document, "")
    except ValueError as error:
        raise ValueError(f"{path}: read as a result of kind {kind}, {error}") from error
    return Result(path.name, kind, document)


def _no_number(constant: str) -> float:
    raise ValueError(f"{constant:.40} is no JSON number")


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _no_number(text)


def _whole(text: str) -> int | float:
    return int(text) if len(text) < LONGEST_INTEGER else _finite(text)
