"""Textures as HaTT XML, in the layout that `hatt_xml` describes; numbers are written in full."""

import os
from collections.abc import Iterable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from texclass.exchange.limited import checked_name
from texclass.recording import Samples
from texclass.textures.hatt import HattTexture
from texclass.vibration import Autoregression, line_spectrum


def write_hatt(texture: HattTexture, path: str | Path) -> Path:
    """Write a texture as HaTT XML; a file of that name is replaced at once.

    The toolkit renders at 1000 Hz whatever SampleRate says: fit at that rate for it.

    Raises
    ------
    ValueError
        If the path does not end in `.xml`, the name cannot be shown, or an order is so high that coefficients
        no longer describe the model (ARcoeff belongs to the layout).
    """
    path = Path(path)
    if path.suffix.lower() != ".xml":
        raise ValueError(f"{path}: ends in {path.suffix!r}; the rule is '.xml'")
    checked_name(texture.name, path)
    lines = [*_head(texture), *_models(texture), "</modelSet>", ""]
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        unfinished.write_text("\n".join(lines), encoding="utf-8")
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
    return path


def _head(texture: HattTexture) -> list[str]:
    mesh = texture.mesh
    image = f"{escape(texture.name)}_square.bmp"
    return [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<modelSet texture="0">',
        _tag("material", escape(texture.name)),
        _tag("AccelUnits", "m/s^2"),
        _tag("SpeedUnits", "mm/s"),
        _tag("ForceUnits", "N"),
        _tag("SampleRate", f"{texture.fs:.17g}"),
        _tag("mu", repr(float(texture.mu))),
        *(_tag(tag, image) for tag in ("htmlPicture", "htmlLinuxPicture", "renderPicture")),
        _tag("numMod", str(mesh.speed.size)),
        _tag("numTri", str(len(mesh.triangles))),
        _tag("maxSpeed", repr(float(mesh.speed.max()))),
        _tag("maxForce", repr(float(mesh.force.max()))),
        *_array("speedList", mesh.speed, ' type="array"'),
        *_array("forceList", mesh.force, ' type="array"'),
        *(line for corners in mesh.triangles + 1 for line in _array("tri", corners, ' type="array"')),
        *(_tag(tag, "") for tag in ("DTpicture", "LinuxDTpicture")),
        _tag("numARCoeff", str(texture.order)),
        _tag("numMACoeff", str(texture.ma_order)),
    ]


def _models(texture: HattTexture) -> Iterable[str]:
    for i in range(texture.mesh.speed.size):
        yield "<model>"
        yield _tag("modNum", str(i + 1))
        for part, lsf in (("AR", texture.ar_lsf[i]), ("MA", texture.ma_lsf[i])):
            yield from _array(f"{part}coeff", _coefficients(lsf))
            yield from _array(f"{part}lsf", lsf)
        # without an MA part the toolkit takes no gain
        gain = float(texture.gain[i])
        variance = float(texture.variance[i]) * (1.0 if texture.ma_order else gain**2)
        yield _tag("var", repr(variance))
        yield _tag("gain", repr(gain if texture.ma_order else 1.0))
        yield _tag("speedMod", repr(float(texture.mesh.speed[i])))
        yield _tag("forceMod", repr(float(texture.mesh.force[i])))
        yield "</model>"


def _coefficients(lsf: Samples) -> Samples:
    """Return 1, a_1 ... of line spectra; 1 alone of none."""
    if not lsf.size:
        return np.ones(1)
    return Autoregression(line_spectrum.to_reflection(lsf), np.array(1.0)).direct_form()


def _array(tag: str, values: Samples, attributes: str = "") -> list[str]:
    inner = [_tag("value", repr(value)) for value in values.tolist()]
    return [f"<{tag}{attributes}>", *inner, f"</{tag}>"]


def _tag(tag: str, text: str) -> str:
    return f"<{tag}>{text}</{tag}>"
