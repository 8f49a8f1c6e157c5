"""Vibration levels: the one-pass filter compared with scipy, units, and fades."""

import numpy as np
import pytest
from scipy import signal

from texclass.phase_settings import PhaseSettings
from texclass.phases import bin_means, find_phases
from texclass.phases.high_pass import high_pass_power
from texclass.phases.vibration_track import track
from texclass.recording import Recording
from texclass.signals import butterworth


@pytest.mark.parametrize(("step", "bin_size"), [(1, 1), (1, 5), (3, 5), (2, 1)])
@pytest.mark.parametrize("first", [0, 700])
def test_power_in_one_pass_equals_that_of_scipy(step, bin_size, first):
    sos = butterworth("highpass", 60.0, 2000.0)
    axes = np.random.default_rng(0).normal(size=(5003, 2)).cumsum(axis=0)
    rest = axes[:20].mean(axis=0)
    padded = np.where(np.arange(len(axes)) < first, 0.0, (axes - rest).T)
    rows = bin_means(padded, step)
    vibration = signal.sosfilt(sos, rows)
    squares = (vibration**2).sum(axis=0)
    lagged = (vibration[:, 1:] * vibration[:, :-1]).sum()
    power, means, correlation = high_pass_power(axes, rest, first, sos, step, bin_size)
    np.testing.assert_allclose(power, squares, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(means, bin_means(rows, bin_size), atol=1e-12)
    assert correlation == pytest.approx(lagged / squares.sum(), rel=1e-12)


@pytest.mark.parametrize(("n", "size"), [(12, 1), (12, 4), (13, 4), (3, 5)])
def test_bin_means_include_a_shorter_last_bin(n, size):
    x = np.random.default_rng(n).normal(size=(2, n))
    expected = [x[:, k : k + size].mean(axis=1) for k in range(0, n, size)]
    np.testing.assert_allclose(bin_means(x, size), np.transpose(expected), rtol=1e-12)


@pytest.mark.parametrize("gain", [1e-100, 1e-30, 1.0, 1e30, 1e100])
@pytest.mark.parametrize("noise", [1e-9, 1e-2])
def test_phases_do_not_depend_on_the_unit(gain, noise):
    rng = np.random.default_rng(1)
    x = noise * rng.normal(size=(20_000, 2)) + 9.8 * np.cos(np.arange(20_000) / 1e5)[:, None]
    x[12_000:12_100] += 1e4 * noise * np.exp(-np.arange(100) / 20)[:, None]
    phases = find_phases(Recording(gain * x, 10_000.0, "arbitrary"))
    assert [tap.impact for tap in phases.taps] == [12_000]
    assert phases.movement is None


@pytest.mark.parametrize("direction", ["in", "out"])
def test_a_fade_is_detected_in_gravity(direction):
    rng = np.random.default_rng(3)
    volume = np.minimum(np.arange(20_000) / 3000, 1.0)
    x = (9.8 * volume)[:, None] * [0.6, 0.0, 0.8] + 0.01 * rng.normal(size=(20_000, 3))
    recording = Recording(x if direction == "in" else x[::-1], 10_000.0, "m/s^2")
    first, stop = track(recording, PhaseSettings()).full
    assert (first, stop) == ((first, 2000) if direction == "in" else (0, stop))
    assert 150 <= 2000 - (stop - first) <= 330
