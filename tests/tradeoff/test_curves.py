"""Cheaper sensors: what is below the new Nyquist frequency stays, what the converter cannot hold goes."""

import numpy as np
import pytest

from texclass.recording import Phases, Recording, Tap
from texclass.tradeoff.curves import degraded, full_scale_of, quantised, resampled

FS = 1000.0


def sine(hz, n=2000, fs=FS):
    return np.cos(np.pi * (np.arange(n) + 0.5) * 2 * hz / fs)


def recording(x, **facts):
    return Recording(x, fs=FS, unit="m/s^2", recording_id="r", **facts)


def test_a_tone_below_the_new_nyquist_frequency_is_sampled_more_slowly_and_one_above_it_vanishes():
    slow = resampled(recording(sine(40.0)), 250.0)
    assert slow.fs == 250
    np.testing.assert_allclose(slow.acceleration, sine(40.0, 500, 250.0), atol=1e-9)
    assert np.abs(resampled(recording(sine(200.0)), 250.0).acceleration).max() < 1e-9
    axes = np.stack([sine(40.0), sine(60.0)], axis=1)
    np.testing.assert_allclose(resampled(recording(axes), 250.0).acceleration[:, 0], slow.acceleration)


def test_phases_and_other_signals_go_along():
    phases = Phases((Tap(100, 200, 400),), (800, 2000), 900)
    slow = resampled(recording(sine(10.0), phases=phases, friction=np.ones(2000)), 500.0)
    assert slow.phases == Phases((Tap(50, 100, 200),), (400, 1000), 450)
    np.testing.assert_allclose(slow.friction, 1.0)


def test_a_converter_errs_by_half_a_step_and_clips():
    x = np.linspace(-1, 1, 10_001)
    for bits in (2, 8, 12):
        q, y = 2 / 2**bits, quantised(x, bits, 1.0)
        assert np.abs(y - x)[x < 1 - q].max() <= q / 2 + 1e-12
        assert np.unique(y).size == 2**bits
        assert (y.min(), y.max()) == (-1, pytest.approx(1 - q))


def test_a_degraded_dataset_is_another_input(toy_dataset):
    dataset = toy_dataset()
    scale = full_scale_of(dataset)
    coarse = degraded(dataset, bits=3, full_scale=scale)
    assert coarse.input_hash != dataset.input_hash
    assert np.unique(coarse[0].acceleration).size <= 8
    assert degraded(dataset, fs=500.0)[0].n_samples == 150
    np.testing.assert_array_equal(degraded(dataset, fs=5000.0)[0].acceleration, dataset[0].acceleration)
    with pytest.raises(ValueError, match="fs is -1"):
        degraded(dataset, fs=-1)
