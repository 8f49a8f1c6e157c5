"""JSON files of formats that are not ours: checked, never trusted, and their unknown keys let pass."""

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict
from pydantic_core import from_json

from texclass.exchange.container import read_limited
from texclass.validation import Written, checked

M = TypeVar("M", bound=BaseModel)


class Part(Written):
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
        raise ValueError(f"{path}: is no JSON ({error}); the rule is a {path.suffix} file") from error
    return checked(model, content, path)
