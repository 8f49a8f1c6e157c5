"""Reading of files from other programs: bounded size, checked values, unknown keys ignored."""

import os
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict
from pydantic_core import from_json

from texclass.validation import StrictModel, validate

M = TypeVar("M", bound=BaseModel)


def read_limited(path: Path, limit: int) -> bytes:
    """Return the bytes of a file that may be damaged or hostile.

    Parameters
    ----------
    path : Path
        File to read.
    limit : int
        Largest size in bytes.

    Raises
    ------
    ValueError
        If the path is not a regular file (a pipe or a device may never end), or the file is too large.
    OSError
        If the file cannot be read.
    """
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is not a regular file. Expected a file, not a folder, pipe or device")
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise ValueError(f"{path} has {size} bytes. Expected at most {limit}")
        return file.read(size)


def check_printable(name: str) -> str:
    """Return the name of a surface, or raise a ValueError if a terminal cannot show it."""
    if len(name) > 200 or not name.isprintable():
        raise ValueError(f"{name!r:.80} must be printable text of at most 200 characters")
    return name


class ExternalModel(StrictModel):
    """Base class of the parts of a file: known keys are checked, unknown keys are ignored, as in players."""

    model_config = ConfigDict(extra="ignore")


def read_external(model: type[M], path: str | Path, max_bytes: int) -> M:
    """Return the contents of a JSON file as a model.

    Parameters
    ----------
    model : type of BaseModel
        Subclass of `ExternalModel`.
    path : str or Path
        File to read.
    max_bytes : int
        Largest size in bytes.

    Raises
    ------
    ValueError
        If the file is too large, is not JSON, is nested too deeply, or has a value that is not valid.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    data = read_limited(path, max_bytes)
    try:
        content = from_json(data, allow_inf_nan=False)
    except ValueError as error:
        raise ValueError(f"{path} is not valid JSON ({error}). Expected a {path.suffix} file") from error
    return validate(model, content, path)
