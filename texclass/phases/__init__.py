"""Where the taps and the movement of a recording are, and what a live stream needs to say so as well."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
