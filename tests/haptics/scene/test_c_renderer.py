"""The C renderer compiles without warnings, in C and C++, and renders the samples of `SceneRenderer`."""

import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from c_program import CPP_COMPILER, build, compile_c, needs_compiler, run

from texclass.haptics.scene import PlannedScene, SceneRenderer, write_c_header
from texclass.haptics.scene.c_header import RENDERER, c_header, files
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.motion_renderer import MAX_INPUT
from texclass.vibration import DecayingModes, TapModel
from texclass.vibration.reflection import MAX_REFLECTION

V, F = np.array([40.0, 80.0, 160.0]), np.array([0.5, 2.0])
RNG = np.random.default_rng(0)
MODELS = {
    "lattice": GridModel((V, F), RNG.uniform(-0.9, 0.9, (3, 2, 6)), RNG.uniform(1, 9, (3, 2)), 20.0),
    "lines": GridModel((V, F), np.full((3, 2, 2), 0.9), np.ones((3, 2)), 4.0, [120.0, 0.0], [0.0, 2.0]),
    "both": GridModel((V, F), RNG.uniform(0, 0.8, (3, 2, 4)), np.ones((3, 2)), 4.0, [90.0], [0.0]),
    "one node": GridModel((V[:1], F[:1]), RNG.uniform(-0.4, 0.4, (1, 1, 3)), np.ones((1, 1)), 4.0),
    "order 400": GridModel((V, F[:1]), RNG.uniform(-0.3, 0.3, (3, 1, 400)), np.ones((3, 1)), 4.0),
    "edge of stability": GridModel((V, F), np.full((3, 2, 2), MAX_REFLECTION), np.ones((3, 2)), 4.0),
    "silence": GridModel.silence(),
}
TAPS = {
    "lattice": TapModel(300.0, 90.0, 210.0),
    "both": DecayingModes([60.0, 250.0, 900.0], [40.0, 80.0, 5.0], [1.0, 0.5, 3.0], [0.1, 2.0, 0.0]),
}


def make_scene(names, fs=1000.0, largest_output=30.0):
    models = tuple(MODELS[name] for name in names)
    indices = {name: i for i, name in enumerate(names)}
    return PlannedScene("all", fs, "m/s^2", (20.0, 450.0), largest_output, 1, indices, models)


