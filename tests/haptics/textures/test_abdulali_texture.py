from dataclasses import replace

import numpy as np
import pytest
from abdulali2016_simulated import simulate_scan
from abdulali2016_study import cross_validate, fit_as_published, study_held_out
from numpy.testing import assert_allclose, assert_array_equal

from texclass.haptics.textures import Scan
from texclass.haptics.textures.abdulali2016 import bake, condition, fit_texture, model_scan
from texclass.haptics.textures.abdulali2016.model_points import growth_of, level_of
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


def test_a_broken_file_is_refused(texture):
    parameters, arrays = dict(texture.parameters()), dict(texture.arrays())
    first = next(iter(arrays))
    frames = ({"peak": float("inf")}, {"peak": -1.0}, {"mean": [0.0]}, {"deviation": [0.0] * 3})
    wrong = [({"frame": {**parameters["frame"], **change}}, {}) for change in frames]
    wrong += [({"fs": -1.0}, {}), ({}, {first: np.full_like(arrays[first], np.nan)})]
    wrong += [({}, {first: arrays[first][..., :1]})]
    if "growth" in parameters:
        wrong += [({"growth": growth}, {}) for growth in ([1], [1, -1], [1, 9])]
        wrong += [
            ({"frame": {**parameters["frame"], "gap": 1.0}}, {}),
            ({"buffer": 0}, {}),
            ({"loudness": 0}, {}),
        ]
    for change, broken in wrong:
        with pytest.raises(ValueError, match=r"Expected|must"):
            type(texture).restore({**parameters, **change}, {**arrays, **broken})


def test_no_sound_without_contact_or_movement_and_none_beyond_twice_the_recorded_peak(texture, training):
    rng, peak = np.random.default_rng(9), np.abs(training.acceleration).max()
    for seed in range(8):
        wild = np.repeat(rng.normal(0, 10 ** rng.uniform(0, 4), (12, 3)), 25, axis=0)
        assert np.abs(texture.renderer(seed=seed).process(wild[:, :2], wild[:, 2])).max() <= 2 * peak
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
    for family, least in (("network", 0.96), ("delaunay", 0.95), ("baked", 0.955)):
        found = cross_validate(textures[family], validation)
        assert found.gfc > least, family
        assert found.level_db < 2.5, family


@pytest.mark.parametrize("name", ["S2", "S9"])
def test_speed_force_and_direction_that_were_left_out_are_recovered(name):
    assert all(gfc > 0.95 for gfc in study_held_out(get_surface(name), 0).values())


def test_direction_matters_to_the_anisotropic_variant_only(textures, training, validation):
    turned = fit_texture(training, isotropic=True)
    both = [cross_validate(each, validation).gfc for each in (textures["network"], turned)]
    assert both[0] > both[1] + 0.01
    k, _ = turned.models([[60.0, 0], [0, 60.0]], [1.0, 1.0])
    assert_array_equal(k[0], k[1])


def test_the_network_says_at_a_segment_what_the_segment_said_and_below_zero_nothing(textures, training):
    plain = model_scan(training, pooling="none", mirror="none")
    raw = plain.points.u * plain.frame.deviation + plain.frame.mean
    out = plain.network().network.at(plain.frame.inputs(raw[:, :2], raw[:, 2]))
    assert_allclose(out[:, :-1], plain.points.lsf, atol=1e-8)
    network, net = textures["published"], textures["published"].network
    below = replace(network, network=replace(net, polynomial=net.polynomial - 100 * np.eye(1, 21, 20)))
    k, level = below.models([[60.0, 0.0]], [1.0])  # a variance that swings below zero
    assert level[0] == 0
    assert np.abs(k).max() < 1


def test_a_baked_texture_is_the_network_at_its_nodes(textures):
    network, grid = textures["network"], textures["baked"].grid
    speed = network.frame.fastest * (3 / 4) ** 2  # node 7 of 9 along v_x
    k, level = network.models([[speed, 0.0]], [network.frame.hardest])
    assert_allclose([*grid.rows[7, 4, 4], np.sqrt(grid.power[7, 4, 4])], [*k[0], level[0]], atol=1e-12)
    for nodes in ((9, 9), (9, 9, 1)):
        with pytest.raises(ValueError, match="nodes are"):
            bake(network, "S7", nodes)
    flat = fit_texture(simulate_scan(get_surface("S4"), 8.0, FS, np.random.default_rng(0)), isotropic=True)
    n = 3000
    one, other = (
        each.renderer(seed=1).process(np.tile([60.0, 0.0], (n, 1)), np.ones(n))
        for each in (flat, bake(flat, "S4"))
    )
    assert_allclose(one[500:], other[500:], atol=0.05 * one.std())


def test_what_cannot_be_fitted_is_refused(training, modelled):
    n = 300
    still = Scan(np.ones(n), np.zeros((n, 2)), np.zeros((n, 2)), np.ones(n), FS, "still")
    with pytest.raises(ValueError, match="'still' has no segment"):
        fit_texture(still)
    with pytest.raises(ValueError, match="solver"):
        modelled.network("best")
    with pytest.raises(ValueError, match="pooling"):
        model_scan(training, pooling="some")


def test_silence_extreme_gains_and_extreme_orders_are_modelled(training):
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


def test_the_law_of_growth_is_recovered_and_the_variance_gives_the_level_of_the_process():
    rng = np.random.default_rng(0)
    speed, force = np.exp(rng.uniform(3, 5, 60)), np.exp(rng.uniform(-1, 1, 60))
    level = 0.2 * speed**0.8 * force**0.5
    growth = growth_of(speed, force, level, rng.uniform(0.1, 1, 60))
    assert_allclose(growth, (0.8, 0.5), atol=1e-9)
    g, k = np.full(60, np.log(0.2)), np.array([[-0.9, 0.5]])
    assert_allclose(level_of("level", g, np.zeros((60, 1)), (speed, force), growth), level)
    assert growth_of(np.full(60, 50.0), force, force, np.ones(60)) == pytest.approx((0.0, 1.0))
    model = Autoregression(k, [2.0])
    assert_allclose(level_of("variance", np.array([4.0]), k, (np.ones(1), np.ones(1)), (0, 0)), model.level)


def test_stylus_recordings_are_modelled_from_their_first_half(data_root):
    dataset = open_dataset("stylus6")
    for entry in dataset.entries[:2]:
        scan = condition(Scan.from_recording(dataset.load(entry)))
        half = len(scan) // 2
        texture = fit_texture(scan.crop(0, half), isotropic=True)
        assert cross_validate(texture, scan.crop(half, len(scan))).gfc > 0.96
