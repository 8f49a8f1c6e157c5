from dataclasses import replace

import numpy as np
import pytest
from abdulali2016_simulated import simulate_scan
from abdulali2016_study import cross_validate, fit_as_published, study_held_out
from numpy.testing import assert_allclose, assert_array_equal

from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import bake, condition, fit_texture, model_scan
from texclass.haptics.textures.abdulali2016.model_points import compute_level, fit_growth
from texclass.haptics.textures.resonant_surfaces import get_surface
from texclass.loaders import open_dataset
from texclass.vibration import Autoregression

FS = 1000.0


@pytest.fixture(scope="module")
def training():
    return simulate_scan(get_surface("S7"), 15.0, FS, np.random.default_rng(0))


@pytest.fixture(scope="module")
def validation():
    return simulate_scan(get_surface("S7"), 6.0, FS, np.random.default_rng(1))


@pytest.fixture(scope="module")
def modelled(training):
    return model_scan(training)


@pytest.fixture(scope="module")
def textures(training, modelled):
    network = modelled.network()
    return {
        "network": network,
        "delaunay": modelled.delaunay(),
        "baked": bake(network, "S7", (9, 9, 5)),
        "published": fit_as_published(training),
    }


@pytest.fixture(params=["network", "delaunay", "baked", "published"])
def texture(request, textures):
    return textures[request.param]


def test_invalid_parameters_and_arrays_are_refused(texture):
    parameters, arrays = dict(texture.parameters()), dict(texture.arrays())
    first = next(iter(arrays))
    frames = ({"peak": float("inf")}, {"peak": -1.0}, {"mean": [0.0]}, {"deviation": [0.0] * 3})
    cases = [({"frame": {**parameters["frame"], **change}}, {}) for change in frames]
    cases += [({"fs": -1.0}, {}), ({}, {first: np.full_like(arrays[first], np.nan)})]
    cases += [({}, {first: arrays[first][..., :1]})]
    if "growth" in parameters:
        cases += [({"growth": growth}, {}) for growth in ([1], [1, -1], [1, 9])]
        cases += [
            ({"frame": {**parameters["frame"], "gap": 1.0}}, {}),
            ({"buffer": 0}, {}),
            ({"loudness": 0}, {}),
        ]
    for change, changed_arrays in cases:
        with pytest.raises(ValueError, match=r"Expected|must"):
            type(texture).restore({**parameters, **change}, {**arrays, **changed_arrays})


def test_output_is_silent_without_contact_or_motion_and_at_most_twice_the_recorded_peak(texture, training):
    rng, peak = np.random.default_rng(9), np.abs(training.acceleration).max()
    for seed in range(8):
        path = np.repeat(rng.normal(0, 10 ** rng.uniform(0, 4), (12, 3)), 25, axis=0)
        assert np.abs(texture.renderer(seed=seed).process(path[:, :2], path[:, 2])).max() <= 2 * peak
    renderer, n = texture.renderer(), 400
    assert np.abs(renderer.process(np.full((n, 2), 60.0), np.full(n, -1.0))).max() == 0
    moving = renderer.process(np.full((n, 2), 60.0), np.ones(n))
    assert moving[-200:].std() > 0
    stopped = renderer.process(np.zeros((n, 2)), np.ones(n))
    assert np.abs(stopped[-100:]).max() < 1e-3 * moving[-200:].std()


