from dataclasses import replace

import numpy as np
import pytest

from texclass.textures.guruswamy2011 import SinusoidTexture, fit_texture
from texclass.textures.guruswamy2011.texture import SILENT
from texclass.textures.scan import Scan


def test_rendered_along_the_scan_it_is_the_scan(rubber_fit):
    scan, texture = rubber_fit.scan, rubber_fit.texture
    y = texture.renderer().process(scan.velocity, scan.force, scan.position)
    total = rubber_fit.responses.sum(len(scan), scan.fs)
    factor = texture.scaling.factor(scan.speed, scan.force)
    assert np.mean(np.abs(y - factor * total)) < 0.03 * np.mean(np.abs(y))
    assert np.mean(np.abs(total - rubber_fit.profile.samples)) < 0.153


def test_rendered_level_obeys_equation_2_at_other_speeds(rubber_fit):
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


def test_what_breaks_a_rule_is_refused(rubber_fit):
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
        with pytest.raises(ValueError, match="the rule is"):
            replace(texture, **change)


def test_baseline_is_one_sinusoid_a_feature_and_fits_worse(rubber_fit):
    baseline = fit_texture(rubber_fit.scan, rubber_fit.texture.scaling.law, method="sinusoid")
    assert isinstance(baseline.texture, SinusoidTexture)
    assert baseline.texture.family == "guruswamy2011-sinusoid"
    assert np.array_equal(baseline.texture.feature, np.arange(baseline.texture.n_features))
    n, x = len(rubber_fit.scan), rubber_fit.profile.samples
    errors = [np.mean(np.abs(each.responses.sum(n, 500.0) - x)) for each in (baseline, rubber_fit)]
    assert errors[0] > 2 * errors[1]


def test_operations_count_the_modes_that_ring(rubber_fit):
    texture = rubber_fit.texture
    modes = {"frequency_hz": [20.0], "decay_per_s": [10.0], "amplitude": [texture.peak], "phase": [0.0]}
    one = replace(texture, position_mm=[0.0], feature=[0], **modes)
    share = np.log(1 / SILENT) / 10.0 * texture.scaling.speed / texture.length_mm
    assert one.operations == pytest.approx(30 + 10 * share)


@pytest.mark.parametrize(("speed", "level"), [(0.0, 1.0), (20.0, 0.01)])
def test_a_scan_that_rests_or_is_silent_is_refused(speed, level):
    noise = level * np.random.default_rng(0).standard_normal(500)
    with pytest.raises(ValueError, match="the rule is"):
        fit_texture(Scan.along_line(noise, speed, 0.5, 500.0, "nothing"))


def test_features_lie_along_the_stroke_wherever_it_began():
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
