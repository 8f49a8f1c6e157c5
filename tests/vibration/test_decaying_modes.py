import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from texclass.vibration.decaying_modes import DecayingModes

FS = 10_000.0


THREE = DecayingModes([100.0, 340.0, 900.0], [60.0, 150.0, 20.0], [2.0, 1.0, 0.5], [-1.5, 0.4, 2.0])


@pytest.mark.parametrize("fs", [4000.0, FS, 50_000.0])
def test_the_sections_have_the_modes_as_impulse_response(fs):
    impulse = np.eye(1, 500)[0]
    assert_allclose(THREE.filter(impulse, fs), THREE.synthesize(500, fs), atol=1e-11)


def test_one_sine_mode_is_the_filter_of_guruswamy2011_eq_4():
    A, B, w, T = 2.0, 60.0, 2 * np.pi * 180.0, 1 / FS
    section = DecayingModes(180.0, B, A, -np.pi / 2).sections(FS)[0]
    printed = [A * np.exp(-B * T) * np.sin(w * T), -2 * np.exp(-B * T) * np.cos(w * T), np.exp(-2 * B * T)]
    assert_allclose([section[1], *section[4:]], printed, rtol=1e-12)
    assert_allclose(section[0], 0.0, atol=1e-15)


def test_synthesis_agrees_with_60_digits():
    n = 3000
    with mpmath.workdps(60):
        rows = zip(THREE.frequency_hz, THREE.decay_per_s, THREE.amplitude, THREE.phase, strict=True)
        t = mpmath.mpf(n - 1) / mpmath.mpf(FS)
        truth = mpmath.fsum(
            mpmath.mpf(A)
            * mpmath.exp(-mpmath.mpf(B) * t)
            * mpmath.cos(2 * mpmath.pi * mpmath.mpf(f) * t + phi)
            for f, B, A, phi in rows
        )
    assert_allclose(THREE.synthesize(n, FS)[-1], float(truth), rtol=1e-11)


def test_a_higher_rate_passes_through_the_same_samples():
    assert_allclose(THREE.synthesize(800, 4 * FS)[::4], THREE.synthesize(200, FS), atol=1e-13)


def test_modes_above_half_the_rate_are_left_out():
    low = DecayingModes(THREE.frequency_hz[:2], THREE.decay_per_s[:2], THREE.amplitude[:2], THREE.phase[:2])
    assert_array_equal(THREE.synthesize(50, 1000.0), low.synthesize(50, 1000.0))
    assert THREE.sections(1000.0).shape == (2, 6)
    assert THREE.below(500.0).n_modes == 2


def test_strongest_orders_by_energy_within_the_duration():
    modes = DecayingModes([100.0, 200.0], [1.0, 1000.0], [1.0, 3.0], [0.0, 0.0])
    assert_array_equal(modes.strongest(2).frequency_hz, [100.0, 200.0])
    assert_array_equal(modes.strongest(1, duration_s=1e-3).frequency_hz, [200.0])


@pytest.mark.parametrize(
    "wrong",
    [(-1.0, 1.0, 1.0, 0.0), (1.0, 0.0, 1.0, 0.0), (1.0, 1.0, -1.0, 0.0), (1.0, 1.0, 1.0, np.nan)],
)
def test_modes_that_break_a_rule_are_named(wrong):
    with pytest.raises(ValueError, match="the rule is"):
        DecayingModes(*wrong)
