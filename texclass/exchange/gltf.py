"""A surface as the haptic material of a glTF file, for scenes: `MPEG_haptic_material` (ISO/IEC 23090-14).

The extension's textures hold numbers in place of colours: here the vibration along a stroke, pixel by pixel,
and the coefficient of friction, as grey PNGs inside the file. It says neither their range nor their size;
`extras` beside each texture does. The material hangs on a square, to be put on anything.
"""

import base64
import binascii
import io
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib import image
from numpy.typing import NDArray
from pydantic import AliasPath, Field

from texclass.exchange.foreign import Part, read_foreign
from texclass.exchange.rendition import Rendition, told_level
from texclass.recording import Samples, Unit
from texclass.whole_files import path_ending, write_whole

NAME = "MPEG_haptic_material"
LARGEST_FILE = 8 << 20
WIDEST = 4096
"""Pixels in a row of what is written and read."""
_PNG = "data:image/png;base64,"


class Scale(Part):
    """What black, white and the width of a pixel (mm) stand for; stroked at mm/s and N."""

    minimum: float = -1.0
    maximum: float = 1.0
    unit: Unit = "arbitrary"
    pitch_mm: float = Field(default=0.1, gt=0, le=1e3)
    speed: float = Field(default=100.0, gt=0, le=1e5)
    force: float = Field(default=1.0, gt=0, le=1e5)


class HapticTexture(Part):
    """A texture of numbers."""

    index: int = Field(ge=0, validation_alias=AliasPath("texture", "index"))
    type: Literal["High_Resolution", "Low_Resolution", "Reference", "Other"]
    extras: Scale = Scale()


class Material(Part):
    """What a surface feels like."""

    name: str = ""
    friction: tuple[HapticTexture, ...] = ()
    vibrotactileTexture: tuple[HapticTexture, ...] = ()  # noqa: N815  as the extension spells it


class Image(Part):
    """Inside the file; others are not opened."""

    uri: str = Field(pattern=f"^{_PNG}")


class Texture(Part):
    """Which image."""

    source: int = Field(ge=0)


class Gltf(Part):
    """A .gltf file, as far as it is felt."""

    materials: tuple[Material, ...] = Field(
        min_length=1, validation_alias=AliasPath("extensions", NAME, "materials")
    )
    textures: tuple[Texture, ...]
    images: tuple[Image, ...]


def write_gltf(rendition: Rendition, path: str | Path) -> dict[str, str]:
    """Write a surface as the haptic material of a glTF file, and return what is lost.

    Parameters
    ----------
    rendition : Rendition
        Of `play_texture`; what would exceed `WIDEST` samples is left out.
    path : str or Path
        Ends in `.gltf`.

    Raises
    ------
    ValueError
        If the path has another ending, or the rendition is one of taps: a material has no place for them.
    """
    path = path_ending(path, ".gltf")
    if rendition.taps.size:
        raise ValueError(f"{path}: holds taps; the rule is a texture: a material has no taps")
    x = rendition.samples[:WIDEST]
    peak = float(np.abs(x).max()) or 1.0
    pitch = rendition.pitch_mm or rendition.speed / rendition.fs
    scale = {"minimum": -peak, "maximum": peak, "unit": rendition.unit, "pitch_mm": pitch,
             "speed": rendition.speed, "force": rendition.force or 1.0}  # fmt: skip
    material: dict[str, Any] = {"name": rendition.name, "vibrotactileTexture": [_texture(0, scale)]}
    levels = np.rint((x / peak + 1) / 2 * 255).astype(np.uint8)
    pictures = [levels]
    if mu := rendition.friction:
        most = max(mu, 1.0)
        material["friction"] = [_texture(1, {"minimum": 0.0, "maximum": most})]
        pictures.append(np.rint([mu / most * 255]).astype(np.uint8))
    write_whole(path, json.dumps(_scene(material, pictures), indent=1))
    lost = dict(rendition.lost)
    if not rendition.pitch_mm:
        lost["speed"] += "; frequencies now follow the speed"
    played = (levels / 127.5 - 1) * peak
    return lost | {
        "level": f"{told_level(played, x)}, 255 steps",
        "length": f"{x.size} of {rendition.samples.size} samples, {pitch * x.size:.4g} mm",
    }


