"""Compare texclass with the feature extractors of other libraries (baselines) on the same folds."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
