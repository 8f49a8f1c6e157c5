"""Outliers of speed, force and position are found, reported, and excluded from every fit that uses them."""

import numpy as np
import pytest

from texclass.features.phase_view import Views
from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import condition, scan_from_sensors
from texclass.haptics.textures.guruswamy2011 import scan_level
from texclass.loaders import load_recording
from texclass.phases import exclude_outliers, find_motion_outliers, interpolate_outliers
from texclass.recording import Phases, Recording
from texclass.simulate import operator_catalogue, record_freehand, surface_catalogue

FS = 1000.0
WRONG = 505_831.0
T = np.arange(5000) / FS


def motion(noise=0.02):
    """Return a force or speed of a hand with sensor noise."""
    return 1 + 0.3 * np.sin(2 * np.pi * 1.3 * T) + noise * np.random.default_rng(0).standard_normal(T.size)


@pytest.mark.parametrize("places", [[0], [4999], [700], [700, 701, 702], [3, 900, 4000], [10, 14]], ids=str)
@pytest.mark.parametrize("size", [WRONG, -WRONG, 30.0])
def test_wrong_samples_anywhere_are_found_and_nothing_else(places, size):
    x = motion()
    x[places] += size * np.linspace(1.0, 0.6, len(places))
    assert find_motion_outliers(x, FS).tolist() == places


def test_a_wrong_value_that_a_merged_log_repeats_is_found_but_a_plateau_of_speed_is_not():
    x = np.repeat(motion()[:500], 10)
    x[1000:1010] = WRONG
    assert find_motion_outliers(x, FS).tolist() == list(range(1000, 1010))
    plateaus = np.repeat([50.0, 100, 50, 100, 50, 100, 50, 600, 50, 100, 50, 100, 50, 100], 400)
    assert not len(find_motion_outliers(plateaus, FS))


@pytest.mark.parametrize(
    "x",
    [
        np.random.default_rng(1).standard_normal(50_000),
        np.round(1 + 0.01 * np.random.default_rng(1).standard_normal(50_000), 2),
        np.ones(5000),
        np.abs(np.sin(40 * T)) * 200,
        np.ones(3),
    ],
    ids=["noise", "coarse quantisation", "constant", "strokes back and forth", "three samples"],
)
def test_valid_motion_has_no_outliers(x):
    assert not len(find_motion_outliers(x, FS))


@pytest.mark.parametrize("seed", range(3))
def test_simulated_operators_have_no_outliers(seed):
    operator, surface = operator_catalogue(3, 0)[seed], surface_catalogue(3, 0)[seed]
    recording = record_freehand(surface, operator, duration_s=10, fs=FS, seed=seed)
    for x in (recording.speed, recording.normal_force):
        assert not len(find_motion_outliers(x, FS))


def test_outliers_are_interpolated_per_axis_and_reported_once_with_their_value_and_time():
    x = np.column_stack([motion(), motion()])
    x[[700, 2000], 0] = WRONG
    with pytest.warns(UserWarning, match=r"oak\.csv: excluded 2 samples of force \(for example 505831 N at"):
        cleaned = exclude_outliers(x, FS, "force", "N", "oak.csv")
    assert cleaned[700, 0] == pytest.approx((x[699, 0] + x[701, 0]) / 2)
    np.testing.assert_array_equal(cleaned[:, 1], x[:, 1])
    assert interpolate_outliers(x[:, 1], np.zeros(0, int)) is not None


def wrong_scan():
    force, speed = motion(), 100 * motion()
    force[700], speed[3000] = WRONG, 40_000.0
    noise = np.random.default_rng(2).standard_normal(T.size)
    with pytest.warns(UserWarning, match="excluded 1 sample of (speed|force)") as warned:
        scan = Scan.along_line(noise, speed, force, FS, "oak")
    assert len(warned) == 2
    return scan, Scan.along_line(noise, 100 * motion(), motion(), FS, "oak")


def test_levels_position_and_conditioned_motion_of_a_scan_ignore_outliers():
    scan, valid = wrong_scan()
    np.testing.assert_allclose(scan_level(scan), scan_level(valid), rtol=1e-4)
    assert scan.distance_mm[-1] == pytest.approx(valid.distance_mm[-1], rel=1e-4)
    smooth, smooth_valid = condition(scan), condition(valid)
    np.testing.assert_allclose(smooth.force, smooth_valid.force, atol=0.02)
    np.testing.assert_allclose(smooth.speed, smooth_valid.speed, atol=2)


def test_outliers_of_recorded_position_and_force_do_not_ring_in_the_velocity():
    position = np.column_stack([50 * T, 0 * T, 0 * T])
    force = np.column_stack([0 * T, 0 * T, motion()])
    position[700, 0], force[900, 2] = 1e6, WRONG
    with pytest.warns(UserWarning, match="excluded 1 sample of (position|force)"):
        scan = scan_from_sensors(np.sin(900 * T), position, force, fs=FS)
    assert scan.speed.max() < 60
    assert scan.force.max() < 2


def test_a_file_with_an_outlier_is_flagged_and_resampling_excludes_it(tmp_path):
    force = motion()
    force[700] = WRONG
    table = np.column_stack([np.random.default_rng(0).standard_normal(T.size), force, 100 * motion()])
    path = tmp_path / "oak.csv"
    np.savetxt(path, table, delimiter=",", header="acceleration,force,speed", comments="")
    options = {"fs": FS, "unit": "m/s^2", "auxiliary": {"normal_force": "force", "speed": "speed"}}
    recording = load_recording(path, **options)
    assert "outliers: 1 sample of normal_force (505831 N at 0.7 s), excluded from fits" in recording.flags[0]
    assert recording.normal_force.max() == WRONG  # a recording keeps its values
    assert load_recording(path, **options, resample=500.0).normal_force.max() < 2


def test_an_outlier_of_speed_does_not_move_the_travelled_distance():
    noise = np.random.default_rng(0).standard_normal(T.size)
    speed = 100 * motion()
    valid = Recording(noise, FS, "m/s^2", speed=speed, phases=Phases(movement=(0, T.size)))
    wrong = speed.copy()
    wrong[700] = 1e7
    with pytest.warns(UserWarning, match="excluded 1 sample of speed"):
        travel = Views(valid.with_(speed=wrong), valid.phases).travel
    expected = Views(valid, valid.phases).travel
    assert travel.samples.size == expected.samples.size
    np.testing.assert_allclose(travel.samples[3000:], expected.samples[3000:], atol=0.1)
