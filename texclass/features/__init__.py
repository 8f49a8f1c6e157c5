"""Features of a recording: one decorated function each, one module per perceptual dimension."""

from typing import TYPE_CHECKING

import lazy_loader

DIMENSIONS = (
    "autoregression", "bands", "cepstrum", "decaying_segments", "excess", "fineness", "friction", "hardness",
    "related_work", "roughness", "slopes", "tap_modes",
)  # fmt: skip
"""The modules that hold features."""

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=DIMENSIONS,
    submod_attrs={
        "contract": ["Feature", "Gain", "feature", "find", "load_feature", "registered"],
        "extractor": ["FeatureExtractor"],
        "phase_view": ["UndefinedFeatureError"],
        "sets": ["FeatureSet", "load_feature_set"],
    },
)

if TYPE_CHECKING:
    from texclass.features.contract import Feature as Feature
    from texclass.features.contract import Gain as Gain
    from texclass.features.contract import feature as feature
    from texclass.features.contract import find as find
    from texclass.features.contract import load_feature as load_feature
    from texclass.features.contract import registered as registered
    from texclass.features.extractor import FeatureExtractor as FeatureExtractor
    from texclass.features.phase_view import UndefinedFeatureError as UndefinedFeatureError
    from texclass.features.sets import FeatureSet as FeatureSet
    from texclass.features.sets import load_feature_set as load_feature_set
