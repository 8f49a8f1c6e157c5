"""A plan is the cheapest that serves, proved on what it has not seen, and survives being written down."""

import json

import numpy as np
import pytest

from texclass.exchange import save_texture
from texclass.scene import (
    PlannedScene,
    load_scene,
    plan_scene,
    play_path,
    read_path,
    read_scene,
    sweep_of,
)
from texclass.textures.grid import GridModel
from texclass.textures.hatt import HattTexture

pytestmark = pytest.mark.usefixtures("few")

FS = 1000.0
TEXT = """
[device]
rate_hz = 1000
band_hz = [20, 450]
noise_floor = 0.05
largest_output = 30
[expected]
speeds_mm_s = [60, 120]
forces_n = [0.8, 1.2]
[tolerance]
score = "{score}"
limit = {limit}
[budget]
microseconds = {microseconds}
bytes = {n_bytes}
contacts = 2
"""
LOOSE = {"score": "log_spectral_db", "limit": 4.0, "microseconds": 1e6, "n_bytes": 1_000_000}


def texture(folder, name, variance=1.0, lsf=(0.6, 1.1)):
    """An AR(2) texture, alike at all speeds and forces."""
    speed, force = (grid.ravel() for grid in np.meshgrid([20.0, 200.0], [0.5, 2.0]))
    found = HattTexture.from_models(speed, force, np.tile(lsf, (4, 1)), np.full(4, variance), FS, name=name)
    save_texture(found, folder / f"{name}.texture")
    return f'[surfaces.{name}]\ntexture = "{name}.texture"\n'


def scene(folder, *surfaces, **options):
    path = folder / "scene.toml"
    path.write_text(TEXT.format(**(LOOSE | options)) + "".join(surfaces))
    return read_scene(path)


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan")
    loud, twin = texture(folder, "loud"), texture(folder, "twin", 1.1)
    other, faint = texture(folder, "other", lsf=(2.0, 2.4)), texture(folder, "faint", 1e-8)
    return plan_scene(scene(folder, loud, twin, other, faint))


def test_the_order_of_the_surface_is_found_and_the_proof_holds(plan):
    found = {one.name: one for one in plan.surfaces}
    assert plan.met
    assert found["other"].model.order in (1, 2)
    assert found["other"].model.n_nodes == (1, 1)
    assert all(one.verdict.within for one in plan.surfaces)


def test_what_the_device_cannot_make_felt_is_silence(plan):
    assert {one.name: one for one in plan.surfaces}["faint"].model.kind == "silence"


def test_surfaces_that_do_not_differ_share_one_model(plan):
    assert plan.scene.assigned["loud"] == plan.scene.assigned["twin"]
    assert len({plan.scene.assigned[name] for name in ("loud", "other", "faint")}) == 3
    assert sum(one.shares is not None for one in plan.surfaces) == 1


def test_the_plan_says_what_it_saves_and_what_was_measured(plan):
    told = json.loads(plan.to_json())
    assert told["saving"] == pytest.approx(told["operations_at_order_400"] / told["operations_per_sample"])
    assert told["saving"] > 20
    assert told["budget"]["met"]
    assert 0 < told["budget"]["microseconds"]["p50"] <= told["budget"]["microseconds"]["p999"]
    assert told["budget"]["bytes"] > told["bytes"]
    assert [row["surface"] for row in told["surfaces"]] == ["loud", "twin", "other", "faint"]


def test_a_scene_that_is_written_down_sounds_the_same(plan, tmp_path):
    again = load_scene(plan.scene.save(tmp_path / "scene.texture"))
    assert again.parameters() == plan.scene.parameters()
    path = sweep_of(again)
    assert set(path.surface) == set(plan.scene.assigned)
    one, other = (play_path(each, path, seed=2) for each in (plan.scene, again))
    np.testing.assert_array_equal(one.samples, other.samples)
    assert np.isfinite(one.samples).all()
    assert one.timing.worst > 0


def test_a_texture_that_is_no_scene_is_refused(tmp_path):
    texture(tmp_path, "loud")
    with pytest.raises(ValueError, match="holds 'hatt'; the rule is one of scene"):
        load_scene(tmp_path / "loud.texture")


def test_a_scene_that_breaks_a_rule_is_not_restored():
    model = GridModel(([50.0], [1.0]), [[[0.5]]], [[1.0]], 1.0)
    good = PlannedScene("s", FS, "m/s^2", (20.0, 450.0), 5.0, 1, {"a": 0}, (model,))
    parameters, arrays = good.parameters(), good.arrays()
    assert PlannedScene.restore(parameters, arrays).parameters() == parameters
    for change in (
        {"models": [parameters["models"][0] | {"peak": -1.0}]},
        {"models": [parameters["models"][0] | {"scale": "root"}]},
        {"models": [{"peak": 1}]},
        {"models": "all"},
        {"assigned": {"a": 7}},
        {"assigned": {}},
        {"contacts": -1},
        {"contacts": 10**30},
        {"largest_output": 0},
        {"band_hz": [20, 900]},
    ):
        with pytest.raises(ValueError, match="rule"):
            PlannedScene.restore(parameters | change, arrays)


def test_an_impossible_tolerance_or_budget_is_told_not_hidden(tmp_path):
    hard = plan_scene(scene(tmp_path, texture(tmp_path, "loud"), limit=0.01, n_bytes=10))
    assert not hard.met
    assert not hard.surfaces[0].verdict.within
    assert not hard.proof.met
    assert hard.surfaces[0].why == "the best there is: nothing met the tolerance"


def test_recordings_with_columns_are_judged_on_pieces_that_were_not_fitted(tmp_path):
    rng, n = np.random.default_rng(0), 20_000
    speed = 90 + 25 * np.sin(np.arange(n) / 3000)
    table = np.column_stack([rng.standard_normal(n) * speed / 90, speed, np.full(n, 1.0)])
    np.savetxt(tmp_path / "free.csv", table, delimiter=",", header="acceleration,speed,force", comments="")
    recording = '{file = "free.csv", column = "acceleration", speed = "speed", force = "force", fs_hz = 1000}'
    plan = plan_scene(scene(tmp_path, f"[surfaces.free]\nrecordings = [{recording}]\n"))
    assert plan.met
    assert plan.surfaces[0].held_out == "pieces 2 and 4 of every 4, 0.51 s each"
    assert plan.surfaces[0].model.order <= 2


def test_recordings_at_known_speeds_are_judged_at_a_speed_that_was_not_fitted(tmp_path):
    rng, rows = np.random.default_rng(0), []
    for v in (60, 85, 120):
        np.savetxt(
            tmp_path / f"{v}.csv", rng.standard_normal(6000) * v / 85, header="acceleration", comments=""
        )
        rows.append(f'{{file = "{v}.csv", speed = {v}, force = 1, fs_hz = 1000}}')
    plan = plan_scene(
        scene(tmp_path, f"[surfaces.plate]\nrecordings = [{', '.join(rows)}]\nfriction = 2.0\n")
    )
    assert plan.met
    assert plan.surfaces[0].held_out == "speeds 85 mm/s"


def test_a_path_over_a_surface_that_the_scene_does_not_have_is_refused(plan, tmp_path):
    (tmp_path / "path.csv").write_text("time,x,y,force,surface\n0,0,0,1,ice\n1,50,0,1,ice\n")
    with pytest.raises(ValueError, match="surface is 'ice'; the rule is one of loud, twin"):
        play_path(plan.scene, read_path(tmp_path / "path.csv"))
