"""Evaluate pipelines from TOML files on datasets: protocols, folds, intervals, paired tests and costs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
