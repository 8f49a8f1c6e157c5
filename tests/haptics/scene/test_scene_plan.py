"""A plan has the cheapest models within the tolerance on the test set, and can be saved and rendered."""

import itertools
import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from texclass.cli import app
from texclass.haptics.exchange import read_wav, save_texture
from texclass.haptics.scene import (
    Device,
    MotionRange,
    PlannedScene,
    default_path,
    load_scene,
    measurement,
    plan_scene,
    read_path,
    render_path,
)
from texclass.haptics.scene.plan import extend_to_lowest, grid_nodes
from texclass.haptics.scene.surface_spectra import OperatingPoints, SurfaceSpectra
from texclass.haptics.textures.grid import GridModel
from texclass.haptics.textures.hatt import HattTexture

pytestmark = pytest.mark.usefixtures("small_search")


def write_texture(folder, name, variance=1.0, lsf=(0.6, 1.1)):
    """Save an AR(2) texture, equal at all speeds and forces but for its variance; return its TOML table."""
    speed, force = (grid.ravel() for grid in np.meshgrid([20.0, 200.0], [0.5, 2.0]))
    models = np.tile(lsf, (4, 1)), np.full((2, 2), variance).ravel()
    save_texture(
        HattTexture.from_models(speed, force, *models, 1000.0, name=name), folder / f"{name}.texture"
    )
    return f'[surfaces.{name}]\ntexture = "{name}.texture"\n'


@pytest.fixture
def plan(scene, tmp_path):
    loud, twin = write_texture(tmp_path, "loud"), write_texture(tmp_path, "twin", 1.1)
    other, weak = write_texture(tmp_path, "other", lsf=(2.0, 2.4)), write_texture(tmp_path, "weak", 1e-8)
    return plan_scene(scene(surfaces=loud + twin + other + weak))


def test_a_plan_selects_and_shares_the_cheapest_models(plan):
    planned = {surface.name: surface for surface in plan.surfaces}
    assert plan.is_feasible
    assert planned["other"].model.order in (1, 2)
    assert planned["other"].model.n_nodes == (1, 1)
    assert all(surface.score["within_tolerance"] for surface in plan.surfaces)
    assert planned["weak"].model.kind == "silence"  # below the noise of the device
    indices = plan.scene.model_indices
    assert indices["loud"] == indices["twin"]  # equal within the tolerance
    assert len({indices[name] for name in ("loud", "other", "weak")}) == 3
    assert sum(surface.shared_from is not None for surface in plan.surfaces) == 1
    match = re.match(r"best with fewer operations: ([0-9.]+) of the tolerance", planned["other"].reason)
    assert float(match[1]) > 0.9  # cheaper models exceed the margin
    assert "larger margins exceeded" not in planned["other"].reason


def test_a_plan_reports_saving_budget_and_surfaces_as_json(plan):
    content = json.loads(plan.to_json())
    measured = content["measurement"]
    ratio = content["operations_at_order_400"] / content["operations_per_sample"]
    assert content["saving"] == pytest.approx(ratio)
    assert content["saving"] > 20
    assert measured["within_budget"]
    assert 0 < measured["microseconds"]["p50"] <= measured["microseconds"]["p999"]
    assert measured["bytes"] > content["bytes"]
    assert [row["surface"] for row in content["surfaces"]] == ["loud", "twin", "other", "weak"]


def test_a_saved_scene_renders_the_same_samples(plan, tmp_path):
    loaded = load_scene(plan.scene.save(tmp_path / "scene.texture"))
    assert loaded.parameters() == plan.scene.parameters()
    path = default_path(loaded)
    assert set(path.surfaces) == set(plan.scene.model_indices)
    original, copy = (render_path(scene, path, seed=2) for scene in (plan.scene, loaded))
    np.testing.assert_array_equal(original.samples, copy.samples)
    assert np.isfinite(original.samples).all()
    assert original.microseconds["worst"] > 0


def test_the_speed_dependence_is_preserved_and_reported_and_fewer_nodes_exceed_the_margin(scene, tmp_path):
    louder = write_texture(tmp_path, "louder", np.array([0.1, 100.0]))  # level proportional to the speed
    (planned,) = plan_scene(scene(("limit = 4", "limit = 2.2"), surfaces=louder)).surfaces
    match = re.search(r"with fewer nodes: ([0-9.]+); margin ([0-9.]+), since", planned.reason)
    assert float(match[1]) > float(match[2])
    plan = plan_scene(scene(("limit = 4", 'limit = 4\naggregate = "mean"'), surfaces=louder))
    (surface,) = json.loads(plan.to_json())["surfaces"]
    assert max(map(abs, surface["slope_errors_db"])) < 1.5
    dependence = surface["speed_dependence"]
    error = np.subtract(dependence["test"]["model_level"], dependence["test"]["level"])
    np.testing.assert_allclose(error, surface["level_errors_db"], atol=0.11)
    low, middle, high = np.array(dependence["curve"]["level"])
    slope = np.polyfit(np.log2(dependence["curve"]["speed"]), middle, 1)[0]
    assert slope == pytest.approx(dependence["slopes_db"][0], abs=1.5)
    assert slope > 2.5
    np.testing.assert_allclose(low, high, atol=1.5)  # independent of the force
    *_, figure = plan.document().blocks
    assert f"the level rises by {dependence['slopes_db'][0]:.1f} dB" in figure.summary
    for width in (9.2, 4.4):
        assert len(figure.draw(width).axes) == 2
    assert list(figure.table.frame["mm/s"]) == [f"{v:.0f}" for v in dependence["test"]["speed"]]


