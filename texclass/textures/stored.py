"""What is checked of a stored texture before it is made again: names, and kinds of values."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples


def check_names(family: str, what: str, found: Iterable[Any], expected: set[str]) -> None:
    """Raise the ValueError that says what is missing or superfluous among the `what` of a family."""
    if set(found) != expected:
        raise ValueError(f"{family}: {what} are {sorted(map(str, found))}; the rule is {sorted(expected)}")


def check_all_names(
    family: str,
    parameters: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    expected: tuple[set[str], set[str]],
) -> None:
    """Check the names of parameters and of arrays."""
    check_names(family, "parameters", parameters, expected[0])
    check_names(family, "arrays", arrays, expected[1])


def is_number(value: Any) -> bool:
    """Whether a value is a real number; true and false are none."""
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def number(parameters: Mapping[str, Any], name: str) -> float:
    """Return a parameter that is a number."""
    value = parameters[name]
    if not is_number(value):
        raise ValueError(f"{name} is {value!r}; the rule is a number")
    return float(value)


def text(parameters: Mapping[str, Any], name: str) -> str:
    """Return a parameter that is a text."""
    value = parameters[name]
    if not isinstance(value, str):
        raise ValueError(f"{name} is {value!r}; the rule is a text")
    return value


def numbers(arrays: Mapping[str, NDArray[Any]], name: str, n_axes: int | None = None) -> Samples:
    """Return an array of finite real numbers, with so many axes."""
    value = np.asarray(arrays[name])
    if value.dtype.kind not in "iuf" or (n_axes is not None and value.ndim != n_axes):
        axes = "" if n_axes is None else f", {n_axes} axes"
        raise ValueError(f"{name} is {value.dtype} {value.shape}; the rule is finite real numbers{axes}")
    if not np.all(np.isfinite(value)):
        raise ValueError(f"{name} holds NaN or infinity; the rule is finite real numbers")
    return value.astype(np.float64)
