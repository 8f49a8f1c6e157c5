"""Models of a vibration: fit -> parameters -> synthesize -> score."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
