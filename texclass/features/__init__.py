"""Features: one decorated function each; importing this index registers them all."""

from texclass.features import (
    cepstrum,
    fineness,
    friction,
    hardness,
    macroscopic,
    related,
    related_spectra,
    roughness,
    taps,
)
from texclass.features.contract import Feature, Gain, UndefinedFeatureError, feature, find, registered
from texclass.features.extractor import FeatureExtractor
from texclass.features.sets import FeatureSet, load_feature_set

__all__ = [
    "Feature",
    "FeatureExtractor",
    "FeatureSet",
    "Gain",
    "UndefinedFeatureError",
    "cepstrum",
    "feature",
    "find",
    "fineness",
    "friction",
    "hardness",
    "load_feature_set",
    "macroscopic",
    "registered",
    "related",
    "related_spectra",
    "roughness",
    "taps",
]
