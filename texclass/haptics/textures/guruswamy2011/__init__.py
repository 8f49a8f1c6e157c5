"""Fit and render spatial textures (`guruswamy2011`): decaying filters at positions along a stroke."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
