"""Recordings in: files of every format, cards of datasets, folders of one's own, simulated datasets."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
