"""Surfaces and vibrations as files: our own, Penn's HaTT XML, MPEG haptics, AHAP, WAV.

Nothing in a file is ever executed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
