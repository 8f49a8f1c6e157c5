"""Write, read and describe .texture files, which contain a texture, a tap library or a planned scene.

A `.texture` file is a safetensors file of arrays with a JSON header; loading it never executes code. The
header contains the family of the object, its unit and its parameters. A SHA-256 checksum of header and arrays
detects damage, but not manipulation. Packed textures are stored as their bytes, without a header.
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
from texclass.haptics.exchange.external_files import check_printable, read_limited
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
    "grid": "texclass.haptics.textures.grid_texture:GridTexture",
    "guruswamy2011": "texclass.haptics.textures.guruswamy2011:SpatialTexture",
    "guruswamy2011-sinusoid": "texclass.haptics.textures.guruswamy2011:SinusoidTexture",
    "hatt": "texclass.haptics.textures.hatt:HattTexture",
    "oeztuerk2018-frequencies": "texclass.haptics.textures.oeztuerk2018:FrequencyTexture",
    "oeztuerk2018-lpc": "texclass.haptics.textures.oeztuerk2018:LpcTexture",
}
"""Allow-list of families and their classes. Only these classes are created from files."""
TAPS: dict[str, str | type[Serializable]] = {
    "okamura2001": "texclass.haptics.textures.okamura2001:TapLibrary"
}
SUFFIX = ".texture"
VERSION = 3
"""Version of the file format. Files of version 1 are ZIP archives."""
MAX_FILE_BYTES, MAX_HEADER_BYTES = 64 << 20, 4 << 20
_KEY = "texclass"


def save_texture(texture: Serializable, path: str | Path, *, unit: str | None = None) -> Path:
    """Write a texture or a tap library to a file.

    The write is atomic: an existing file is replaced only after the new file is complete.

    Parameters
    ----------
    texture : Texture or TapLibrary
        Object whose family is in `TEXTURES` or `TAPS`, or a packed texture.
    path : str or Path
        File to write; must end in `.texture`.
    unit : str, optional
        Unit of the vibration: m/s^2, g, mg, counts, V or arbitrary (default: the unit of the texture, or
        m/s^2).

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    ValueError
        If the path does not end in `.texture`, or the texture contains values that a file cannot store.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from texclass.haptics.textures import pack
    >>> texture = pack(np.random.default_rng(0).standard_normal(2000), n_bytes=32, fs=1000)
    >>> path = save_texture(texture, pathlib.Path(tempfile.mkdtemp()) / "noise.texture")
    >>> load_texture(path).name
    'noise'
    """
    if isinstance(texture, PackedTexture):
        path = check_suffix(path, SUFFIX)
        write_atomic(path, texture.to_bytes())
        return path
    if texture.family not in TEXTURES | TAPS:
        names = ", ".join(sorted(TEXTURES | TAPS))
        raise ValueError(f"{path}: unknown family {texture.family!r:.80}. Expected one of {names}")
    return write_object(texture, path, unit=unit or str(getattr(texture, "unit", "m/s^2")))


def load_texture(path: str | Path) -> Texture:
    """Load a texture from a `.texture` or HaTT `.xml` file.

    The texture renders the same samples as the saved texture.

    Parameters
    ----------
    path : str or Path
        File to read.

    Raises
    ------
    ValueError
        If the file is damaged, does not contain a texture, or contains an invalid value.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from texclass.haptics.textures.hatt import HattTexture
    >>> texture = HattTexture.from_models([100.0], [1.0], [[1.0, 2.0]], [0.25], fs=1000.0, name="cork")
    >>> path = save_texture(texture, pathlib.Path(tempfile.mkdtemp()) / "cork.texture")
    >>> load_texture(path).name
    'cork'
    """
    path = Path(path)
    if path.suffix.lower() == ".xml":
        return read_hatt(path)
    texture: Texture = _read_packed(path) or read_object(path, TEXTURES)
    return texture


def _read_packed(path: Path) -> PackedTexture | None:
    """Return the packed texture in a file, or None if the file has another format."""
    data = read_limited(path, MAX_FILE_BYTES)
    if not data or data[0] != MARK:
        return None
    try:
        return PackedTexture.from_bytes(data, path.stem)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def load_taps(path: str | Path) -> "TapLibrary":
    """Load a tap library from a `.texture` file.

    Parameters
    ----------
    path : str or Path
        File to read.

    Raises
    ------
    ValueError
        If the file is damaged, does not contain a tap library, or contains an invalid value.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from texclass.haptics.textures.okamura2001 import TapLibrary
    >>> from texclass.vibration import TapModel
    >>> library = TapLibrary(("wood",), (TapModel(1500.0, 90.0, 100.0),))
    >>> list(load_taps(save_texture(library, pathlib.Path(tempfile.mkdtemp()) / "taps.texture")))
    ['wood']
    """
    taps: TapLibrary = read_object(path, TAPS)
    return taps


def describe(path: str | Path) -> dict[str, Any]:
    """Return family, range, points, order, sampling rate, unit and size of a `.texture` or `.xml` file.

    The range is that of the speeds and forces of the recording; planned scenes and taps have none.

    Parameters
    ----------
    path : str or Path
        File to read.

    Returns
    -------
    dict of str to object
        Properties as JSON values.

    Raises
    ------
    ValueError
        If the file is damaged, has another format, or contains an invalid value.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from texclass.haptics.textures import pack
    >>> texture = pack(np.random.default_rng(0).standard_normal(2000), n_bytes=32, fs=1000)
    >>> properties = describe(save_texture(texture, pathlib.Path(tempfile.mkdtemp()) / "noise.texture"))
    >>> properties["family"], properties["fs"], properties["unit"]
    ('packed', 1000.0, 'm/s^2')
    """
    path = Path(path)
    texture: Texture | None = None
    if path.suffix.lower() == ".xml":
        texture = read_hatt(path)
        header, arrays = make_header(texture, "m/s^2", path), dict[str, NDArray[Any]](texture.arrays())
        origin = {"format": "HaTT XML"}
    elif (packed := _read_packed(path)) is not None:
        header, arrays = make_header(packed, packed.unit, path), {"data": packed.data}
        texture = packed
        origin = {"format": "packed texture"}
    else:
        header, arrays = read_container(path)
        if header.family in TEXTURES:
            texture = read_object(path, TEXTURES)
        origin = {
            "format": f"texclass texture {header.version}",
            "written by": f"texclass {header.texclass}",
        }
    # shape for each last part of an array name; number of values if several arrays share that part
    shapes = dict[str, list[int]]()
    for name, array in arrays.items():
        last = name.rpartition(".")[2]
        shapes[last] = [int(np.prod(shapes[last])) + array.size] if last in shapes else list(array.shape)
    # number of rows, which are points, triangles, features or modes
    point_arrays = "speed", "triangles", "speeds", "centres", "u", "position_mm", "frequency_hz"
    return {
        "family": header.family,
        "name": header.name,
        **origin,
        "unit": header.unit,
        "fs": header.fs,
        "range": {} if texture is None else _range(texture),
        "points": {name: shapes[name][0] for name in point_arrays if shapes.get(name)},
        "order": header.order,
        "operations per sample": header.operations,
        "bytes": path.stat().st_size,
        "arrays": shapes,
    }


def _range(texture: Texture) -> dict[str, list[float]]:
    """Return the lowest and highest speed and force of a texture; one value if it does not depend on it."""
    axes = {"speed (mm/s)": texture.speeds, "force (N)": texture.forces}
    return {name: [float(end) for end in sorted({axis[0], axis[-1]})] for name, axis in axes.items()}


class Header(StrictModel):
    """Header of a `.texture` file.

    Attributes
    ----------
    family : str
        Family of the object, for example "hatt" or "okamura2001".
    name : str
        Name of the surface or scene.
    fs : float or None
        Sampling rate of the vibration in Hz; None for taps.
    unit : str
        Unit of the vibration.
    order, operations : number or None
        Order of the models and operations per rendered sample; None if the family does not define them.
    parameters : mapping
        Parameters that are not arrays; see `texclass.haptics.textures.contract`.
    texclass, version
        Version of texclass that wrote the file, and version of the file format.
    sha256 : str
        Checksum of all other fields and of the arrays.
    """

    family: str
    name: Annotated[str, AfterValidator(check_printable)]
    fs: float | None
    unit: Unit
    order: int | None
    operations: float | None
    parameters: dict[str, Any]
    texclass: Annotated[str, AfterValidator(check_printable)] = __version__
    version: int = Field(
        default=VERSION, ge=VERSION, le=VERSION, description=f"{VERSION}: a newer texclass is needed"
    )
    sha256: str = ""


def make_header(stored: Serializable, unit: str, where: object) -> Header:
    """Return the header of a texture, tap library or scene; `where` appears in error messages."""
    try:
        parameters = json.loads(json.dumps(stored.parameters(), allow_nan=False, sort_keys=True))
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(
            f"{where}: the parameters cannot be written as JSON ({error}). Expected finite numbers and text"
        ) from error
    facts = {key: getattr(stored, key, None) for key in ("fs", "order", "operations")}
    content = {"family": stored.family, "name": getattr(stored, "name", ""), "unit": unit, **facts}
    return validate(Header, content | {"parameters": parameters}, where)


def write_object(stored: Serializable, path: str | Path, *, unit: str) -> Path:
    """Write a texture, a tap library or a scene atomically.

    Raises
    ------
    ValueError
        If the path does not end in `.texture`, or a value cannot be stored.
    """
    path = check_suffix(path, SUFFIX)
    arrays = {name: np.array(array, order="C") for name, array in stored.arrays().items()}
    _check_arrays(arrays, path)
    write_atomic(path, to_bytes(make_header(stored, unit, path), arrays))
    return path


def to_bytes(header: Header, arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return the bytes of a file, including the checksum. Equal contents yield equal bytes."""
    complete = header.model_copy(update={"sha256": _digest(header, arrays)})
    return save(dict(arrays), {_KEY: complete.model_dump_json()})


