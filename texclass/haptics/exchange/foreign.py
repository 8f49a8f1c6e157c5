"""Files that others wrote: read up to a limit, checked, never trusted; unknown keys are let pass."""

import os
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict
from pydantic_core import from_json

from texclass.validation import StrictModel, validate

M = TypeVar("M", bound=BaseModel)


def read_limited(path: Path, limit: int) -> bytes:
    """Return the bytes of a file that may be hostile.

    Raises
    ------
    ValueError
        If it is no regular file (a pipe or a device may never end) or longer than `limit` bytes.
    OSError
        If it cannot be read.
    """
    if path.exists() and not path.is_file():
        raise ValueError(f"{path}: is not a file. Expected a regular file")
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise ValueError(f"{path}: holds {size} bytes. Expected at most {limit}")
        return file.read(size)


def printable(name: str) -> str:
    """Return the name of a surface, or raise the ValueError that says why a terminal cannot show it."""
    if len(name) > 200 or not name.isprintable():
        raise ValueError(f"holds {name!r:.80}. Expected printable text, at most 200 characters")
    return name


class Part(StrictModel):
    """A part of a file: its known keys are checked, others are left alone, as players do."""

    model_config = ConfigDict(extra="ignore")


def read_foreign(model: type[M], path: str | Path, largest: int) -> M:
    """Return what a JSON file holds, as a model.

    Parameters
    ----------
    model : type of BaseModel
        A `Part`.
    path : str or Path
        The file.
    largest : int
        Bytes it may have.

    Raises
    ------
    ValueError
        If it is too long, no JSON or too deep, or breaks a rule; the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    data = read_limited(path, largest)
    try:
        content = from_json(data, allow_inf_nan=False)
    except ValueError as error:
        raise ValueError(f"{path}: is no JSON ({error}). Expected a {path.suffix} file") from error
    return validate(model, content, path)
