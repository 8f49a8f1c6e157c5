import json
import pkgutil
import re
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from c_program import build, needs_compiler, run
from numpy.testing import assert_array_equal
from typer.testing import CliRunner

from texclass.cli import app
from texclass.haptics.exchange import (
    describe,
    load_texture,
    play_ahap,
    play_hjif,
    play_texture,
    read_ahap,
    read_hatt,
    read_hjif,
    read_wav,
    save_texture,
    to_hatt,
    write_ahap,
    write_hatt,
    write_hjif,
    write_wav,
)
from texclass.haptics.exchange.texture_file import TAPS, TEXTURES
from texclass.haptics.scene import (
    PlannedScene,
    SceneRenderer,
    SceneSurface,
    measurement,
    plan,
    scene_of_file,
    surface_spectra,
)
from texclass.haptics.textures import GridModel, GridTexture, Renderer, Texture, pack
from texclass.haptics.textures.abdulali2016 import DelaunayTexture, Frame, NetworkTexture, RadialNetwork, bake
from texclass.haptics.textures.contract import stroke_range
from texclass.haptics.textures.guruswamy2011 import Amplitude, LevelLaw, SinusoidTexture, SpatialTexture
from texclass.haptics.textures.oeztuerk2018 import FrequencyTexture, LpcTexture
from texclass.vibration import Autoregression
from texclass.vibration.line_spectrum import from_reflection
from texclass.vibration.major_frequencies import MajorFrequencies
from texclass.vibration.scores import goodness_of_fit

K = np.array([[-0.8, 0.5, 0.1], [-0.5, 0.6, 0.2]])
LSF = from_reflection(K[0])
FRAME = Frame(True, (80.0, 1.0), (40.0, 0.5), 160.0, 2.0, 4.0, 0.05, 5.0, 20.0, (16.0, 160.0), (0.2, 2.0))
POLYNOMIAL = np.vstack([np.append(LSF, 0.4), np.append(0.05 * LSF, 0.1), np.append(0.02 * LSF, 0.1)])


def network():
    return NetworkTexture(
        "slate", 1000.0, FRAME, RadialNetwork(np.zeros((1, 2)), np.zeros((1, 4)), POLYNOMIAL)
    )


def delaunay():
    u = np.array([[-2.0, -2.0], [2.0, -2.0], [-2.0, 2.0], [2.0, 2.0]])
    outputs = np.append(LSF, 0.5) * np.array([[0.9], [0.95], [1.0], [1.05]])
    return DelaunayTexture("slate", 1000.0, FRAME, u, outputs)


def lpc(fs=2000.0):
    return LpcTexture([50.0, 150.0], Autoregression(K, [0.2, 0.5]), 3.0, fs, "slate")


def frequencies():
    models = [
        MajorFrequencies([90.0, 210.0], [1.0, 0.5], [0.1, 0.2]),
        MajorFrequencies([100.0], [2.0], [0.3]),
    ]
    return FrequencyTexture([50.0, 150.0], models, 3.0, 2000.0, "slate")


def spatial(kind):
    modes = [90.0, 240.0, 130.0], [60.0, 90.0, 75.0], [1.0, 0.4, 0.8], [0.0, 0.3, -0.2]
    return kind(
        "slate", 1000.0, 30.0, [1.0, 12.0], [0.0, 0.0, 1.0], *modes,
        Amplitude(LevelLaw(3.0, 0.2, 0.1), 60.0, 1.0), 2.0, [1.0, 0.0],
    )  # fmt: skip


GRID = GridModel(
    ([40.0, 80.0, 160.0], [0.5, 2.0]), np.repeat(K, 3, axis=0).reshape(3, 2, 3), np.full((3, 2), 0.3), 4.0
)
FAMILIES = {
    "abdulali2016": network,
    "abdulali2016-baked": lambda: bake(network(), "slate", (5, 4)),
    "abdulali2016-delaunay": delaunay,
    "grid": lambda: GridTexture("slate", 1000.0, GRID),
    "guruswamy2011": lambda: spatial(SpatialTexture),
    "guruswamy2011-sinusoid": lambda: spatial(SinusoidTexture),
    "hatt": lambda: to_hatt(network(), order=2),
    "oeztuerk2018-frequencies": frequencies,
    "oeztuerk2018-lpc": lpc,
}


def scene_surface():
    grid = GridModel(([50.0, 200.0], [0.5, 2.0]), np.full((2, 2, 1), 0.5), np.full((2, 2), 4.0), 5.0)
    scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 400.0), 30.0, 1, {"wood": 0}, (grid,))
    return SceneSurface(scene, "wood")


