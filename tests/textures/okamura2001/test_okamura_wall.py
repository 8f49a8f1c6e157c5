import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from okamura2001_taps import TABLE_II

from texclass.textures.okamura2001 import ForceDevice, VirtualWall

DEVICE = ForceDevice(limit_n=50.0)
WALL = VirtualWall(TABLE_II["aluminum"], DEVICE)
FS = DEVICE.rate_hz


def _taps(n=6000, period=1500):
    t = np.arange(n)
    depth = 2 * np.sin(2 * np.pi * t / period - 0.5)
    return depth, np.gradient(depth) * FS


def _press(depth, velocity, n):
    return np.full(n, depth), np.full(n, velocity)


def test_force_is_the_spring_and_the_published_vibration():
    depth, velocity = _press(2.0, 150.0, 800)
    force = WALL.renderer().process(depth, velocity)
    vibration = WALL.tap.synthesize(0.15, 800, FS) * DEVICE.mass_kg
    assert_allclose(force, WALL.stiffness_n_mm * 2.0 - vibration, atol=1e-9)


def test_any_blocking_gives_the_same_forces_again():
    depth, velocity = _taps()
    renderer = WALL.renderer()
    whole = renderer.process(depth, velocity)
    for size in (1, 13, 999):
        renderer.reset()
        cuts = range(0, depth.size, size)
        pieces = [renderer.process(depth[i : i + size], velocity[i : i + size]) for i in cuts]
        assert_array_equal(np.concatenate(pieces), whole)


def test_outside_the_wall_there_is_no_force_before_and_soon_after_a_tap_nor_when_it_was_left_at_once():
    assert_allclose(WALL.renderer().process(*_press(1.0, -100.0, 50)), WALL.stiffness_n_mm)
    renderer = WALL.renderer()
    assert not renderer.process(*_press(-1.0, 100.0, 100)).any()
    inside = renderer.process(*_press(1e-9, 100.0, 50))
    left = renderer.process(*_press(-1.0, -100.0, 500))
    assert 0 < np.abs(left).max() < np.abs(inside).max()
    assert np.abs(left[200:]).max() < 1e-3 * np.abs(inside).max()


def test_a_second_tap_rings_again_with_its_own_velocity():
    renderer = WALL.renderer()
    first = renderer.process(*_press(1.0, 100.0, 5000))
    renderer.process(*_press(-1.0, 0.0, 2000))
    second = renderer.process(*_press(1.0, 200.0, 5000))
    spring = WALL.stiffness_n_mm * 1.0
    assert_allclose(second - spring, 2 * (first - spring), atol=1e-9)


def test_neither_impact_nor_release_jumps_beyond_spring_and_vibration():
    depth, velocity = _taps()
    force = WALL.renderer().process(depth, velocity)
    impact = np.abs(velocity).max() * 1e-3 * abs(WALL.tap.amplitude_slope) * DEVICE.mass_kg
    per_sample = 2 * np.pi * WALL.tap.frequency_hz / FS
    spring = WALL.stiffness_n_mm * np.abs(np.diff(depth)).max()
    assert np.abs(np.diff(force)).max() < 1.2 * (impact * per_sample + spring)


def test_force_never_exceeds_the_limit():
    wall = VirtualWall(TABLE_II["aluminum"], ForceDevice(limit_n=4.0))
    force = wall.renderer().process(*_press(7.9, 400.0, 2000))
    assert force.max() == 4.0
    assert force.min() >= -4.0


def test_bad_paths_and_a_frequency_above_half_the_rate_are_refused():
    for path in (([1.0, np.nan], [0.0, 0.0]), ([1.0], [np.inf]), ([1.0], [1.0, 2.0]), (1.0, 1.0)):
        with pytest.raises(ValueError, match="rule is"):
            WALL.renderer().process(*path)
    with pytest.raises(ValueError, match="rule is"):
        VirtualWall(TABLE_II["aluminum"], ForceDevice(rate_hz=601.0, band_hz=(30.0, 250.0)), -1.0)
    with pytest.raises(ValueError, match="below half"):
        VirtualWall(TABLE_II["aluminum"], ForceDevice(rate_hz=590.0, band_hz=(30.0, 250.0)))
