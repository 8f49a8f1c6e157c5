"""Spatial textures: fit and rendering."""

from dataclasses import replace

import numpy as np
import pytest
from guruswamy2011_objects import OBJECTS, lay_out, simulate_scan

from texclass.haptics.textures.guruswamy2011 import (
    Amplitude,
    LevelLaw,
    SinusoidTexture,
    SpatialTexture,
    fit_texture,
)
from texclass.haptics.textures.guruswamy2011.texture import (
    BACKLASH_MM,
    MAX_RINGING,
    PEAK_FACTOR,
    SILENCE_RATIO,
)
from texclass.haptics.textures.scan import Scan
from texclass.vibration.decaying_modes import DecayingModes


@pytest.fixture(scope="module")
def rubber_fit():
    """Return a short scan of the simulated rubber mat and its texture."""
    rng = np.random.default_rng(3)
    section = lay_out(OBJECTS[2], 80.0, rng)
    return fit_texture(simulate_scan(OBJECTS[2], section, rng), OBJECTS[2].law)


# Fit --------------------------------------------------------------------------------------------------------


def test_rendering_along_the_path_of_the_scan_reproduces_the_scan(rubber_fit):
    scan, texture = rubber_fit.scan, rubber_fit.texture
    y = texture.renderer().process(scan.velocity, scan.force, scan.position)
    total = rubber_fit.responses.sum(len(scan), scan.fs)
    factor = texture.scaling.factor(scan.speed, scan.force)
    assert np.mean(np.abs(y - factor * total)) < 0.03 * np.mean(np.abs(y))
    assert np.mean(np.abs(total - rubber_fit.profile.samples)) < 0.153


def test_the_rendered_level_satisfies_equation_2_at_other_speeds(rubber_fit):
    texture = rubber_fit.texture
    n = 6000
    for speed, force in ((40.0, 0.443), (85.0, 0.443), (60.0, 1.5)):
        v = np.tile([[speed, 0.0]], (n, 1))
        y = texture.renderer().process(v, np.full(n, force))
        rms = np.sqrt(np.mean(y**2)) / np.sqrt(np.mean(rubber_fit.profile.samples**2))
        expected = texture.scaling.law.rms(speed, force) / texture.scaling.law.rms(
            texture.scaling.speed, texture.scaling.force
        )
        assert rms == pytest.approx(expected, rel=0.15)


def test_invalid_values_are_refused(rubber_fit):
    texture = rubber_fit.texture
    arrays = texture.arrays()
    for change in (
        {"fs": -1.0}, {"length_mm": 1.0}, {"length_mm": 1e-300}, {"peak": 1e300}, {"origin_mm": 1e300},
        {"course": "sideways"}, {"direction": [2.0, 0.0]}, {"decay_per_s": -arrays["decay_per_s"]},
        {"frequency_hz": arrays["frequency_hz"] + 1e4}, {"position_mm": arrays["position_mm"][::-1]},
        {"feature": arrays["feature"] + 0.5}, {"feature": arrays["feature"] + 1e6},
        {"amplitude": arrays["amplitude"][:-1]}, {"amplitude": 1e300 * arrays["amplitude"]},
        {"phase": np.nan * arrays["phase"]},
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"must (be|have)"):
            replace(texture, **change)


def test_the_baseline_has_one_sinusoid_per_feature_and_a_larger_error(rubber_fit):
    baseline = fit_texture(rubber_fit.scan, rubber_fit.texture.scaling.law, method="sinusoid")
    assert isinstance(baseline.texture, SinusoidTexture)
    assert baseline.texture.family == "guruswamy2011-sinusoid"
    assert np.array_equal(baseline.texture.feature, np.arange(baseline.texture.n_features))
    n, x = len(rubber_fit.scan), rubber_fit.profile.samples
    errors = [np.mean(np.abs(fit.responses.sum(n, 500.0) - x)) for fit in (baseline, rubber_fit)]
    assert errors[0] > 2 * errors[1]


