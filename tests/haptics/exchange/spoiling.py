"""Change of one value in nested data, for files with a single fault."""

from typing import Any

REMOVED = object()
"""Marks a value that is removed instead of replaced."""


def replace_value(tree: Any, path: tuple[Any, ...], value: Any) -> None:
    """Replace or remove the value at a path of keys and indices in nested dicts and lists."""
    *parents, last = path
    for key in parents:
        tree = tree[key]
    if value is REMOVED:
        del tree[last]
    else:
        tree[last] = value
