import json

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from typer.testing import CliRunner

from texclass.cli import app
from texclass.haptics.exchange import load_taps, load_texture, read_hatt, read_wav, save_texture, write_hatt
from texclass.haptics.scene import PlannedScene, SceneSurface, load_scene
from texclass.haptics.textures import GridModel
from texclass.haptics.textures.oeztuerk2018 import LpcTexture
from texclass.haptics.textures.okamura2001 import TapLibrary
from texclass.vibration import Autoregression, TapModel


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_converting_to_and_from_hatt_keeps_every_bit(slate, tmp_path):
    first, middle, last = (tmp_path / name for name in ("a.xml", "b.texture", "c.xml"))
    write_hatt(slate, first)
    assert run("convert", first, "-o", middle).exit_code == 0
    result = run("convert", middle, "-o", last)
    assert result.exit_code == 0
    assert f"wrote {last}, {last.stat().st_size} bytes" in result.output
    assert last.read_bytes() == first.read_bytes()
    assert_array_equal(load_texture(middle).ar_lsf, slate.ar_lsf)


def test_convert_changes_the_rate_and_order_of_a_texture(tmp_path):
    rng = np.random.default_rng(0)
    texture = LpcTexture(
        [50.0, 90.0], Autoregression(rng.uniform(-0.3, 0.3, (2, 60)), [1.0, 2.0]), 5.0, 4000.0
    )
    save_texture(texture, tmp_path / "a.texture")
    assert (
        run("convert", tmp_path / "a.texture", "-o", tmp_path / "a.xml", "--fs", 2000, "--order", 9).exit_code
        == 0
    )
    converted = read_hatt(tmp_path / "a.xml")
    assert (converted.fs, converted.order) == (2000.0, 9)


def test_the_texture_command_shows_the_properties_of_a_file(slate, tmp_path):
    path = save_texture(slate, tmp_path / "a.texture")
    result = run("texture", path, "--json", tmp_path / "a.json")
    assert result.exit_code == 0
    limits = "speed (mm/s) 40 to 160, force (N) 0.5 to 3"
    for words in ("hatt", "slate & chalk", "m/s^2", "triangles", limits, str(path.stat().st_size)):
        assert words in result.output
    properties = json.loads((tmp_path / "a.json").read_text())
    expected = ("hatt", 4, 1000.0, "m/s^2")
    assert tuple(properties[key] for key in ("family", "order", "fs", "unit")) == expected
    assert properties["range"] == {"speed (mm/s)": [40.0, 160.0], "force (N)": [0.5, 3.0]}
    assert properties["points"] == {"speed": slate.mesh.speed.size, "triangles": len(slate.mesh.triangles)}


def test_convert_writes_a_c_header_next_to_its_renderer(tmp_path):
    library = TapLibrary(("wood", "steel"), (TapModel(300.0, 80.0, 155.0), TapModel(800.0, 40.0, 600.0)))
    save_texture(library, tmp_path / "taps.texture")
    result = run("convert", tmp_path / "taps.texture", "-o", tmp_path / "taps.h")
    assert result.exit_code == 0, result.output
    text = (tmp_path / "taps.h").read_text()
    assert "TAPS_WOOD = 0, TAPS_STEEL = 1" in text
    assert "Losses" not in result.output
    for name in ("taps.h", "texclass_render.h"):
        assert f"wrote {tmp_path / name}" in result.output.replace("\n", "")
    result = run("convert", tmp_path / "taps.texture", "-o", tmp_path / "texclass_render.h")
    assert isinstance(result.exception, ValueError)


def test_unsupported_formats_are_refused(tmp_path):
    for source, target in (("a.texture", "b.mp3"), ("a.xml", "b.xml"), ("a.wav", "b.texture")):
        result = run("convert", tmp_path / source, "-o", tmp_path / target)
        assert isinstance(result.exception, ValueError)
        assert "Expected" in str(result.exception)


@pytest.mark.parametrize("kind", ["hjif", "ahap", "wav"])
def test_a_surface_is_converted_to_other_formats_and_back_and_losses_are_shown(slate, tmp_path, kind):
    write_hatt(slate, tmp_path / "a.xml")
    target = tmp_path / f"a.{kind}"
    result = run("convert", tmp_path / "a.xml", "-o", target, "--speed", 90, "--duration", 0.5)
    assert result.exit_code == 0, result.output
    assert f"wrote {target}, {target.stat().st_size} bytes" in result.output
    assert "fixed at 90 mm/s" in " ".join(result.output.split())
    if kind != "wav":
        assert run("convert", target, "-o", tmp_path / "b.wav", "--physical").exit_code == 0
        vibration = read_wav(tmp_path / "b.wav")
        assert vibration.unit == ("arbitrary" if kind == "ahap" else "m/s^2")
        assert abs(vibration.samples.shape[0] / vibration.fs - 0.5) < 0.01
    result = run("convert", target, "-o", tmp_path / "b.texture")
    if kind in ("ahap", "wav"):
        assert "Expected" in str(result.exception)
    else:
        assert "AR model of order 30" in result.output
        assert load_texture(tmp_path / "b.texture").mu == pytest.approx(0.25, abs=0.005)


def test_a_surface_of_a_scene_is_selected_by_its_name(tmp_path):
    grid = GridModel(([50.0, 200.0], [1.0]), np.full((2, 1, 1), 0.5), np.array([[1.0], [4.0]]), 5.0)
    scene = PlannedScene("desk", 1000.0, "m/s^2", (20.0, 400.0), 30.0, 1, {"wood": 0, "felt": 0}, (grid,))
    path = scene.save(tmp_path / "desk.texture")
    assert "one of felt, wood" in str(run("convert", path, "-o", tmp_path / "a.hjif").exception)
    result = run("convert", path, "-o", tmp_path / "a.hjif", "--surface", "felt")
    assert result.exit_code == 0, result.output
    assert "50 to 200 mm/s change the level by -" in result.output
    renderer = SceneSurface(load_scene(path), "felt").renderer(seed=1)
    still, moving = np.zeros((500, 2)), np.tile([0.0, 100.0], (500, 1))
    assert not renderer.process(still, np.zeros(500)).any()
    assert renderer.process(moving, np.ones(500)).std() > 0.3


def test_one_material_of_a_tap_library_can_be_selected_and_taps_are_converted_back(tmp_path):
    taps = TapLibrary(("wood", "steel"), (TapModel(300.0, 80.0, 155.0), TapModel(800.0, 40.0, 600.0)))
    path = save_texture(taps, tmp_path / "taps.texture")
    for words, n in (((), 2), (("--surface", "steel"), 1)):
        assert run("convert", path, "-o", tmp_path / "a.ahap", *words).exit_code == 0
        assert len(json.loads((tmp_path / "a.ahap").read_text())["Pattern"]) == n
        assert run("convert", path, "-o", tmp_path / "a.hjif", *words).exit_code == 0
        assert run("convert", tmp_path / "a.hjif", "-o", tmp_path / "b.texture").exit_code == 0
        assert len(load_taps(tmp_path / "b.texture")) == n
