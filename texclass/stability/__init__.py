"""Test models, filters, transforms and features of texclass and of other libraries on extreme inputs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
