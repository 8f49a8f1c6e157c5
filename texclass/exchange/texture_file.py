"""Texture files of our own: save a texture or a library of taps, load it, say what is in a file."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from texclass.exchange import container
from texclass.exchange.hatt_xml import read_hatt
from texclass.textures.contract import Stored, Texture
from texclass.textures.packed import MARK, PackedTexture
from texclass.whole_files import path_ending, write_whole

if TYPE_CHECKING:
    from texclass.textures.okamura2001 import TapLibrary

TEXTURES: dict[str, str | type[Stored]] = {
    "abdulali2016": "texclass.textures.abdulali2016:NetworkTexture",
    "abdulali2016-baked": "texclass.textures.abdulali2016:BakedTexture",
    "abdulali2016-delaunay": "texclass.textures.abdulali2016:DelaunayTexture",
    "guruswamy2011": "texclass.textures.guruswamy2011:SpatialTexture",
    "guruswamy2011-sinusoid": "texclass.textures.guruswamy2011:SinusoidTexture",
    "hatt": "texclass.textures.hatt:HattTexture",
    "oeztuerk2018-frequencies": "texclass.textures.oeztuerk2018:FrequencyTexture",
    "oeztuerk2018-lpc": "texclass.textures.oeztuerk2018:LpcTexture",
}
"""Family -> class: nothing else is ever made of a file."""
TAPS: dict[str, str | type[Stored]] = {"okamura2001": "texclass.textures.okamura2001:TapLibrary"}
_POINTS = ("speed", "triangles", "speeds", "centres", "u", "position_mm", "frequency_hz")
"""Arrays with one row a point, triangle, feature or mode."""


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
    if isinstance(texture, PackedTexture):
        path = path_ending(path, container.SUFFIX)
        write_whole(path, texture.to_bytes())
        return path
    if texture.family not in TEXTURES | TAPS:
        known = ", ".join(sorted(TEXTURES | TAPS))
        raise ValueError(f"{path}: family is {texture.family!r:.80}; the rule is one of {known}")
    return container.write_stored(texture, path, unit=unit or str(getattr(texture, "unit", "m/s^2")))


def load_texture(path: str | Path) -> Texture:
    """Return the texture of a file; it renders, bit for bit, what the written one did.

    Raises
    ------
    ValueError
        If the file is damaged, holds something else, or the family finds its own rules broken; the message
        names file, value and rule.
    OSError
        If it cannot be read.
    """
    packed = _packed(Path(path))
    if packed is not None:
        return packed
    texture: Texture = container.read_stored(path, TEXTURES)
    return texture


def _packed(path: Path) -> PackedTexture | None:
    """Return the texture of a file that is nothing but its bytes; None if it is a container."""
    begin = container.read_limited(path, container.LARGEST_FILE)
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
    taps: TapLibrary = container.read_stored(path, TAPS)
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
        header, arrays = container.header_of(hatt, "m/s^2", path), dict[str, NDArray[Any]](hatt.arrays())
        origin = {"format": "HaTT XML"}
    elif (packed := _packed(path)) is not None:
        header, arrays = container.header_of(packed, packed.unit, path), {"data": packed.data}
        origin = {"format": "packed texture"}
    else:
        header, arrays = container.read_container(path)
        written = {"written by": f"texclass {header.texclass}"}
        origin = {"format": f"texclass texture {header.version}", **written}
    shapes = dict[str, list[int]]()  # by the last part of the name; where several share it, how many numbers
    for name, array in arrays.items():
        last = name.rpartition(".")[2]
        shapes[last] = [int(np.prod(shapes[last])) + array.size] if last in shapes else list(array.shape)
    return {
        "family": header.family,
        "name": header.name,
        **origin,
        "unit": header.unit,
        "fs": header.fs,
        "points": {name: shapes[name][0] for name in _POINTS if shapes.get(name)},
        "order": header.order,
        "operations per sample": header.operations,
        "bytes": path.stat().st_size,
        "arrays": shapes,
    }
