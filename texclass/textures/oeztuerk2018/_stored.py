"""What texture files are checked for before a texture is made of them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass.recording import Samples


def check_names(
    parameters: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
    *,
    expected: tuple[set[str], set[str]],
    family: str,
) -> None:
    """Raise the ValueError that says what is missing or superfluous."""
    for what, found, names in (
        ("parameters", set(parameters), expected[0]),
        ("arrays", set(arrays), expected[1]),
    ):
        if found != names:
            raise ValueError(f"{family}: {what} are {sorted(map(str, found))}; the rule is {sorted(names)}")


def number(parameters: Mapping[str, Any], name: str) -> float:
    """Return a parameter that is a number."""
    value = parameters[name]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} is {value!r}; the rule is a number")
    return float(value)


def text(parameters: Mapping[str, Any], name: str) -> str:
    """Return a parameter that is a text."""
    value = parameters[name]
    if not isinstance(value, str):
        raise ValueError(f"{name} is {value!r}; the rule is a text")
    return value


def array(arrays: Mapping[str, NDArray[Any]], name: str, n_axes: int) -> Samples:
    """Return an array of real numbers with so many axes."""
    value = np.asarray(arrays[name])
    if value.dtype.kind not in "iuf" or value.ndim != n_axes:
        raise ValueError(f"{name} is {value.dtype} {value.shape}; the rule is real numbers, {n_axes} axes")
    return value.astype(np.float64)