def test_a_jump_of_speed_force_or_direction_does_not_click(textures):
    n = 1000
    velocity, force = np.tile([100.0, 0.0], (2 * n, 1)), np.ones(2 * n)
    velocity[n:], force[n:] = [0.0, 40.0], 0.5
    for family in ("network", "delaunay", "baked"):
        for seed in range(8):
            difference = np.abs(np.diff(textures[family].renderer(seed=seed).process(velocity, force)))
            assert difference[n - 1 : n + 60].max() < 1.5 * difference[n // 2 : n].max(), family


def test_a_rendered_recording_has_the_spectrum_and_level_of_a_new_one(textures, validation):
    for family, min_gfc in (("network", 0.96), ("delaunay", 0.95), ("baked", 0.955)):
        scores = cross_validate(textures[family], validation)
        assert scores.gfc > min_gfc, family
        assert scores.level_db < 2.5, family


@pytest.mark.parametrize("name", ["S2", "S9"])
def test_held_out_speeds_forces_and_directions_are_recovered(name):
    assert all(gfc > 0.95 for gfc in study_held_out(get_surface(name), 0).values())


def test_only_the_anisotropic_variant_uses_the_direction(textures, training, validation):
    isotropic = fit_texture(training, isotropic=True)
    gfc = [cross_validate(texture, validation).gfc for texture in (textures["network"], isotropic)]
    assert gfc[0] > gfc[1] + 0.01
    k, _ = isotropic.models([[60.0, 0], [0, 60.0]], [1.0, 1.0])
    assert_array_equal(k[0], k[1])


def test_the_network_interpolates_the_segments_and_negative_variances_are_silent(textures, training):
    plain = model_scan(training, pooling="none", mirror="none")
    raw = plain.points.u * plain.frame.deviation + plain.frame.mean
    out = plain.network().network.at(plain.frame.inputs(raw[:, :2], raw[:, 2]))
    assert_allclose(out[:, :-1], plain.points.lsf, atol=1e-8)
    texture, network = textures["published"], textures["published"].network
    lowered = replace(network, polynomial=network.polynomial - 100 * np.eye(1, 21, 20))
    below = replace(texture, network=lowered)
    k, level = below.models([[60.0, 0.0]], [1.0])  # the variance is negative
    assert level[0] == 0
    assert np.abs(k).max() < 1


def test_a_baked_texture_equals_the_network_at_its_nodes(textures):
    network, grid = textures["network"], textures["baked"].grid
    speed = network.frame.fastest * (3 / 4) ** 2  # node 7 of 9 along v_x
    k, level = network.models([[speed, 0.0]], [network.frame.hardest])
    assert_allclose([*grid.rows[7, 4, 4], np.sqrt(grid.power[7, 4, 4])], [*k[0], level[0]], atol=1e-12)
    for nodes in ((9, 9), (9, 9, 1)):
        with pytest.raises(ValueError, match="nodes must be"):
            bake(network, "S7", nodes)
    scan = simulate_scan(get_surface("S4"), 8.0, FS, np.random.default_rng(0))
    isotropic, n = fit_texture(scan, isotropic=True), 3000
    original, baked = (
        texture.renderer(seed=1).process(np.tile([60.0, 0.0], (n, 1)), np.ones(n))
        for texture in (isotropic, bake(isotropic, "S4"))
    )
    assert_allclose(original[500:], baked[500:], atol=0.05 * original.std())


def test_scans_at_rest_and_unknown_options_are_refused(training, modelled):
    n = 300
    resting = Scan(np.ones(n), np.zeros((n, 2)), np.zeros((n, 2)), np.ones(n), FS, "rest")
    with pytest.raises(ValueError, match="'rest' must have at least one segment"):
        fit_texture(resting)
    with pytest.raises(ValueError, match="solver"):
        modelled.network("best")
    with pytest.raises(ValueError, match="pooling"):
        model_scan(training, pooling="some")


def test_silence_and_extreme_gains_and_orders_can_be_modelled(training):
    for gain in (0.0, 1e-70, 1e70):
        short = training.crop(0, 6000)
        scan = Scan(gain * short.acceleration, short.position, short.velocity, short.force, FS)
        for texture in (fit_texture(scan), fit_as_published(scan)):
            y = texture.renderer().process(scan.velocity[:2000], scan.force[:2000])
            assert np.isfinite(y).all()
            assert (np.abs(y).max() > 0) == (gain > 0)
    for order in (1, 400):
        texture = fit_texture(training.crop(0, 6000), order=order)
        assert np.abs(texture.models(training.velocity[::1000], training.force[::1000])[0]).max() < 1
        assert texture.order == order


def test_a_straight_stroke_can_be_modelled():
    speed = 60 + 30 * np.sin(np.arange(8000) / 700)
    velocity = np.column_stack([speed, np.zeros(8000)])
    x = get_surface("S4").vibration(velocity, np.ones(8000), FS, np.random.default_rng(0))
    scan = condition(Scan.along_line(x, speed, 1.0, FS))
    for isotropic in (False, True):
        assert cross_validate(fit_texture(scan, isotropic=isotropic), scan).gfc > 0.94


def test_the_exponents_of_the_level_are_recovered_and_the_variance_gives_the_level_of_the_process():
    rng = np.random.default_rng(0)
    speed, force = np.exp(rng.uniform(3, 5, 60)), np.exp(rng.uniform(-1, 1, 60))
    level = 0.2 * speed**0.8 * force**0.5
    growth = fit_growth(speed, force, level, rng.uniform(0.1, 1, 60))
    assert_allclose(growth, (0.8, 0.5), atol=1e-9)
    g, k = np.full(60, np.log(0.2)), np.array([[-0.9, 0.5]])
    assert_allclose(compute_level("level", g, np.zeros((60, 1)), (speed, force), growth), level)
    assert fit_growth(np.full(60, 50.0), force, force, np.ones(60)) == pytest.approx((0.0, 1.0))
    model = Autoregression(k, [2.0])
    assert_allclose(
        compute_level("variance", np.array([4.0]), k, (np.ones(1), np.ones(1)), (0, 0)), model.level
    )


@pytest.mark.filterwarnings("ignore:scan .* excluded")
def test_stylus_recordings_are_modelled_from_their_first_half(data_root):
    dataset = open_dataset("stylus6")
    for entry in dataset.entries[:2]:
        scan = condition(Scan.from_recording(dataset.load(entry)))
        half = len(scan) // 2
        texture = fit_texture(scan.crop(0, half), isotropic=True)
        assert cross_validate(texture, scan.crop(half, len(scan))).gfc > 0.96
