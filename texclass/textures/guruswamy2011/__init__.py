"""Textures of Guruswamy, Lang and Lee (2011): decaying filters at places, rendered along strokes."""

from texclass.textures.guruswamy2011.fit import FittedScan, fit_texture
from texclass.textures.guruswamy2011.level import Amplitude, LevelFit, LevelLaw, fit_level_law
from texclass.textures.guruswamy2011.renderer import SpatialRenderer
from texclass.textures.guruswamy2011.texture import SinusoidTexture, SpatialTexture

__all__ = [
    "Amplitude",
    "FittedScan",
    "LevelFit",
    "LevelLaw",
    "SinusoidTexture",
    "SpatialRenderer",
    "SpatialTexture",
    "fit_level_law",
    "fit_texture",
]
