"""From recordings to a surface that can be felt at any speed and force: one folder per paper."""

from texclass.textures.contract import Renderer, Texture
from texclass.textures.scan import Scan

__all__ = ["Renderer", "Scan", "Texture"]
