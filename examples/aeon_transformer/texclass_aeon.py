"""Features of texclass as a transformer of aeon's: a collection of series in, a table of features out.

A package of its own (`pip install examples/aeon_transformer`), which passes aeon's checks
(`pytest tests/baselines/test_aeon_transformer.py`). `texclass.loaders.collection_of` makes a collection of
recordings. Every series is a movement from its first sample to its last; a feature that is undefined for a
series is NaN, so impute before most classifiers.
"""

from aeon.transformations.collection import BaseCollectionTransformer

from texclass import FeatureExtractor


class TexclassFeatures(BaseCollectionTransformer):
    """Features of movements recorded by an accelerometer.

    Parameters
    ----------
    features : str, path or FeatureSet
        As `texclass.FeatureExtractor` takes them, like all that follow.
    channels : {"combine", "each", "auto"}
        Whether axes are combined.
    fs : float
        Sampling rate in Hz.
    unit : str
        Of the samples: "m/s^2", "g", "mg", "counts", "V" or "arbitrary".
    """

    _tags = {  # noqa: RUF012  (aeon's)
        "X_inner_type": ["numpy3D", "np-list"],
        "output_data_type": "Tabular",
        "capability:multivariate": True,
        "capability:unequal_length": True,
        "algorithm_type": "feature",
        "fit_is_empty": True,
    }

    def __init__(self, features="strese2015", channels="combine", fs=None, unit="arbitrary"):
        self.features = features
        self.channels = channels
        self.fs = fs
        self.unit = unit
        super().__init__()

    def _transform(self, X, y=None):
        extractor = FeatureExtractor(self.features, channels=self.channels, fs=self.fs, unit=self.unit)
        return extractor.fit_transform([x.T for x in X])

    @classmethod
    def _get_test_params(cls, parameter_set="default"):
        return {"features": "strese2015", "fs": 1000.0}