def test_a_model_of_one_force_does_not_fade_out_within_the_motion_range():
    model = GridModel(([60.0, 120.0], [1.0]), np.full((2, 1, 1), 0.5), np.ones((2, 1)), 4.0)
    motion = MotionRange(speeds_mm_s=(60, 120), forces_n=(0.4, 2.0))
    points = OperatingPoints(np.zeros((2, 1)), np.array([90.0, 90.0]), np.array([0.4, 2.0]))
    device = Device(rate_hz=1000.0, band_hz=(20.0, 450.0), noise_floor=0.01, largest_output=50.0)
    soft, hard = measurement.render_points(extend_to_lowest(model, motion), points, device).std(axis=1)
    assert soft == pytest.approx(hard, rel=0.1)
    faded, _ = measurement.render_points(model, points, device).std(axis=1)
    assert faded == pytest.approx(0.4 * hard, rel=0.1)


def test_invalid_scenes_textures_and_paths_are_rejected(tmp_path):
    model = GridModel(([50.0], [1.0]), [[[0.5]]], [[1.0]], 1.0)
    valid = PlannedScene("s", 1000.0, "m/s^2", (20.0, 450.0), 5.0, 1, {"a": 0}, (model,))
    parameters, arrays = valid.parameters(), valid.arrays()
    assert PlannedScene.restore(parameters, arrays).parameters() == parameters
    for change in (
        {"models": [parameters["models"][0] | {"peak": -1.0}]},
        {"models": [parameters["models"][0] | {"scale": "root"}]},
        {"models": [{"peak": 1}]},
        {"models": "all"},
        {"model_indices": {"a": 7}},
        {"model_indices": {}},
        {"contacts": -1},
        {"contacts": 10**30},
        {"largest_output": 0},
        {"band_hz": [20, 900]},
    ):
        with pytest.raises(ValueError, match=r"scene: .*(must (be|have|increase)|Expected a parameter)"):
            PlannedScene.restore(parameters | change, arrays)
    write_texture(tmp_path, "loud")
    with pytest.raises(ValueError, match=r"contains an object of the family 'hatt'. Expected one of scene"):
        load_scene(tmp_path / "loud.texture")
    (tmp_path / "path.csv").write_text("time,x,y,force,surface\n0,0,0,1,ice\n1,50,0,1,ice\n")
    with pytest.raises(ValueError, match=r"surface must be one of a, got 'ice'"):
        render_path(valid, read_path(tmp_path / "path.csv"))


def test_the_time_of_each_sample_is_the_minimum_over_several_runs(scene, tmp_path, monkeypatch):
    runs = itertools.count()

    def interrupted_steps(renderer, names, speeds, forces, n):
        return 1000.0 * (1 + np.arange(n)) + 1e9 * (np.arange(n) % 3 == next(runs) % 3)

    monkeypatch.setattr(measurement, "time_steps", interrupted_steps)
    model = GridModel(([50.0], [1.0]), [[[0.5]]], [[1.0]], 1.0)
    planned = PlannedScene("s", 1000.0, "m/s^2", (20.0, 450.0), 5.0, 2, {"a": 0}, (model,))
    result = measurement.measure_scene(planned, scene(surfaces=write_texture(tmp_path, "loud")))
    settings = measurement.MEASUREMENT
    assert result["microseconds_per_surface"] == {"a": pytest.approx((1 + settings.n_surface_samples) / 2)}
    assert result["microseconds"]["worst"] == settings.n_samples
    assert result["microseconds"]["p50"] == pytest.approx((1 + settings.n_samples) / 2)


