"""Rendered surfaces: textures, files of other devices, scenes, and how a surface feels on six scales."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