def make_path(scene, n=3600):
    """Return a path with sweeps, jumps, rests, lifts, switches during crossfades, and extreme values."""
    rng, t = np.random.default_rng(1), np.arange(n)
    block = t // 60
    speed = 10.0 ** rng.uniform(-1, 4, n // 60)[block]
    force = rng.choice([-1.0, 0.0, 0.1, 1.0, 5.0, 1e4], n // 60)[block]
    sweep = (t >= n // 3) & (t < 2 * n // 3)
    speed[sweep] = 100 * (1 + np.sin(t[sweep] / 150))
    force[sweep] = 1.2 * (1 + np.cos(t[sweep] / 90))
    speed[::611], speed[420:480] = MAX_INPUT / 2, 0.0
    surfaces = rng.integers(-1, len(scene.model_indices), n // 60)[block]
    surfaces[:300] = np.arange(300) // 7 % (len(scene.model_indices) + 1) - 1
    return surfaces, np.column_stack([0.6 * speed, -0.8 * speed]), force


def render_in_python(scene, surfaces, velocity, force):
    names = [*scene.model_indices, None]
    renderer = SceneRenderer(scene, n_contacts=1)
    return renderer.process(velocity[np.newaxis], force[np.newaxis], [[names[i] for i in surfaces]])[0]


def size_in_header():
    """Return the largest size of the state of a contact that the header states."""
    text = files("texclass.haptics.scene").joinpath("c", RENDERER).read_text()
    return int(re.search(r"at most (\d+) bytes", text)[1])


@needs_compiler
@pytest.mark.parametrize("fs", [1000.0, 3000.0])
@pytest.mark.parametrize("names", [*([name] for name in MODELS), list(MODELS)], ids=", ".join)
def test_c_and_python_render_the_same_samples(names, fs, tmp_path):
    scene = make_scene(names, fs)
    path = make_path(scene)
    program = build(tmp_path, scene)
    samples, size, n_refused = run(program, *path)
    expected = render_in_python(scene, *path)
    assert np.abs(samples - expected).max() <= 1e-9 * np.abs(expected).max()
    assert np.abs(expected).max() > 0.1 or names == ["silence"]
    assert n_refused == 0
    in_blocks, _, _ = run(program, *path, mode="blocks")
    np.testing.assert_array_equal(in_blocks, samples)
    assert size <= size_in_header() <= 1.1 * size


@needs_compiler
@pytest.mark.skipif(CPP_COMPILER is None, reason="no C++ compiler is installed")
@pytest.mark.parametrize("language", ["c++11", "c++20"])
def test_the_header_is_valid_cpp_and_renders_the_same_samples(language, tmp_path):
    scene = make_scene(list(MODELS))
    path = make_path(scene)
    samples, _, _ = run(build(tmp_path, scene, TAPS, language=language), *path)
    expected = render_in_python(scene, *path)
    assert np.abs(samples - expected).max() <= 1e-9 * np.abs(expected).max()


@needs_compiler
def test_refused_inputs_count_as_rest_and_do_not_poison_the_state(tmp_path):
    scene = make_scene(["both"])
    surfaces, velocity, force = make_path(scene)
    valid_velocity, valid_force = velocity.copy(), force.copy()
    for t, motion in (
        (500, (np.nan, 0, 1)),
        (700, (0, 1.4e154, 1)),
        (900, (0, 0, np.inf)),
        (901, (-2e9, 0, 1)),
    ):
        velocity[t], force[t] = motion[:2], motion[2]
        valid_velocity[t], valid_force[t] = 0.0, 0.0
    samples, _, n_refused = run(build(tmp_path, scene), surfaces, velocity, force)
    expected = render_in_python(scene, surfaces, valid_velocity, valid_force)
    assert np.abs(samples - expected).max() <= 1e-9 * np.abs(expected).max()
    assert n_refused == 4


@needs_compiler
def test_taps_are_those_of_their_models_and_add_to_the_stroke(tmp_path):
    fs, n = 2000.0, 1500
    scene = make_scene(["lattice", "both", "silence"], fs, largest_output=1e6)
    program = build(tmp_path, scene, TAPS)
    surfaces, taps = np.zeros(n), np.zeros(n)
    surfaces[700:], taps[[10, 400, 800]] = 1, [0.2, 0.1, 0.3]
    rest = np.zeros((n, 2)), np.zeros(n)
    expected = np.zeros(n)
    for start, tap, velocity in ((10, "lattice", 0.2), (400, "lattice", 0.1), (800, "both", 0.3)):
        model = TAPS[tap]
        if isinstance(model, TapModel):
            expected[start:] += model.synthesize(velocity, n - start, fs)
        else:  # modes at 0.1 m/s
            expected[start:] += velocity / 0.1 * model.synthesize(n - start, fs)
    samples, _, _ = run(program, surfaces, *rest, taps)
    np.testing.assert_allclose(samples, expected, atol=1e-6)
    stroke = np.full((n, 2), 60.0), np.ones(n)
    both, _, _ = run(program, surfaces, *stroke, taps)
    alone, _, _ = run(program, surfaces, *stroke)
    np.testing.assert_allclose(both - alone, expected, atol=1e-6)
    silent, _, _ = run(program, np.full(n, 2.0), *rest, taps)
    assert not silent.any()


@needs_compiler
def test_many_taps_stay_within_the_state_and_the_output_limit(tmp_path):
    scene = make_scene(["both"], 2000.0)
    n = 2000
    samples, _, _ = run(
        build(tmp_path, scene, TAPS), np.zeros(n), np.zeros((n, 2)), np.zeros(n), np.full(n, 50.0)
    )
    assert np.isfinite(samples).all()
    assert np.abs(samples).max() == scene.largest_output


@needs_compiler
@pytest.mark.parametrize("surface", ["a*/b", "int", "größe 7", "3M", "texclass", "\\", "/*"])
def test_any_surface_name_becomes_a_valid_and_unique_name(surface, tmp_path):
    model = MODELS["one node"]
    scene = replace(
        make_scene(["one node"]), model_indices={surface: 0, surface + " ": 0, "x": 0}, models=(model,)
    )
    path = make_path(scene, 600)
    samples, _, _ = run(build(tmp_path, replace(scene, name=surface)), *path)
    expected = render_in_python(scene, *path)
    assert np.abs(samples - expected).max() <= 1e-9 * np.abs(expected).max()
    text = c_header(scene, surface)
    assert "texclass_scene texclass_scene" not in text
    constants = re.findall(r"(\w+) = \d", re.search("enum {.*}", text)[0])
    assert len(set(constants)) == 4


@needs_compiler
def test_the_program_on_the_page_compiles_and_renders(tmp_path):
    page = (Path(__file__).parents[3] / "docs/textures.md").read_text(encoding="utf-8")
    (tmp_path / "main.c").write_text(re.search(r"```c main.c\n(.*?)```", page, re.S)[1])
    scene = make_scene(["lattice"])
    write_c_header(tmp_path / "fabric.h", scene)
    compile_c([tmp_path / "main.c", "-o", tmp_path / "main"])
    printed = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout.split()
    renderer = SceneRenderer(scene)
    renderer.touch(0, "lattice")
    expected = [renderer.step(0, 120.0, 0.0, 1.0) for _ in range(1000)]
    np.testing.assert_allclose(np.array(printed, float), expected, rtol=1e-5, atol=1e-5)
    assert f"at most\n  {size_in_header()} bytes" in page


def test_the_page_states_the_measured_times():
    root = Path(__file__).parents[3]
    study = json.loads((root / "reports/studies/c_renderer.json").read_text(encoding="utf-8"))
    times = {(row["order"], row["lines"]): round(row["c"]) for row in study["rows"]}
    page = " ".join((root / "docs/textures.md").read_text(encoding="utf-8").split())
    assert f"{times[8, 0]} ns with a model of order 8, and {times[100, 0]} ns with order 100" in page


def test_names_of_header_files_are_checked(tmp_path):
    scene = make_scene(["one node"])
    for name, match in (("scene.c", r"\.h"), (RENDERER, "name of the renderer itself")):
        with pytest.raises(ValueError, match=match):
            write_c_header(tmp_path / name, scene)


def test_constants_of_the_header_are_those_of_python():
    text = files("texclass.haptics.scene").joinpath("c", RENDERER).read_text()
    constants = dict(re.findall(r"#define TEXCLASS_(MAX_INPUT|MAX_REFLECTION|PI) +([0-9.e]+)", text))
    assert {name: float(value) for name, value in constants.items()} == {
        "MAX_INPUT": MAX_INPUT, "MAX_REFLECTION": MAX_REFLECTION, "PI": np.pi,
    }  # fmt: skip
    includes = re.findall(r"#include <(.*)>", text)
    assert includes == ["math.h", "stdint.h", "string.h"]


def test_the_pages_state_the_input_bound():
    root = Path(__file__).parents[3]
    for page in ("scene", "textures"):
        assert f"above {MAX_INPUT:.0e}".replace("+0", "") in (root / f"docs/{page}.md").read_text("utf-8")
