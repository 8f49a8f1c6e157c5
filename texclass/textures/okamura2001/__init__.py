"""Taps as decaying sinusoids: a library of materials, scaled into a device, felt on a virtual wall."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
