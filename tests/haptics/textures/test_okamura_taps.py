"""Joint fits of taps, tap libraries, and the virtual wall."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from okamura2001_taps import FS, MATERIALS, TABLE_I, TABLE_II, simulate_taps

from texclass.haptics.textures.okamura2001 import (
    ForceDevice,
    TapLibrary,
    VirtualWall,
    find_onset,
    fit_aligned,
    fit_library,
    scale_to_device,
    tap_peak,
)
from texclass.vibration import TapModel

# Taps and libraries -----------------------------------------------------------------------------------------


WOOD = TABLE_I["wood"]


def _tap(model, velocity, rest, n, fs):
    t = np.arange(n) / fs - rest
    shape = np.exp(-model.decay_per_s * np.maximum(t, 0)) * np.sin(2 * np.pi * model.frequency_hz * t)
    return np.where(t >= 0, model.amplitude_slope * velocity * shape, 0.0)


def _values(model):
    return np.array([model.amplitude_slope, model.decay_per_s, model.frequency_hz])


def test_table_1_is_recovered_within_three_percent():
    for material in MATERIALS:
        taps, velocity = simulate_taps(TABLE_I[material], np.random.default_rng(0), FS[material], n_taps=24)
        fit = fit_aligned(taps, velocity, FS[material])
        assert_allclose(_values(fit.model), _values(TABLE_I[material]), rtol=0.03)
        assert fit.r_squared > 0.99
        assert fit.explained_energy > 0.98


def test_fits_without_noise_are_exact_with_onsets_between_samples_and_before_the_first():
    fs, rests = 25_000.0, np.array([20.3, 31.75, 12.0])
    v = np.array([0.1, 0.2, 0.3])
    taps = [_tap(WOOD, u, r / fs, 300, fs) for u, r in zip(v, rests, strict=True)]
    fit = fit_aligned(taps, v, fs)
    assert_allclose(_values(fit.model), _values(WOOD), rtol=1e-4)
    assert_allclose(fit.onset, rests, atol=1e-2)
    assert_allclose(fit.amplitude, WOOD.amplitude_slope * v, rtol=1e-4)
    early = fit_aligned([_tap(WOOD, 0.2, -5 / fs, 300, fs)], [0.2], fs)
    assert_allclose(early.onset, -5, atol=0.1)
    assert_allclose(_values(early.model), _values(WOOD), rtol=1e-2)


def test_the_unit_of_the_taps_only_scales_the_slope():
    tap = _tap(WOOD, 0.2, 1e-3, 300, 25_000.0)
    for gain in (1e-200, 1.0, -1e200):
        fit = fit_aligned([gain * tap], [0.2], 25_000.0).model
        assert_allclose(fit.amplitude_slope / gain, WOOD.amplitude_slope, rtol=1e-3)
        assert_allclose(fit.decay_per_s, WOOD.decay_per_s, rtol=1e-3)


def test_the_onset_is_found_in_noise():
    rng = np.random.default_rng(0)
    for rest in rng.uniform(30, 70, 50):
        tap = _tap(WOOD, 1.0, rest / 25_000, 300, 25_000.0)
        noisy = tap + 0.05 * np.abs(tap).max() * rng.standard_normal(300)
        assert abs(find_onset(noisy) - rest) < 4


def test_invalid_taps_and_devices_are_refused():
    sine = np.sin(np.arange(50))
    for taps, velocity in (
        ([], []), ([[0.0] * 50], [1.0]), ([[1.0, 2.0]], [1.0]), ([[np.nan] * 50], [1.0]), ([sine], [0.0]),
        ([sine], [1.0, 2.0]),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"must (be|contain)|contains 50 NaN"):
            fit_aligned(taps, velocity, 1000.0)
    for change in (
        {"band_hz": (300.0, 30.0)},
        {"force_n": (1.0, 20.0)},
        {"rate_hz": 500.0},
        {"mass_kg": 0.0},
    ):
        with pytest.raises(ValueError, match=r"must (be|end below|satisfy|not exceed)"):
            ForceDevice(**change)


def test_a_library_has_one_model_per_material():
    taps = {m: [_tap(TABLE_I[m], 0.2, 1e-3, 400, FS[m])] for m in ("wood", "aluminum")}
    library, fits = fit_library(taps, {m: [0.2] for m in taps}, 25_000.0)
    assert list(library) == ["wood", "aluminum"]
    assert library["wood"] is fits["wood"].model
    with pytest.raises(ValueError, match="same materials"):
        fit_library(taps, {"wood": [0.2]}, 25_000.0)


def test_a_library_is_restored_with_the_checks_of_its_constructor():
    parameters = json.loads(json.dumps(TABLE_I.parameters()))
    assert TapLibrary.restore(parameters, {}) == TABLE_I
    for changes in (
        {"materials": ["a", "a", "b"]},
        {"models": parameters["models"][:2]},
        {"models": [{"amplitude_slope": 1.0, "decay_per_s": -1.0, "frequency_hz": 1.0}] * 3},
    ):
        with pytest.raises(ValueError, match=r"materials must be|a TapModel must be"):
            TapLibrary.restore({**parameters, **changes}, {})


def test_the_peak_of_a_tap_is_its_largest_sample():
    for model in (*TABLE_I.models, *TABLE_II.models):
        x = TapModel(1.0, model.decay_per_s, model.frequency_hz).synthesize(1.0, 50_000, 250e3)
        assert_allclose(tap_peak(model), x.max(), rtol=1e-4)


def test_a_scaled_library_fits_the_device_in_the_same_order_and_stays_if_it_fits():
    device = ForceDevice()
    scaled = scale_to_device(TABLE_I, device, 0.4)
    w, original = scaled.table[:, 2], TABLE_I.table[:, 2]
    assert_allclose([w.min(), w.max()], device.band_hz)
    assert_array_equal(np.argsort(w), np.argsort(original))
    forces = [device.peak_force(m, 0.4) for m in scaled.models]
    assert device.force_n[0] <= min(forces) < max(forces) <= device.force_n[1] * (1 + 1e-9)
    ratio = [m.frequency_hz / m.decay_per_s for m in scaled.models]
    assert_allclose(ratio, [m.frequency_hz / m.decay_per_s for m in TABLE_I.models])
    assert all(m.amplitude_slope < 0 for m in scaled.models)
    library = TapLibrary(("a", "b"), (TapModel(-100.0, 50.0, 60.0), TapModel(-150.0, 70.0, 200.0)))
    scaled = scale_to_device(library, device, 0.4)
    for m in library:
        assert_allclose(_values(scaled[m]), _values(library[m]))


# Virtual wall -----------------------------------------------------------------------------------------------


DEVICE = ForceDevice(limit_n=50.0)
WALL = VirtualWall(TABLE_II["aluminum"], DEVICE)
RATE = DEVICE.rate_hz


def _taps(n=6000, period=1500):
    t = np.arange(n)
    depth = 2 * np.sin(2 * np.pi * t / period - 0.5)
    return depth, np.gradient(depth) * RATE


def _press(depth, velocity, n):
    return np.full(n, depth), np.full(n, velocity)


def test_the_force_is_the_spring_plus_the_published_vibration():
    depth, velocity = _press(2.0, 150.0, 800)
    force = WALL.renderer().process(depth, velocity)
    vibration = WALL.tap.synthesize(0.15, 800, RATE) * DEVICE.mass_kg
    assert_allclose(force, WALL.stiffness_n_mm * 2.0 - vibration, atol=1e-9)


def test_the_forces_do_not_depend_on_the_block_length():
    depth, velocity = _taps()
    renderer = WALL.renderer()
    whole = renderer.process(depth, velocity)
    for size in (1, 13, 999):
        renderer.reset()
        cuts = range(0, depth.size, size)
        blocks = [renderer.process(depth[i : i + size], velocity[i : i + size]) for i in cuts]
        assert_array_equal(np.concatenate(blocks), whole)


def test_there_is_no_force_outside_the_wall_before_and_soon_after_a_tap():
    # an impact away from the wall causes no vibration
    assert_allclose(WALL.renderer().process(*_press(1.0, -100.0, 50)), WALL.stiffness_n_mm)
    renderer = WALL.renderer()
    assert not renderer.process(*_press(-1.0, 100.0, 100)).any()
    inside = renderer.process(*_press(1e-9, 100.0, 50))
    outside = renderer.process(*_press(-1.0, -100.0, 500))
    assert 0 < np.abs(outside).max() < np.abs(inside).max()
    assert np.abs(outside[200:]).max() < 1e-3 * np.abs(inside).max()


def test_a_second_tap_vibrates_with_its_own_velocity():
    renderer = WALL.renderer()
    first = renderer.process(*_press(1.0, 100.0, 5000))
    renderer.process(*_press(-1.0, 0.0, 2000))
    second = renderer.process(*_press(1.0, 200.0, 5000))
    spring = WALL.stiffness_n_mm * 1.0
    assert_allclose(second - spring, 2 * (first - spring), atol=1e-9)


def test_force_steps_at_impact_and_release_are_bounded_by_spring_and_vibration():
    depth, velocity = _taps()
    force = WALL.renderer().process(depth, velocity)
    impact = np.abs(velocity).max() * 1e-3 * abs(WALL.tap.amplitude_slope) * DEVICE.mass_kg
    per_sample = 2 * np.pi * WALL.tap.frequency_hz / RATE
    spring = WALL.stiffness_n_mm * np.abs(np.diff(depth)).max()
    assert np.abs(np.diff(force)).max() < 1.2 * (impact * per_sample + spring)


def test_the_force_never_exceeds_the_limit():
    wall = VirtualWall(TABLE_II["aluminum"], ForceDevice(limit_n=4.0))
    force = wall.renderer().process(*_press(7.9, 400.0, 2000))
    assert force.max() == 4.0
    assert force.min() >= -4.0


def test_invalid_paths_and_frequencies_above_half_the_rate_are_refused():
    for path in (([1.0, np.nan], [0.0, 0.0]), ([1.0], [np.inf]), ([1.0], [1.0, 2.0]), (1.0, 1.0)):
        with pytest.raises(ValueError, match="depth_mm and velocity_mm_s must have"):
            WALL.renderer().process(*path)
    with pytest.raises(ValueError, match="stiffness_n_mm must be"):
        VirtualWall(TABLE_II["aluminum"], ForceDevice(rate_hz=601.0, band_hz=(30.0, 250.0)), -1.0)
    with pytest.raises(ValueError, match="below half"):
        VirtualWall(TABLE_II["aluminum"], ForceDevice(rate_hz=590.0, band_hz=(30.0, 250.0)))
