"""What accuracy costs: time, features, seconds of touch, bits; the recogniser at a budget."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
