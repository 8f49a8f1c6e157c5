"""Features of a recording: one decorated function each, one module per perceptual dimension."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