def test_operations_count_the_active_modes(rubber_fit):
    texture = rubber_fit.texture
    modes = {"frequency_hz": [20.0], "decay_per_s": [10.0], "amplitude": [texture.peak], "phase": [0.0]}
    single = replace(texture, position_mm=[0.0], feature=[0], **modes)
    n_active = np.log(1 / SILENCE_RATIO) / 10.0 * texture.scaling.speed / texture.length_mm
    assert single.operations == pytest.approx(30 + 10 * n_active)


@pytest.mark.parametrize(("speed", "level"), [(0.0, 1.0), (20.0, 0.01)])
def test_scans_at_rest_and_silent_scans_are_refused(speed, level):
    noise = level * np.random.default_rng(0).standard_normal(500)
    with pytest.raises(ValueError, match=r"must contain a movement|Expected a stronger vibration"):
        fit_texture(Scan.along_line(noise, speed, 0.5, 500.0, "nothing"))


def test_features_lie_along_the_stroke_wherever_it_starts():
    t = np.arange(1000) / 500
    a = 5 * np.exp(-20 * (t % 0.2)) * np.sin(2 * np.pi * 40 * (t % 0.2))
    path = np.column_stack([-3.0 * t, 4.0 * t])
    velocity = np.tile([[-3.0, 4.0]], (1000, 1))
    scan = Scan(a, path + np.array([40.0, -7.0]), velocity, np.full(1000, 0.5), 500.0)
    fitted = fit_texture(scan)
    texture = fitted.texture
    assert texture.direction == pytest.approx([-0.6, 0.8])
    assert texture.n_features == pytest.approx(10, abs=1)
    rendered = texture.renderer().process(velocity, scan.force, scan.position)
    assert np.mean(np.abs(rendered - fitted.responses.sum(1000, 500.0))) < 0.02


# Rendering --------------------------------------------------------------------------------------------------


FS = 500.0
LAW = LevelLaw(k_v=20.0, k_c=0.5, a_0=0.3)
RING = DecayingModes(*np.array([[60.0], [30.0], [2.0], [-1.0]]))


def surface(positions=(10.0, 20.0, 35.0), length=50.0, **changes) -> SpatialTexture:
    n = len(positions)
    texture = SpatialTexture(
        "three ridges", FS, length, positions, np.arange(n), *(np.full(n, v[0]) for v in (
            RING.frequency_hz, RING.decay_per_s, RING.amplitude, RING.phase)),
        scaling=Amplitude(LAW, 20.0, 0.5), peak=2.0, direction=[1.0, 0.0],
    )  # fmt: skip
    return replace(texture, **changes)


def stroke(speed, n, start=0.0, force=0.5):
    x = start + speed * np.arange(n) / FS
    zero = np.zeros(n)
    return np.column_stack([np.full(n, speed), zero]), np.full(n, force), np.column_stack([x, zero])


def expected_output(texture, starts, n, factor):
    out = np.zeros(n)
    for k in starts:
        out[k:] += factor * RING.synthesize(n - k, FS)
    return out


@pytest.mark.parametrize(
    ("speed", "force", "compensated"),
    [(20.0, 0.5, True), (55.0, 9.0, False), (130.0, 0.5, True), (130.0, 0.01, False), (12.0, 0.5, True)],
)
def test_the_output_is_the_sum_of_equation_5(speed, force, compensated):
    texture = surface(scaling=Amplitude(LAW, 20.0, 0.5, compensated))
    v, f, x = stroke(speed, 1000, force=force)
    starts = [
        int(np.argmax(x[:, 0] >= position + 50.0 * period))
        for period in range(6)
        for position in texture.position_mm
        if position + 50.0 * period <= x[-1, 0]
    ]
    expected = expected_output(texture, starts, 1000, texture.scaling.factor(speed, force))
    assert np.abs(texture.renderer().process(v, f, x) - expected).max() < 5 * SILENCE_RATIO * texture.peak


