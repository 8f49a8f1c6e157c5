import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from texclass.loaders import open_dataset
from texclass.textures import Renderer, Scan, Texture
from texclass.textures.abdulali2016 import (
    bake,
    condition,
    cross_validate,
    fit_as_published,
    fit_texture,
    model_scan,
    simulate_scan,
    surface,
)
from texclass.textures.abdulali2016.loudness import growth_of, level_of, residual_of
from texclass.textures.abdulali2016.study import study_held_out
from texclass.vibration import Autoregression

FS = 1000.0
FAMILIES = ("network", "delaunay", "baked", "published")


@pytest.fixture(scope="module")
def training():
    return simulate_scan(surface("S7"), 15.0, FS, np.random.default_rng(0))


@pytest.fixture(scope="module")
def validation():
    return simulate_scan(surface("S7"), 6.0, FS, np.random.default_rng(1))


@pytest.fixture(scope="module")
def textures(training):
    modelled = model_scan(training)
    network = modelled.network()
    return {
        "network": network,
        "delaunay": modelled.delaunay(),
        "baked": bake(network, "S7", (9, 9, 5)),
        "published": fit_as_published(training),
    }


@pytest.fixture(params=FAMILIES)
def texture(request, textures):
    return textures[request.param]


def test_every_way_keeps_the_contract(texture):
    assert isinstance(texture, Texture)
    assert isinstance(texture.renderer(), Renderer)
    assert texture.family.startswith("abdulali2016")
    assert texture.operations > 12 * 20 / 2


@pytest.mark.parametrize("pieces", [1, 7, 16, 333])
def test_pieces_of_a_path_are_the_whole_path(texture, validation, pieces):
    v, f = validation.velocity[:700], validation.force[:700]
    whole = texture.renderer(seed=3).process(v, f)
    renderer = texture.renderer(seed=3)
    for _ in range(2):
        parts = [renderer.process(v[i : i + pieces], f[i : i + pieces]) for i in range(0, 700, pieces)]
        assert_array_equal(np.concatenate(parts), whole)
        renderer.reset()


def test_a_texture_survives_being_written_down(texture, validation):
    parameters = json.loads(json.dumps(dict(texture.parameters())))
    back = type(texture).restore(parameters, dict(texture.arrays()))
    v, f = validation.velocity[:300], validation.force[:300]
    assert_array_equal(back.renderer(seed=1).process(v, f), texture.renderer(seed=1).process(v, f))


def test_a_broken_file_is_refused(texture):
    parameters, arrays = dict(texture.parameters()), dict(texture.arrays())
    first = next(iter(arrays))
    wrong = [
        ({**parameters, "more": 1}, arrays),
        ({k: v for k, v in parameters.items() if k != "frame"}, arrays),
        ({**parameters, "fs": "fast"}, arrays),
        ({**parameters, "frame": [1, 2]}, arrays),
        ({**parameters, "frame": {**parameters["frame"], "peak": float("inf")}}, arrays),
        ({**parameters, "frame": {**parameters["frame"], "deviation": None}}, arrays),
        (parameters, {**arrays, first: np.array(["x"])}),
        (parameters, {**arrays, first: np.full_like(arrays[first], np.nan)}),
        (parameters, {**arrays, first: arrays[first][..., :1]}),
        (parameters, {}),
    ]
    if "growth" in parameters:
        wrong += [({**parameters, "growth": g}, arrays) for g in ([1], ["a", "b"], [1, -1], None)]
    for broken in wrong:
        with pytest.raises(ValueError, match="the rule is"):
            type(texture).restore(*broken)


def test_output_is_finite_and_within_twice_the_recorded_peak_on_wild_paths(texture, training):
    rng = np.random.default_rng(9)
    peak = np.abs(training.acceleration).max()
    for _ in range(20):
        jumps = np.repeat(rng.normal(0, 10 ** rng.uniform(0, 4), (12, 3)), 25, axis=0)
        y = texture.renderer(seed=int(rng.integers(99))).process(jumps[:, :2], jumps[:, 2])
        assert np.isfinite(y).all()
        assert np.abs(y).max() <= 2 * peak