def read_gltf(path: str | Path) -> Rendition:
    """Return the first material of a glTF file as played at the speed that it was made for.

    Raises
    ------
    ValueError
        If it is too long, no JSON, has no vibrotactile texture inside, or breaks a rule; the message names
        file, value and rule.
    OSError
        If it cannot be read.
    """
    file = read_foreign(Gltf, path, LARGEST_FILE)
    material = file.materials[0]
    if not material.vibrotactileTexture:
        raise ValueError(f"{path}: its first haptic material has no vibrotactileTexture; the rule is one")
    try:
        x = _values(file, material.vibrotactileTexture[0])
        mu = float(_values(file, material.friction[0]).mean()) if material.friction else 0.0
    except (ValueError, IndexError, OSError, SyntaxError, binascii.Error) as error:
        raise ValueError(
            f"{path}: a texture is unreadable ({error}); the rule is a grey PNG inside"
        ) from None
    scale = material.vibrotactileTexture[0].extras
    lost = {"speed": f"played at {scale.speed:.4g} mm/s", "force": f"played at {scale.force:.4g} N"}
    pitch, v, f = scale.pitch_mm, scale.speed, scale.force
    return Rendition(
        material.name, scale.unit, v / pitch, x, v, f, friction=max(mu, 0.0), pitch_mm=pitch, lost=lost
    )


def _texture(index: int, scale: dict[str, Any]) -> dict[str, Any]:
    return {"texture": {"index": index}, "type": "High_Resolution", "extras": scale}


def _values(file: Gltf, haptic: HapticTexture) -> Samples:
    """Return the numbers (n,) of the middle row of a haptic texture."""
    data = base64.b64decode(file.images[file.textures[haptic.index].source].uri.removeprefix(_PNG))
    width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    if not (0 < width <= WIDEST and 0 < height <= WIDEST):
        raise ValueError(f"has {width} x {height} pixels; the rule is at most {WIDEST} each")
    pixels = np.asarray(image.imread(io.BytesIO(data), format="png"), dtype=np.float64)
    row = pixels[pixels.shape[0] // 2]
    grey = row if row.ndim == 1 else row[:, 0]
    span = haptic.extras.maximum - haptic.extras.minimum
    return np.asarray(haptic.extras.minimum + grey * span)


def _scene(material: dict[str, Any], pictures: list[NDArray[np.uint8]]) -> dict[str, Any]:
    """Return a file with a square of 100 mm on which a material lies, and its pictures (n,), a row each."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype="<f4")
    parts = [0.1 * corners, corners[:, :2], np.array([0, 1, 2, 2, 1, 3], dtype="<u2")]
    data, sizes = b"".join(part.tobytes() for part in parts), [part.nbytes for part in parts]
    views = [{"buffer": 0, "byteOffset": sum(sizes[:i]), "byteLength": n} for i, n in enumerate(sizes)]
    kinds = [(5126, 4, "VEC3"), (5126, 4, "VEC2"), (5123, 6, "SCALAR")]
    accessors: list[dict[str, Any]] = [
        {"bufferView": i, "componentType": number, "count": n, "type": kind}
        for i, (number, n, kind) in enumerate(kinds)
    ]
    accessors[0] |= {"min": [0.0, 0.0, 0.0], "max": [float(np.float32(0.1))] * 2 + [0.0]}
    images = []
    for levels in pictures:
        out = io.BytesIO()
        image.imsave(out, np.repeat(levels[np.newaxis, :, np.newaxis], 3, axis=2), format="png")
        images.append({"uri": _PNG + base64.b64encode(out.getvalue()).decode(), "mimeType": "image/png"})
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}
    return {
        "asset": {"version": "2.0", "generator": "texclass"},
        "extensionsUsed": [NAME],
        "extensions": {NAME: {"materials": [material]}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive], "extensions": {NAME: {"hapticMaterialIndex": 0}}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [
            {
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
                "byteLength": len(data),
            }
        ],
        "textures": [{"source": i} for i in range(len(images))],
        "images": images,
    }