def read_container(path: str | Path) -> tuple[Header, dict[str, NDArray[Any]]]:
    """Read and validate the header and the arrays of a file.

    Raises
    ------
    ValueError
        If the file is damaged, has another version, or contains an invalid value.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    start = read_limited(path, MAX_FILE_BYTES)[:8]
    if start[:2] == b"PK":
        raise ValueError(
            f"{path} was written by texclass 0.1. Expected format version {VERSION}. Fit or convert the "
            "texture again, or plan the scene again (texclass scene plan)"
        )
    if int.from_bytes(start, "little") > MAX_HEADER_BYTES:
        raise ValueError(
            f"{path} is not a texture, or its header is larger than {MAX_HEADER_BYTES} bytes. "
            f"Expected a {SUFFIX} file"
        )
    try:
        with safe_open(path, "np") as file:
            text = (file.metadata() or {}).get(_KEY, "")
            slices = {name: file.get_slice(name) for name in file.offset_keys()}
            for name, part in slices.items():
                if part.get_dtype() not in ("F64", "I64") or len(part.get_shape()) > 4:
                    raise ValueError(
                        f"array {name!r:.80} has dtype {part.get_dtype()} and {len(part.get_shape())} axes"
                    )
            arrays = {name: file.get_tensor(name) for name in slices}
        content = from_json(text, allow_inf_nan=False)
    except (SafetensorError, ValueError) as error:
        raise ValueError(f"{path} is damaged ({error}). Expected a complete {SUFFIX} file") from error
    header = validate(Header, content, path)
    if text != header.model_dump_json():
        raise ValueError(
            f"{path}: the header was not written by texclass. Save the object again with texclass"
        )
    if header.sha256 != _digest(header, arrays):
        raise ValueError(f"{path} is damaged: wrong SHA-256 checksum. Copy or save the file again")
    _check_arrays(arrays, path)
    return header, arrays


def read_object(path: str | Path, families: Mapping[str, str | type[Serializable]]) -> Any:
    """Create the object that is stored in a file.

    Parameters
    ----------
    path : str or Path
        File to read.
    families : mapping of str to type or str
        Allow-list of families. Each value is the class, or a string "module:class" that is imported if
        needed.

    Raises
    ------
    ValueError
        If `read_container` rejects the file, its family is not in the list, or the class rejects a value.
    OSError
        If the file cannot be read.
    """
    header, arrays = read_container(path)
    if header.family not in families:
        names = ", ".join(sorted(families))
        raise ValueError(
            f"{path} contains an object of the family {header.family!r:.80}. Expected one of {names}"
        )
    cls = families[header.family]
    if isinstance(cls, str):
        cls = pkgutil.resolve_name(cls)
    try:
        with np.errstate(all="ignore"):  # the class itself rejects implausible numbers
            restored = cls.restore(header.parameters, arrays)
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
        raise ValueError(f"{path}: cannot create {header.family!r}: {reason:.500}") from error
    declared = header.name, header.fs
    actual = getattr(restored, "name", ""), getattr(restored, "fs", None)
    if declared != actual:
        raise ValueError(
            f"{path}: name and fs are {declared} in the header but {actual} in the data. "
            "Save the object again"
        )
    return restored


def _check_arrays(arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    for name, array in arrays.items():
        if array.dtype not in (np.float64, np.int64) or not np.isfinite(array).all():
            raise ValueError(
                f"{path}: array {name} must contain finite float64 or int64 values, got {array.dtype}"
            )


def _digest(header: Header, arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256(header.model_dump_json(exclude={"sha256"}).encode())
    for name in sorted(arrays):
        digest.update(f"{name}{arrays[name].dtype}{arrays[name].shape}".encode())
        digest.update(arrays[name].tobytes())
    return digest.hexdigest()
