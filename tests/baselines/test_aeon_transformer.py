"""The transformer of `examples/aeon_transformer` passes aeon's checks and returns our features."""

import numpy as np
import pytest

import texclass as tx

checking = pytest.importorskip("aeon.testing.estimator_checking")
TexclassFeatures = pytest.importorskip("texclass_aeon").TexclassFeatures


@checking.parametrize_with_checks([TexclassFeatures])
def test_it_is_a_transformer_of_aeon(check):
    check()


@pytest.mark.parametrize("length", [3000, 2500])
def test_a_collection_gives_the_features_of_its_recordings(length):
    rng = np.random.default_rng(0)
    recordings = [
        tx.Recording(rng.standard_normal((n, 3)), 1000.0, phases=tx.Phases(movement=(0, n)))
        for n in (3000, length)
    ]
    features = TexclassFeatures(fs=1000.0).fit_transform(tx.loaders.collection_of(recordings))
    np.testing.assert_array_equal(features, tx.extract(recordings, "strese2015"))
