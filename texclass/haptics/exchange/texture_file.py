"""Texture files of our own: textures, libraries of taps and planned scenes, written, read and described.

A `.texture` file is one safetensors file of arrays and a header, and can execute nothing. The header says
which family of textures it holds, in which unit, made of which parameters, and closes with a checksum over
all of it, which shows damage, not who wrote the file. A packed texture is nothing but its bytes.
"""

import hashlib
import json
import pkgutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field
from pydantic_core import from_json
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from texclass._version import __version__
from texclass.atomic_write import check_suffix, write_atomic
from texclass.haptics.exchange.foreign import printable, read_limited
from texclass.haptics.exchange.hatt_xml import read_hatt
from texclass.haptics.textures.contract import Serializable, Texture
from texclass.haptics.textures.packed import MARK, PackedTexture
from texclass.recording import Unit
from texclass.validation import StrictModel, validate

if TYPE_CHECKING:
    from texclass.haptics.textures.okamura2001 import TapLibrary

TEXTURES: dict[str, str | type[Serializable]] = {
    "abdulali2016": "texclass.haptics.textures.abdulali2016:NetworkTexture",
    "abdulali2016-baked": "texclass.haptics.textures.abdulali2016:BakedTexture",
    "abdulali2016-delaunay": "texclass.haptics.textures.abdulali2016:DelaunayTexture",
    "guruswamy2011": "texclass.haptics.textures.guruswamy2011:SpatialTexture",
    "guruswamy2011-sinusoid": "texclass.haptics.textures.guruswamy2011:SinusoidTexture",
    "hatt": "texclass.haptics.textures.hatt:HattTexture",
    "oeztuerk2018-frequencies": "texclass.haptics.textures.oeztuerk2018:FrequencyTexture",
    "oeztuerk2018-lpc": "texclass.haptics.textures.oeztuerk2018:LpcTexture",
}
"""Family -> class: nothing else is ever made of a file."""
TAPS: dict[str, str | type[Serializable]] = {
    "okamura2001": "texclass.haptics.textures.okamura2001:TapLibrary"
}
SUFFIX = ".texture"
VERSION = 2
"""Of the header. Files of version 1 were ZIP archives."""
LARGEST_FILE, LARGEST_HEADER = 64 << 20, 4 << 20
"""Bytes that are read at most."""
_KEY = "texclass"


def save_texture(texture: Serializable, path: str | Path, *, unit: str | None = None) -> Path:
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
    if isinstance(texture, PackedTexture):
        path = check_suffix(path, SUFFIX)
        write_atomic(path, texture.to_bytes())
        return path
    if texture.family not in TEXTURES | TAPS:
        known = ", ".join(sorted(TEXTURES | TAPS))
        raise ValueError(f"{path}: family is {texture.family!r:.80}. Expected one of {known}")
    return write_stored(texture, path, unit=unit or str(getattr(texture, "unit", "m/s^2")))


