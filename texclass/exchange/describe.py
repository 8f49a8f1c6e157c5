"""What is in a texture file, in a few words."""

from pathlib import Path
from typing import Any

from texclass.exchange.families import Stored
from texclass.exchange.hatt_xml import read_hatt
from texclass.exchange.texture_file import read_texture_file, restore

_POINTS = ("speed", "triangles", "speeds", "centres", "u", "position_mm", "frequency_hz")
"""Arrays with one row a point, triangle, feature or mode."""


def describe(path: str | Path) -> dict[str, Any]:
    """Return family, points, order, rate, unit and bytes of a `.texture` or HaTT `.xml`, as JSON knows them.

    Raises
    ------
    ValueError, OSError
        As `load_texture` and `read_hatt`.
    """
    path = Path(path)
    if path.suffix.lower() == ".xml":
        texture: Stored = read_hatt(path)
        head = {"format": "HaTT XML", "unit": "m/s^2"}
    else:
        file = read_texture_file(path)
        texture = restore(file, path)
        head = {
            "format": f"texclass texture {file.version}",
            "written by": f"texclass {file.texclass}",
            "unit": file.unit,
        }
    arrays = texture.arrays()
    points = {name: len(arrays[name]) for name in _POINTS if name in arrays and arrays[name].ndim}
    return {
        "family": texture.family,
        "name": getattr(texture, "name", ""),
        **head,
        "fs": getattr(texture, "fs", None),
        "points": points,
        "order": getattr(texture, "order", None),
        "operations per sample": getattr(texture, "operations", None),
        "bytes": path.stat().st_size,
        "arrays": {name: list(array.shape) for name, array in arrays.items()},
    }
