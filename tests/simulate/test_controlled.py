"""Tests of the simulation of controlled recordings and gestures."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from texclass.loaders.simulated import open_gestures
from texclass.simulate import (
    GESTURES,
    Grating,
    Recipe,
    operator_catalogue,
    record_gesture,
    record_rising_force,
    record_rising_speed,
    record_rising_taps,
    record_steps,
    surface_catalogue,
)
from texclass.simulate.controlled import REST_S

OPERATOR = replace(operator_catalogue(1, 1)[0], direction_deg=0.0)
ROUGH = replace(surface_catalogue(1, 1)[0], gratings=(), bumps=None, rms_um=2.0, stiffness_n_m=6e4)
SURFACE = surface_catalogue(3, 6)[2]
GROOVED = replace(ROUGH, rms_um=0.1, gratings=(Grating(wavelength_mm=2.0, depth_um=8.0),))


def peak_hz(recording, low=15.0):
    frequency, power = signal.welch(recording.acceleration[5000:, 2], recording.fs, nperseg=20_000)
    power[frequency < low] = 0.0
    return frequency[np.argmax(power)]


@pytest.mark.parametrize("speed", [60.0, 120.0, 200.0])
def test_grating_gives_a_line_at_speed_over_wavelength(speed):
    recording = record_rising_speed(GROOVED, OPERATOR, duration_s=5.0, seed=1, speed_mm_s=(speed, speed))
    assert peak_hz(recording) == pytest.approx(speed / 2.0, abs=1.0)


def test_rising_speed_rises_and_moves_the_spectrum_up():
    recording = record_rising_speed(ROUGH, OPERATOR, duration_s=8.0, seed=2, speed_mm_s=(20.0, 200.0))
    seconds = recording.speed[: 8 * 10_000].reshape(8, -1).mean(axis=1)
    assert (np.diff(seconds) > 10.0).all()
    assert recording.speed[-2000:].mean() == pytest.approx(200.0, rel=0.05)
    early, late = recording.acceleration[5000:25000, 2], recording.acceleration[60000:, 2]
    share = []
    for window in (early, late):
        frequency, power = signal.welch(window, recording.fs, nperseg=4096)
        share.append(power[(frequency > 150)].sum() / power[frequency > 15].sum())
    assert share[1] > share[0]
    assert late.std() > 2 * early.std()


def test_rising_force_rises_at_constant_speed_and_raises_the_contact_resonance():
    recording = record_rising_force(ROUGH, OPERATOR, duration_s=8.0, seed=3, force_n=(0.3, 3.0))
    assert recording.normal_force[6000:9000].mean() < 0.6
    assert recording.normal_force[-5000:].mean() == pytest.approx(3.0, rel=0.15)
    assert recording.speed[6000:].reshape(-1, 2000).mean(axis=1).std() < 10.0
    windows = recording.acceleration[5000:25000, 2], recording.acceleration[-20000:, 2]
    centroids = []
    for window in windows:
        frequency, power = signal.welch(window, recording.fs, nperseg=4096)
        band = (frequency > 100) & (frequency < 1500)
        centroids.append((frequency * power)[band].sum() / power[band].sum())
    assert centroids[1] > centroids[0]


def test_level_rises_with_force():
    levels = []
    for force in (0.4, 1.6):
        recording = record_rising_force(ROUGH, OPERATOR, duration_s=4.0, seed=4, force_n=(force, force))
        levels.append(recording.acceleration[5000:].std(axis=0).mean())
    assert levels[1] > 1.1 * levels[0]


def test_rising_taps_have_rising_peak_forces():
    soft = replace(ROUGH, stiffness_n_m=8e3)
    recording = record_rising_taps(soft, OPERATOR, n_taps=6, seed=5)
    assert recording.phases.kind == "taps only"
    peaks = [recording.normal_force[tap.impact : tap.end].max() for tap in recording.phases.taps]
    assert len(peaks) == 6
    assert (np.diff(peaks) > 0).all()


@pytest.mark.parametrize("fs", [1000.0, 10_000.0, 50_000.0])
def test_controlled_recordings_support_any_sampling_rate(fs):
    recording = record_rising_speed(GROOVED, OPERATOR, duration_s=3.0, seed=1, fs=fs, speed_mm_s=(80.0, 80.0))
    assert recording.n_samples == round(3.0 * fs)
    assert recording.speed[recording.n_samples // 2 :].mean() == pytest.approx(80.0, rel=0.02)


def test_invalid_taps_raise_a_value_error():
    for options in ({"n_taps": 0}, {"tap_speed_mm_s": (0.0, 10.0)}):
        with pytest.raises(ValueError, match="must be positive"):
            record_rising_taps(ROUGH, OPERATOR, seed=1, **options)


def gesture_recording(gesture, seed=1):
    return record_gesture(gesture, SURFACE, OPERATOR, seed=seed)


def test_the_gesture_tap_has_one_tap_and_strokes_have_a_movement():
    assert (gesture_recording("tap").phases.kind, len(gesture_recording("tap").phases.taps)) == (
        "taps only",
        1,
    )
    assert {gesture_recording(name).phases.kind for name in GESTURES if name != "tap"} == {"movement only"}


def test_strokes_have_the_speed_and_force_of_their_name():
    recordings = {
        name: [gesture_recording(name, seed) for seed in range(4)] for name in GESTURES if name != "tap"
    }
    speed = {
        name: np.median([r.speed[r.phases.onset :].mean() for r in group])
        for name, group in recordings.items()
    }
    force = {name: np.median([r.normal_force.mean() for r in group]) for name, group in recordings.items()}
    assert 2 * speed["slow stroke"] < speed["hard stroke"]
    assert 1.5 * speed["hard stroke"] < speed["fast stroke"]
    assert force["hard stroke"] == pytest.approx(2.5 * force["fast stroke"], rel=0.2)


def test_taps_vary_in_strength_between_seeds_and_are_reproducible():
    peaks = [np.abs(gesture_recording("tap", seed).acceleration).max() for seed in range(5)]
    assert np.std(peaks) > 0.03 * np.mean(peaks)
    assert (
        gesture_recording("tap", 3).acceleration.tobytes()
        == gesture_recording("tap", 3).acceleration.tobytes()
    )


def test_a_dataset_of_a_gesture_has_the_operators_of_its_recipe_and_no_phases():
    recipe = Recipe(n_surfaces=2, n_recordings=4, n_operators=2, duration_s=5, fs=8000, seed=6)
    taps, strokes = open_gestures(recipe, "tap"), open_gestures(recipe, "fast stroke")
    assert taps.input_hash != strokes.input_hash
    assert taps.input_hash != open_gestures(recipe.model_copy(update={"seed": 7}), "tap").input_hash
    entry = taps.entries[1]
    recording = taps.load(entry)
    assert (recording.operator, recording.surface) == (entry.operator, entry.surface)
    assert (recording.phases, recording.fs) == (None, 8000)
    other = taps.load(replace(entry, operator=taps.entries[0].operator))
    assert recording.n_samples != other.n_samples or (recording.acceleration != other.acceleration).any()


def test_steps_have_the_level_and_lines_of_strokes_at_constant_speed_and_force():
    steps, step_s = [(60.0, 0.5), (120.0, 2.0), (80.0, 1.0)], 2.0
    recording = record_steps(GROOVED, OPERATOR, steps, step_s=step_s, seed=1)
    assert len(recording.acceleration) == round((REST_S + 3 * step_s) * 10_000)
    for i, (speed, force) in enumerate(steps):
        begin, end = (round((REST_S + i * step_s + t) * 10_000) for t in (0.3, step_s))
        assert recording.speed[begin:end].mean() == pytest.approx(speed, rel=0.05)
        assert recording.normal_force[begin:end].mean() == pytest.approx(force, rel=0.1)
        frequency, power = signal.welch(recording.acceleration[begin:end, 2], recording.fs, nperseg=10_000)
        assert frequency[np.argmax(power * (frequency > 15))] == pytest.approx(speed / 2.0, abs=1.5)
    assert recording.speed[: round(0.2 * 10_000)].max() < 5.0


def test_steps_have_the_spectra_of_separate_recordings():
    rough, conditions, fs = surface_catalogue(30, 0)[20], [(50.0, 0.6), (150.0, 1.5)], 2000.0
    steps = record_steps(rough, OPERATOR, conditions, step_s=6.0, fs=fs, seed=3)
    for i, (speed, force) in enumerate(conditions):
        alone = record_rising_speed(
            rough, OPERATOR, duration_s=6.0, fs=fs, seed=4, speed_mm_s=(speed, speed), force_n=force
        )
        begin = round((REST_S + 6.0 * i + 0.3) * fs)
        levels = []
        for x in (steps.acceleration[begin : begin + 11_000, 2], alone.acceleration[1000:, 2]):
            _, power = signal.welch(x, fs, nperseg=256)
            bands = power[: 128 // 16 * 16].reshape(-1, 16).mean(axis=1)
            levels.append(10 * np.log10(bands[1:]))
        assert np.sqrt(np.mean((levels[0] - levels[1]) ** 2)) < 1.5
