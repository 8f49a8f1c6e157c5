"""Benchmark suite: many methods on many datasets under honest splits, with the same stored folds."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
