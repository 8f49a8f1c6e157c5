"""Intervals and JSON of a result."""

import pytest
from scipy.stats import binomtest

from texclass.experiment.result import Accuracy, wilson_interval


@pytest.mark.parametrize("hits", [0, 1, 17, 39, 40])
@pytest.mark.parametrize("confidence", [0.95, 0.8])
def test_wilson_interval_agrees_with_scipy(hits, confidence):
    reference = binomtest(hits, 40).proportion_ci(confidence, method="wilson")
    assert wilson_interval(hits, 40, confidence) == pytest.approx((reference.low, reference.high), abs=1e-12)


def test_accuracy_is_pooled_over_recordings_not_folds():
    assert Accuracy(3, 4, (1.0, 0.0)).mean == 0.75
