"""Textures as the Penn Haptic Texture Toolkit has them: ARMA models on a plane of speed and force."""

from texclass.textures.hatt.mesh import Mesh, triangulate
from texclass.textures.hatt.renderer import HattRenderer
from texclass.textures.hatt.texture import HattTexture

__all__ = ["HattRenderer", "HattTexture", "Mesh", "triangulate"]
