"""Frames of a movement and their spectra, against numpy's own."""

import numpy as np
import pytest
from feature_signals import noise
from numpy.lib.stride_tricks import sliding_window_view

from texclass.features.phase_view import PhaseView
from texclass.features.spectra import frames_of, power_frames


@pytest.mark.parametrize(("n", "length", "hop"), [(100, 100, 7), (1000, 64, 1), (1003, 250, 150)])
def test_frames_are_those_of_a_sliding_window(n, length, hop):
    x = noise(n).astype(np.float32)
    np.testing.assert_array_equal(frames_of(x, length, hop), sliding_window_view(x, length)[::hop])


def test_power_of_frames_is_a_one_sided_density():
    x, fs = noise(20_000), 2000.0
    power, frequency = power_frames(PhaseView(x, fs), 0.25, 0.125, "hann")
    assert power.shape == (79, frequency.size)
    of_unit = np.mean((x / np.abs(x).max()) ** 2)
    assert power.mean(axis=0).sum() * frequency[1] == pytest.approx(of_unit, rel=0.02)
