"""Phases of synthetic signals with known phases, and of real recordings."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from texclass.phase_settings import PhaseSettings
from texclass.phases import Levels, find_hand_start, find_impulses, find_phases
from texclass.recording import Phases, Recording, Tap

FS = 10_000.0
DATA = Path(os.environ.get("TEXCLASS_DATA", Path(__file__).parents[3] / "shared" / "data"))


def _recording(x, fs=FS, unit="m/s^2"):
    return Recording(acceleration=x, fs=fs, unit=unit, recording_id="made")


def _freehand(
    *,
    taps=(0.6, 1.1, 1.7),
    strengths=(20.0, 60.0, 40.0),
    move=(2.5, 6.0),
    fs=FS,
    noise=0.02,
    n_axes=3,
    duration=6.0,
    seed=0,
):
    """Return gravity, tremor, taps after hand motion, and strokes with pauses at turning points."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration * fs)) / fs
    x = 0.05 * np.sin(2 * np.pi * 9 * t)
    for at, strength in zip(taps, strengths, strict=False):
        decay_t, hand = np.maximum(t - at, 0.0), np.clip((at - t) / 0.08, 0.0, 1.0)
        x += strength * (t >= at) * np.exp(-decay_t / 0.006) * (np.sin(2 * np.pi * 250 * decay_t) + 0.4)
        x -= 0.02 * strength * np.sin(np.pi * hand)
    if move:
        rough = signal.sosfilt(
            signal.butter(2, min(800, 0.4 * fs), fs=fs, output="sos"), rng.standard_normal(t.size)
        )
        x += (
            2.0
            * rough
            * np.sqrt(np.abs(np.sin(2 * np.pi * (t - move[0]) / 1.5)))
            * ((t >= move[0]) & (t < move[1]))
        )
    axes = np.outer(x, [0.3, -0.5, 0.81]) + noise * rng.standard_normal((t.size, 3)) + [2.0, 0.0, 9.6]
    return _recording(axes if n_axes == 3 else axes[:, 2], fs)


def _check_impacts(phases, taps, fs=FS, within_s=0.003):
    assert len(phases.taps) == len(taps)
    assert all(abs(tap.impact / fs - at) <= within_s for tap, at in zip(phases.taps, taps, strict=True))


@pytest.mark.parametrize("n_axes", [1, 3])
@pytest.mark.parametrize("fs", [1000.0, 2200.0, 5000.0, 10_000.0, 20_000.0, 50_000.0])
def test_taps_and_movement_are_found_at_any_rate(fs, n_axes):
    phases = find_phases(_freehand(fs=fs, n_axes=n_axes))
    assert phases.kind == "taps and movement"
    _check_impacts(phases, (0.6, 1.1, 1.7), fs)
    assert abs(phases.onset / fs - 2.5) < 0.1
    assert phases.movement == (phases.onset, round(6.0 * fs))


def test_a_tap_starts_with_hand_motion_and_ends_before_the_next_tap():
    phases = find_phases(_freehand())
    for tap, at in zip(phases.taps, (0.6, 1.1, 1.7), strict=True):
        assert 0.03 < at - tap.start / FS < 0.12
        assert 0.01 < tap.end / FS - at < 0.08
    assert all(a.end <= b.start for a, b in zip(phases.taps, phases.taps[1:], strict=False))


def test_taps_in_quick_succession_are_separate():
    at = (0.6, 0.75, 0.9, 1.05)
    phases = find_phases(_freehand(taps=at, strengths=(30.0,) * 4, move=None, duration=2.0))
    _check_impacts(phases, at)
    assert all(a.end <= b.impact for a, b in zip(phases.taps, phases.taps[1:], strict=False))


def test_movement_without_taps_starts_after_the_quiet_start():
    phases = find_phases(_freehand(taps=()))
    assert phases.kind == "movement only"
    assert abs(phases.onset / FS - 2.5) < 0.05


def test_a_recording_without_quiet_window_is_all_movement_with_a_note():
    rng = np.random.default_rng(1)
    level = 1.0 + 0.6 * np.sin(2 * np.pi * 1.7 * np.arange(20_000) / FS)
    phases = find_phases(_recording(level * signal.lfilter([1.0], [1, -0.9], rng.standard_normal(20_000))))
    assert phases.movement == (0, 20_000)
    assert phases.onset is None
    assert phases.notes


@pytest.mark.parametrize("unit", ["m/s^2", "counts"])
def test_sensor_noise_is_neither_taps_nor_movement(unit):
    noise = 0.02 * np.random.default_rng(2).standard_normal((30_000, 3))
    phases = find_phases(_recording(noise + 9.81, unit=unit))
    assert phases.kind == "nothing"
    assert "neither" in phases.notes[0]


@pytest.mark.parametrize("n", [1, 2, 100, 5000, 30_000])
def test_a_constant_signal_has_no_phases(n):
    assert find_phases(_recording(np.full(n, 9.81))).kind == "nothing"
    assert find_phases(_recording(np.tile([0.0, 0.0, 9.81], (n, 1)))).kind == "nothing"


def test_declared_phases_are_returned_unchanged():
    declared = Phases(taps=(Tap(1, 2, 3),))
    recording = Recording(np.zeros(10), FS, "m/s^2", "declared", phases=declared)
    assert find_phases(recording) is declared


