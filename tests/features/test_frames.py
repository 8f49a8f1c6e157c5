import numpy as np
import pytest

from texclass.features.phase_view import PhaseView
from texclass.features.spectra import long_frames, power_frames, spectral_moments, spread

FS = 10_000.0


def test_power_of_all_frames_is_that_of_the_signal() -> None:
    x = np.random.default_rng(0).standard_normal(100_000)
    frames, frequency = power_frames(PhaseView(x, FS), 0.4096, 0.2048, "hann")
    power = frames.sum(axis=1).mean() * frequency[1]
    assert power == pytest.approx(np.mean(x**2) / np.abs(x).max() ** 2, rel=0.02)


def test_moments_are_those_of_each_frame_written_out() -> None:
    view = PhaseView(np.cumsum(np.random.default_rng(1).standard_normal(30_000)), FS)
    centroid, deviation = spectral_moments(view)
    frames, frequency = long_frames(view)
    for power, mean, std in zip(frames.astype(float), centroid, deviation, strict=True):
        right = np.average(frequency, weights=power)
        assert mean == pytest.approx(right, rel=1e-9)
        assert std == pytest.approx(np.sqrt(np.average((frequency - right) ** 2, weights=power)), rel=1e-6)


def test_starts_spread_from_the_first_to_the_last_and_no_closer_than_a_step() -> None:
    assert spread(1000, 100, 64).tolist() == list(range(0, 1001, 100))
    few = spread(1000, 1, 5)
    assert few.tolist() == [0, 250, 500, 750, 1000]
    assert spread(0, 10, 64).tolist() == [0]
