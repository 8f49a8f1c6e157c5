"""Pages of several results, the listings of what is shipped, and the picture of one recording."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
