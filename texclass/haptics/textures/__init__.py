"""From recordings to a surface that can be felt at any speed and force: a module or a folder per paper."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