def test_no_sound_without_contact_or_movement(texture):
    renderer = texture.renderer()
    n = 400
    assert np.abs(renderer.process(np.full((n, 2), 60.0), np.full(n, -1.0))).max() == 0
    moving = renderer.process(np.full((n, 2), 60.0), np.ones(n))
    assert moving[-200:].std() > 0
    stopped = renderer.process(np.zeros((n, 2)), np.ones(n))
    assert np.abs(stopped[-100:]).max() < 1e-3 * moving[-200:].std()


@pytest.mark.parametrize("family", ["network", "delaunay", "baked"])
def test_a_jump_of_speed_force_or_direction_does_not_click(textures, family):
    texture, n = textures[family], 1000
    velocity = np.tile([100.0, 0.0], (2 * n, 1))
    force = np.ones(2 * n)
    velocity[n:] = [0.0, 40.0]
    force[n:] = 0.5
    jumps = []
    for seed in range(8):
        y = texture.renderer(seed=seed).process(velocity, force)
        difference = np.abs(np.diff(y))
        jumps.append(difference[n - 1 : n + 60].max() / difference[n // 2 : n].max())
    assert np.max(jumps) < 1.5


def test_bad_paths_are_refused(texture):
    renderer = texture.renderer()
    with pytest.raises(ValueError, match="shape"):
        renderer.process(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="finite"):
        renderer.process(np.full((2, 2), np.nan), np.zeros(2))
    assert renderer.process(np.zeros((0, 2)), np.zeros(0)).size == 0


def test_inputs_of_other_kinds_are_taken_and_not_written_to(texture, validation):
    v = np.asfortranarray(validation.velocity[:200].astype(np.float32))
    f = validation.force[:400:2].astype(np.float32)
    v.setflags(write=False)
    expected = texture.renderer().process(v.astype(float), f.astype(float))
    assert_array_equal(texture.renderer().process(v, f), expected)


def test_a_rendered_recording_has_the_spectrum_and_level_of_a_new_one(textures, validation):
    for family, least in (("network", 0.96), ("delaunay", 0.95), ("baked", 0.955)):
        result = cross_validate(textures[family], validation)
        assert result.mean > least, family
        assert result.level_rms_db < 2.5, family
        assert result.mean == pytest.approx(result.gfc.mean())


@pytest.mark.parametrize("name", ["S2", "S5", "S9"])
def test_speed_force_and_direction_that_were_left_out_are_recovered(name):
    assert all(gfc > 0.95 for gfc in study_held_out(surface(name), 0).values())


def test_direction_matters_to_the_anisotropic_variant_only():
    what = surface("S1")
    training = simulate_scan(what, 20.0, FS, np.random.default_rng(2))
    validation = simulate_scan(what, 8.0, FS, np.random.default_rng(3))
    both = [cross_validate(fit_texture(training, isotropic=i), validation).mean for i in (False, True)]
    assert both[0] > both[1] + 0.01
    turned = fit_texture(training, isotropic=True).models([[60.0, 0], [0, 60.0]], [1.0, 1.0])
    assert_array_equal(turned[0][0], turned[0][1])


def test_the_network_says_at_a_segment_what_the_segment_said(training):
    modelled = model_scan(training, pooling="none", mirror="none")
    raw = modelled.points.u * modelled.normalisation.deviation + modelled.normalisation.mean
    out = modelled.network().network.at(modelled.frame.inputs(raw[:, :2], raw[:, 2]))
    assert_allclose(out[:, :-1], modelled.points.lsf, atol=1e-8)


def test_baking_finely_is_not_baking(textures):
    network = textures["network"]
    nodes = bake(network, "S7", (9, 9, 5)).grid
    assert np.abs(nodes[..., :-1]).max() < 1
    speed = network.frame.fastest * (3 / 4) ** 2  # node 7 of 9 along v_x
    k, level = network.models([[speed, 0.0]], [network.frame.hardest])
    assert_allclose(nodes[7, 4, 4], [*k[0], level[0]], atol=1e-12)


def test_a_buffer_of_jumps_is_an_option(training, validation):
    modelled = model_scan(training)
    held = modelled.network(glide=False, buffer=16)
    gliding = modelled.network(buffer=16)
    assert cross_validate(held, validation).mean == pytest.approx(
        cross_validate(gliding, validation).mean, abs=0.02
    )


def test_a_variance_that_swings_below_zero_is_silence(textures):
    network = textures["published"]
    net = network.network
    below = replace(network, network=replace(net, polynomial=net.polynomial - 100 * np.eye(1, 21, 20)))
    k, level = below.models([[60.0, 0.0]], [1.0])
    assert level[0] == 0
    assert np.abs(k).max() < 1


def test_a_scan_without_segments_or_of_another_rate_is_refused(textures, training):
    n = 300
    still = Scan(np.ones(n), np.zeros((n, 2)), np.zeros((n, 2)), np.ones(n), FS, "still")
    with pytest.raises(ValueError, match="'still' has no segment"):
        fit_texture(still)
    fast = Scan.along_line(np.ones(n), 10.0, 1.0, 2000.0)
    with pytest.raises(ValueError, match="one rate"):
        cross_validate(textures["network"], fast)
    with pytest.raises(ValueError, match="solver"):
        model_scan(training).network("best")


@pytest.mark.parametrize("gain", [0.0, 1e-70, 1e70])
def test_silence_and_extreme_gains_are_modelled(training, gain):
    motion = training.position, training.velocity, training.force
    scan = Scan(gain * training.acceleration, *motion, FS)
    for texture in (fit_texture(scan), fit_as_published(scan)):
        y = texture.renderer().process(scan.velocity[:2000], scan.force[:2000])
        assert np.isfinite(y).all()
        assert (np.abs(y).max() > 0) == (gain > 0)


def test_a_straight_stroke_can_be_modelled(validation):
    rng = np.random.default_rng(0)
    speed = 60 + 30 * np.sin(np.arange(8000) / 700)
    velocity = np.column_stack([speed, np.zeros(8000)])
    what = surface("S4")
    x = what.vibration(velocity, np.ones(8000), FS, rng)
    scan = condition(Scan.along_line(x, speed, 1.0, FS))
    for isotropic in (False, True):
        assert cross_validate(fit_texture(scan, isotropic=isotropic), scan).mean > 0.94


def test_the_law_of_growth_is_recovered():
    rng = np.random.default_rng(0)
    speed, force = np.exp(rng.uniform(3, 5, 60)), np.exp(rng.uniform(-1, 1, 60))
    level = 0.2 * speed**0.8 * force**0.5
    growth = growth_of(speed, force, level, rng.uniform(0.1, 1, 60))
    assert_allclose(growth, (0.8, 0.5), atol=1e-9)
    output = residual_of(level, speed, force, growth)
    assert_allclose(level_of("level", output, np.zeros((60, 1)), (speed, force), growth), level)
    assert growth_of(np.full(60, 50.0), force, force, np.ones(60)) == pytest.approx((0.0, 1.0))


def test_the_variance_of_the_paper_gives_the_level_of_the_process():
    k = np.array([[-0.9, 0.5]])
    model = Autoregression(k, [2.0])
    assert_allclose(level_of("variance", np.array([4.0]), k, (np.ones(1), np.ones(1)), (0, 0)), model.level)


@pytest.mark.parametrize("order", [1, 400])
def test_extreme_orders_are_stable(training, order):
    texture = fit_texture(training, order=order)
    k, _ = texture.models(training.velocity[::1000], training.force[::1000])
    assert np.abs(k).max() < 1
    assert texture.order == order


def test_stylus_recordings_are_modelled_from_their_first_half(data_root):
    dataset = open_dataset("stylus6")
    for entry in dataset.entries[:2]:
        scan = condition(Scan.from_recording(dataset.load(entry)))
        half = len(scan) // 2
        texture = fit_texture(scan.part(0, half), isotropic=True)
        assert cross_validate(texture, scan.part(half, len(scan))).mean > 0.96
