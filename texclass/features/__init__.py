"""Features: one decorated function each; importing this index registers them all."""

from texclass.features import (
    autoregression,
    cepstrum,
    fineness,
    friction,
    hardness,
    macroscopic,
    modes,
    related,
    related_spectra,
    roughness,
    segments,
    taps,
)
from texclass.features.contract import Feature, Gain, UndefinedFeatureError, feature, find, registered
from texclass.features.extractor import FeatureExtractor
from texclass.features.own import load_feature
from texclass.features.sets import FeatureSet, load_feature_set

__all__ = [
    "Feature",
    "FeatureExtractor",
    "FeatureSet",
    "Gain",
    "UndefinedFeatureError",
    "autoregression",
    "cepstrum",
    "feature",
    "find",
    "fineness",
    "friction",
    "hardness",
    "load_feature",
    "load_feature_set",
    "macroscopic",
    "modes",
    "registered",
    "related",
    "related_spectra",
    "roughness",
    "segments",
    "taps",
]
