"""texclass scene: plan, then render, as a user would."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from texclass.cli import app
from texclass.exchange import read_wav

pytestmark = pytest.mark.usefixtures("few")


def run(*arguments):
    return CliRunner().invoke(app, ["scene", *map(str, arguments)])


def test_a_scene_is_planned_written_and_played(toml, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    planned = run("plan", toml(("limit = 4", "limit = 6")), "--json", "plan.json", "--report", "page")
    assert planned.exit_code == 0, planned.output
    assert "times fewer" in planned.output
    assert json.loads((tmp_path / "plan.json").read_text())["surfaces"][0]["surface"] == "wood"
    assert "![What the speed does to wood" in (tmp_path / "page/scene.md").read_text()
    assert (tmp_path / "page/scene-speed-wood.png").is_file()
    rows = ["time,x,y,force,surface", "0,0,0,1,wood", "0.5,50,0,1,", "1,100,0,1,"]
    (tmp_path / "path.csv").write_text("\n".join(rows))
    played = run("render", "scene.texture", "path.csv", "--physical", "--output", "scene.wav")
    assert played.exit_code == 0, played.output
    assert "one sample a call" in played.output
    wav = read_wav(tmp_path / "scene.wav")
    assert (wav.fs, wav.unit, wav.samples.size) == (1000.0, "m/s^2", 1000)
    assert np.abs(wav.samples[100:500]).max() > 0
    assert not wav.samples[600:].any()
    played = run("render", "scene.texture", "path.csv", "--output", "heard.wav", "--shift", 200)
    assert played.exit_code == 0, played.output
    heard = read_wav(tmp_path / "heard.wav")
    assert (heard.fs, heard.samples.size, heard.shift_hz) == (48_000.0, 48_000, 200.0)
    assert f"full scale is {heard.peak:.4g} m/s^2, gain {1 / heard.peak:.4g}" in played.output
    powers = [np.mean(x**2) for x in (wav.samples[100:500], heard.samples[4800:24000])]
    assert powers[1] == pytest.approx(powers[0], rel=0.1)


def test_what_is_not_met_is_exit_code_1_and_a_bad_scene_one_clear_error(toml, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = run("plan", toml(("limit = 4", "limit = 0.01")))
    assert found.exit_code == 1
    assert "outside the tolerance: wood" in found.output
    found = run("plan", toml(("limit = 4", "limit = -2")))
    assert isinstance(found.exception, ValueError)
    assert "limit is -2" in str(found.exception)
