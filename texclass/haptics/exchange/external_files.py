"""Read files from other programs: limit their size, validate known keys and ignore unknown ones."""

import os
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict
from pydantic_core import from_json

from texclass.validation import StrictModel, validate

M = TypeVar("M", bound=BaseModel)


def read_limited(path: Path, limit: int) -> bytes:
    """Read a file that may be damaged or malicious.

    Parameters
    ----------
    path : Path
        File to read.
    limit : int
        Largest size in bytes.

    Raises
    ------
    ValueError
        If the path is not a regular file (reading a pipe or device may never end), or the file is too large.
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
    """Return the name of a surface; raise ValueError if it is too long or not printable."""
    if len(name) > 200 or not name.isprintable():
        raise ValueError(f"the name must be printable text of at most 200 characters, got {name!r:.80}")
    return name


class ExternalModel(StrictModel):
    """Base class of the parts of a file. Known keys are validated; like players, it ignores unknown keys."""

    model_config = ConfigDict(extra="ignore")


def read_external(model: type[M], path: str | Path, max_bytes: int) -> M:
    """Read a JSON file, and validate its contents with a model.

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
        If the file is too large, not JSON or nested too deeply, or a value is invalid.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    data = read_limited(path, max_bytes)
    try:
        content = from_json(data, allow_inf_nan=False)
    except ValueError as error:
        raise ValueError(
            f"{path} is not valid JSON ({error}). Expected the JSON content of a {path.suffix} file"
        ) from error
    return validate(model, content, path)
