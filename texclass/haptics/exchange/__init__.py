"""File formats for surfaces and vibrations: .texture, HaTT XML, MPEG haptics, AHAP and WAV.

Reading a file never executes code.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
