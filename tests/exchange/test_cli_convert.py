import json

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from typer.testing import CliRunner

from texclass.cli import app
from texclass.exchange import load_texture, read_hatt, save_texture, write_hatt
from texclass.textures.oeztuerk2018 import LpcTexture
from texclass.vibration import Autoregression


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_convert_there_and_back_keeps_every_bit(slate, tmp_path):
    first, middle, last = (tmp_path / name for name in ("a.xml", "b.texture", "c.xml"))
    write_hatt(slate, first)
    assert run("convert", first, middle).exit_code == 0
    result = run("convert", middle, last)
    assert result.exit_code == 0
    assert f"wrote {last}, {last.stat().st_size} bytes" in result.output
    assert last.read_bytes() == first.read_bytes()
    assert_array_equal(load_texture(middle).ar_lsf, slate.ar_lsf)


def test_convert_brings_a_texture_to_the_rate_and_order_asked_for(tmp_path):
    rng = np.random.default_rng(0)
    texture = LpcTexture(
        [50.0, 90.0], Autoregression(rng.uniform(-0.3, 0.3, (2, 60)), [1.0, 2.0]), 5.0, 4000.0
    )
    save_texture(texture, tmp_path / "a.texture")
    assert (
        run("convert", tmp_path / "a.texture", tmp_path / "a.xml", "--fs", 2000, "--order", 9).exit_code == 0
    )
    found = read_hatt(tmp_path / "a.xml")
    assert (found.fs, found.order) == (2000.0, 9)


def test_texture_shows_what_is_inside(slate, tmp_path):
    path = save_texture(slate, tmp_path / "a.texture")
    result = run("texture", path, "--json", tmp_path / "a.json")
    assert result.exit_code == 0
    for words in ("hatt", "slate & chalk", "m/s^2", "triangles", str(path.stat().st_size)):
        assert words in result.output
    found = json.loads((tmp_path / "a.json").read_text())
    assert (found["family"], found["order"], found["fs"], found["unit"]) == ("hatt", 4, 1000.0, "m/s^2")
    assert found["points"] == {"speed": slate.mesh.speed.size, "triangles": len(slate.mesh.triangles)}


@pytest.mark.parametrize(
    ("source", "target"), [("a.texture", "b.wav"), ("a.xml", "b.xml"), ("a.wav", "b.texture")]
)
def test_other_formats_are_refused(tmp_path, source, target):
    result = run("convert", tmp_path / source, tmp_path / target)
    assert isinstance(result.exception, ValueError)
    assert "the rule is" in str(result.exception)
