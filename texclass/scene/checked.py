"""A TOML table read strictly: every message names file, key, value and rule."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Table:
    """A TOML table that knows where it stands, so that messages can say it."""

    values: Mapping[str, Any]
    where: str
    folder: Path

    def keys(self, *needed: str, optional: tuple[str, ...] = ()) -> None:
        """Refuse keys that are missing or unknown."""
        if unknown := sorted(set(self.values) - {*needed, *optional}):
            rule = ", ".join((*needed, *optional))
            raise ValueError(f"{self.where}: unknown key {unknown[0]!r}; the rule is one of {rule}")
        if missing := [key for key in needed if key not in self.values]:
            raise ValueError(f"{self.where}: no key {missing[0]!r}; the rule is that it is given")

    def table(self, key: str) -> "Table":
        """Return a table inside."""
        if not isinstance(self.values[key], dict):
            raise ValueError(f"{self.where}: {key} is {self.values[key]!r}; the rule is a table [{key}]")
        return Table(self.values[key], f"{self.where}: {key}", self.folder)

    def text(self, key: str, default: str | None = None, one_of: tuple[str, ...] = ()) -> str:
        """Return a text, or refuse it."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or not value or (one_of and value not in one_of):
            rule = f"one of {', '.join(one_of)}" if one_of else "a text"
            raise ValueError(f"{self.where}: {key} is {value!r}; the rule is {rule}")
        return value

    def number(
        self,
        key: str,
        *,
        above: float = -np.inf,
        at_least: float = -np.inf,
        at_most: float = np.inf,
        default: float | None = None,
        whole: bool = False,
    ) -> float:
        """Return a number within bounds, or refuse it."""
        value = self.values.get(key, default)
        if not is_number(value, whole) or not (above < value and at_least <= value <= at_most):
            raise ValueError(
                f"{self.where}: {key} is {value!r}; the rule is a {'whole ' if whole else ''}number"
                f"{_bounds(above, at_least, at_most)}"
            )
        return float(value)

    def pair(self, key: str, *, at_least: float = 0.0, equal: bool = False) -> tuple[float, float]:
        """Return the two ends of a range, or refuse them."""
        value = self.values[key]
        if not isinstance(value, list) or len(value) != 2 or not all(is_number(v) for v in value):
            raise ValueError(f"{self.where}: {key} is {value!r}; the rule is [lowest, highest]")
        low, high = map(float, value)
        if not (at_least <= low <= high and (equal or low < high)):
            raise ValueError(
                f"{self.where}: {key} is {value!r}; the rule is rising numbers of at least {at_least:g}"
            )
        return low, high

    def file(self, key: str) -> Path:
        """Return an existing file; its path is relative to the TOML."""
        path = self.folder / os.path.expanduser(self.text(key))  # no error where there is no such user
        if not os.path.isfile(path):  # no error where a name is too long for one
            raise ValueError(
                f"{self.where}: {key} is {self.values[key]!r:.200}; the rule is an existing file"
            )
        return path


def is_number(value: Any, whole: bool = False) -> bool:
    """Return whether a value is a finite number, a whole one if asked for."""
    if not isinstance(value, int if whole else int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond every float
        return False


def _bounds(above: float, at_least: float, at_most: float) -> str:
    words = [f" above {above:g}"] if above > -np.inf else []
    words += [f" of at least {at_least:g}"] if at_least > -np.inf else []
    words += [f" at most {at_most:g}"] if at_most < np.inf else []
    return ",".join(words)
