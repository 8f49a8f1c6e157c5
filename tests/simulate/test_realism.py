"""Tests that simulated strokes resemble real ones where both are measured alike."""

import itertools

import numpy as np
import pytest
from scipy import signal

from texclass.loaders import open_dataset
from texclass.simulate import operator_catalogue, profile, record_freehand, surface_catalogue

EDGES_HZ = (20.0, 50.0, 100.0, 400.0)


def low_levels(x, fs):
    """Return the levels of 20-50 and 50-100 Hz in dB, relative to 100-400 Hz."""
    frequency, density = signal.welch(x, fs, nperseg=round(0.5 * fs))
    bands = itertools.pairwise(EDGES_HZ)
    power = [density[(frequency >= low) & (frequency < high)].sum() for low, high in bands]
    return 10 * np.log10(np.divide(power[:2], power[2]))


def simulated_levels():
    operators = operator_catalogue(5, seed=77)
    recordings = [
        record_freehand(surface, operators[i % 5], duration_s=3.0, seed=i, with_taps=False)
        for i, surface in enumerate(surface_catalogue(24, seed=77))
    ]
    return [low_levels(r.acceleration[slice(*r.phases.movement), 2], r.fs) for r in recordings]


@pytest.mark.usefixtures("data_root")
def test_level_below_100_hz_is_that_of_the_recordings_from_the_laboratory_of_the_paper(monkeypatch):
    excerpts = open_dataset("lmt_excerpts")
    real = np.median(
        [low_levels(r.acceleration.ravel(), r.fs) for r in map(excerpts.load, excerpts.entries)], 0
    )
    assert np.median(simulated_levels(), axis=0) == pytest.approx(real, abs=3.0)
    monkeypatch.setattr(profile, "waviness_gain", lambda surface, frequency: np.ones_like(frequency))
    assert np.median(simulated_levels(), axis=0)[0] < real[0] - 5.0
