"""Textures of Guruswamy, Lang and Lee (2011): decaying filters at places, rendered along strokes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
