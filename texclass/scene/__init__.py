"""From textures to a scene: the cheapest that serve, rendered sample by sample, and exchanged as files."""

from texclass.scene.definition import (
    Budget,
    Device,
    Expected,
    SceneDefinition,
    SurfaceDefinition,
    Tolerance,
    read_scene,
)
from texclass.scene.models import GridModel
from texclass.scene.paths import HandPath, read_path, sweep
from texclass.scene.plan import PlannedSurface, ScenePlan, plan_scene
from texclass.scene.planned import PlannedScene, load_scene
from texclass.scene.playing import Played, play_path, sweep_of
from texclass.scene.renderer import SceneRenderer

__all__ = [
    "Budget",
    "Device",
    "Expected",
    "GridModel",
    "HandPath",
    "PlannedScene",
    "PlannedSurface",
    "Played",
    "SceneDefinition",
    "ScenePlan",
    "SceneRenderer",
    "SurfaceDefinition",
    "Tolerance",
    "load_scene",
    "plan_scene",
    "play_path",
    "read_path",
    "read_scene",
    "sweep",
    "sweep_of",
]