def test_nodes_cover_the_overlap_of_motion_range_and_fitting_set():
    points = OperatingPoints(np.ones((2, 1)), np.array([40.0, 160.0]), np.array([0.5, 2.0]))
    spectra = SurfaceSpectra("surface", points, points, points, 1.0, "")
    for speeds, forces, ends in (
        ((60.0, 120.0), (0.1, 9.0), ([60, 120], [0.5, 2])),
        ((10.0, 900.0), (0.8, 1.2), ([40, 160], [0.8, 1.2])),
        ((400.0, 900.0), (0.01, 0.1), ([80], [1])),
    ):
        motion = MotionRange(speeds_mm_s=speeds, forces_n=forces)
        nodes = grid_nodes(spectra, motion, (2, 2))
        assert [axis.tolist() for axis in nodes] == [pytest.approx(end) for end in ends]


def test_recordings_are_scored_on_windows_and_speeds_outside_the_fitting_set(tmp_path, scene):
    rng, n = np.random.default_rng(0), 20_000
    speed = 90 + 25 * np.sin(np.arange(n) / 3000)
    table = np.column_stack([rng.standard_normal(n) * speed / 90, speed, np.full(n, 1.0)])
    np.savetxt(tmp_path / "free.csv", table, delimiter=",", header="acceleration,speed,force", comments="")
    freehand = '{file = "free.csv", column = "acceleration", speed = "speed", force = "force", fs_hz = 1000}'
    rows = []
    for v in (60, 85, 120):
        x = rng.standard_normal(6000) * v / 85
        np.savetxt(tmp_path / f"{v}.csv", x, header="acceleration", comments="")
        rows.append(f'{{file = "{v}.csv", speed = {v}, force = 1, fs_hz = 1000}}')
    surfaces = (
        f"[surfaces.free]\nrecordings = [{freehand}]\n[surfaces.plate]\nrecordings = [{', '.join(rows)}]\n"
    )
    plan = plan_scene(scene(surfaces=f"{surfaces}friction = 2.0\n"))
    assert plan.is_feasible
    assert [surface.test_set for surface in plan.surfaces] == [
        "window 4 of every 4, 0.51 s each", "second half at 85 mm/s"
    ]  # fmt: skip
    assert plan.surfaces[0].model.order <= 2


def run_scene(*arguments):
    return CliRunner().invoke(app, ["scene", *map(str, arguments)])


def test_a_scene_is_planned_saved_and_rendered(toml, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    planned = run_scene("plan", toml(("limit = 4", "limit = 6")), "--json", "plan.json", "--report", "page")
    assert planned.exit_code == 0, planned.output
    assert "times fewer" in planned.output
    assert json.loads((tmp_path / "plan.json").read_text())["surfaces"][0]["surface"] == "wood"
    assert "![Effect of speed on wood" in (tmp_path / "page/scene.md").read_text()
    assert (tmp_path / "page/scene-speed-wood.png").is_file()
    rows = ["time,x,y,force,surface", "0,0,0,1,wood", "0.5,50,0,1,", "1,100,0,1,"]
    (tmp_path / "path.csv").write_text("\n".join(rows))
    rendered = run_scene("render", "scene.texture", "path.csv", "--physical", "--output", "scene.wav")
    assert rendered.exit_code == 0, rendered.output
    assert "one sample per call" in rendered.output
    wav = read_wav(tmp_path / "scene.wav")
    assert (wav.fs, wav.unit, wav.samples.size) == (1000.0, "m/s^2", 1000)
    assert np.abs(wav.samples[100:500]).max() > 0
    assert not wav.samples[600:].any()
    rendered = run_scene("render", "scene.texture", "path.csv", "--output", "audible.wav", "--shift", 200)
    assert rendered.exit_code == 0, rendered.output
    audible = read_wav(tmp_path / "audible.wav")
    assert (audible.fs, audible.samples.size, audible.shift_hz) == (48_000.0, 48_000, 200.0)
    assert f"full scale is {audible.peak:.4g} m/s^2, gain {1 / audible.peak:.4g}" in rendered.output
    powers = [np.mean(x**2) for x in (wav.samples[100:500], audible.samples[4800:24000])]
    assert powers[1] == pytest.approx(powers[0], rel=0.1)


def test_an_infeasible_plan_has_exit_code_1_and_an_invalid_scene_one_clear_error(toml, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    limits = ("limit = 4", "limit = 0.01"), ("1_000_000", "10")
    result = run_scene("plan", toml(*limits, surfaces=write_texture(tmp_path, "loud")), "--json", "plan.json")
    assert result.exit_code == 1
    output = " ".join(result.output.split())
    for note in ("outside the tolerance: loud", "budget 10: NOT met", "one contact on each surface: loud"):
        assert note in output
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert not plan["measurement"]["within_budget"]
    assert plan["surfaces"][0]["reason"].endswith("no model is within the tolerance on the test set")
    result = run_scene("plan", toml(("limit = 4", "limit = -2")))
    assert isinstance(result.exception, ValueError)
    assert "limit must be positive for log_spectral_db, got -2" in str(result.exception)
