"""Files that are whole but for one value."""

from typing import Any

GONE = object()
"""In the place of a value: it is taken away."""


def put(tree: Any, way: tuple[Any, ...], value: Any) -> None:
    """Put a value into nested maps and lists, by the keys that lead to it."""
    *path, last = way
    for step in path:
        tree = tree[step]
    if value is GONE:
        del tree[last]
    else:
        tree[last] = value
