from itertools import pairwise

import numpy as np
import pytest
from abdulali2016_simulated import hand_motion, simulate_scan
from numpy.testing import assert_allclose, assert_array_equal

from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import condition, scan_from_sensors, segment_input
from texclass.haptics.textures.abdulali2016.model_points import (
    LINE_MM,
    VARIATION,
    limit_vibration,
    smooth_motion,
    straight_lines,
)
from texclass.haptics.textures.resonant_surfaces import SURFACES, get_surface

FS = 1000.0


@pytest.fixture(scope="module")
def scan():
    return simulate_scan(get_surface("S7"), 12.0, FS, np.random.default_rng(1))


def _zigzag(speeds, corners, n=400):
    """Return a path along straight lines, each with its own speed and direction, at a force of 1 N."""
    steps = zip(speeds, corners, strict=True)
    velocity = np.concatenate([np.tile([v * np.cos(a), v * np.sin(a)], (n, 1)) for v, a in steps])
    position = np.cumsum(velocity, axis=0) / FS
    return Scan(np.ones(len(velocity)), position, velocity, np.ones(len(velocity)), FS)


def test_lines_end_at_corners_and_reversals_and_segments_at_a_step_of_speed():
    slack = LINE_MM / (80 / FS) / np.sin(1.0)  # samples until 2 mm from the line
    assert_allclose(
        straight_lines(_zigzag([80, 80, 80], [0.0, 2.0, -1.0]).position), [0, 400, 800, 1200], atol=slack
    )
    assert_allclose(straight_lines(_zigzag([60, 60], [0.3, 0.3 + np.pi]).position), [0, 400, 800], atol=3)
    segments = segment_input(_zigzag([60, 120], [0.3, 0.3]))
    assert_array_equal([segments.start, segments.stop], [[0, 400], [400, 800]])


def test_every_line_satisfies_equations_1_and_2_and_every_segment_is_steady_and_long_enough(scan):
    bounds = straight_lines(scan.position)
    assert (bounds[0], bounds[-1]) == (0, len(scan))
    for a, b in pairwise(bounds):
        p = scan.position[a:b]
        A, B, C = p - p[0], p[-1] - p, p[-1] - p[0]
        h = np.abs(A[:, 0] * B[:, 1] - A[:, 1] * B[:, 0]) / np.hypot(*C)
        assert h.max() <= LINE_MM * (1 + 1e-9)
        feet = sum(np.sqrt(np.maximum((V**2).sum(axis=1) - h**2, 0)) for V in (A, B))
        assert np.all(feet <= np.hypot(*C) + 2 * 0.05 * LINE_MM + 1e-9)
    segments = segment_input(scan)
    assert len(segments) > 10
    assert segments.n_samples.min() >= 75
    for a, b in zip(segments.start, segments.stop, strict=True):
        v, f = scan.speed[a:b], scan.force[a:b]
        assert (v.std() / v.mean() + f.std() / f.mean()) / 2 <= VARIATION + 1e-9
        assert np.searchsorted(segments.lines, a, "right") == np.searchsorted(segments.lines, b - 1, "right")


def test_a_tool_at_rest_or_without_contact_gives_no_segment():
    n, air = 500, _zigzag([60], [0.3])
    resting = Scan(np.ones(n), np.zeros((n, 2)), np.zeros((n, 2)), np.ones(n), FS)
    lifted = Scan(air.acceleration, air.position, air.velocity, np.zeros(len(air)), FS)
    assert len(segment_input(resting)) == len(segment_input(lifted)) == 0


def test_bounds_do_not_depend_on_the_rate():
    motion = hand_motion(6.0, 10_000.0, np.random.default_rng(3))
    fast = Scan(np.ones(60_000), *motion, 10_000.0)
    slow = Scan(np.ones(6000), *(x[::10] for x in motion), FS)
    assert_array_equal(segment_input(fast).start, 10 * segment_input(slow).start)


def test_invalid_arguments_are_refused(scan):
    with pytest.raises(ValueError, match=r"variation must be.*got -1"):
        segment_input(scan, variation=-1)
    with pytest.raises(ValueError, match=r"fs must be.*got 50"):
        smooth_motion(np.zeros(100), 50.0)
    for normal in ((0, 0, 0), (1, 2), (np.nan, 0, 1)):
        with pytest.raises(ValueError, match="normal must be"):
            scan_from_sensors(np.ones(9), np.ones((9, 3)), np.ones((9, 3)), FS, normal=normal)
    with pytest.raises(ValueError, match="position"):
        scan_from_sensors(np.ones(9), np.ones((9, 2)), np.ones((9, 3)), FS)


def test_vibration_and_motion_are_filtered_to_their_bands(scan):
    t, middle = np.arange(4000) / FS, slice(1000, 3000)
    for hz, passes in ((2.0, False), (100.0, True), (400.0, True)):
        x = np.sin(2 * np.pi * hz * t)
        assert_allclose(limit_vibration(x, FS)[middle], passes * x[middle], atol=1e-2)
    slow, fast = np.sin(2 * np.pi * 2 * t), np.sin(2 * np.pi * 200 * t)
    assert_allclose(smooth_motion(slow + fast, FS)[middle], slow[middle], atol=0.03)
    at_cutoff = smooth_motion(np.sin(2 * np.pi * 25 * t), FS)[middle]
    assert_allclose(np.sqrt(2 * np.mean(at_cutoff**2)), 0.5, rtol=0.01)
    original = scan.acceleration.copy()
    condition(scan)
    assert_array_equal(scan.acceleration, original)


def test_sensor_data_are_projected_on_the_plane():
    n = np.array([0.3, -0.5, 0.9]) / np.linalg.norm([0.3, -0.5, 0.9])
    axis = np.eye(3)[0] - n[0] * n
    plane = np.stack([axis / np.linalg.norm(axis), np.cross(n, axis / np.linalg.norm(axis))])
    flat = hand_motion(3.0, FS, np.random.default_rng(0))
    force = -flat[2][:, np.newaxis] * n + 0.3 * plane[0]
    scan = scan_from_sensors(np.ones(3000), flat[0] @ plane + 7 * n, force, FS, normal=2 * n)
    inner = slice(200, -200)
    assert_allclose(scan.position[inner], flat[0][inner], atol=0.5)
    assert_allclose(scan.speed[inner], np.hypot(*flat[1][inner].T), atol=12)
    assert_allclose(scan.force[inner], flat[2][inner], atol=0.03)


def test_simulated_surfaces_have_their_true_level_and_resonance_and_only_s4_is_isotropic():
    assert [s.name for s in SURFACES if not s.is_anisotropic] == ["S4"]
    assert len(SURFACES) == 9
    level = get_surface("S4").true_spectrum([[80.0, 0.0], [0.0, 80.0]], [1.0, 1.0])[2]
    assert level[0] == level[1]
    surface, n = get_surface("S7"), 40_000
    velocity, force = np.tile([90.0, 0.0], (n, 1)), np.ones(n)
    frequency, _, level = surface.true_spectrum(velocity[:1], force[:1])
    x = surface.vibration(velocity, force, FS, np.random.default_rng(0))
    assert_allclose(x.std(), level[0], rtol=0.1)
    power = np.abs(np.fft.rfft(x.reshape(-1, 500), axis=1)) ** 2
    assert abs(np.argmax(power.mean(axis=0)) * FS / 500 - frequency[0, 0]) < 6
    with pytest.raises(ValueError, match="S10"):
        get_surface("S10")
