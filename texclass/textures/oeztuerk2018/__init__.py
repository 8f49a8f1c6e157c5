"""Signals at any speed from recordings at a few: LPC and major frequencies."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
