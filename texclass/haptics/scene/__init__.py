"""Plan scenes, with the cheapest model of each surface within a tolerance, and render them in real time."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
