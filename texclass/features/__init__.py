"""Features: one decorated function each; importing this index registers them all."""

from texclass.features import (
    autoregression,
    bands,
    cepstrum,
    differences,
    excess,
    fineness,
    friction,
    hardness,
    macroscopic,
    modes,
    modulation,
    related,
    related_spectra,
    roughness,
    segments,
    shape,
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
    "bands",
    "cepstrum",
    "differences",
    "excess",
    "feature",
    "find",
    "fineness",
    "friction",
    "hardness",
    "load_feature",
    "load_feature_set",
    "macroscopic",
    "modes",
    "modulation",
    "registered",
    "related",
    "related_spectra",
    "roughness",
    "segments",
    "shape",
    "taps",
]
