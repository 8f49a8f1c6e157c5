"""Anisotropic textures of Abdulali and Jeon: input-space segments, AR -> LSF, RBF network; `abdulali2016`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
