"""Define textures: models of a surface that can be rendered at any speed and force. One module per paper."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