def packed_vibration():
    return pack(np.random.default_rng(0).standard_normal(2000), 40, fs=1000.0)


WITH_AR_MODELS = {
    **{name: make for name, make in FAMILIES.items() if not name.startswith(("guruswamy", "oeztuerk2018-f"))},
    "packed law": lambda: pack(to_hatt(network(), order=2), 64),
    "packed vibration": packed_vibration,
}
EVERY_KIND = FAMILIES | WITH_AR_MODELS | {"surface of a scene": scene_surface}


@pytest.mark.parametrize("kind", EVERY_KIND)
@pytest.mark.parametrize("motion", [(np.nan, 0, 1), (0, 1.4e154, 1), (50, 0, np.inf), (50, -2e9, 1)], ids=str)
def test_every_renderer_refuses_invalid_motion_and_keeps_its_state(kind, motion):
    renderer, twin = (EVERY_KIND[kind]().renderer(seed=3) for _ in range(2))
    velocity, force = np.full((50, 2), 60.0), np.ones(50)
    for each in (renderer, twin):
        each.process(velocity, force)
    bad_velocity, bad_force = velocity.copy(), force.copy()
    bad_velocity[7], bad_force[7] = motion[:2], motion[2]
    with pytest.raises(ValueError, match=r"must be finite and at most 1e\+09"):
        renderer.process(bad_velocity, bad_force)
    assert_array_equal(renderer.process(velocity, force), twin.process(velocity, force))


@pytest.fixture
def quick_plans(monkeypatch):
    """Plan textures with few candidates and samples."""
    grids = {"n_speeds": (1, 2), "n_forces": (1, 2), "reduced_grids": ((2, 2),), "n_lines": (1, 2)}
    monkeypatch.setattr(plan, "SEARCH", replace(plan.SEARCH, stages=(range(1, 7),), **grids))
    sampling = replace(surface_spectra.SAMPLING, n_speeds=2, n_forces=2, n_test_points=2)
    monkeypatch.setattr(surface_spectra, "SAMPLING", sampling)
    durations = replace(measurement.MEASUREMENT, n_samples=100, n_surface_samples=50)
    monkeypatch.setattr(measurement, "MEASUREMENT", durations)


@needs_compiler
@pytest.mark.parametrize("kind", [*FAMILIES, "packed law", "packed vibration", "surface of a scene"])
def test_the_c_header_of_every_texture_renders_the_samples_of_its_scene(kind, quick_plans, tmp_path):
    texture, path = (FAMILIES | WITH_AR_MODELS | {"surface of a scene": scene_surface})[kind](), "a.texture"
    if kind == "surface of a scene":
        texture.scene.save(tmp_path / path)
    else:
        save_texture(texture, tmp_path / path)
    scene, taps, losses = scene_of_file(tmp_path / path)
    is_exact = kind in ("grid", "packed law", "packed vibration", "surface of a scene")
    assert ("model" in losses) is not is_exact
    if is_exact and kind != "surface of a scene":
        model = texture.grid if kind == "grid" else texture.model
        assert_array_equal(scene.models[0].rows, model.rows)
    assert ("position" in losses) is kind.startswith("guruswamy")
    t = np.arange(3000)
    speed, force = 100 * (1 + np.sin(t / 200)), 1.5 * (1 + np.cos(t / 130))
    surfaces = np.where(t % 900 < 800, 0, -1)
    velocity = np.column_stack([speed, 0 * speed])
    samples, _, _ = run(build(tmp_path, scene, taps), surfaces, velocity, force)
    names = [next(iter(scene.model_indices)), None]
    expected = SceneRenderer(scene, n_contacts=1).process(
        velocity[np.newaxis], force[np.newaxis], [[names[i] for i in surfaces]]
    )[0]
    assert np.abs(expected).max() > 0
    assert np.abs(samples - expected).max() <= 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_every_texture_is_exported_at_the_middle_of_its_range(kind, tmp_path):
    texture = EVERY_KIND[kind]()
    for axis in (texture.speeds, texture.forces):
        assert axis.size
        assert axis[0] > 0
        assert np.all(np.diff(axis) > 0)
    played = play_texture(texture, seconds=0.3)
    middle = [np.sqrt(axis[0] * axis[-1]) for axis in (texture.speeds, texture.forces)]
    assert (played.speed, played.force) == pytest.approx(middle)
    ends = f"{texture.speeds[0]:.4g} to {texture.speeds[-1]:.4g} mm/s"
    assert (ends if texture.speeds.size > 1 else "has only this value") in played.losses["speed"]
    write_hjif(played, tmp_path / "a.hjif")
    write_ahap(played, tmp_path / "a.ahap")
    write_wav(tmp_path / "a.wav", played.samples, played.fs, unit=played.unit)
    level = [np.std(x) for x in (play_hjif(read_hjif(tmp_path / "a.hjif")), played.samples)]
    assert level[0] == pytest.approx(level[1], rel=0.03)
    assert play_ahap(read_ahap(tmp_path / "a.ahap")).any()
    outside = play_texture(texture, speed=3 * texture.speeds[-1], seconds=0.3).losses["speed"]
    assert ("outside the" in outside) == (texture.speeds.size > 1)


