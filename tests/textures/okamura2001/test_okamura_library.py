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


@pytest.mark.parametrize("material", MATERIALS)
def test_table_1_is_recovered_within_three_percent(material):
    taps, velocity = simulate_taps(TABLE_I[material], np.random.default_rng(0), FS[material], n_taps=24)
    found = fit_aligned(taps, velocity, FS[material])
    assert_allclose(_values(found.model), _values(TABLE_I[material]), rtol=0.03)
    assert found.r_squared > 0.99
    assert found.explained > 0.98


def test_without_noise_parameters_and_onsets_between_samples_are_exact():
    fs, rests = 25_000.0, np.array([20.3, 31.75, 12.0])
    v = np.array([0.1, 0.2, 0.3])
    taps = [_tap(WOOD, u, r / fs, 300, fs) for u, r in zip(v, rests, strict=True)]
    found = fit_aligned(taps, v, fs)
    assert_allclose(_values(found.model), _values(WOOD), rtol=1e-4)
    assert_allclose(found.onset, rests, atol=1e-2)
    assert_allclose(found.amplitude, WOOD.amplitude_slope * v, rtol=1e-4)


def test_a_tap_that_began_before_the_recording_is_still_fitted():
    tap = _tap(WOOD, 0.2, -5 / 25_000, 300, 25_000.0)
    found = fit_aligned([tap], [0.2], 25_000.0)
    assert_allclose(found.onset, -5, atol=0.1)
    assert_allclose(_values(found.model), _values(WOOD), rtol=1e-2)


@pytest.mark.parametrize("gain", [1e-200, 1.0, -1e200])
def test_the_unit_of_the_taps_only_scales_the_slope(gain):
    tap = _tap(WOOD, 0.2, 1e-3, 300, 25_000.0)
    found = fit_aligned([gain * tap], [0.2], 25_000.0).model
    assert_allclose(found.amplitude_slope / gain, WOOD.amplitude_slope, rtol=1e-3)
    assert_allclose(found.decay_per_s, WOOD.decay_per_s, rtol=1e-3)


def test_onset_is_found_in_noise_of_the_rest():
    rng = np.random.default_rng(0)
    for rest in rng.uniform(30, 70, 50):
        tap = _tap(WOOD, 1.0, rest / 25_000, 300, 25_000.0)
        noisy = tap + 0.05 * np.abs(tap).max() * rng.standard_normal(300)
        assert abs(find_onset(noisy) - rest) < 4


@pytest.mark.parametrize(
    ("taps", "velocity"),
    [
        ([], []),
        ([[0.0] * 50], [1.0]),
        ([[1.0, 2.0]], [1.0]),
        ([[np.nan] * 50], [1.0]),
        ([np.sin(np.arange(50))], [0.0]),
        ([np.sin(np.arange(50))], [1.0, 2.0]),
    ],
)
def test_bad_taps_are_refused(taps, velocity):
    with pytest.raises(ValueError, match="rule is"):
        fit_aligned(taps, velocity, 1000.0)


def test_a_library_holds_one_model_a_material():
    taps = {m: [_tap(TABLE_I[m], 0.2, 1e-3, 400, FS[m])] for m in ("wood", "aluminum")}
    library, found = fit_library(taps, {m: [0.2] for m in taps}, 25_000.0)
    assert list(library) == ["wood", "aluminum"]
    assert library["wood"] is found["wood"].model
    with pytest.raises(ValueError, match="same ones"):
        fit_library(taps, {"wood": [0.2]}, 25_000.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"materials": ["a", "a", "b"]},
        {"models": TABLE_I.parameters()["models"][:2]},
        {"models": [{"amplitude_slope": 1.0, "decay_per_s": -1.0, "frequency_hz": 1.0}] * 3},
    ],
)
def test_a_library_is_restored_by_its_own_rules(changes):
    parameters = json.loads(json.dumps(TABLE_I.parameters()))
    assert TapLibrary.restore(parameters, {}) == TABLE_I
    with pytest.raises(ValueError, match="rule"):
        TapLibrary.restore({**parameters, **changes}, {})


@pytest.mark.parametrize("model", [*TABLE_I.models, *TABLE_II.models])
def test_the_peak_of_a_tap_is_its_largest_sample(model):
    x = TapModel(1.0, model.decay_per_s, model.frequency_hz).synthesize(1.0, 200_000, 1e6)
    assert_allclose(tap_peak(model), x.max(), rtol=1e-4)


def test_a_scaled_library_lies_in_the_band_and_the_forces_and_keeps_its_order():
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


def test_a_library_that_fits_already_stays_as_it_is():
    library = TapLibrary(("a", "b"), (TapModel(-100.0, 50.0, 60.0), TapModel(-150.0, 70.0, 200.0)))
    scaled = scale_into(library, ForceDevice(), 0.4)
    for m in library:
        assert_allclose(_values(scaled[m]), _values(library[m]))


@pytest.mark.parametrize(
    "change", [{"band_hz": (300.0, 30.0)}, {"force_n": (1.0, 20.0)}, {"rate_hz": 500.0}, {"mass_kg": 0.0}]
)
def test_impossible_devices_are_refused(change):
    with pytest.raises(ValueError, match="rule is"):
        ForceDevice(**change)
