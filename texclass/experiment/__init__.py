"""Experiments: a pipeline TOML evaluated on a dataset, with intervals, paired tests and costs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