def load_texture(path: str | Path) -> Texture:
    """Return the texture of a `.texture` or HaTT `.xml`; it renders, bit for bit, what the written one did.

    Raises
    ------
    ValueError
        If the file is damaged, holds something else, or the family finds its own rules broken; the message
        names file, value and rule.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() == ".xml":
        return read_hatt(path)
    texture: Texture = _packed(path) or read_stored(path, TEXTURES)
    return texture


def _packed(path: Path) -> PackedTexture | None:
    """Return the texture of a file that is nothing but its bytes; None if it is a container."""
    begin = read_limited(path, LARGEST_FILE)
    if not begin or begin[0] != MARK:
        return None
    try:
        return PackedTexture.from_bytes(begin, path.stem)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def load_taps(path: str | Path) -> "TapLibrary":
    """Return the tap library of a file.

    Raises
    ------
    ValueError, OSError
        As `load_texture`.
    """
    taps: TapLibrary = read_stored(path, TAPS)
    return taps


def describe(path: str | Path) -> dict[str, Any]:
    """Return family, points, order, rate, unit and bytes of a `.texture` or HaTT `.xml`, as JSON knows them.

    Raises
    ------
    ValueError, OSError
        As `load_texture` and `read_hatt`.
    """
    path = Path(path)
    if path.suffix.lower() == ".xml":
        hatt = read_hatt(path)
        header, arrays = header_of(hatt, "m/s^2", path), dict[str, NDArray[Any]](hatt.arrays())
        origin = {"format": "HaTT XML"}
    elif (packed := _packed(path)) is not None:
        header, arrays = header_of(packed, packed.unit, path), {"data": packed.data}
        origin = {"format": "packed texture"}
    else:
        header, arrays = read_container(path)
        written = {"written by": f"texclass {header.texclass}"}
        origin = {"format": f"texclass texture {header.version}", **written}
    shapes = dict[str, list[int]]()  # by the last part of the name; where several share it, how many numbers
    for name, array in arrays.items():
        last = name.rpartition(".")[2]
        shapes[last] = [int(np.prod(shapes[last])) + array.size] if last in shapes else list(array.shape)
    # with one row a point, triangle, feature or mode
    counted = "speed", "triangles", "speeds", "centres", "u", "position_mm", "frequency_hz"
    return {
        "family": header.family,
        "name": header.name,
        **origin,
        "unit": header.unit,
        "fs": header.fs,
        "points": {name: shapes[name][0] for name in counted if shapes.get(name)},
        "order": header.order,
        "operations per sample": header.operations,
        "bytes": path.stat().st_size,
        "arrays": shapes,
    }


class Header(StrictModel):
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
        What is not an array; see `texclass.haptics.textures.contract`.
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


def header_of(stored: Serializable, unit: str, where: object) -> Header:
    """Return what a file of a texture, tap library or scene says of itself; `where` names it in messages."""
    try:
        parameters = json.loads(json.dumps(stored.parameters(), allow_nan=False, sort_keys=True))
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{where}: no JSON for the parameters ({error}). Expected numbers, text") from error
    facts = {key: getattr(stored, key, None) for key in ("fs", "order", "operations")}
    content = {"family": stored.family, "name": getattr(stored, "name", ""), "unit": unit, **facts}
    return validate(Header, content | {"parameters": parameters}, where)


def write_stored(stored: Serializable, path: str | Path, *, unit: str) -> Path:
    """Write a texture, a tap library or a scene; a file of that name is replaced at once, never half written.

    Raises
    ------
    ValueError
        If the path does not end in `.texture`, or something is not what a file may hold.
    """
    path = check_suffix(path, SUFFIX)
    arrays = {name: np.array(array, order="C") for name, array in stored.arrays().items()}
    _check_arrays(arrays, path)
    write_atomic(path, sealed(header_of(stored, unit, path), arrays))
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
            f"{path}: was written by texclass 0.1. Expected version {VERSION}: fit or convert the texture "
            "again and save it, or plan the scene again (texclass scene plan)"
        )
    if int.from_bytes(begin, "little") > LARGEST_HEADER:
        raise ValueError(f"{path}: no texture, or a header above {LARGEST_HEADER} bytes. Expected less")
    try:
        with safe_open(path, "np") as file:
            text = (file.metadata() or {}).get(_KEY, "")
            described = {name: file.get_slice(name) for name in file.offset_keys()}
            for name, part in described.items():
                if part.get_dtype() not in ("F64", "I64") or len(part.get_shape()) > 4:
                    raise ValueError(
                        f"array {name!r:.80} is {part.get_dtype()} of {len(part.get_shape())} axes"
                    )
            arrays = {name: file.get_tensor(name) for name in described}
        content = from_json(text, allow_inf_nan=False)
    except (SafetensorError, ValueError) as error:
        raise ValueError(f"{path}: is damaged ({error}). Expected a whole {SUFFIX} file") from error
    header = validate(Header, content, path)
    if text != header.model_dump_json():
        raise ValueError(
            f"{path}: has a header of another form. Expected each key once, as texclass writes it"
        )
    if header.sha256 != _digest(header, arrays):
        raise ValueError(f"{path}: does not fit its SHA-256. Expected unchanged data")
    _check_arrays(arrays, path)
    return header, arrays


def read_stored(path: str | Path, families: Mapping[str, str | type[Serializable]]) -> Any:
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
        raise ValueError(f"{path}: holds {header.family!r:.80}. Expected one of {known}")
    kind = families[header.family]
    if isinstance(kind, str):
        kind = pkgutil.resolve_name(kind)
    try:
        with np.errstate(all="ignore"):  # of numbers that no surface has: the family's own rules judge them
            found = kind.restore(header.parameters, arrays)
    except (
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        ArithmeticError,
        MemoryError,
        RecursionError,
    ) as error:
        reason = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        raise ValueError(f"{path}: makes no {header.family!r}: {reason:.500}") from error
    told, held = (header.name, header.fs), (getattr(found, "name", ""), getattr(found, "fs", None))
    if told != held:
        raise ValueError(f"{path}: describes {told}, holds {held}. Expected the same")
    return found


def _check_arrays(arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    for name, array in arrays.items():
        if array.dtype not in (np.float64, np.int64) or not np.isfinite(array).all():
            raise ValueError(f"{path}: array {name} is {array.dtype}. Expected finite float64 or int64")


def _digest(header: Header, arrays: Mapping[str, NDArray[Any]]) -> str:
    found = hashlib.sha256(header.model_dump_json(exclude={"sha256"}).encode())
    for name in sorted(arrays):
        found.update(f"{name}{arrays[name].dtype}{arrays[name].shape}".encode())
        found.update(arrays[name].tobytes())
    return found.hexdigest()
