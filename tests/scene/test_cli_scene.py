"""texclass scene: plan, then render, as a user would."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from texclass.cli import app
from texclass.exchange import read_wav

pytestmark = pytest.mark.usefixtures("few")

SCENE = """
[device]
rate_hz = 1000
band_hz = [20, 450]
noise_floor = 0.05
largest_output = 30
[expected]
speeds_mm_s = [80, 120]
forces_n = [1, 1]
[tolerance]
score = "gfc"
limit = {limit}
[budget]
microseconds = 1e6
bytes = 1000000
contacts = 1
[surfaces.fabric]
simulated = "abdulali2016/S4"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "desk.toml").write_text(SCENE.format(limit=0.9))
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(app, ["scene", *arguments])


def test_a_scene_is_planned_written_and_played(folder):
    planned = run("plan", "desk.toml", "--json", "desk.json")
    assert planned.exit_code == 0, planned.output
    assert "times fewer" in planned.output
    assert json.loads((folder / "desk.json").read_text())["surfaces"][0]["surface"] == "fabric"
    rows = ["time,x,y,force,surface", "0,0,0,1,fabric", "0.5,50,0,1,", "1,100,0,1,"]
    (folder / "path.csv").write_text("\n".join(rows))
    played = run("render", "desk.texture", "path.csv", "--out", "desk.wav")
    assert played.exit_code == 0, played.output
    assert "one sample a call" in played.output
    wav = read_wav(folder / "desk.wav")
    assert (wav.fs, wav.unit, wav.samples.size) == (1000.0, "m/s^2", 1000)
    assert np.abs(wav.samples[100:500]).max() > 0
    assert not wav.samples[600:].any()


def test_exit_code_is_1_where_the_tolerance_is_not_met(folder):
    (folder / "desk.toml").write_text(SCENE.format(limit=0.9999))
    found = run("plan", "desk.toml")
    assert found.exit_code == 1
    assert "outside the tolerance: fabric" in found.output


def test_a_bad_scene_is_one_clear_error(folder):
    (folder / "desk.toml").write_text(SCENE.format(limit=2))
    found = run("plan", "desk.toml")
    assert isinstance(found.exception, ValueError)
    assert "limit is 2" in str(found.exception)
