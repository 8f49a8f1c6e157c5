"""Scenes: the cheapest model of each surface within a tolerance, and a real-time renderer for all of them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
