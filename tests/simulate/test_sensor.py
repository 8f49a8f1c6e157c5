"""Tests of saturation, quantisation and noise of the simulated electronics."""

import numpy as np
import pytest
from scipy import signal

from texclass.recording import STANDARD_GRAVITY
from texclass.simulate import Sensor

SENSOR = Sensor()


def rng():
    return np.random.default_rng(0)


def test_read_values_are_multiples_of_the_quantum_within_the_range():
    acceleration = 200.0 * rng().standard_normal((5000, 3))
    read = SENSOR.read(acceleration, 10_000.0, rng())
    steps = read / SENSOR.quantum_m_s2
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-4)
    assert np.abs(read).max() <= SENSOR.range_g * STANDARD_GRAVITY + SENSOR.quantum_m_s2


def test_noise_has_the_declared_density():
    read = SENSOR.read(np.zeros((200_000, 3)), 10_000.0, rng())
    expected = 50e-6 * STANDARD_GRAVITY * np.sqrt(1.11 * 1800.0)
    assert read.std(axis=0) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("fs", [1000.0, 10_000.0, 50_000.0])
def test_analogue_filter_passes_low_and_stops_what_would_alias(fs):
    internal = 40 * fs
    sos = SENSOR.analogue_filter(fs, internal)
    _, response = signal.sosfreqz(sos, worN=[1.0, 1.2 * fs], fs=internal)
    assert abs(response[0]) == pytest.approx(1.0, abs=1e-3)
    assert abs(response[1]) < 0.02


def test_bridge_is_odd_and_saturates():
    quiet = Sensor(bridge_noise_v=0.0, bridge_drift_v=0.0)
    ends = [quiet.read_bridge(np.full(5000, f), 10_000.0, rng())[-1] for f in (-1.0, 1.0, 1e3)]
    assert ends[0] == pytest.approx(-ends[1])
    assert ends[1] < ends[2] < quiet.bridge_v
