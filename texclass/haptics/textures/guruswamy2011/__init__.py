"""Spatial textures of `guruswamy2011`: decaying filters at positions, rendered along strokes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
