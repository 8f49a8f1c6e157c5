"""Convert any texture file to a scene, for pages and C headers: exactly if possible, or else by planning."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from texclass.haptics.exchange import describe, load_taps, load_texture
from texclass.haptics.scene.definition import scene_from_texture
from texclass.haptics.scene.plan import plan_scene
from texclass.haptics.scene.renderer import PlannedScene, load_scene
from texclass.haptics.textures import GridTexture, PackedTexture
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import DecayingModes, TapModel
from texclass.vibration.decaying_modes import NO_MODES

Taps = dict[str, TapModel | DecayingModes]
TAP_FS = 8000.0
"""Sampling rate in Hz at which taps without textures are rendered; the highest frequency of MPEG haptics is
half of it."""


def scene_of_file(
    path: str | Path, *, max_fs: float = np.inf, progress: Callable[[int, int, str], None] | None = None
) -> tuple[PlannedScene, Taps, dict[str, str]]:
    """Load a scene, a texture or a tap library as a scene.

    Parameters
    ----------
    path : str or Path
        A `.texture` file, or the `.xml` file of a HaTT texture.
    max_fs : float
        Largest sampling rate in Hz of a model that is used without planning (default: no limit).
    progress : callable, optional
        Callback `progress(n_done, n_total, "surfaces")`.

    Returns
    -------
    scene : PlannedScene
        The scene of the file; a scene with the model of a grid or packed texture; a scene of silent surfaces
        for taps; or else a planned scene, see `scene_from_texture`.
    taps : dict of str to TapModel or DecayingModes
        Taps of the file by surface.
    losses : dict of str to str
        Description of the information that is lost, by topic.

    Raises
    ------
    ValueError
        If the file is damaged, or has no such content.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    facts = describe(path)
    unit = facts["unit"]
    if facts["family"] == PlannedScene.family:
        return load_scene(path), {}, {}
    if facts["family"] == TapLibrary.family:
        library = load_taps(path)
        indices = dict.fromkeys(library, 0)
        band = 20.0, 0.45 * TAP_FS
        silent = PlannedScene("taps", TAP_FS, unit, band, 1e6, 1, indices, (GridModel.silence(),))
        return silent, dict(library), {}
    texture = load_texture(path)
    name = texture.name or path.stem
    tap = texture.tap if isinstance(texture, PackedTexture) else NO_MODES
    taps: Taps = {name: tap} if tap.n_modes else {}
    if isinstance(texture, GridTexture | PackedTexture) and texture.fs <= max_fs:
        model = texture.model if isinstance(texture, PackedTexture) else texture.grid
        return PlannedScene.of_model(name, texture.fs, unit, model), taps, {}
    (surface,) = (plan := plan_scene(scene_from_texture(path), progress=progress)).surfaces
    error, order = max(surface.score["scores"]), surface.model.order
    nodes = " x ".join(map(str, surface.model.n_nodes))
    kind = f"AR of order {order} on {nodes} nodes" if order else f"{surface.model.n_lines} lines"
    losses = {"model": f"approximated by {kind}, up to {error:.1f} dB different in 64 subbands"}
    if getattr(texture, "length_mm", 0.0):
        losses["position"] = "the positions of features on the surface"
    return plan.scene, taps, losses
