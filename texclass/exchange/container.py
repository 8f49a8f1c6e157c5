"""The container of `.texture` files: arrays and a header in one safetensors file, which can execute nothing.

The header says which family of textures the file holds, in which unit, made of which parameters, and closes
with a checksum over all of it. It shows damage, not who wrote the file.
"""

import hashlib
import json
import os
import pkgutil
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field
from pydantic_core import from_json
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from texclass._version import __version__
from texclass.recording import Unit
from texclass.textures.contract import Stored
from texclass.validation import Written, checked
from texclass.whole_files import path_ending, write_whole

SUFFIX = ".texture"
VERSION = 2
"""Of the header. Files of version 1 were ZIP archives."""
LARGEST_FILE, LARGEST_HEADER = 64 << 20, 4 << 20
"""Bytes that are read at most."""
MOST_DIMENSIONS = 4
_KEY = "texclass"
_UNFIT = (LookupError, TypeError, AttributeError, ArithmeticError, MemoryError, RecursionError)


def printable(name: str) -> str:
    """Return the name of a surface, or raise the ValueError that says why a terminal cannot show it."""
    if len(name) > 200 or not name.isprintable():
        raise ValueError(f"holds {name!r:.80}; the rule is printable text, at most 200 characters")
    return name


class Header(Written):
    """What a file says of itself.

    Attributes
    ----------
    family : str
        Which kind of texture, tap library or scene.
    name : str
        Of the surface or scene.
    fs : float or None
        Sampling rate of the vibration, Hz; taps have none.
    unit : str
        Of the vibration.
    order, operations : number or None
        Of the models, and per rendered sample, where the family has them.
    parameters : mapping
        What is not an array; see `texclass.textures.contract`.
    texclass, version
        What wrote the file, and how.
    sha256 : str
        Of all the others and of the arrays.
    """

    family: str
    name: Annotated[str, AfterValidator(printable)]
    fs: float | None
    unit: Unit
    order: int | None
    operations: float | None
    parameters: dict[str, Any]
    texclass: Annotated[str, AfterValidator(printable)] = __version__
    version: int = Field(
        default=VERSION, ge=VERSION, le=VERSION, description=f"{VERSION}: a newer texclass is needed"
    )
    sha256: str = ""


def header_of(stored: Stored, unit: str, where: object) -> Header:
    """Return what a file of a texture, tap library or scene says of itself; `where` names it in messages."""
    try:
        parameters = json.loads(json.dumps(stored.parameters(), allow_nan=False, sort_keys=True))
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(
            f"{where}: no JSON for the parameters ({error}); the rule is numbers, text"
        ) from error
    facts = {key: getattr(stored, key, None) for key in ("fs", "order", "operations")}
    content = {"family": stored.family, "name": getattr(stored, "name", ""), "unit": unit, **facts}
    return checked(Header, content | {"parameters": parameters}, where)


def write_stored(stored: Stored, path: str | Path, *, unit: str) -> Path:
    """Write a texture, a tap library or a scene; a file of that name is replaced at once, never half written.

    Raises
    ------
    ValueError
        If the path does not end in `.texture`, or something is not what a file may hold.
    """
    path = path_ending(path, SUFFIX)
    arrays = {name: np.array(array, order="C") for name, array in stored.arrays().items()}
    _check_arrays(arrays, path)
    write_whole(path, sealed(header_of(stored, unit, path), arrays))
    return path


def sealed(header: Header, arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return the bytes of a file, its checksum added; the same content makes the same bytes."""
    closed = header.model_copy(update={"sha256": _digest(header, arrays)})
    return save(dict(arrays), {_KEY: closed.model_dump_json()})


def read_container(path: str | Path) -> tuple[Header, dict[str, NDArray[Any]]]:
    """Return header and arrays of a file, every rule of the container checked.

    Raises
    ------
    ValueError
        If it is damaged, of another version, or breaks a rule; the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    begin = read_limited(path, LARGEST_FILE)[:8]
    if begin[:2] == b"PK":
        raise ValueError(
            f"{path}: was written by texclass 0.1; the rule is version {VERSION}: fit or convert the texture "
            "again and save it, or plan the scene again (texclass scene plan)"
        )
    if int.from_bytes(begin, "little") > LARGEST_HEADER:
        raise ValueError(f"{path}: no texture, or a header above {LARGEST_HEADER} bytes; the rule is less")
    try:
        with safe_open(path, "np") as file:
            text = (file.metadata() or {}).get(_KEY, "")
            described = {name: file.get_slice(name) for name in file.offset_keys()}
            for name, part in described.items():
                if part.get_dtype() not in ("F64", "I64") or len(part.get_shape()) > MOST_DIMENSIONS:
                    raise ValueError(
                        f"array {name!r:.80} is {part.get_dtype()} of {len(part.get_shape())} axes"
                    )
            arrays = {name: file.get_tensor(name) for name in described}
        content = from_json(text, allow_inf_nan=False)
    except (SafetensorError, ValueError) as error:
        raise ValueError(f"{path}: is damaged ({error}); the rule is a whole {SUFFIX} file") from error
    header = checked(Header, content, path)
    if text != header.model_dump_json():
        raise ValueError(
            f"{path}: has a header of another form; the rule is each key once, as texclass writes it"
        )
    if header.sha256 != _digest(header, arrays):
        raise ValueError(f"{path}: does not fit its SHA-256; the rule is unchanged data")
    _check_arrays(arrays, path)
    return header, arrays


def read_stored(path: str | Path, families: Mapping[str, str | type[Stored]]) -> Any:
    """Return what a file holds, made again.

    Parameters
    ----------
    path : str or Path
    families : mapping of str to type or str
        What it may hold: family -> its class, or "module:class" to be imported where a file holds it.

    Raises
    ------
    ValueError
        As `read_container`, if it holds another family, or the family finds its own rules broken.
    OSError
        If it cannot be read.
    """
    header, arrays = read_container(path)
    if header.family not in families:
        known = ", ".join(sorted(families))
        raise ValueError(f"{path}: holds {header.family!r:.80}; the rule is one of {known}")
    kind = families[header.family]
    if isinstance(kind, str):
        kind = pkgutil.resolve_name(kind)
    try:
        with np.errstate(all="ignore"):  # of numbers that no surface has: the family's own rules judge them
            found = kind.restore(header.parameters, arrays)
    except (ValueError, *_UNFIT) as error:
        reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        raise ValueError(f"{path}: makes no {header.family!r}: {reason:.500}") from error
    told, held = (header.name, header.fs), (getattr(found, "name", ""), getattr(found, "fs", None))
    if told != held:
        raise ValueError(f"{path}: describes {told}, holds {held}; the rule is the same")
    return found


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
        raise ValueError(f"{path}: is not a file; the rule is a regular file")
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise ValueError(f"{path}: holds {size} bytes; the rule is at most {limit}")
        return file.read(size)


def _check_arrays(arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    for name, array in arrays.items():
        if array.dtype not in (np.float64, np.int64) or not np.isfinite(array).all():
            raise ValueError(f"{path}: array {name} is {array.dtype}; the rule is finite float64 or int64")


def _digest(header: Header, arrays: Mapping[str, NDArray[Any]]) -> str:
    found = hashlib.sha256(header.model_dump_json(exclude={"sha256"}).encode())
    for name in sorted(arrays):
        found.update(f"{name}{arrays[name].dtype}{arrays[name].shape}".encode())
        found.update(arrays[name].tobytes())
    return found.hexdigest()
