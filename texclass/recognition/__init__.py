"""Recognition: models that are trained, saved, asked which surface this is, and listen while it is felt."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
