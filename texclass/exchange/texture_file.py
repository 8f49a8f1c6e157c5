"""Texture files of our own: one archive with a description (JSON) and float64 arrays (`.npy`).

`texture.json` says schema and version, family, name, sampling rate, unit, parameters, the version of texclass
that wrote it and, of each array `arrays/NAME.npy`, dtype, shape and SHA-256; its own checksum closes it. They
show damage, not who wrote the file. Reading a file executes nothing in it: see `archive`, `npy`,
`description`.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from texclass._version import __version__
from texclass.exchange import archive, npy
from texclass.exchange.description import SCHEMA, VERSION, decode, encode
from texclass.exchange.families import Stored, family_class
from texclass.exchange.limited import checked_name
from texclass.textures import Texture
from texclass.textures.okamura2001 import TapLibrary

SUFFIX = ".texture"
_DESCRIPTION = "texture.json"
_UNFIT = (LookupError, TypeError, AttributeError, ArithmeticError, MemoryError, RecursionError)


@dataclass(frozen=True, eq=False)
class TextureFile:
    """What a texture file holds, checked, before a texture is made of it.

    Attributes
    ----------
    family : str
        Which texture model.
    name : str
        Of the surface.
    fs : float or None
        Sampling rate of the vibration, Hz; taps have none.
    unit : str
        Of the rendered vibration.
    texclass : str
        Version that wrote the file.
    version : int
        Of the schema.
    n_bytes : int
        Of the file.
    parameters : mapping
        What is not an array.
    arrays : mapping of str to ndarray
        float64, read-only, finite.
    """

    family: str
    name: str
    fs: float | None
    unit: str
    texclass: str
    version: int
    n_bytes: int
    parameters: Mapping[str, Any]
    arrays: Mapping[str, NDArray[np.float64]]


def save_texture(texture: Stored, path: str | Path, *, unit: str | None = None) -> Path:
    """Write a texture or a tap library; a file of that name is replaced at once, never left half written.

    Parameters
    ----------
    texture : Texture or TapLibrary
        Of a known family.
    path : str or Path
        Ends in `.texture`.
    unit : str, optional
        Of the vibration: m/s^2, g, mg, counts, V or arbitrary; by default the texture's own, else m/s^2.

    Returns
    -------
    Path
        Of the file.

    Raises
    ------
    ValueError
        If the path has another ending, or what the texture says of itself is not what a file may hold.
    """
    path = Path(path)
    if path.suffix != SUFFIX:
        raise ValueError(f"{path}: ends in {path.suffix!r}; the rule is {SUFFIX!r}")
    family_class(texture.family)
    dumped = {name: npy.dump(array) for name, array in sorted(texture.arrays().items())}
    members = {_DESCRIPTION: _description(texture, unit or str(getattr(texture, "unit", "m/s^2")), dumped)}
    data = archive.pack(members | {_member(name): each for name, each in dumped.items()})
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        unfinished.write_bytes(data)
        read_texture_file(unfinished)
        unfinished.replace(path)
    except ValueError as error:
        raise ValueError(str(error).replace(str(unfinished), str(path))) from error
    finally:
        unfinished.unlink(missing_ok=True)
    return path


def read_texture_file(path: str | Path) -> TextureFile:
    """Return what a texture file holds, every rule of the schema checked.

    Raises
    ------
    ValueError
        If it is damaged, of a newer schema, or breaks a rule; the message names file, value and rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    members = archive.unpack(path)
    if _DESCRIPTION not in members:
        raise ValueError(f"{path}: holds no {_DESCRIPTION}; the rule is one")
    found = decode(members.pop(_DESCRIPTION), f"{path}: {_DESCRIPTION}")
    expected = {_member(name) for name in found["arrays"]}
    if set(members) != expected:
        odd = sorted(set(members) ^ expected)[0]
        raise ValueError(f"{path}: {odd!r:.80} is not both described and there; the rule is both")
    arrays = {
        name: _array(members[_member(name)], announced, f"{path}: array {name}")
        for name, announced in found["arrays"].items()
    }
    checked_name(found["name"], path)
    return TextureFile(
        found["family"],
        found["name"],
        None if found["fs"] is None else float(found["fs"]),
        found["unit"],
        found["texclass"],
        found["version"],
        path.stat().st_size,
        found["parameters"],
        arrays,
    )


def load_texture(path: str | Path) -> Texture:
    """Return the texture of a file; it renders, bit for bit, what the written one did.

    Raises
    ------
    ValueError
        As `read_texture_file`, if the family is unknown, or if the family finds its own rules broken.
    OSError
        If it cannot be read.
    """
    texture = restore(read_texture_file(path), path)
    if not isinstance(texture, Texture):
        raise ValueError(f"{path}: holds {texture.family!r}, taps; the rule is a texture to stroke")
    return texture


def load_taps(path: str | Path) -> TapLibrary:
    """Return the tap library of a file.

    Raises
    ------
    ValueError, OSError
        As `load_texture`, and if it holds no taps.
    """
    taps = restore(read_texture_file(path), path)
    if not isinstance(taps, TapLibrary):
        raise ValueError(f"{path}: holds {taps.family!r}; the rule is a tap library, {TapLibrary.family!r}")
    return taps


def restore(file: TextureFile, where: object) -> Stored:
    """Return the texture or tap library of what a file holds; `where` names it in messages."""
    try:
        with np.errstate(all="ignore"):  # of numbers that no surface has: the family's own rules judge them
            found = family_class(file.family).restore(file.parameters, file.arrays)
    except (ValueError, *_UNFIT) as error:
        reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        raise ValueError(f"{where}: makes no {file.family!r:.80}: {reason}") from error
    if _name_and_rate(found) != (file.name, file.fs):
        raise ValueError(
            f"{where}: describes {(file.name, file.fs)}, holds {_name_and_rate(found)}; the rule is the same"
        )
    return found


def _description(texture: Stored, unit: str, dumped: Mapping[str, bytes]) -> bytes:
    name, fs = _name_and_rate(texture)
    announced = {
        key: {"dtype": npy.DTYPE, "shape": list(array.shape), "sha256": _digest(dumped[key])}
        for key, array in texture.arrays().items()
    }
    return encode(
        {
            "schema": SCHEMA,
            "version": VERSION,
            "texclass": __version__,
            "family": texture.family,
            "name": name,
            "unit": unit,
            "fs": fs,
            "parameters": dict(texture.parameters()),
            "arrays": announced,
        }
    )


def _name_and_rate(texture: Stored) -> tuple[str, float | None]:
    fs = getattr(texture, "fs", None)
    return getattr(texture, "name", ""), None if fs is None else float(fs)


def _array(data: bytes, announced: Mapping[str, Any], where: str) -> NDArray[np.float64]:
    if _digest(data) != announced["sha256"]:
        raise ValueError(f"{where}: does not fit its SHA-256; the rule is unchanged data")
    return npy.parse(data, tuple(announced["shape"]), where)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _member(name: str) -> str:
    return f"arrays/{name}.npy"
