"""Fit and render anisotropic textures (`abdulali2016`): input segments, AR models and an RBF network."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
