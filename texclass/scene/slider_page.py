"""A page in which sliders make a texture rougher, harder, ... while it is stroked.

The page holds the texture as `retouch` makes it at some values of each scale, one scale at a time.
`feel/sliders.js` adds up what several do: at those values it plays what `texclass convert --scale` writes.
"""

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from texclass.features.scales import SCALES
from texclass.scene.feel_page import feel_page, tap_modes
from texclass.scene.renderer import PlannedScene
from texclass.textures import PackedTexture, Texture, felt_scales, retouch
from texclass.textures.retouch import OF_SPECTRUM
from texclass.whole_files import path_ending, write_whole

VALUES = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)
"""Of each scale, beside its own; of `hard`, which goes by a law, and of `sticky`, not heard, the ends."""
APART = 0.5
"""From the texture's own value, at least."""


def slider_page(
    texture: Texture,
    *,
    file: str = "surface.texture",
    unit: str = "m/s^2",
    n_bytes: int = 128,
    progress: Callable[[int, int, str], None] | None = None,
) -> str:
    """Return a texture as a page of HTML with a slider for each scale that it has (see `felt_scales`).

    Parameters
    ----------
    texture : Texture
        As for `retouch`.
    file : str
        Its name in the command that the page says.
    unit : str
        Of the vibration.
    n_bytes : int
        Of each model; see `pack`.
    progress : callable, optional
        Called with (done, total, what).

    Raises
    ------
    ValueError
        If the texture cannot be retouched at all. What is out of reach shortens a slider.
    """
    felt = {name: round(value, 1) for name, value in felt_scales(texture).items()}
    base = retouch(texture, n_bytes, unit=unit, rough=felt["rough"])
    models, scales = [base], dict[str, Any]()
    for done, (name, value) in enumerate(felt.items()):
        if progress is not None:
            progress(done, len(felt), name)
        source = texture if name in OF_SPECTRUM else base
        found = _along(source, name, value, base, n_bytes, unit)
        if len(found) == 1:  # nothing else is in reach
            continue
        scales[name] = {"value": value, "values": list(found), "end": SCALES[name].other_end}
        if name in OF_SPECTRUM:
            scales[name]["models"] = list(range(len(models), len(models) + len(found)))
            models += found.values()
        elif name == "hard":
            scales[name]["taps"] = [tap_modes(one.tap) for one in found.values()]
    grids = [one.model for one in (*models, base, base)]  # the last two take what is blended
    order = max(one.order for one in grids)
    of_one_order = [np.pad(one.rows, ((0, 0), (0, 0), (0, order - one.order))) for one in grids]
    grids = [replace(one, rows=rows) for one, rows in zip(grids, of_one_order, strict=True)]
    name = texture.name or Path(file).stem
    scene = PlannedScene(name, base.fs, base.unit, (20.0, 0.45 * base.fs), 1e6, 1, {name: 0}, tuple(grids))
    command = f"texclass convert {shlex.quote(file)} -o changed.texture"
    command += f" --bytes {n_bytes}" if n_bytes != 128 else ""
    taps = {name: base.tap} if base.tap.n_modes else {}
    more = {"scales": scales, "command": command}
    return feel_page(scene, taps=taps, title=f"How {name} feels", more=more)


def write_slider_page(path: str | Path, texture: Texture, **given: Any) -> Path:
    """Write what `slider_page` returns; a file of that name is replaced at once.

    Raises
    ------
    ValueError
        As `slider_page`, or if the name does not end in `.html`.
    """
    path = path_ending(path, ".html")
    write_whole(path, slider_page(texture, **given).encode())
    return path


def _along(
    texture: Texture, name: str, value: float, base: PackedTexture, n_bytes: int, unit: str
) -> dict[float, PackedTexture]:
    """Return the texture at values of a scale, from its own on both ways as far as it goes."""
    found = {value: base}
    below = [v for v in reversed(VALUES) if v < value - APART]
    above = [v for v in VALUES if v > value + APART]
    for beyond in (below, above):
        for v in beyond if name in OF_SPECTRUM else beyond[-1:]:
            try:
                found[v] = retouch(texture, n_bytes, unit=unit, **{name: v})
            except ValueError:
                break
    return dict(sorted(found.items()))
