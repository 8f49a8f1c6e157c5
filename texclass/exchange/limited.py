"""Reading a file that may be hostile: never more than a limit, never anything but a file."""

import os
from pathlib import Path


def read_limited(path: Path, limit: int) -> bytes:
    """Return the bytes of a file.

    Raises
    ------
    ValueError
        If it is no regular file (a pipe or a device may never end) or longer than `limit` bytes.
    OSError
        If it cannot be read.
    """
    if path.exists() and not path.is_file():
        raise ValueError(f"{path}: is not a file; the rule is a regular file")
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise ValueError(f"{path}: holds {size} bytes; the rule is at most {limit}")
        return file.read(size)


def checked_name(name: object, where: object) -> str:
    """Return the name of a surface if it can be shown on a terminal, else raise a ValueError."""
    if not isinstance(name, str) or len(name) > 200 or not name.isprintable():
        raise ValueError(f"{where}: name is {name!r:.80}; the rule is printable text, at most 200 characters")
    return name