def test_a_packed_texture_has_the_range_of_its_law_or_the_nominal_speed_and_force():
    law, vibration = (WITH_AR_MODELS[kind]() for kind in ("packed law", "packed vibration"))
    for axis, expected in zip((law.speeds, law.forces), law.model.axes, strict=True):
        assert_array_equal(axis, expected)
        assert axis.size == 2
    assert (vibration.speeds.tolist(), vibration.forces.tolist()) == ([100.0], [1.0])


@pytest.mark.parametrize("kind", WITH_AR_MODELS)
def test_every_texture_of_ar_models_is_written_as_hatt(kind, tmp_path):
    texture = WITH_AR_MODELS[kind]()
    written = read_hatt(write_hatt(to_hatt(texture, fs=texture.fs), tmp_path / "a.xml"))
    assert (written.speeds[-1], written.forces[-1]) == pytest.approx(
        (5.0, 0.05) if kind == "packed vibration" else (texture.speeds[-1], texture.forces[-1])
    )
    speed, force = texture.speeds[-1], texture.forces[-1]
    original, converted = (
        play_texture(each, speed=speed, force=force, seconds=3.0) for each in (texture, written)
    )
    assert np.std(converted.samples) == pytest.approx(np.std(original.samples), rel=0.15)
    assert goodness_of_fit(original.samples, converted.samples) > 0.97


@pytest.mark.parametrize("kind", sorted(EVERY_KIND.keys() - WITH_AR_MODELS))
def test_textures_without_ar_models_are_not_written_as_hatt(kind):
    if kind != "surface of a scene":
        with pytest.raises(ValueError, match="must contain AR models, got"):
            to_hatt(EVERY_KIND[kind]())


FORMATS = ("texture", "xml", "hjif", "ahap", "wav", "html")
NOT_IN_FILES = ("surface of a scene",)


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("kind", sorted(EVERY_KIND.keys() - set(NOT_IN_FILES)))
def test_the_commands_convert_every_kind_of_texture_to_every_format(kind, suffix, tmp_path):
    texture = EVERY_KIND[kind]()
    source = save_texture(texture, tmp_path / "slate.texture")
    target = tmp_path / f"a.{suffix}"
    assert isinstance(load_texture(source), type(texture))
    speed, force = np.sqrt(texture.speeds[0] * texture.speeds[-1]), texture.forces[-1]
    words = ("convert", source, "-o", target)
    if suffix == "html":
        words = ("texture", source, "--page", target)
    elif suffix in ("hjif", "ahap", "wav"):
        words += ("--speed", speed, "--force", force, "--duration", 1.5)
        words += ("--physical",) if suffix == "wav" else ()
    elif suffix == "texture":
        words += ("--bytes", 128)
    result = CliRunner().invoke(app, [str(word) for word in words])
    if suffix == "xml" and kind not in WITH_AR_MODELS:
        assert "must contain AR models, got" in str(result.exception)
        return
    assert result.exit_code == 0, result.output or result.exception
    original = play_texture(texture, speed=speed, force=force, seconds=1.5).samples
    if suffix in ("texture", "xml"):
        read = load_texture(target)
        assert read.fs == (1000.0 if suffix == "xml" else texture.fs)
        converted = play_texture(read, speed=speed, force=force, seconds=1.5).samples
        tolerance_db = 3.0
    elif suffix == "hjif":
        back = tmp_path / "back.texture"
        assert CliRunner().invoke(app, ["convert", str(target), "-o", str(back)]).exit_code == 0
        converted = play_texture(load_texture(back), speed=speed, force=force, seconds=1.5).samples
        assert_level(play_hjif(read_hjif(target))[:, 0], original, 0.3)
        tolerance_db = 2.5  # noise of the converted model, and pauses of spatial textures
    elif suffix == "wav":
        vibration = read_wav(target)
        assert (vibration.fs, vibration.unit) == (texture.fs, "m/s^2")
        converted, tolerance_db = vibration.samples, 1e-3
    elif suffix == "ahap":
        assert play_ahap(read_ahap(target)).any()
        return
    else:
        data = re.search(r'id="scene">(.*?)</script>', target.read_text(), re.DOTALL)[1]
        (surface,) = json.loads(data)["surfaces"]
        assert surface["rms"] > 0
        if kind != "packed vibration":  # its model has one node, above which it is constant
            (slow, fast), (light, hard) = stroke_range(texture)
            assert slow * 0.999 <= surface["speeds"][0] <= surface["speeds"][1] <= fast * 1.001
            assert light * 0.999 <= surface["forces"][0] <= surface["forces"][1] <= hard * 1.001
        return
    if suffix == "xml" and texture.fs > 1000:  # .xml contains the frequencies below 500 Hz
        return
    assert_level(converted, original, tolerance_db)


