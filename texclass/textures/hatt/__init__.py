"""Textures as the Penn Haptic Texture Toolkit has them: ARMA models on a plane of speed and force."""

from typing import TYPE_CHECKING

import lazy_loader as lazy

if TYPE_CHECKING:
    from texclass.textures.hatt.arma_texture import HattTexture as HattTexture
    from texclass.textures.hatt.speed_force_mesh import Mesh as Mesh
    from texclass.textures.hatt.speed_force_mesh import triangulate as triangulate

__getattr__, __dir__, __all__ = lazy.attach(
    __name__, submod_attrs={"arma_texture": ["HattTexture"], "speed_force_mesh": ["Mesh", "triangulate"]}
)
