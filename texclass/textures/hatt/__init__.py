"""Textures as the Penn Haptic Texture Toolkit has them: ARMA models on a plane of speed and force."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