def test_a_return_stroke_passes_the_features_in_reverse_order():
    texture = surface()
    v, f, x = stroke(50.0, 400)
    path = np.concatenate([x, x[::-1]])
    y = texture.renderer().process(np.concatenate([v, -v]), np.concatenate([f, f]), path)
    forward = [int(np.argmax(path[:, 0] >= position)) for position in (10.0, 20.0, 35.0)]
    back = [400 + int(np.argmax(path[400:, 0] + BACKLASH_MM < position)) for position in (35.0, 20.0, 10.0)]
    expected = expected_output(texture, forward + back, 800, texture.scaling.factor(50.0, 0.5))
    assert np.abs(y - expected).max() < 7 * SILENCE_RATIO * texture.peak


def test_a_tip_that_trembles_on_a_feature_excites_it_once():
    texture = surface()
    x = np.concatenate([np.linspace(9, 10.0, 50), 10 + 0.04 * np.sin(np.arange(500))])
    path = np.column_stack([x, np.zeros(x.size)])
    y = texture.renderer().process(np.gradient(path, axis=0) * FS, np.full(x.size, 0.5), path)
    assert np.abs(y).max() > 0.5
    assert np.abs(y[-200:]).max() == 0


def test_grooves_are_silent_along_their_direction_and_grains_are_not():
    v, f, x = stroke(100.0, 500)
    perpendicular = v[:, ::-1], f, x[:, ::-1]
    assert not np.any(surface().renderer().process(*perpendicular))
    grains = surface(course="travelled")
    assert np.array_equal(grains.renderer().process(*perpendicular), grains.renderer().process(v, f, x))


def test_without_contact_no_feature_is_excited_and_active_modes_decay():
    texture = surface()
    v, f, x = stroke(50.0, 400)
    assert not np.any(texture.renderer().process(v, 0 * f, x))
    lifted = np.where(x[:, 0] > 10.5, 0.0, 0.5)
    y, pressed = (texture.renderer().process(v, force, x) for force in (lifted, f))
    second = int(np.argmax(x[:, 0] >= 20))
    assert np.array_equal(y[:second], pressed[:second])
    assert np.abs(y[-50:]).max() == 0


def test_decayed_modes_leave_the_pool():
    renderer = surface().renderer()
    renderer.process(*stroke(50.0, 450))
    assert renderer.n_ringing <= 2
    renderer.process(np.zeros((400, 2)), np.full(400, 0.5), np.tile([[44.9, 0.0]], (400, 1)))
    assert renderer.n_ringing == 0


def test_the_output_is_bounded_and_finite_for_any_path():
    positions = np.arange(0.0, 50.0, 0.05)
    texture = surface(tuple(positions))
    rng = np.random.default_rng(4)
    renderer = texture.renderer()
    for _ in range(10):
        v = 10.0 ** rng.uniform(0, 6) * rng.standard_normal((100, 2))
        y = renderer.process(v, 50 * rng.standard_normal(100), 1e3 * rng.standard_normal((100, 2)))
        assert np.all(np.isfinite(y))
        assert np.abs(y).max() <= PEAK_FACTOR * texture.peak
        assert renderer.n_ringing <= MAX_RINGING


def test_the_surface_repeats_far_from_the_origin():
    texture = surface()
    reference = texture.renderer().process(*stroke(50.0, 400))
    for period in (-1000, 1000):
        shifted = texture.renderer().process(*stroke(50.0, 400, start=50.0 * period))
        assert np.abs(shifted - reference).max() < 1e-9


def test_too_large_inputs_are_refused_and_leave_the_state_unchanged():
    texture = surface()
    v, f, x = stroke(50.0, 200)
    renderer = texture.renderer()
    renderer.process(v[:100], f[:100], x[:100])
    for which in range(3):
        inputs = [v[100:].copy(), f[100:].copy(), x[100:].copy()]
        inputs[which][3] = 1e10
        with pytest.raises(ValueError, match="at most 1e"):
            renderer.process(*inputs)
    whole = texture.renderer().process(v, f, x)
    assert np.array_equal(renderer.process(v[100:], f[100:], x[100:]), whole[100:])
    with pytest.raises(ValueError, match="position"):
        renderer.process(v, f, x[:-1])
