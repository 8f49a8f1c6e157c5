"""At the extremes: hard inputs for every model, filter, transform and feature, ours and public ones."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
