import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from okamura2001_taps import FS, MATERIALS, TABLE_I, TABLE_II, simulate_taps

from texclass.textures.okamura2001 import (
    ForceDevice,
    TapLibrary,
    find_onset,
    fit_aligned,
    fit_library,
    scale_into,
    tap_peak,
)
from texclass.vibration import TapModel

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
        found = fit_aligned(taps, velocity, FS[material])
        assert_allclose(_values(found.model), _values(TABLE_I[material]), rtol=0.03)
        assert found.r_squared > 0.99
        assert found.explained > 0.98


def test_without_noise_parameters_and_onsets_between_samples_and_before_the_first_are_exact():
    fs, rests = 25_000.0, np.array([20.3, 31.75, 12.0])
    v = np.array([0.1, 0.2, 0.3])
    taps = [_tap(WOOD, u, r / fs, 300, fs) for u, r in zip(v, rests, strict=True)]
    found = fit_aligned(taps, v, fs)
    assert_allclose(_values(found.model), _values(WOOD), rtol=1e-4)
    assert_allclose(found.onset, rests, atol=1e-2)
    assert_allclose(found.amplitude, WOOD.amplitude_slope * v, rtol=1e-4)
    begun = fit_aligned([_tap(WOOD, 0.2, -5 / fs, 300, fs)], [0.2], fs)
    assert_allclose(begun.onset, -5, atol=0.1)
    assert_allclose(_values(begun.model), _values(WOOD), rtol=1e-2)


def test_the_unit_of_the_taps_only_scales_the_slope():
    tap = _tap(WOOD, 0.2, 1e-3, 300, 25_000.0)
    for gain in (1e-200, 1.0, -1e200):
        found = fit_aligned([gain * tap], [0.2], 25_000.0).model
        assert_allclose(found.amplitude_slope / gain, WOOD.amplitude_slope, rtol=1e-3)
        assert_allclose(found.decay_per_s, WOOD.decay_per_s, rtol=1e-3)


def test_onset_is_found_in_noise_of_the_rest():
    rng = np.random.default_rng(0)
    for rest in rng.uniform(30, 70, 50):
        tap = _tap(WOOD, 1.0, rest / 25_000, 300, 25_000.0)
        noisy = tap + 0.05 * np.abs(tap).max() * rng.standard_normal(300)
        assert abs(find_onset(noisy) - rest) < 4


def test_bad_taps_and_impossible_devices_are_refused():
    sine = np.sin(np.arange(50))
    for taps, velocity in (
        ([], []), ([[0.0] * 50], [1.0]), ([[1.0, 2.0]], [1.0]), ([[np.nan] * 50], [1.0]), ([sine], [0.0]),
        ([sine], [1.0, 2.0]),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="rule is"):
            fit_aligned(taps, velocity, 1000.0)
    for change in (
        {"band_hz": (300.0, 30.0)},
        {"force_n": (1.0, 20.0)},
        {"rate_hz": 500.0},
        {"mass_kg": 0.0},
    ):
        with pytest.raises(ValueError, match="rule is"):
            ForceDevice(**change)


def test_a_library_holds_one_model_a_material():
    taps = {m: [_tap(TABLE_I[m], 0.2, 1e-3, 400, FS[m])] for m in ("wood", "aluminum")}
    library, found = fit_library(taps, {m: [0.2] for m in taps}, 25_000.0)
    assert list(library) == ["wood", "aluminum"]
    assert library["wood"] is found["wood"].model
    with pytest.raises(ValueError, match="same ones"):
        fit_library(taps, {"wood": [0.2]}, 25_000.0)


def test_a_library_is_restored_by_its_own_rules():
    parameters = json.loads(json.dumps(TABLE_I.parameters()))
    assert TapLibrary.restore(parameters, {}) == TABLE_I
    for changes in (
        {"materials": ["a", "a", "b"]},
        {"models": parameters["models"][:2]},
        {"models": [{"amplitude_slope": 1.0, "decay_per_s": -1.0, "frequency_hz": 1.0}] * 3},
    ):
        with pytest.raises(ValueError, match="rule"):
            TapLibrary.restore({**parameters, **changes}, {})


def test_the_peak_of_a_tap_is_its_largest_sample():
    for model in (*TABLE_I.models, *TABLE_II.models):
        x = TapModel(1.0, model.decay_per_s, model.frequency_hz).synthesize(1.0, 50_000, 250e3)
        assert_allclose(tap_peak(model), x.max(), rtol=1e-4)


def test_a_scaled_library_lies_in_the_band_and_the_forces_keeps_its_order_and_itself_if_it_fits():
    device = ForceDevice()
    scaled = scale_into(TABLE_I, device, 0.4)
    w, before = scaled.table[:, 2], TABLE_I.table[:, 2]
    assert_allclose([w.min(), w.max()], device.band_hz)
    assert_array_equal(np.argsort(w), np.argsort(before))
    forces = [device.peak_force(m, 0.4) for m in scaled.models]
    assert device.force_n[0] <= min(forces) < max(forces) <= device.force_n[1] * (1 + 1e-9)
    ratio = [m.frequency_hz / m.decay_per_s for m in scaled.models]
    assert_allclose(ratio, [m.frequency_hz / m.decay_per_s for m in TABLE_I.models])
    assert all(m.amplitude_slope < 0 for m in scaled.models)
    library = TapLibrary(("a", "b"), (TapModel(-100.0, 50.0, 60.0), TapModel(-150.0, 70.0, 200.0)))
    scaled = scale_into(library, device, 0.4)  # fits already
    for m in library:
        assert_allclose(_values(scaled[m]), _values(library[m]))