def assert_level(x, reference, tolerance_db):
    assert abs(20 * np.log10(np.sqrt(np.mean(x**2) / np.mean(reference**2)))) < tolerance_db


def test_every_family_is_tested():
    assert set(TEXTURES) == set(FAMILIES)
    for family, class_path in (TEXTURES | TAPS).items():
        assert pkgutil.resolve_name(class_path).family == family


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_renders_the_same_samples_after_loading(family, tmp_path):
    texture = FAMILIES[family]()
    assert texture.family == family
    assert isinstance(texture, Texture)
    path = save_texture(texture, tmp_path / "slate.texture")
    v = np.column_stack([60 + 60 * np.sin(np.arange(400) / 60), np.zeros(400)])
    f = 1 + np.cos(np.arange(400) / 80)
    expected = texture.renderer(seed=1).process(v, f)
    assert expected.any()
    assert_array_equal(load_texture(path).renderer(seed=1).process(v, f), expected)
    properties = describe(path)
    assert (properties["family"], properties["name"], properties["fs"]) == (family, "slate", texture.fs)
    assert properties["bytes"] == path.stat().st_size
    assert properties["operations per sample"] == texture.operations


VARIANTS = FAMILIES | {
    "abdulali2016 as published": lambda: replace(network(), loudness="variance", buffer=5, glide=False),
    "guruswamy2011 travelled": lambda: replace(spatial(SpatialTexture), course="travelled"),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_renderer_takes_blocks_of_any_length_and_type_and_refuses_invalid_ones(variant):
    texture = VARIANTS[variant]()
    assert texture.operations > 0
    n = 5000
    t = np.arange(n) / 70
    v, f = np.column_stack([90 + 80 * np.sin(t), 20 * np.cos(t / 3)]), 1 + 1.5 * np.cos(t / 4)
    renderer = texture.renderer(seed=3)
    assert isinstance(renderer, Renderer)
    whole = renderer.process(v, f)
    assert whole.any()
    for size, last in ((1, 60), (7, 700), (16, 700), (1999, n)):
        renderer.reset()
        cuts = [0, 0, *range(size, last, size), last]
        blocks = [renderer.process(v[a:b], f[a:b]) for a, b in pairwise(cuts)]
        assert_array_equal(np.concatenate(blocks), whole[:last])
    renderer.reset()
    invalid = [(v[:3], f[:2]), (v[0], f[:2]), (v[:2] * np.nan, f[:2]), (v[:2], [1.0, np.inf])]
    for velocity, force in invalid:
        with pytest.raises(ValueError, match=r"velocity.* force.* must (be|have)"):
            renderer.process(velocity, force)
    assert_array_equal(
        renderer.process(v[:99], f[:99]), whole[:99]
    )  # refused blocks leave the state unchanged
    narrow = np.asfortranarray(v[:200].astype(np.float32))
    narrow.setflags(write=False)
    expected = texture.renderer().process(narrow.astype(np.float64), f[:200])
    assert_array_equal(texture.renderer().process(narrow, f[:200].tolist()), expected)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_reports_invalid_parameters_as_a_value_error(family, forge, tmp_path):
    path = save_texture(FAMILIES[family](), tmp_path / "slate.texture")
    whole = path.read_bytes()
    for key, value in product(FAMILIES[family]().parameters(), ([None], [], {}, "1", -1, 10**400, True)):
        try:
            load_texture(forge(path, {f"parameters/{key}": value}))
            message = str(path)  # the value is valid for some parameters
        except ValueError as error:
            message = str(error)
        assert str(path) in message
        path.write_bytes(whole)
