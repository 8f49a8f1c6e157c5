"""Classifiers with the scikit-learn API: kernel discriminant, and voting over the segments of a movement."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