def test_phases_do_not_depend_on_gain_and_unit():
    recording = _freehand()
    scaled = _recording(1e4 * recording.acceleration, unit="counts")
    assert find_phases(scaled).movement == find_phases(recording).movement
    assert [t.impact for t in find_phases(scaled).taps] == [t.impact for t in find_phases(recording).taps]


def test_coarse_quantisation_is_not_movement():
    recording = _freehand(noise=1e-4)
    rounded = _recording(0.05 * np.round(recording.acceleration / 0.05))
    phases = find_phases(rounded)
    _check_impacts(phases, (0.6, 1.1, 1.7))
    assert abs(phases.onset / FS - 2.5) < 0.05


def test_a_short_recording_that_starts_at_rest_is_one_tap():
    t = np.arange(202) / 2000.0
    x = 290 + np.round(200 * np.where(t > 0.006, np.exp(-(t - 0.006) / 0.02) * np.sin(900 * (t - 0.006)), 0))
    phases = find_phases(_recording(x, 2000.0, "counts"))
    assert phases.kind == "taps only"
    assert abs(phases.taps[0].impact - 12) <= 2


def test_settings_take_effect():
    assert not find_phases(_freehand(), PhaseSettings(tap_ratio=1e9)).taps


@pytest.mark.parametrize("n", [3, 10, 299, 3001])
def test_white_noise_of_any_length_has_valid_phases(n):
    phases = find_phases(_recording(np.random.default_rng(n).standard_normal(n)))
    assert phases.movement is None or 0 <= phases.movement[0] < phases.movement[1] <= n
    assert all(tap.end <= n for tap in phases.taps)


def _levels(db):
    ratio = 10.0 ** (np.asarray(db) / 10.0)
    return Levels(ratio, ratio, ratio, bin_s=0.001)


@pytest.mark.parametrize("later", [20, 40, 50])
def test_an_impulse_is_sharp_if_its_peak_follows_the_rise_within_45_ms(later):
    level_db = np.zeros(700)
    level_db[300 : 301 + later] = np.linspace(25.0, 32.0, later + 1)
    level_db[300 + later : 341 + later] = np.linspace(32.0, 0.0, 41)
    impulses = find_impulses(_levels(level_db), PhaseSettings())
    assert len(impulses) == (later < 45)
    for impulse in impulses:
        assert impulse.peak == pytest.approx(300 + later, abs=1)
        # the past ends 15 ms earlier: within that time, the rise is compared with rest
        assert impulse.prominence_db == pytest.approx(25.0 + 7.0 * 15 / later, abs=0.5)


@pytest.mark.parametrize(("at", "is_found"), [(20, True), (50, True), (65, False)])
def test_vibration_at_the_start_of_the_data_does_not_hide_impulses_within_50_ms(at, is_found):
    level_db = np.zeros(700)
    level_db[:at] = 17.0
    level_db[at : at + 41] = np.linspace(25.0, 0.0, 41)
    assert bool(find_impulses(_levels(level_db), PhaseSettings())) == is_found


# Real recordings --------------------------------------------------------------------------------------------


@pytest.fixture
def data():
    if not DATA.is_dir():
        pytest.skip(f"real recordings are not at {DATA}; set TEXCLASS_DATA")
    return DATA


def test_real_strokes_are_movement_only(data):
    for path in sorted((data / "stylus6").glob("*.csv")):
        x = np.loadtxt(path, delimiter=",", skiprows=1)[:, 0]
        phases = find_phases(_recording(x, 1000.0))
        assert phases.kind == "movement only", path.name
        assert phases.movement[1] - phases.movement[0] > 0.95 * x.size, path.name


def test_real_excerpt_of_a_movement_is_movement_only(data):
    x = np.loadtxt(data / "lmt_excerpts" / "G1EpoxyRasterPlate_Movement_X_test1.txt")
    phases = find_phases(_recording(x, unit="arbitrary"))
    assert phases.kind == "movement only"
    assert phases.movement[1] - phases.movement[0] > 0.9 * x.size


@pytest.mark.parametrize("fs", [1000.0, 2000.0, 5000.0])
def test_real_taps_are_taps_only(data, fs):
    rows = [
        np.genfromtxt(data / "taps5" / f"data_chan{c}.csv", delimiter=",", skip_header=1)
        for c in (1, 2, 3, 4)
    ]
    taps = np.nan_to_num(np.stack(rows, axis=-1)[:, :202])
    kinds = [find_phases(_recording(tap, fs, "counts")).kind for tap in taps]
    assert np.mean([kind == "taps only" for kind in kinds]) >= 0.9  # others start during the contact


def test_a_long_hand_motion_starts_where_it_leaves_rest():
    fs, pull_s, t = 10_000.0, 0.11, np.arange(2500) / 10_000.0
    pull = np.outer(1.5 * np.clip(1.0 - (0.25 - t) / pull_s, 0.0, 1.0), [0.6, 0.8])
    rest = 9.81 + 0.01 * np.random.default_rng(0).standard_normal((2500, 2))
    assert find_hand_start(rest + pull, fs) / fs == pytest.approx(0.25 - 0.8 * pull_s, abs=0.008)
